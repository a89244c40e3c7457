"""Excitations: the commands a person or a test bench would drive with, one (v_ref, omega_ref) a sample."""

from __future__ import annotations

import numpy as np

KINDS = ("thesis", "one_directional", "rich", "figure_eight")


def _steps(rng, n: int, rate: float, levels, shortest: float, longest: float) -> np.ndarray:
    """Held levels, each drawn by `levels()`, for a random time between `shortest` and `longest` seconds."""
    out, k = np.zeros(n), int(rate * rng.uniform(0.3, 1.0))
    while k < n:
        hold = int(rate * rng.uniform(shortest, longest)) + 1
        out[k : k + hold] = levels()
        k += hold
    return out


def _thesis(rng, n, rate, v, w, half):
    """Steps, mostly forwards, both channels at once; now and then a stop, seldom a little backwards."""
    def forward():
        pick = rng.random()
        return 0.0 if pick < 0.08 else (-rng.uniform(0.2, 0.6) * v if pick < 0.14 else rng.uniform(0.2, 1.0) * v)

    turn = lambda: 0.0 if rng.random() < 0.25 else rng.uniform(-1.0, 1.0) * w
    return _steps(rng, n, rate, forward, 1.5, 5.0), _steps(rng, n, rate, turn, 1.2, 4.0)


def _one_directional(rng, n, rate, v, w, half):
    """Forwards only, and so that no wheel ever turns back."""
    a = _steps(rng, n, rate, lambda: rng.uniform(0.35, 1.0) * v, 1.5, 5.0)
    b = _steps(rng, n, rate, lambda: rng.uniform(-1.0, 1.0) * min(w, 0.22 * v / half), 1.2, 4.0)
    a[: int(0.5 * rate)], b[: int(2.0 * rate)] = 0.5 * v, 0.0
    return a, b


def _rich(rng, n, rate, v, w, half):
    """Steps of both signs with stops and slow sweeps, a few sines on top."""
    signed = lambda top: 0.0 if rng.random() < 0.12 else rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 0.8) * top
    a = _steps(rng, n, rate, lambda: signed(v), 0.5, 3.5)
    b = _steps(rng, n, rate, lambda: signed(w), 0.4, 3.0)
    t = np.arange(n) / rate
    for out, top in ((a, v), (b, w)):
        for _ in range(3):
            out += top * 0.06 * np.sin(2 * np.pi * rng.uniform(0.05, 1.2) * t + rng.uniform(0, 6.28))
    quiet = _steps(rng, n, rate, lambda: float(rng.random() < 0.8), 4.0, 9.0)
    return a * np.maximum(quiet, 0.0), b * np.maximum(quiet, 0.0)


def _figure_eight(rng, n, rate, v, w, half):
    """Eights of changing pace."""
    t = np.arange(n) / rate
    pace = np.cumsum(_steps(rng, n, rate, lambda: rng.uniform(0.5, 1.5), 6.0, 15.0)) / rate
    period = rng.uniform(6.0, 14.0)
    a = v * (0.6 + 0.3 * np.sin(4 * np.pi * pace / period)) * np.minimum(t / 0.5, 1.0)
    return a, w * 0.9 * np.sin(2 * np.pi * pace / period)


def drive(kind: str, rng, seconds: float, rate: float, robot) -> np.ndarray:
    """Commands (n, 2) of the given kind; a robot's set-points are rounded as its protocol would (1e-5)."""
    n = int(round(seconds * rate)) + 1
    make = {"thesis": _thesis, "one_directional": _one_directional, "rich": _rich, "figure_eight": _figure_eight}[kind]
    a, b = make(rng, n, rate, robot.v_max, robot.w_max, robot.half)
    return np.round(np.column_stack([a, b]), 5)
