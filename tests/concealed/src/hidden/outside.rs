//! Causes that are in no library of effects.

use super::Subject;
use super::build::{fit_gear, gear};
use crate::draw::{log_uniform, sign};
use crate::plant::surroundings::{Carpet, Shove};
use crate::plant::{LEFT, Lifted};
use rand::Rng;
use rand::rngs::StdRng;
use std::f64::consts::TAU;

/// What the referee knows of a cause beside its words.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Known {
    /// When it acts, where only at some times.
    pub during: Vec<(f64, f64)>,
    /// Names that are the same mathematics, under the given bandwidth of driving \[rad/s\].
    pub same: Vec<(&'static str, f64)>,
}

/// A cause outside the library.
#[derive(Clone, Copy, Debug)]
pub struct Outside {
    /// What it is.
    pub words: &'static str,
    /// How it is hidden.
    pub hide: fn(&mut Subject, &mut StdRng) -> Known,
}

/// All of them.
pub const OUTSIDE: [Outside; 12] = [
    Outside { words: "somebody pushes the robot now and then", hide: pushes },
    Outside { words: "messages are lost for moments, the last command stays in force", hide: dropouts },
    Outside { words: "the motors cog: torque ripples with the wheel's angle", hide: cogging },
    Outside { words: "stripes of carpet lie in the room", hide: carpet },
    Outside { words: "the shafts between motors and wheels are soft and ring", hide: resonance },
    Outside { words: "the gyroscope's bias wanders", hide: drift },
    Outside { words: "the grease is cold at first", hide: warm_up },
    Outside { words: "one wheel is thrown into the air by bumps", hide: bumps },
    Outside { words: "gusts of wind", hide: gusts },
    Outside { words: "the speed sensor cannot show high speeds", hide: clipped_sensor },
    Outside { words: "messages are lost for moments, a dead-man stops the robot", hide: dead_man },
    Outside { words: "set-points are rounded coarsely", hide: rounded },
];

/// Moments of `length` seconds, on average `every` seconds apart, from the begin of the first recording to the end of all.
fn moments(s: &Subject, every: f64, length: (f64, f64), rng: &mut StdRng) -> Vec<(f64, f64)> {
    let mut t = s.span.0 + rng.random_range(0.2..1.0) * every;
    let mut out = Vec::new();
    while t < s.until {
        let end = t + rng.random_range(length.0..length.1);
        out.push((t, end));
        t = end + rng.random_range(0.5..1.5) * every;
    }
    out
}

fn pushes(s: &mut Subject, rng: &mut StdRng) -> Known {
    let during = moments(s, 18.0, (0.6, 1.6), rng);
    for &during in &during {
        let along = s.force(s.strength) * rng.random_range(0.6..1.2) * sign(rng);
        let yaw = s.torque(s.strength) * rng.random_range(0.3..1.0) * sign(rng);
        s.machine.rig.surroundings.shoves.push(Shove { during, force: [along, yaw] });
    }
    Known { during, same: Vec::new() }
}

fn dropouts(s: &mut Subject, rng: &mut StdRng) -> Known {
    let longest = 0.6 + 2.0 * s.strength;
    let during = moments(s, 14.0, (0.4, longest), rng);
    s.machine.firmware.link.lost.extend(&during);
    Known { during, same: Vec::new() }
}

fn dead_man(s: &mut Subject, rng: &mut StdRng) -> Known {
    s.machine.firmware.link.dead_man = Some(0.3);
    dropouts(s, rng)
}

fn rounded(s: &mut Subject, _: &mut StdRng) -> Known {
    let step = 0.5 * s.strength;
    s.machine.firmware.shaping.rounding = [step * s.speed(), step * s.machine.typical[1].abs()];
    Known::default()
}

fn cogging(s: &mut Subject, rng: &mut StdRng) -> Known {
    let size = s.wheel_torque(s.force(0.3 * s.strength));
    let periods = f64::from(rng.random_range(3..12));
    for motor in &mut s.machine.rig.motors {
        motor.cogging = (size, periods);
    }
    Known::default()
}

fn carpet(s: &mut Subject, rng: &mut StdRng) -> Known {
    let stripe = s.speed() * rng.random_range(3.0..7.0);
    let drag = s.force(0.25 * s.strength);
    s.machine.rig.surroundings.carpet = Some(Carpet { stripe, drag, soft: 0.02 * s.speed() });
    Known::default()
}

fn resonance(s: &mut Subject, rng: &mut StdRng) -> Known {
    let frequency = log_uniform(rng, 1.5, 4.0) / s.strength.sqrt();
    let rim_mass = s.machine.rig.wheels[LEFT].inertia / s.machine.firmware.radius.powi(2);
    let carried = 0.5 * s.machine.rig.body.mass;
    let soft = gear(s, 0.0, frequency * (carried / (0.7 * rim_mass)).sqrt(), 0.05);
    fit_gear(s, soft);
    let slow = TAU * frequency / 4.0;
    Known { during: Vec::new(), same: vec![("command_delay", slow), ("actuator_lag", slow), ("sensor_delay", slow)] }
}

fn drift(s: &mut Subject, rng: &mut StdRng) -> Known {
    s.machine.sensors.drift = (0.15 * s.strength * s.machine.typical[1].abs(), rng.random_range(40.0..120.0));
    Known::default()
}

fn warm_up(s: &mut Subject, _: &mut StdRng) -> Known {
    let radius = s.machine.firmware.radius;
    for wheel in &mut s.machine.rig.wheels {
        wheel.bearing.cold = 0.25 * s.strength * s.machine.servo[0] * radius * radius;
        wheel.bearing.warm_time = 0.4 * (s.span.1 - s.span.0);
    }
    Known { during: Vec::new(), same: vec![("battery_sag", f64::INFINITY)] }
}

fn bumps(s: &mut Subject, rng: &mut StdRng) -> Known {
    let longest = 0.15 + 0.5 * s.strength;
    let during = moments(s, 8.0, (0.1, longest), rng);
    let wheel = usize::from(rng.random::<bool>());
    s.machine.rig.lifted = Some(Lifted { wheel, during: during.clone() });
    s.drop_rate_gain();
    Known { during, same: Vec::new() }
}

fn gusts(s: &mut Subject, rng: &mut StdRng) -> Known {
    let during = moments(s, 3.0, (0.8, 4.0), rng);
    for &during in &during {
        let along = s.force(0.5 * s.strength) * rng.random_range(-1.0..1.0);
        let yaw = s.torque(0.4 * s.strength) * rng.random_range(-1.0..1.0);
        s.machine.rig.surroundings.shoves.push(Shove { during, force: [along, yaw] });
    }
    Known::default()
}

fn clipped_sensor(s: &mut Subject, _: &mut StdRng) -> Known {
    s.machine.sensors.range[0] = s.speed() * (1.5 - 0.6 * s.strength);
    Known::default()
}
