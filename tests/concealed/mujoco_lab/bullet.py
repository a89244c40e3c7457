"""A third engine: the same robots and drives in Bullet (`pip install pybullet`), for the effects that need no actuator of MuJoCo's.

Bullet's joints take torques; the speed servo, its damping and limits are written out here, joint friction is Bullet's own velocity constraint of
limited torque, contacts, masses and gravity are the engine's.
"""

from __future__ import annotations

import math

import numpy as np
import pybullet as bullet

from .hidden import Hidden
from .robots import GRAVITY, Robot
from .world import SETTLE, STEP, Run

# What of the catalogue this world can hide (names of the functions in `effects`).
CAN = (
    "coulomb", "coulomb_one", "viscous_asymmetry", "quadratic", "dead_zone", "velocity_saturation", "slew", "torque_saturation", "delay", "gain_asymmetry",
    "lateral_com", "slip", "slope", "payload", "sag", "jitter", "sensor_delay", "speed_register", "push", "dropout",
)
CASTOR, LEFT, RIGHT = -1, 0, 1


def _build(robot: Robot, hidden: Hidden) -> int:
    bullet.resetSimulation()
    bullet.setTimeStep(STEP)
    bullet.setPhysicsEngineParameter(numSolverIterations=200, solverResidualThreshold=1e-12, numSubSteps=0, contactERP=0.2, frictionERP=0.2)
    g, tilt = GRAVITY, hidden.slope
    bullet.setGravity(-g * math.sin(tilt) * math.cos(hidden.slope_heading), -g * math.sin(tilt) * math.sin(hidden.slope_heading), -g * math.cos(tilt))
    plane = bullet.createMultiBody(0, bullet.createCollisionShape(bullet.GEOM_PLANE))
    bullet.changeDynamics(plane, -1, lateralFriction=1.0)
    castor = bullet.createCollisionShape(
        bullet.GEOM_SPHERE, radius=robot.castor_radius, collisionFramePosition=[robot.castor_x - robot.com_x, -hidden.com_y, robot.castor_radius - robot.com_z]
    )
    tyre = bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=robot.radius)
    com = [robot.com_x, hidden.com_y, robot.com_z - robot.radius]
    body = bullet.createMultiBody(
        baseMass=robot.mass, baseCollisionShapeIndex=castor, basePosition=[com[0], com[1], robot.com_z],
        linkMasses=[robot.wheel_mass] * 2, linkCollisionShapeIndices=[tyre] * 2, linkVisualShapeIndices=[-1] * 2,
        linkPositions=[[-com[0], side * robot.half - com[1], -com[2]] for side in (1, -1)], linkOrientations=[[0, 0, 0, 1]] * 2,
        linkInertialFramePositions=[[0, 0, 0]] * 2, linkInertialFrameOrientations=[[0, 0, 0, 1]] * 2,
        linkParentIndices=[0, 0], linkJointTypes=[bullet.JOINT_REVOLUTE] * 2, linkJointAxis=[[0, 1, 0]] * 2,
    )
    ixy, hub = 0.6 * robot.inertia_z, 0.5 * robot.wheel_mass * robot.radius**2
    still = {"linearDamping": 0.0, "angularDamping": 0.0, "restitution": 0.0, "rollingFriction": 0.0, "spinningFriction": 0.0}
    bullet.changeDynamics(body, CASTOR, localInertiaDiagonal=[ixy, ixy, robot.inertia_z], lateralFriction=0.0, **still)
    for wheel in (LEFT, RIGHT):
        bullet.changeDynamics(
            body, wheel, localInertiaDiagonal=[hub, robot.wheel_inertia, hub], lateralFriction=hidden.mu, jointDamping=0.0, **still
        )
        # The default motor would brake; as joint friction it may brake by this torque.
        bullet.setJointMotorControl2(body, wheel, bullet.VELOCITY_CONTROL, targetVelocity=0.0, force=hidden.frictionloss[wheel])
    return body


def _torques(target, wheels, robot: Robot, hidden: Hidden, left_over: float):
    """The servo: on the wheels, or on v and omega."""
    back = [robot.damping * (1.0 + e) * w for e, w in zip(hidden.damping_error, wheels)]
    limit = hidden.force_limit or (math.inf, math.inf)
    if robot.level == "wheel":
        raw = [robot.gain_v * (left_over * (1.0 + g) * u - w) for g, u, w in zip(hidden.gain_error, target, wheels)]
        raw = [min(max(x, -m), m) for x, m in zip(raw, limit)]
    else:
        v, w = robot.radius * (wheels[0] + wheels[1]) / 2.0, robot.radius * (wheels[1] - wheels[0]) / robot.track
        force = robot.gain_v * (left_over * target[0] - v), robot.gain_w * (left_over * target[1] - w)
        force = [min(max(x, -m), m) for x, m in zip(force, limit)]
        share, turn = force[0] * robot.radius / 2.0, force[1] * robot.radius / robot.track
        raw = [share - turn, share + turn]
    return [x - d for x, d in zip(raw, back)]


