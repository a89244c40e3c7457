//! Other forms in the robot's matter.

use super::super::power::voltage_loss;
use super::super::{Parameters, Subject, build, friction, parameters, resistance};
use crate::draw::sign;
use crate::plant::bearing::{Dry, Law};
use crate::plant::castor::Ball;
use crate::plant::contact::{Contact, Scrub, Tyre};
use crate::plant::motor::{Battery, Discharge};
use crate::plant::surroundings::{Air, GRAVITY};
use crate::sensors::Source;
use rand::Rng;
use rand::rngs::StdRng;

/// Changes the law of dry friction that is in both wheels.
fn with_law(s: &mut Subject, law: Law) {
    for wheel in &mut s.machine.rig.wheels {
        wheel.bearing.dry = wheel.bearing.dry.map(|dry| Dry { law, ..dry });
    }
}

pub(super) fn coulomb_bristles(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let said = friction::coulomb(s, rng);
    with_law(s, Law::Bristles { deflection: 0.01, damping: 1e-3 });
    said
}

pub(super) fn coulomb_soft(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let said = friction::coulomb(s, rng);
    with_law(s, Law::Soft { speed: 0.05 * s.wheel_speed() });
    said
}

pub(super) fn stribeck_bristles(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let said = friction::stribeck(s, rng);
    with_law(s, Law::Bristles { deflection: 0.01, damping: 1e-3 });
    said
}

pub(super) fn drag_power(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let (v, w) = (s.speed(), s.machine.typical[1].abs());
    let air = Air { drag: s.force(0.15 * s.strength) / v.powf(1.7), yaw: s.torque(0.15 * s.strength) / w.powf(1.7), power: 1.7 };
    s.machine.rig.surroundings.air = Some(air);
    parameters([("power", 1.7.into()), ("drag_n_at_typical_speed", s.force(0.15 * s.strength).into())])
}

pub(super) fn voltage_limit(s: &mut Subject, _: &mut StdRng) -> Parameters {
    // Never so little that it could not keep the speed: that would be another limit.
    let keeps = s.machine.rig.motors[0].back_emf * s.asked.fastest / s.machine.firmware.radius;
    let volts = (s.asked.voltage * (1.0 - 0.8 * s.strength)).max(1.15 * keeps);
    for motor in &mut s.machine.rig.motors {
        motor.voltage_limit = volts;
    }
    parameters([("limit_v", volts.into())])
}

pub(super) fn winding(s: &mut Subject, _: &mut StdRng) -> Parameters {
    // A current much slower than the robot would make the loop ring.
    let times = s.machine.times();
    let electric_time = (0.15 * s.strength).min(0.5 * times[0].min(times[1]));
    for motor in &mut s.machine.rig.motors {
        motor.electric_time = electric_time;
    }
    s.drop_rate_gain();
    parameters([("time_constant_s", electric_time.into())])
}

pub(super) fn amplifier(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let off = 0.2 * s.strength * sign(rng);
    s.machine.rig.motors[0].amplifier = 1.0 - off;
    s.machine.rig.motors[1].amplifier = 1.0 + off;
    parameters([("wheel", if off > 0.0 { "right" } else { "left" }.into()), ("amplifier_difference", (2.0 * off.abs()).into())])
}

pub(super) fn smooth_floor(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let grip = s.asked.hardest * (1.0 - 0.7 * s.strength);
    let mass = s.machine.rig.body.mass;
    let tyre = Tyre { stiffness: (8.0 * 0.5 * mass * GRAVITY).max(3.0 * grip), grip, floor: 0.05 * s.speed() };
    for wheel in &mut s.machine.rig.wheels {
        wheel.contact = Contact::Tyre(tyre);
    }
    s.machine.sensors.source = Source::Body;
    s.drop_rate_gain();
    parameters([("grip_per_wheel_n", grip.into())])
}

pub(super) fn sliding_scrub(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let said = resistance::scrub(s, rng);
    s.machine.rig.scrub = s.machine.rig.scrub.map(|scrub| {
        let patch = Tyre { stiffness: 3.0 * scrub.patch.grip / 0.06, ..scrub.patch };
        Scrub { patch, ..scrub }
    });
    said
}

pub(super) fn waves(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let mut said = resistance::slope(s, rng);
    let wave = s.speed() * rng.random_range(15.0..40.0);
    if let Some(slope) = &mut s.machine.rig.surroundings.slope {
        slope.wave = wave;
    }
    said.insert("wave_m".to_owned(), wave.into());
    said
}

pub(super) fn filling(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let (mut load, begin) = build::load(s, rng);
    let length = rng.random_range(4.0..12.0);
    load.on.1 = begin + length;
    s.machine.rig.load = Some(load);
    parameters([("time_s", begin.into()), ("filled_s", load.on.1.into()), ("mass_kg", load.body.mass.into())])
}

pub(super) fn on_and_off(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let (mut load, begin) = build::load(s, rng);
    let end = begin + rng.random_range(0.4..0.8) * (s.span.1 - begin);
    load.off = (end, end);
    s.machine.rig.load = Some(load);
    parameters([("time_s", begin.into()), ("off_s", end.into()), ("mass_kg", load.body.mass.into())])
}

pub(super) fn settling_sag(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let loss = voltage_loss(s);
    s.machine.rig.battery = Battery { loss, span: s.span.1 - s.span.0, shape: Discharge::Settling(0.3), per_ampere: 0.0 };
    parameters([("voltage_lost_over_recording", loss.into())])
}

pub(super) fn weak_cells(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let motor = &s.machine.rig.motors[0];
    let current = 2.0 * s.asked.hardest * s.machine.firmware.radius / motor.torque_constant;
    let per_ampere = 0.6 * s.strength / current;
    s.machine.rig.battery = Battery { loss: 0.1 * s.strength, span: s.span.1 - s.span.0, shape: Discharge::Even, per_ampere };
    parameters([("voltage_lost_per_ampere", per_ampere.into())])
}

pub(super) fn dead_cell(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let (loss, at) = (voltage_loss(s), rng.random_range(0.2..0.75));
    let span = s.span.1 - s.span.0;
    s.machine.rig.battery = Battery { loss, span, shape: Discharge::Step(at), per_ampere: 0.0 };
    parameters([("voltage_lost", loss.into()), ("time_s", (s.span.0 + at * span).into())])
}

pub(super) fn oval(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let said = build::eccentricity(s, rng);
    for wheel in &mut s.machine.rig.wheels {
        wheel.lobes = 2.0;
    }
    said
}

pub(super) fn ball(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let drag = s.force(0.12 * s.strength);
    let place = -rng.random_range(0.9..1.5) * s.machine.rig.half_track;
    s.machine.rig.dragging_ball = Some(Ball { place, drag, soft: s.machine.rig.soft_speed });
    parameters([("drag_n", drag.into()), ("place_m", place.into())])
}

pub(super) fn damped_gap(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let rim = 0.06 * s.strength * s.machine.rig.half_track;
    let gap = rim / s.machine.firmware.radius;
    build::fit_gear(s, build::gear(s, gap, 50.0, 1.5));
    parameters([("gap_rad", gap.into()), ("gap_at_rim_m", rim.into())])
}

pub(super) fn discs(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let off = 0.04 * s.strength;
    s.machine.sensors.disc = off;
    s.machine.sensors.source = Source::Wheels;
    parameters([("speed_variation", off.into())])
}
