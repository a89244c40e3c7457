"""A fit of the plain six-parameter model by output error, for the detectability of what is hidden.

The referee's own: written for the key alone. theta1 v' = v_ref - theta4 v + theta3 w^2,
theta2 w' = w_ref - theta6 w - theta5 v w (Laut 2011, A.3), with the commands held between samples.
Simulated by an exponential midpoint rule, all perturbed parameter sets at once.
"""

from __future__ import annotations

import numpy as np


def free_run(theta: np.ndarray, commands: np.ndarray, start: np.ndarray, dt: float, substeps: int = 2) -> np.ndarray:
    """Free runs for each row of `theta` (k, 6) from `start` (2,) or (k, 2); returns (n, k, 2)."""
    theta = np.atleast_2d(theta)
    h = dt / substeps
    rate_v, rate_w = theta[:, 3] / theta[:, 0], theta[:, 5] / theta[:, 1]
    ev, ew = np.exp(-rate_v * h), np.exp(-rate_w * h)
    ev2, ew2 = np.exp(-rate_v * h / 2), np.exp(-rate_w * h / 2)
    g4, g6 = 1.0 / theta[:, 3], 1.0 / theta[:, 5]
    t3, t5 = theta[:, 2], theta[:, 4]
    n = len(commands)
    out = np.empty((n, len(theta), 2))
    v = np.broadcast_to(np.asarray(start)[..., 0], len(theta)).copy()
    w = np.broadcast_to(np.asarray(start)[..., 1], len(theta)).copy()
    av, aw, bv, bw = (1 - ev2) * g4, (1 - ew2) * g6, (1 - ev) * g4, (1 - ew) * g6
    for k in range(n):
        out[k, :, 0], out[k, :, 1] = v, w
        uv, uw = commands[k]
        for _ in range(substeps):
            vm = v * ev2 + av * (uv + t3 * w * w)
            wm = w * ew2 + aw * (uw - t5 * v * w)
            v = v * ev + bv * (uv + t3 * wm * wm)
            w = w * ew + bw * (uw - t5 * vm * wm)
    return out


def _whiten(r: np.ndarray, pole: float) -> np.ndarray:
    """The innovations of `r` (n, ...) if it were noise of an AR(1) with this pole and unit variance."""
    if pole == 0.0:
        return r
    out = r.copy()
    out[1:] = (r[1:] - pole * r[:-1]) / np.sqrt(1.0 - pole**2)
    return out


def fit(y: np.ndarray, commands: np.ndarray, dt: float, guess: np.ndarray, sigma: np.ndarray, pole: float = 0.0, rounds: int = 14):
    """Best plain parameters for the noise-free `y` (n, 2) and what is left: the sum of squares in units of the noise.

    The start speeds are fitted too. Levenberg-Marquardt with a secant Jacobian. Returns (theta, misfit, residual (n, 2)).
    """
    p = np.concatenate([guess, y[0]])
    scale = np.concatenate([np.maximum(np.abs(guess), [0.02, 0.02, 0.01, 0.1, 0.05, 0.1]), np.maximum(np.abs(y[0]), sigma)])
    low = np.array([2e-3, 2e-3, -np.inf, 0.05, -np.inf, 0.05, -np.inf, -np.inf])
    damping, best = 1e-3, None

    def residuals(rows: np.ndarray) -> np.ndarray:
        with np.errstate(over="ignore", invalid="ignore"):  # a trial step may run away; it is refused below
            runs = free_run(rows[:, :6], commands, rows[:, 6:], dt)
        return _whiten((y[:, None, :] - runs) / sigma, pole)

    for _ in range(rounds):
        steps = np.diag(scale * 1e-4)
        batch = residuals(np.vstack([p, p + steps]))
        r = batch[:, 0, :].ravel()
        cost = float(r @ r)
        if not np.isfinite(cost):
            break
        jac = (batch[:, 1:, :].transpose(0, 2, 1).reshape(-1, 8) - r[:, None]) / 1e-4
        gram, slope = jac.T @ jac, jac.T @ r
        improved = False
        for _ in range(6):
            step = np.linalg.solve(gram + damping * np.diag(np.diag(gram)) + 1e-9 * np.eye(8), -slope)
            trial = np.maximum(p + step * scale, low)
            new = residuals(trial[None, :])
            with np.errstate(over="ignore"):
                value = float(np.sum(new**2))
            if np.isfinite(value) and value < cost:
                improved = True
                break
            damping = max(damping, 1e-6) * 8.0
        if not improved:
            break
        p, damping = trial, damping / 5.0
        if cost - value < 1e-4 * (1.0 + value):
            break
    r = residuals(p[None, :])[:, 0, :]
    return p[:6], float(np.sum(r**2)), r


def beyond(change: np.ndarray, commands: np.ndarray, dt: float, theta: np.ndarray, start: np.ndarray, sigma: np.ndarray, pole: float = 0.0) -> float:
    """What of a `change` (n, 2) of the noise-free signals no small change of the plain parameters can imitate, in units of the noise."""
    p = np.concatenate([theta, start])
    steps = np.maximum(np.abs(p), 0.01) * 1e-4
    rows = np.vstack([p, p + np.diag(steps)])
    runs = free_run(rows[:, :6], commands, rows[:, 6:], dt)
    jac = _whiten((runs[:, 1:, :] - runs[:, :1, :]) / sigma, pole).transpose(0, 2, 1).reshape(-1, 8) / steps
    d = _whiten(change / sigma, pole).ravel()
    left = d - jac @ np.linalg.lstsq(jac, d, rcond=None)[0]
    return float(left @ left)
