"""The catalogue: how each named effect, and each cause that has no name, is hidden in the engine, and how strongly.

Strength 1 is a strong effect (diagnosis notes, section 11), 0.15 a faint one. A `Recipe` changes a `Hidden` and returns the
parameters for the key. What it needs of the robot, the drive or the channels is said in its fields.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Callable

from .robots import GRAVITY, Robot


@dataclass(frozen=True)
class Recipe:
    """One way to hide one effect."""

    effect: str | None  # name in the contract; None for a cause outside every library
    apply: Callable  # (hidden, robot, strength, rng, commands, rate) -> parameters for the key
    family: str
    form: str = "engine"  # how it is made, for the key
    level: str | None = None  # 'wheel' or 'vw' where only that servo can carry it
    castor: str | None = None
    four_wheels: bool = False
    channels: str | None = None  # 'body' or 'odometry' where only that shows it
    extras: tuple = ()  # 'pose', 'wheels': columns that must be recorded
    other_form: bool = False
    outside: str = ""


def typical(robot: Robot) -> float:
    return 0.6 * robot.v_max


def rim_torque(robot: Robot, offset: float) -> float:
    """The torque on each wheel that costs as much speed as a command offset of `offset` m/s on v."""
    wheels = 4 if robot.wheelbase > 0 else 2
    if robot.level == "wheel":
        return robot.gain_v * offset / robot.radius
    return robot.gain_v * offset * robot.radius / wheels


def body_force(robot: Robot, offset: float) -> float:
    """The force on the body that costs as much speed as a command offset of `offset` m/s."""
    wheels = 4 if robot.wheelbase > 0 else 2
    return wheels * rim_torque(robot, offset) / robot.radius


def wheel_load(robot: Robot) -> float:
    """Normal force on each driven wheel at rest."""
    if robot.wheelbase > 0:
        return robot.total_mass * GRAVITY / 4.0
    return 0.5 * (robot.mass * (1.0 - robot.com_x / robot.castor_x) + 2.0 * robot.wheel_mass) * GRAVITY


def rim_commands(robot: Robot, commands):
    return abs(commands[:, 0]) + robot.half * abs(commands[:, 1])


def coulomb(h, robot, s, rng, u, rate):
    c = rim_torque(robot, 0.12 * s * typical(robot))
    h.frictionloss = (c, c)
    return {"torque": c}


def coulomb_one(h, robot, s, rng, u, rate):
    c = rim_torque(robot, 0.2 * s * typical(robot))
    side = int(rng.integers(2))
    h.frictionloss = (c, 0.0) if side == 0 else (0.0, c)
    return {"wheel": ("left", "right")[side], "torque": c}


def stribeck(h, robot, s, rng, u, rate):
    c = rim_torque(robot, 0.08 * s * typical(robot))
    ratio, speed = rng.uniform(1.0, 4.0), rng.uniform(0.1, 0.3) * typical(robot) / robot.radius
    h.stribeck = (c, ratio, speed)
    h.frictionloss = (c, c)
    return {"torque": c, "ratio": ratio, "speed": speed * robot.radius}


def rolling(h, robot, s, rng, u, rate):
    h.rolling = rim_torque(robot, 0.12 * s * typical(robot)) / wheel_load(robot)
    return {"coefficient_m": h.rolling}


def viscous_asymmetry(h, robot, s, rng, u, rate):
    share = min(0.1 * s / 0.15, 0.8) * rng.choice([-1.0, 1.0])
    gain = robot.gain_v if robot.level == "wheel" else robot.gain_v * robot.radius**2 / 2.0
    robot.damping = max(robot.damping, 0.15 * gain)
    h.damping_error = (share, -share)
    return {"share": share}


def direction(h, robot, s, rng, u, rate):
    c = rim_torque(robot, 0.12 * s * typical(robot))
    a = rng.uniform(0.5, 0.9) * rng.choice([-1.0, 1.0])
    h.direction = (c * (1 + a), c * (1 - a))
    return {"forward": c * (1 + a), "backward": c * (1 - a)}


def quadratic(h, robot, s, rng, u, rate):
    v = typical(robot)
    cv = body_force(robot, 0.15 * s * v) / v**2
    h.drag = (cv, rng.uniform(0.0, 1.0) * cv * robot.half**3 * 2.0)
    return {"v": h.drag[0], "omega": h.drag[1]}


def dead_zone(h, robot, s, rng, u, rate):
    h.dead = 0.35 * s * typical(robot)
    return {"width": h.dead}


def dead_zone_subtracting(h, robot, s, rng, u, rate):
    h.dead_subtract = True
    return {"width": dead_zone(h, robot, 0.5 * s, rng, u, rate)["width"], "form": "subtracting"}


def velocity_saturation(h, robot, s, rng, u, rate):
    share = 1.0 - 0.4 * s
    if robot.level == "wheel":
        top = share * float(rim_commands(robot, u).max())
        h.ctrl_limit = (top / robot.radius,) * 2
        return {"limit": top}
    h.ctrl_limit = tuple(share * float(abs(u[:, i]).max()) for i in (0, 1))
    return {"v": h.ctrl_limit[0], "omega": h.ctrl_limit[1]}


def slew(h, robot, s, rng, u, rate):
    h.slew = (0.35 * typical(robot) / s, 0.35 * 0.6 * robot.w_max / s)
    return {"v_dot": h.slew[0], "omega_dot": h.slew[1]}


def torque_saturation(h, robot, s, rng, u, rate):
    share = 0.6 - 0.42 * s
    if robot.level == "wheel":
        top = share * rim_torque(robot, typical(robot))
        h.force_limit = (top, top)
        return {"torque": top}
    h.force_limit = (share * robot.gain_v * typical(robot), share * robot.gain_w * 0.6 * robot.w_max)
    return {"force": h.force_limit[0], "moment": h.force_limit[1]}


def delay(h, robot, s, rng, u, rate):
    h.delay = 0.01 + 0.24 * s
    return {"delay_s": round(h.delay, 3)}


def lag(h, robot, s, rng, u, rate):
    h.lag = 0.01 + 0.19 * s
    return {"time_constant_s": h.lag}


def integral(h, robot, s, rng, u, rate):
    h.integral = 2.5 * s
    return {"ki_per_s": h.integral}


def gain_asymmetry(h, robot, s, rng, u, rate):
    g = 0.06 * s * rng.choice([-1.0, 1.0])
    h.gain_error = (-g, g)
    return {"share": g}


def servo_asymmetry(h, robot, s, rng, u, rate):
    g = 0.25 * s * rng.choice([-1.0, 1.0])
    h.servo_error = (-g, g)
    robot.damping = max(robot.damping, 0.1 * robot.gain_v)
    return {"share": g, "form": "the whole servo gain"}


def radius_mismatch(h, robot, s, rng, u, rate):
    e = 0.03 * s * rng.choice([-1.0, 1.0])
    h.radius_error = (-e, e)
    return {"share": e}


def track_error(h, robot, s, rng, u, rate):
    h.track_error = (0.04 + 0.08 * s) * rng.choice([-1.0, 1.0])
    return {"share": h.track_error}


def lateral_com(h, robot, s, rng, u, rate):
    h.com_y = 0.3 * s * robot.half * rng.choice([-1.0, 1.0])
    return {"offset": h.com_y}


def slip(h, robot, s, rng, u, rate):
    peak = typical(robot) / robot.theta1
    share = 2.0 * wheel_load(robot) / GRAVITY / robot.total_mass
    h.mu = (0.75 - 0.5 * s) * peak / (GRAVITY * share)
    return {"mu": h.mu, "form": "Coulomb contact"}


def slip_creep(h, robot, s, rng, u, rate):
    h.impratio, h.contact_creep = 1.0, 0.02 + 0.1 * s
    return {"form": "viscous creep of the contact", "time_constant_s": h.contact_creep}


def scrub(h, robot, s, rng, u, rate):
    """Four fixed wheels slide sideways in a turn: at most mu * weight * wheelbase / 2 resists it. The wheelbase is fitted to the strength."""
    moment = 4.0 * rim_torque(robot, 0.45 * s * robot.w_max * robot.half) / robot.radius * robot.half
    weight = robot.total_mass * GRAVITY
    acceleration = (robot.v_max / robot.theta1 + robot.half * robot.w_max / robot.theta2) / GRAVITY
    h.mu, h.impratio, h.contact_creep = 1.3 * acceleration, 50.0, 0.02
    shortest = max(0.15 * robot.track, 3.0 * robot.com_z * acceleration)
    robot.wheelbase = min(max(2.0 * moment / (h.mu * weight), shortest), 0.9 * robot.track)
    return {"mu": h.mu, "wheelbase": robot.wheelbase}


def castor(h, robot, s, rng, u, rate):
    force = body_force(robot, 0.12 * s * typical(robot))
    h.castor_roll = force * robot.castor_radius
    h.castor_swivel = rng.uniform(0.2, 0.8) * force * robot.castor_trail
    return {"force": force, "swivel_torque": h.castor_swivel}


def castor_ball(h, robot, s, rng, u, rate):
    load = robot.mass * GRAVITY - 2.0 * (wheel_load(robot) - robot.wheel_mass * GRAVITY)
    h.castor_ball_mu = min(body_force(robot, 0.12 * s * typical(robot)) / max(load, 1e-9), 0.6)
    return {"mu": h.castor_ball_mu, "form": "ball that slides"}


def slope(h, robot, s, rng, u, rate):
    h.slope = min(math.asin(min(0.2 * s * typical(robot) / robot.theta1 / GRAVITY, 0.5)), 0.14)
    h.slope_heading = rng.uniform(-math.pi, math.pi)
    return {"angle_rad": h.slope, "uphill_heading_rad": h.slope_heading}


def payload(h, robot, s, rng, u, rate):
    h.payload_mass, h.payload_x = s * robot.mass, rng.uniform(0.2, 1.2) * robot.com_x
    h.payload_time = rng.uniform(0.25, 0.7) * len(u) / rate
    return {"mass": h.payload_mass, "time_s": h.payload_time}


def payload_ramp(h, robot, s, rng, u, rate):
    h.payload_ramp = rng.uniform(5.0, 12.0)
    return payload(h, robot, s, rng, u, rate) | {"form": "filled over seconds", "ramp_s": h.payload_ramp}


def sag(h, robot, s, rng, u, rate):
    h.sag = 0.15 * s * rate / len(u)
    return {"share_per_s": h.sag}


def sag_closed(h, robot, s, rng, u, rate):
    h.sag, h.sag_closed = 0.6 * s * rate / len(u), True
    gain = robot.gain_v if robot.level == "wheel" else robot.gain_v * robot.radius**2 / 2.0
    robot.damping = max(robot.damping, 0.2 * gain)
    return {"share_per_s": h.sag, "form": "the servo's whole gain"}


def backlash(h, robot, s, rng, u, rate):
    h.backlash = s * 0.04 * robot.half / robot.radius
    return {"gap_rad": h.backlash, "gap_m": h.backlash * robot.radius}


def eccentricity(h, robot, s, rng, u, rate):
    e = [0.01 + 0.03 * s, rng.uniform(0.0, 0.02) * float(rng.random() < 0.5)]
    side = int(rng.integers(2))
    h.eccentricity = tuple(e if side == 0 else e[::-1])
    h.eccentricity_phase = tuple(float(rng.uniform(0, 6.28)) for _ in range(2))
    return {"wheel": ("left", "right")[side], "share": e[0]}


def quantisation(h, robot, s, rng, u, rate):
    h.counts = (0.03 + 0.09 * s) * typical(robot) / rate
    return {"speed_step": h.counts * rate, "form": "counts differenced over one sample"}


def speed_register(h, robot, s, rng, u, rate):
    h.counts, h.counts_instant = (0.03 + 0.09 * s) * typical(robot) / rate, True
    return {"speed_step": h.counts * rate, "form": "speed register"}


def jitter(h, robot, s, rng, u, rate):
    h.jitter = (0.15 + 0.4 * s) / rate
    return {"std_s": h.jitter}


def sensor_delay(h, robot, s, rng, u, rate):
    d = 0.01 + 0.14 * s
    axis = ("both", "omega", "v")[int(rng.choice(3, p=[0.4, 0.4, 0.2]))]
    h.sensor_delay = {"both": (d, d), "omega": (0.0, d), "v": (d, 0.0)}[axis]
    return {"axis": axis, "delay_s": d}


def push(h, robot, s, rng, u, rate):
    for _ in range(1 + int(rng.integers(3))):
        t0 = rng.uniform(0.1, 0.9) * len(u) / rate
        f = body_force(robot, rng.uniform(0.3, 0.7) * (0.4 + s) * typical(robot))
        angle = rng.uniform(-3.14, 3.14)
        h.pushes.append((t0, t0 + rng.uniform(0.3, 1.2), f * math.cos(angle), 0.3 * f * math.sin(angle), 0.7 * f * math.sin(angle) * robot.half))
    return {}


def dropout(h, robot, s, rng, u, rate):
    for _ in range(2 + int(rng.integers(5))):
        t0 = rng.uniform(0.05, 0.95) * len(u) / rate
        h.dropouts.append((t0, t0 + rng.uniform(0.3, 0.5 + 1.5 * s)))
    return {}


def carpet(h, robot, s, rng, u, rate):
    f = body_force(robot, 0.25 * s * typical(robot))
    h.carpet = (f, 0.3 * f * robot.half)
    return {}


def flexible(h, robot, s, rng, u, rate):
    inertia = robot.wheel_inertia - 0.5 * robot.wheel_mass * robot.radius**2
    h.coupling = (2 * math.pi * (3.0 - 1.8 * s)) ** 2 * inertia * 4.0
    h.coupling_damping = 0.1 * math.sqrt(h.coupling * inertia)
    return {}


def cogging(h, robot, s, rng, u, rate):
    h.cogging = (rim_torque(robot, 0.25 * s * typical(robot)), float(rng.integers(2, 7)))
    return {"order": h.cogging[1]}


def swinging(h, robot, s, rng, u, rate):
    h.pendulum = (0.15 + 0.35 * s, rng.uniform(0.8, 2.0), 0.05)
    return {}


RECIPES = [
    Recipe("coulomb_friction", coulomb, "friction"),
    Recipe("coulomb_friction_one_wheel", coulomb_one, "friction"),
    Recipe("stribeck_friction", stribeck, "friction"),
    Recipe("rolling_resistance", rolling, "friction"),
    Recipe("viscous_asymmetry", viscous_asymmetry, "asymmetry"),
    Recipe("direction_asymmetry", direction, "friction"),
    Recipe("quadratic_drag", quadratic, "drag"),
    Recipe("dead_zone", dead_zone, "dead", level="wheel"),
    Recipe("velocity_saturation", velocity_saturation, "limit"),
    Recipe("slew_limit", slew, "ramp"),
    Recipe("torque_saturation", torque_saturation, "limit"),
    Recipe("command_delay", delay, "timing"),
    Recipe("actuator_lag", lag, "timing"),
    Recipe("integral_action", integral, "integral"),
    Recipe("gain_asymmetry", gain_asymmetry, "asymmetry", level="wheel"),
    Recipe("wheel_radius_mismatch", radius_mismatch, "geometry", extras=("pose", "wheels"), form="unequal wheels"),
    Recipe("track_width_error", track_error, "geometry", extras=("pose", "wheels")),
    Recipe("lateral_com_offset", lateral_com, "mass"),
    Recipe("wheel_slip", slip, "slip", channels="body"),
    Recipe("turning_scrub", scrub, "slip", four_wheels=True),
    Recipe("castor_drag", castor, "friction", castor="swivel"),
    Recipe("slope", slope, "slope", extras=("pose",)),
    Recipe("payload_change", payload, "mass"),
    Recipe("battery_sag", sag, "sag", form="the reference's gain"),
    Recipe("backlash", backlash, "backlash"),
    Recipe("wheel_eccentricity", eccentricity, "geometry", channels="body"),
    Recipe("encoder_quantisation", quantisation, "sensing", channels="odometry", extras=("wheels",)),
    Recipe("encoder_quantisation", speed_register, "sensing", channels="odometry", extras=("wheels",)),
    Recipe("timestamp_jitter", jitter, "sensing"),
    Recipe("sensor_delay", sensor_delay, "timing"),
]
OTHER_FORMS = [
    Recipe("dead_zone", dead_zone_subtracting, "dead", level="wheel", other_form=True),
    Recipe("gain_asymmetry", servo_asymmetry, "asymmetry", level="wheel", other_form=True),
    Recipe("castor_drag", castor_ball, "friction", castor="ball", other_form=True),
    Recipe("wheel_slip", slip_creep, "slip", channels="body", other_form=True),
    Recipe("payload_change", payload_ramp, "mass", other_form=True),
    Recipe("battery_sag", sag_closed, "sag", other_form=True),
]
OUTSIDE = [
    Recipe(None, push, "push", outside="somebody pushes the robot"),
    Recipe(None, dropout, "dropout", outside="command packets are lost, the last one stays in force"),
    Recipe(None, carpet, "carpet", extras=("pose",), outside="a patch of carpet drags on the robot"),
    Recipe(None, flexible, "flexible", outside="a flexible coupling between motor and wheel"),
    Recipe(None, cogging, "cogging", outside="the motors cog: torque ripple over the wheel's turn"),
    Recipe(None, swinging, "swinging", outside="a load swings on the robot"),
]

_ALIKE_WITHOUT_REVERSAL = ("coulomb_friction", "direction_asymmetry", "stribeck_friction", "rolling_resistance")


def equivalents(effect: str, parameters: dict, reverses: bool, excitation: str, channels: str, wheels: bool) -> list[list[str]]:
    """Other names that are the same mathematics on this recording (diagnosis notes, section 6), declared with the case."""
    same: list[str] = []
    if effect in _ALIKE_WITHOUT_REVERSAL and not reverses:
        same += [e for e in _ALIKE_WITHOUT_REVERSAL if e != effect]
    if effect == "rolling_resistance":
        same.append("coulomb_friction")  # the engine's rolling friction is a torque of constant size at each wheel
    if effect == "dead_zone" and parameters.get("form") == "subtracting":
        same.append("coulomb_friction")
    timing = ["command_delay", "sensor_delay"]
    if effect in timing:
        same += [e for e in timing if e != effect]
    if excitation == "figure_eight" and effect in timing + ["actuator_lag"]:
        same += [e for e in timing + ["actuator_lag"] if e != effect]
    if effect in ("gain_asymmetry", "wheel_radius_mismatch") and channels == "body" and not wheels:
        same += [e for e in ("gain_asymmetry", "wheel_radius_mismatch") if e != effect]
    return [[e] for e in dict.fromkeys(same)]
