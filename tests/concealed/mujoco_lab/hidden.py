"""What is hidden in a robot: a record of deviations that the world builds into the engine's model or acts out in its loop."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import mujoco
import numpy as np


@dataclass
class Hidden:
    """Deviations from the nominal robot; all zero is a robot that the plain model describes."""

    # joints and wheels (left, right)
    frictionloss: tuple = (0.0, 0.0)
    damping_error: tuple = (0.0, 0.0)
    radius_error: tuple = (0.0, 0.0)
    eccentricity: tuple = (0.0, 0.0)
    eccentricity_phase: tuple = (0.0, 0.0)
    armature: float = 0.0
    backlash: float = 0.0  # rad at the wheel
    coupling: float = 0.0  # N m/rad of a flexible shaft
    coupling_damping: float = 0.0
    track_error: float = 0.0
    stribeck: tuple = ()  # (torque, ratio, speed rad/s)
    direction: tuple = ()  # (forward torque, backward torque)
    cogging: tuple = ()  # (torque, order)
    # body and floor
    com_y: float = 0.0
    slope: float = 0.0
    slope_heading: float = 0.0
    mu: float = 1.5
    impratio: float = 200.0
    contact_creep: float = 0.002  # time constant of the contact's friction, s
    noslip: int = 0
    rolling: float = 0.0  # m
    castor_roll: float = 0.0  # N m
    castor_swivel: float = 0.0
    castor_ball_mu: float = 0.0
    payload_time: float = 0.0
    payload_mass: float = 0.0
    payload_x: float = 0.0
    payload_ramp: float = 0.1
    pendulum: tuple = ()  # (share of the body's mass, frequency Hz, damping ratio)
    drag: tuple = ()  # (N s2/m2, N m s2/rad2)
    pushes: list = field(default_factory=list)  # (t0, t1, fx, fy, mz) in the robot's frame
    carpet: tuple = ()  # (drag N, scrub N m)
    carpet_tile: float = 1.0  # side of the squares, m, every other of which is carpet
    # servo
    ctrl_limit: tuple | None = None
    force_limit: tuple | None = None
    lag: float = 0.0
    integral: float = 0.0
    gain_error: tuple = (0.0, 0.0)
    servo_error: tuple = (0.0, 0.0)
    sag: float = 0.0  # share lost per second
    sag_closed: bool = False  # the servo's whole gain sags, not only its reference
    # command path
    delay: float = 0.0
    slew: tuple = ()  # (m/s2, rad/s2)
    dead: float = 0.0  # m/s at the rim
    dead_subtract: bool = False
    dropouts: list = field(default_factory=list)  # (t0, t1)
    # sensing
    counts: float = 0.0  # rim distance of one encoder count, m
    counts_instant: bool = False  # a speed register instead of differenced counts
    jitter: float = 0.0  # s
    sensor_delay: tuple = (0.0, 0.0)  # v, omega

    def setpoints(self, held: np.ndarray, step: float) -> np.ndarray:
        """The command path ahead of the wheels: queue, dropped packets, ramp limiter."""
        out = held.copy()
        for t0, t1 in self.dropouts:
            a, b = int(t0 / step), min(int(t1 / step), len(out))
            out[a:b] = out[max(a - 1, 0)]
        if self.delay > 0:
            shift = int(round(self.delay / step))
            out = np.vstack([np.zeros((shift, 2)), out[: len(out) - shift]])
        if self.slew:
            limit = np.array(self.slew) * step
            now = np.zeros(2)
            for k in range(len(out)):
                now = now + np.clip(out[k] - now, -limit, limit)
                out[k] = now
        return out

    def wheel_setpoints(self, wheels: np.ndarray, robot) -> np.ndarray:
        """The dead band of each wheel's set-point (rad/s)."""
        if self.dead <= 0:
            return wheels
        d = self.dead / robot.radius
        if self.dead_subtract:
            return np.sign(wheels) * np.maximum(np.abs(wheels) - d, 0.0)
        return np.where(np.abs(wheels) < d, 0.0, wheels)

    def forces(self, model, dofs: list[int]) -> list:
        """What acts step by step in the engine's loop: functions of (t, model, data)."""
        acting = []
        body = model.body("robot").id
        if self.stribeck:
            acting.append(_stribeck(dofs, *self.stribeck))
        if self.direction:
            acting.append(_direction(dofs, *self.direction))
        if self.cogging:
            acting.append(_cogging(model, dofs, *self.cogging))
        if self.drag or self.pushes or self.carpet:
            acting.append(_external(body, self))
        if self.payload_mass > 0:
            acting.append(_payload(model, self))
        if self.sag != 0.0:
            acting.append(_sag(model, self.sag, self.sag_closed))
        return acting


