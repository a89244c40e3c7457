"""The robots: dimensions, masses and servo gains, drawn at random around known sizes.

A `Robot` holds the nominal machine, that is, what its maker believes. What is hidden in a case is written in a `Hidden`
(module `hidden`), never here.
"""

from __future__ import annotations

from dataclasses import dataclass

GRAVITY = 9.81


@dataclass
class Robot:
    """A differential-drive (or four-wheel skid-steer) robot; SI units; x forward from the axle, y left, z up."""

    family: str
    level: str  # 'wheel': servo on each wheel's speed; 'vw': servo on v and omega
    mass: float  # body without wheels and castor
    inertia_z: float  # body, about its centre of mass
    com_x: float  # centre of mass, from the axle
    com_z: float  # above ground
    radius: float
    track: float
    wheel_mass: float
    wheel_inertia: float  # about the axle, gear and motor included
    castor: str  # 'ball', 'swivel' or 'none' (four wheels)
    castor_x: float
    castor_trail: float
    castor_radius: float
    gain_v: float  # N per m/s ('vw'), or per wheel N m per rad/s ('wheel')
    gain_w: float  # N m per rad/s ('vw' only)
    damping: float  # N m s/rad per wheel: bearings and back-EMF
    wheelbase: float  # of a four-wheel robot, else 0
    theta1: float  # nominal, for the choice of a drive
    theta2: float
    v_max: float
    w_max: float

    @property
    def half(self) -> float:
        return self.track / 2.0

    @property
    def total_mass(self) -> float:
        wheels = 4 if self.wheelbase > 0 else 2
        return self.mass + wheels * self.wheel_mass


# family: (mass, track, wheel radius, theta1, top speed), each a range
SIZES = {
    "khepera": ((0.4, 0.7), (0.05, 0.09), (0.012, 0.021), (0.04, 0.12), (0.1, 0.3)),
    "turtlebot": ((2.0, 6.5), (0.16, 0.3), (0.033, 0.038), (0.06, 0.2), (0.2, 0.5)),
    "pioneer": ((9.0, 17.0), (0.32, 0.4), (0.085, 0.11), (0.15, 0.35), (0.5, 1.0)),
    "cart": ((25.0, 50.0), (0.45, 0.65), (0.09, 0.13), (0.2, 0.45), (0.6, 1.2)),
}


def draw_robot(rng, family: str | None = None, level: str | None = None, four_wheels: bool = False) -> Robot:
    """A robot of `family` (or of any), with gains chosen for a time constant and damping typical of its size."""
    family = family or ("pioneer", "turtlebot", "cart")[int(rng.integers(3))] if four_wheels else family
    family = family or list(SIZES)[int(rng.integers(len(SIZES)))]
    mass_r, track_r, radius_r, theta1_r, v_r = SIZES[family]
    mass, track, radius = rng.uniform(*mass_r), rng.uniform(*track_r), rng.uniform(*radius_r)
    theta1, v_max = rng.uniform(*theta1_r), rng.uniform(*v_r)
    half = track / 2.0
    level = level or ("wheel" if rng.random() < 0.65 else "vw")
    gyration = rng.uniform(0.6, 1.0) * half
    length = rng.uniform(0.7, 1.0) * track  # axle to castor
    com_x = -rng.uniform(0.12, 0.3) * length
    wheelbase = rng.uniform(0.6, 0.9) * track if four_wheels else 0.0
    if four_wheels:
        com_x = rng.uniform(-0.03, 0.03) * wheelbase
    wheel_mass = 0.03 * mass
    wheel_inertia = 0.5 * wheel_mass * radius**2 + rng.uniform(0.02, 0.12) * mass * radius**2
    wheels = 4 if four_wheels else 2
    translating = mass + wheels * (wheel_mass + wheel_inertia / radius**2)
    turning = mass * (gyration**2 + com_x**2) + wheels * (wheel_mass + wheel_inertia / radius**2) * half**2
    loss = rng.uniform(0.02, 0.3)  # theta4 - 1
    gain = translating * radius**2 / (wheels * theta1)
    theta2 = theta1 * turning / half**2 / translating
    if level == "wheel":
        gain_v, gain_w, damping = gain, 0.0, gain * loss
    else:
        gain_v = translating / theta1
        theta2 *= rng.uniform(0.6, 1.4)
        gain_w = turning / theta2
        damping = gain * loss
    # Wheels must never break away on the good floor: steps stay below 3 m/s2.
    v_max = min(v_max, 2.2 * theta1)
    w_max = min(rng.uniform(0.5, 0.9) * v_max / half, 1.5 * theta2 / half, 4.0)
    if four_wheels:  # gentle steps, so that a floor slippery enough to let it turn still carries the drive
        v_max = min(v_max, theta1)
        w_max = min(w_max, 0.8 * theta2 / half)
    return Robot(
        family=family, level=level, mass=mass, inertia_z=mass * gyration**2, com_x=com_x,
        com_z=rng.uniform(0.6, 1.0) * radius if family != "khepera" else rng.uniform(0.8, 1.1) * radius,
        radius=radius, track=track, wheel_mass=wheel_mass, wheel_inertia=wheel_inertia,
        castor="none" if four_wheels else "ball", castor_x=-length, castor_trail=0.25 * radius, castor_radius=0.4 * radius,
        gain_v=gain_v, gain_w=gain_w, damping=damping, wheelbase=wheelbase, theta1=theta1, theta2=theta2,
        v_max=v_max, w_max=w_max,
    )
