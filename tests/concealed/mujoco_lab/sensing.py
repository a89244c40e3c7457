"""What is recorded: channels, clocks and noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .hidden import Hidden
from .robots import Robot
from .world import STEP, Run

COLOURED_POLE = 0.7
HEADING_NOISE = 0.002  # rad, of a recorded pose
NOISES = ("white", "coloured", "heavy", "quantised")


@dataclass
class Setup:
    """How a case is recorded."""

    rate_hz: float
    channels: str  # 'odometry': v, omega from the wheels by nominal geometry; 'body': of the body
    pose: bool
    wheels: bool
    noise: str
    level: tuple  # noise standard deviation of v and omega, m/s and rad/s


@dataclass
class Truth:
    """Noise-free samples: what the sensors would say without noise."""

    y: np.ndarray  # (n, 2) v, omega
    wheels: np.ndarray
    pose: np.ndarray


def observe(run: Run, robot: Robot, hidden: Hidden, setup: Setup, rng) -> Truth:
    """Sample a run at the recording's rate, with the sensors' own delay, jitter and counting window (but no rounding)."""
    per = round(1.0 / setup.rate_hz / STEP)
    t = run.t[::per]
    taken = t
    if hidden.jitter > 0:
        taken = t + np.clip(rng.normal(0.0, hidden.jitter, len(t)), -0.9 / setup.rate_hz, 0.9 / setup.rate_hz)
    at = lambda when, series: np.interp(np.clip(when, 0.0, run.t[-1]), run.t, series)
    wheels = np.column_stack([at(taken, run.wheel_speed[:, i]) for i in (0, 1)])
    if hidden.counts > 0 and not hidden.counts_instant:
        angle = run.wheel_angle[::per]
        wheels = np.vstack([wheels[:1], np.diff(angle, axis=0) * setup.rate_hz])
    if setup.channels == "odometry" and max(hidden.sensor_delay) == 0.0:
        y = odometry(wheels, robot)
    else:
        v, w = run.v, run.omega
        if setup.channels == "odometry":
            v, w = odometry(run.wheel_speed, robot).T
        y = np.column_stack([at(taken - d, c) for d, c in zip(hidden.sensor_delay, (v, w))])
    pose = np.column_stack([run.x[::per], run.y[::per], run.phi[::per]])
    return Truth(y=y, wheels=wheels, pose=pose)


def odometry(wheels: np.ndarray, robot: Robot) -> np.ndarray:
    left, right = wheels[:, 0], wheels[:, 1]
    return np.column_stack([robot.radius * (left + right) / 2.0, robot.radius * (right - left) / robot.track])


def _from_odometry(y: np.ndarray, robot: Robot) -> np.ndarray:
    return np.column_stack([y[:, 0] - robot.half * y[:, 1], y[:, 0] + robot.half * y[:, 1]]) / robot.radius


def _noise(rng, kind: str, n: int, level: float) -> np.ndarray:
    if kind == "heavy":
        return level / np.sqrt(3.0) * rng.standard_t(3, n)
    e = rng.normal(0.0, level, n)
    if kind == "coloured":
        out = e.copy()
        for k in range(1, n):
            out[k] = COLOURED_POLE * out[k - 1] + np.sqrt(1.0 - COLOURED_POLE**2) * e[k]
        return out
    return e


def record(truth: Truth, commands: np.ndarray, robot: Robot, hidden: Hidden, setup: Setup, rng) -> dict[str, np.ndarray]:
    """The columns of a recording: noise, then rounding by the sensors."""
    n = len(truth.y)
    v, w = (truth.y[:, i] + _noise(rng, setup.noise, n, setup.level[i]) for i in (0, 1))
    if setup.noise == "quantised":
        v, w = (np.round(c / q) * q for c, q in ((v, setup.level[0]), (w, setup.level[1])))
    wheels = None
    consistent = setup.channels == "odometry" and max(hidden.sensor_delay) == 0.0
    if hidden.counts > 0:
        step = hidden.counts * setup.rate_hz / robot.radius
        noisy = truth.wheels + rng.normal(0.0, 0.25 * step, (n, 2))
        wheels = np.round(noisy / step) * step
        v, w = odometry(wheels, robot).T
    elif consistent:
        wheels = _from_odometry(np.column_stack([v, w]), robot)
    elif setup.wheels:
        wheels = truth.wheels + rng.normal(0.0, setup.level[0] / robot.radius, (n, 2))
    columns = {
        "t": np.arange(n) / setup.rate_hz, "v_ref": commands[:, 0], "omega_ref": commands[:, 1], "v": v, "omega": w,
    }
    if setup.pose:
        spread = (0.005 * robot.track, 0.005 * robot.track, HEADING_NOISE)
        columns |= {name: truth.pose[:, i] + rng.normal(0.0, spread[i], n) for i, name in enumerate(("x", "y", "phi"))}
    if setup.wheels:
        columns |= {"omega_left": wheels[:, 0], "omega_right": wheels[:, 1]}
    return columns