def _stribeck(dofs, torque, ratio, speed):
    def act(t, model, data):
        for i in dofs:
            model.dof_frictionloss[i] = torque * (1.0 + ratio * math.exp(-((data.qvel[i] / speed) ** 2)))

    return act


def _direction(dofs, forward, backward):
    def act(t, model, data):
        for i in dofs:
            model.dof_frictionloss[i] = forward if data.qvel[i] > 0 else backward

    return act


def _cogging(model, dofs, torque, order):
    places = [model.jnt_qposadr[model.dof_jntid[i]] for i in dofs]

    def act(t, model, data):
        for i, j in zip(dofs, places):
            data.qfrc_applied[i] = torque * math.sin(order * data.qpos[j])

    return act


def _external(body, hidden):
    drag, pushes, carpet, tile = hidden.drag, hidden.pushes, hidden.carpet, hidden.carpet_tile

    def act(t, model, data):
        q, u = data.qpos, data.qvel
        yaw = math.atan2(2.0 * (q[3] * q[6] + q[4] * q[5]), 1.0 - 2.0 * (q[5] ** 2 + q[6] ** 2))
        c, s = math.cos(yaw), math.sin(yaw)
        v, w = u[0] * c + u[1] * s, u[5]
        fx = fy = mz = 0.0
        if drag:
            fx -= drag[0] * v * abs(v)
            mz -= drag[1] * w * abs(w)
        for t0, t1, px, py, pm in pushes:
            if t0 <= t < t1:
                fx, fy, mz = fx + px, fy + py, mz + pm
        if carpet and math.floor(q[0] / tile) % 3 == 1:
            fx -= carpet[0] * math.tanh(v / 0.01)
            mz -= carpet[1] * math.tanh(w / 0.05)
        # The force acts at the axle; xfrc_applied acts at the centre of mass.
        ox, oy = data.xipos[body, 0] - q[0], data.xipos[body, 1] - q[1]
        gx, gy = fx * c - fy * s, fx * s + fy * c
        data.xfrc_applied[body, 0], data.xfrc_applied[body, 1] = gx, gy
        data.xfrc_applied[body, 5] = mz - (ox * gy - oy * gx)

    return act


def _payload(model, hidden):
    """A box put down on the robot: its mass grows over `payload_ramp` seconds from `payload_time` on."""
    box, scratch, state = model.body("payload").id, mujoco.MjData(model), {"share": 0.0}

    def act(t, model, data):
        share = min(max((t - hidden.payload_time) / hidden.payload_ramp, 0.0), 1.0)
        if share == state["share"]:
            return
        state["share"] = share
        mass = 1e-6 + share * hidden.payload_mass
        model.body_mass[box] = mass
        model.body_inertia[box] = np.full(3, 1e-9 + mass * (0.3 * abs(model.body_ipos[1, 0]) + 0.02) ** 2)
        mujoco.mj_setConst(model, scratch)

    return act


def _sag(model, rate, closed):
    gain, bias = model.actuator_gainprm[:, 0].copy(), model.actuator_biasprm[:, 2].copy()

    def act(t, model, data):
        left = max(1.0 - rate * t, 0.1)
        model.actuator_gainprm[:, 0] = gain * left
        if closed:
            model.actuator_biasprm[:, 2] = bias * left

    return act