def _push(body, hidden: Hidden, t: float, v: float, w: float, yaw: float, axle: list[float]) -> None:
    """Drag and pushes, at the axle."""
    fx = fy = mz = 0.0
    if hidden.drag:
        fx, mz = -hidden.drag[0] * v * abs(v), -hidden.drag[1] * w * abs(w)
    for t0, t1, px, py, pm in hidden.pushes:
        if t0 <= t < t1:
            fx, fy, mz = fx + px, fy + py, mz + pm
    if fx or fy or mz:
        c, s = math.cos(yaw), math.sin(yaw)
        bullet.applyExternalForce(body, CASTOR, [fx * c - fy * s, fx * s + fy * c, 0.0], axle, bullet.WORLD_FRAME)
        bullet.applyExternalTorque(body, CASTOR, [0.0, 0.0, mz], bullet.WORLD_FRAME)


def simulate(robot: Robot, hidden: Hidden, commands: np.ndarray, rate_hz: float) -> Run:
    """As `world.simulate`, in Bullet."""
    bullet.connect(bullet.DIRECT)
    try:
        return _simulate(_build(robot, hidden), robot, hidden, commands, rate_hz)
    finally:
        bullet.disconnect()


def _simulate(body: int, robot: Robot, hidden: Hidden, commands: np.ndarray, rate_hz: float) -> Run:
    per_sample = round(1.0 / rate_hz / STEP)
    n = per_sample * (len(commands) - 1)
    targets = hidden.setpoints(np.repeat(commands[:-1], per_sample, axis=0), STEP)
    if robot.level == "wheel":
        rim = np.column_stack([targets[:, 0] - robot.half * targets[:, 1], targets[:, 0] + robot.half * targets[:, 1]])
        targets = hidden.wheel_setpoints(rim / robot.radius, robot)
    if hidden.ctrl_limit is not None:
        targets = np.clip(targets, -np.array(hidden.ctrl_limit), np.array(hidden.ctrl_limit))
    settle, loaded = int(SETTLE / STEP), False
    out = np.empty((n + 1, 9))
    for k in range(-settle, n + 1):
        t = k * STEP
        place, quaternion = bullet.getBasePositionAndOrientation(body)
        linear, angular = bullet.getBaseVelocity(body)
        (a0, w0, *_), (a1, w1, *_) = bullet.getJointStates(body, [LEFT, RIGHT])
        yaw = bullet.getEulerFromQuaternion(quaternion)[2]
        c, s = math.cos(yaw), math.sin(yaw)
        v = linear[0] * c + linear[1] * s + angular[2] * hidden.com_y
        x, y = place[0] - robot.com_x * c + hidden.com_y * s, place[1] - robot.com_x * s - hidden.com_y * c
        if k >= 0:
            out[k] = v, angular[2], x, y, yaw, w0, w1, a0, a1
        if k == n:
            break
        target = targets[k] if k >= 0 else (0.0, 0.0)
        torques = _torques(target, (w0, w1), robot, hidden, max(1.0 - hidden.sag * max(t, 0.0), 0.1))
        bullet.setJointMotorControlArray(body, [LEFT, RIGHT], bullet.TORQUE_CONTROL, forces=torques)
        _push(body, hidden, t, v, angular[2], yaw, [x, y, place[2]])
        if hidden.payload_mass > 0 and t >= hidden.payload_time and not loaded:
            loaded, grown = True, 1.0 + hidden.payload_mass / robot.mass
            ixy = 0.6 * robot.inertia_z * grown
            bullet.changeDynamics(body, CASTOR, mass=robot.mass * grown, localInertiaDiagonal=[ixy, ixy, robot.inertia_z * grown])
        bullet.stepSimulation()
    if not np.all(np.isfinite(out)):
        raise ArithmeticError("the engine diverged")
    phi = np.unwrap(out[:, 4])
    return Run(
        t=np.arange(n + 1) * STEP, v=out[:, 0], omega=out[:, 1], x=out[:, 2] - out[0, 2], y=out[:, 3] - out[0, 3], phi=phi - phi[0],
        wheel_speed=out[:, 5:7].copy(), wheel_angle=out[:, 7:9].copy(),
    )
