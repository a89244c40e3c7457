"""The world: MJCF of a robot with its hidden physics, and the run of the engine under a series of commands."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import mujoco
import numpy as np

from .hidden import Hidden
from .robots import GRAVITY, Robot

STEP = 0.001  # s of the engine
SETTLE = 0.6  # s at rest before the recording
# Contacts as stiff as the time step allows, with hardly any creep.
STIFF = 'solref="0.003 1" solimp="0.99 0.9999 0.0001"'
# Four wheels on a plane carry a load that rigid contacts leave undetermined; softer ones share it without chatter.
SOFT = 'solref="0.02 1" solimp="0.9 0.95 0.001"'


@dataclass
class Run:
    """What the engine did, at every engine step from t = 0 on (n + 1 rows), free of noise."""

    t: np.ndarray
    v: np.ndarray  # forward speed of the axle's middle
    omega: np.ndarray
    x: np.ndarray
    y: np.ndarray
    phi: np.ndarray
    wheel_speed: np.ndarray  # (n + 1, 2) left, right, at the encoder
    wheel_angle: np.ndarray


def _wheel_xml(name: str, x: float, y: float, side: int, robot: Robot, hidden: Hidden) -> str:
    """One driven wheel. With a gap or a spring between motor and wheel the motor is a body of its own."""
    radius = robot.radius * (1.0 + hidden.radius_error[side])
    ecc = hidden.eccentricity[side] * radius
    phase = hidden.eccentricity_phase[side]
    # With a gap, half of the damping (back-EMF) acts on the motor, half (bearings) on the wheel: see `_bearings_xml`.
    loss, damping = hidden.frictionloss[side], _damping(robot, hidden, side) * (0.5 if hidden.backlash > 0 else 1.0)
    motor_inertia = robot.wheel_inertia - 0.5 * robot.wheel_mass * robot.radius**2 + hidden.armature
    tyre = f'<geom name="tyre_{name}" type="sphere" size="{radius!r}" pos="{ecc * math.cos(phase)!r} 0 {ecc * math.sin(phase)!r}"/>'
    hub = 0.5 * robot.wheel_mass * robot.radius**2
    mass = f'<inertial pos="0 0 0" mass="{robot.wheel_mass!r}" diaginertia="{hub!r} {hub!r} {hub!r}"/>'
    height = 0.0 if hidden.radius_error == (0.0, 0.0) else radius - robot.radius
    split = hidden.backlash > 0 or hidden.coupling > 0
    joint = f'<joint name="{name}" axis="0 1 0" damping="{damping!r}" frictionloss="{loss!r}" armature="{0.0 if split else motor_inertia!r}"/>'
    if not split:
        return f'<body name="w_{name}" pos="{x!r} {y!r} {height!r}">{mass}{joint}{tyre}</body>'
    if hidden.backlash > 0:
        gap = hidden.backlash / 2.0
        inner = f'<joint name="gap_{name}" axis="0 1 0" limited="true" range="{-gap!r} {gap!r}" solreflimit="0.004 1" solimplimit="0.95 0.999 0.0005"/>'
    else:
        inner = f'<joint axis="0 1 0" stiffness="{hidden.coupling!r}" damping="{hidden.coupling_damping!r}"/>'
    speck = 1e-3 * robot.wheel_mass
    rotor = f'<inertial pos="0 0 0" mass="{speck!r}" diaginertia="{motor_inertia!r} {motor_inertia!r} {motor_inertia!r}"/>'
    return (
        f'<body name="m_{name}" pos="{x!r} {y!r} {height!r}">{rotor}{joint}'
        f'<body name="w_{name}">{mass}{inner}{tyre}</body></body>'
    )


def _damping(robot: Robot, hidden: Hidden, side: int) -> float:
    return robot.damping * (1.0 + hidden.damping_error[side])


def _bearings_xml(places: list[tuple], robot: Robot, hidden: Hidden) -> str:
    """Damping between chassis and wheel where motor and wheel are two bodies: a tendon over both joints."""
    if hidden.backlash <= 0:
        return ""
    return "".join(
        f'<fixed name="bearing_{n}" damping="{0.5 * _damping(robot, hidden, side)!r}">'
        f'<joint joint="{n}" coef="1"/><joint joint="gap_{n}" coef="1"/></fixed>'
        for n, _, _, side in places
    )


def _castor_xml(robot: Robot, hidden: Hidden) -> str:
    r, z = robot.castor_radius, robot.castor_radius - robot.radius
    if robot.castor == "none":
        return ""
    if robot.castor == "ball":
        return f'<geom name="castor" type="sphere" size="{r!r}" pos="{robot.castor_x!r} 0 {z!r}" mass="0"/>'
    m = 0.0005 * robot.mass
    i = 0.4 * m * r * r
    return (
        f'<body name="fork" pos="{robot.castor_x!r} 0 {z!r}"><inertial pos="{-robot.castor_trail / 2!r} 0 0" mass="{m!r}" '
        f'diaginertia="{i!r} {i!r} {i!r}"/><joint name="swivel" axis="0 0 1" frictionloss="{hidden.castor_swivel!r}" '
        f'damping="{2e-4 * robot.mass * r * r!r}"/>'
        f'<body name="castor_wheel" pos="{-robot.castor_trail!r} 0 0"><inertial pos="0 0 0" mass="{m!r}" diaginertia="{i!r} {i!r} {i!r}"/>'
        f'<joint name="castor_roll" axis="0 1 0" frictionloss="{hidden.castor_roll!r}"/>'
        f'<geom name="castor" type="sphere" size="{r!r}"/></body></body>'
    )


def _actuator_xml(names: list[str], robot: Robot, hidden: Hidden) -> tuple[str, str]:
    """Tendons and actuators: a speed servo per wheel, or one on v and one on omega through tendons; with PI where asked."""
    lag = f'dyntype="filterexact" dynprm="{hidden.lag!r}"' if hidden.lag > 0 else ""
    rows, tendons = [], ""
    if robot.level == "vw":
        left, right = names[0::2], names[1::2]
        share = robot.radius / len(names)
        turn = robot.radius / (len(left) * robot.track)
        tendons = "<fixed name='tv'>" + "".join(f'<joint joint="{n}" coef="{share!r}"/>' for n in names) + "</fixed><fixed name='tw'>"
        tendons += "".join(f'<joint joint="{n}" coef="{-turn!r}"/>' for n in left) + "".join(f'<joint joint="{n}" coef="{turn!r}"/>' for n in right)
        tendons += "</fixed>"
        axes = [("tendon", "tv", robot.gain_v, 0), ("tendon", "tw", robot.gain_w, 1)]
    else:
        axes = [("joint", n, robot.gain_v, i % 2) for i, n in enumerate(names)]
    for kind, name, gain, side in axes:
        limits = ""
        if hidden.ctrl_limit is not None:
            limits += f'ctrllimited="true" ctrlrange="{-hidden.ctrl_limit[side]!r} {hidden.ctrl_limit[side]!r}"'
        if hidden.force_limit is not None:
            limits += f' forcelimited="true" forcerange="{-hidden.force_limit[side]!r} {hidden.force_limit[side]!r}"'
        drive = gain * (1.0 + hidden.gain_error[side])
        back = gain * (1.0 + hidden.servo_error[side])
        if hidden.servo_error[side] != 0.0:
            drive = back
        rows.append(
            f'<general {kind}="{name}" {lag} gaintype="fixed" gainprm="{drive!r}" biastype="affine" biasprm="0 0 {-back!r}" {limits}/>'
        )
    for kind, name, gain, side in axes:
        if hidden.integral > 0:
            rows.append(f'<intvelocity {kind}="{name}" kp="{gain * hidden.integral!r}" actrange="-1e6 1e6"/>')
    return tendons, "<actuator>" + "".join(rows) + "</actuator>"


def _model_xml(robot: Robot, hidden: Hidden) -> tuple[str, list[str]]:
    half = robot.half * (1.0 + hidden.track_error)
    places = [("l", 0.0, half, 0), ("r", 0.0, -half, 1)]
    if robot.wheelbase > 0:
        front = robot.wheelbase / 2.0
        places = [("lf", front, half, 0), ("rf", front, -half, 1), ("lr", -front, half, 0), ("rr", -front, -half, 1)]
    names = [p[0] for p in places]
    tilt = hidden.slope
    g = GRAVITY
    gx, gy = -g * math.sin(tilt) * math.cos(hidden.slope_heading), -g * math.sin(tilt) * math.sin(hidden.slope_heading)
    wheels = "".join(_wheel_xml(n, x, y, side, robot, hidden) for n, x, y, side in places)
    tendons, actuators = _actuator_xml(names, robot, hidden)
    tendons += _bearings_xml(places, robot, hidden)
    roll = hidden.rolling
    creep = hidden.contact_creep
    contact = SOFT if robot.wheelbase > 0 else STIFF
    pairs = "".join(
        f'<pair geom1="tyre_{n}" geom2="floor" condim="{6 if roll > 0 else 3}" '
        f'friction="{hidden.mu!r} {hidden.mu!r} 1e-6 {max(roll, 1e-9)!r} {max(roll, 1e-9)!r}" {contact} solreffriction="{creep!r} 1"/>'
        for n in names
    )
    if robot.castor == "ball":
        mu = hidden.castor_ball_mu
        dims = 3 if mu > 0 else 1
        pairs += f'<pair geom1="castor" geom2="floor" condim="{dims}" friction="{max(mu, 1e-6)!r} {max(mu, 1e-6)!r} 1e-6 1e-9 1e-9" {STIFF}/>'
    elif robot.castor == "swivel":
        pairs += f'<pair geom1="castor" geom2="floor" condim="3" friction="1 1 1e-6 1e-9 1e-9" {STIFF}/>'
    ixy = 0.6 * robot.inertia_z
    box = "" if hidden.payload_mass <= 0 else (
        f'<body name="payload" pos="{hidden.payload_x!r} 0 {robot.radius * 0.6!r}">'
        f'<inertial pos="0 0 0" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/></body>'
    )
    if hidden.pendulum:
        share, hertz, ratio = hidden.pendulum
        m, arm = share * robot.mass, GRAVITY / (2 * math.pi * hertz) ** 2
        box += (
            f'<body name="load" pos="{robot.com_x!r} 0 {robot.radius + arm!r}"><joint axis="0 1 0" damping="{2 * ratio * 2 * math.pi * hertz * m * arm**2!r}"/>'
            f'<inertial pos="0 0 {-arm!r}" mass="{m!r}" diaginertia="{1e-4 * m * arm**2!r} {1e-4 * m * arm**2!r} {1e-4 * m * arm**2!r}"/></body>'
        )
    xml = (
        f'<mujoco><compiler boundmass="0" boundinertia="0" angle="radian"/>'
        f'<option timestep="{STEP}" integrator="implicitfast" cone="elliptic" impratio="{hidden.impratio!r}" solver="Newton" '
        f'tolerance="1e-12" iterations="60" noslip_iterations="{hidden.noslip}" gravity="{gx!r} {gy!r} {-g * math.cos(tilt)!r}"/>'
        f'<default><geom contype="0" conaffinity="0"/></default>'
        f'<worldbody><geom name="floor" type="plane" size="0 0 1"/>'
        f'<body name="robot" pos="0 0 {robot.radius!r}"><freejoint/>'
        f'<inertial pos="{robot.com_x!r} {hidden.com_y!r} {robot.com_z - robot.radius!r}" mass="{robot.mass!r}" '
        f'diaginertia="{ixy!r} {ixy!r} {robot.inertia_z!r}"/>'
        f"{wheels}{_castor_xml(robot, hidden)}{box}</body></worldbody>"
        f"<contact>{pairs}</contact><tendon>{tendons}</tendon>{actuators}</mujoco>"
    )
    return xml, names


def _plain(value):
    """Numpy scalars as Python floats, also within tuples, so that `repr` writes what XML reads."""
    if isinstance(value, tuple):
        return tuple(_plain(x) for x in value)
    return float(value) if isinstance(value, np.floating) else value


def _plain_fields(record):
    return replace(record, **{f.name: _plain(getattr(record, f.name)) for f in fields(record)})


def _yaw(q: np.ndarray) -> float:
    return math.atan2(2.0 * (q[0] * q[3] + q[1] * q[2]), 1.0 - 2.0 * (q[2] ** 2 + q[3] ** 2))


def simulate(robot: Robot, hidden: Hidden, commands: np.ndarray, rate_hz: float) -> Run:
    """Drive the robot by `commands` (rows of v_ref, omega_ref, each held for one sample) and return every engine step."""
    robot, hidden = _plain_fields(robot), _plain_fields(hidden)
    xml, names = _model_xml(robot, hidden)
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    per_sample = round(1.0 / rate_hz / STEP)
    n = per_sample * (len(commands) - 1)
    targets = hidden.setpoints(np.repeat(commands[:-1], per_sample, axis=0), STEP)
    if robot.level == "wheel":
        left, right = (targets[:, 0] - robot.half * targets[:, 1]) / robot.radius, (targets[:, 0] + robot.half * targets[:, 1]) / robot.radius
        targets = hidden.wheel_setpoints(np.column_stack([left, right] * (len(names) // 2)), robot)
    if hidden.integral > 0:
        targets = np.hstack([targets, targets])
    velocity = [model.joint(name).dofadr[0] for name in names]
    angle = [model.joint(name).qposadr[0] for name in names]
    acting = hidden.forces(model, velocity)
    data.ctrl[:] = 0.0
    mujoco.mj_step(model, data, int(SETTLE / STEP))
    nl, out = len(names), np.empty((n + 1, 7 + 2 * len(names)))
    qpos, qvel, ctrl = data.qpos, data.qvel, data.ctrl
    for k in range(n + 1):
        row = out[k]
        row[0:4] = qpos[0], qpos[1], qvel[0], qvel[1]
        row[4] = qvel[5]
        row[5] = _yaw(qpos[3:7])
        row[7 : 7 + nl] = qvel[velocity]
        row[7 + nl :] = qpos[angle]
        if k == n:
            break
        ctrl[:] = targets[k]
        for act in acting:
            act(k * STEP, model, data)
        mujoco.mj_step(model, data)
    if not np.all(np.isfinite(out[:, :6])) or data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number > 0:
        raise ArithmeticError("the engine diverged")
    phi = np.unwrap(out[:, 5])
    phi -= phi[0]
    heading = out[:, 5]
    wheel = lambda base, side: out[:, base + side : base + nl : 2].mean(axis=1)
    return Run(
        t=np.arange(n + 1) * STEP, v=out[:, 2] * np.cos(heading) + out[:, 3] * np.sin(heading), omega=out[:, 4].copy(),
        x=out[:, 0] - out[0, 0], y=out[:, 1] - out[0, 1], phi=phi,
        wheel_speed=np.column_stack([wheel(7, 0), wheel(7, 1)]), wheel_angle=np.column_stack([wheel(7 + nl, 0), wheel(7 + nl, 1)]),
    )
