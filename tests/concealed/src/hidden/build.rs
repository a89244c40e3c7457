//! How the robot is really built: wheels, track, mass, gears, tyres.

use super::{Parameters, Subject, parameters, side};
use crate::draw::sign;
use crate::plant::body::{Body, Load};
use crate::plant::contact::{Contact, Tyre};
use crate::plant::gear::Gear;
use crate::plant::surroundings::GRAVITY;
use crate::plant::{LEFT, RIGHT};
use crate::sensors::Source;
use rand::Rng;
use rand::rngs::StdRng;
use std::f64::consts::TAU;

/// One wheel is larger than the other.
pub fn radius_mismatch(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let (larger, word) = side(rng);
    let off = 0.04 * s.strength;
    for i in [LEFT, RIGHT] {
        s.machine.rig.wheels[i].radius *= if i == larger { 1.0 + off } else { 1.0 - off };
    }
    s.machine.sensors.source = Source::Body;
    parameters([("wheel", word.into()), ("radius_difference", (2.0 * off).into())])
}

/// The wheels are further apart, or nearer, than anyone believes.
pub fn track_error(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let off = 0.12 * s.strength * sign(rng);
    s.machine.rig.half_track *= 1.0 + off;
    s.machine.sensors.source = Source::Body;
    parameters([("track_error", off.into())])
}

/// The centre of mass is not in the middle.
pub fn lateral_com(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let left = 0.3 * s.strength * s.machine.rig.half_track * sign(rng);
    s.machine.rig.body.left = left;
    parameters([("left_m", left.into())])
}

/// Tyres creep when they push.
pub fn slip(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let mass = s.machine.rig.body.mass;
    let stiffness = 0.5 * mass * s.speed() / (0.12 * s.strength);
    let tyre = Tyre { stiffness, grip: 0.7 * 0.5 * mass * GRAVITY, floor: 0.05 * s.speed() };
    for wheel in &mut s.machine.rig.wheels {
        wheel.contact = Contact::Tyre(tyre);
    }
    s.machine.sensors.source = Source::Body;
    s.drop_rate_gain();
    parameters([("slip_stiffness_n", stiffness.into())])
}

/// A load that comes on between a fifth and three quarters of the recording.
pub(super) fn load(s: &Subject, rng: &mut StdRng) -> (Load, f64) {
    let h = s.machine.rig.half_track;
    let body = &s.machine.rig.body;
    let begin = s.span.0 + rng.random_range(0.2..0.75) * (s.span.1 - s.span.0);
    let mass = s.strength * body.mass;
    let wanted = mass * (body.forward + rng.random_range(-0.3..0.3) * h);
    let (own, most) = (body.mass * body.forward, s.machine.steady_moment(0.4));
    let forward = ((own + wanted).clamp(-most, most) - own) / mass;
    let carried = Body { mass, inertia: 0.25 * mass * h * h, forward, left: 0.0 };
    (Load { body: carried, on: (begin, begin), off: (f64::INFINITY, f64::INFINITY) }, begin)
}

/// A load is put on.
pub fn payload(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let (load, begin) = load(s, rng);
    s.machine.rig.load = Some(load);
    parameters([("time_s", begin.into()), ("mass_kg", load.body.mass.into()), ("forward_m", load.body.forward.into())])
}

/// A gear with a gap: the rotor has seven tenths of what turns.
pub(super) fn gear(s: &Subject, gap: f64, frequency: f64, damping: f64) -> Gear {
    let rotor = 0.7 * s.machine.rig.wheels[LEFT].inertia;
    let pace = TAU * frequency;
    Gear { gap, stiffness: rotor * pace * pace, damping: 2.0 * damping * rotor * pace, rotor }
}

/// Fits a gear between rotor and wheel.
pub(super) fn fit_gear(s: &mut Subject, gear: Gear) {
    for wheel in &mut s.machine.rig.wheels {
        wheel.inertia -= gear.rotor;
    }
    s.machine.rig.gear = Some(gear);
    s.drop_rate_gain();
}

/// Play in both gears.
pub fn backlash(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let rim = 0.06 * s.strength * s.machine.rig.half_track;
    let gap = rim / s.machine.firmware.radius;
    fit_gear(s, gear(s, gap, 80.0, 0.4));
    parameters([("gap_rad", gap.into()), ("gap_at_rim_m", rim.into())])
}

/// Wheels that are not mounted in their middle.
pub fn eccentricity(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let off = 0.04 * s.strength;
    for wheel in &mut s.machine.rig.wheels {
        wheel.eccentricity = off * rng.random_range(0.7..1.3);
        wheel.phase = rng.random_range(0.0..TAU);
    }
    s.machine.sensors.source = Source::Body;
    parameters([("radius_variation", off.into())])
}
