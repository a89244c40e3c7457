//! Other forms on the way of commands and measurements.

use super::super::{Parameters, Subject, command, measuring, parameters};
use crate::sensors::{Lateness, Source};
use rand::Rng;
use rand::rngs::StdRng;

pub(super) fn dead_band(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let said = command::dead_zone(s, rng);
    s.machine.firmware.shaping.subtract = true;
    said
}

pub(super) fn bridge_loss(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let volts = 0.25 * s.strength * s.speed() * s.machine.firmware.control.gain[0];
    for motor in &mut s.machine.rig.motors {
        motor.voltage_lost = volts;
    }
    parameters([("lost_v", volts.into())])
}

pub(super) fn axis_limit(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let share = 1.0 - 0.5 * s.strength;
    let limit = [1.6 * s.speed() * share, 1.8 * s.machine.typical[1].abs() * share];
    s.machine.firmware.shaping.axis_limit = limit;
    parameters([("limit_v_m_s", limit[0].into()), ("limit_omega_rad_s", limit[1].into())])
}

pub(super) fn soft_limit(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let said = command::velocity_saturation(s, rng);
    s.machine.firmware.shaping.soft_limit = true;
    said
}

pub(super) fn wheel_ramp(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let ramp = [0.35 * s.speed() / s.strength, 0.7 * s.speed() / s.strength];
    s.machine.firmware.shaping.wheel_ramp = ramp;
    parameters([("speeding_up_m_s2", ramp[0].into()), ("slowing_down_m_s2", ramp[1].into())])
}

pub(super) fn varying_delay(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let said = command::delay(s, rng);
    s.machine.firmware.link.variation = 0.4;
    said
}

pub(super) fn slow_loop(s: &mut Subject, _: &mut StdRng) -> Parameters {
    // A loop that waits longer than its own time constant would not be stable.
    let times = s.machine.times();
    let period = (0.15 * s.strength).min(0.8 * times[0].min(times[1]));
    s.machine.firmware.period = (period / 5e-4).round().max(1.0) * 5e-4;
    s.drop_rate_gain();
    parameters([("period_s", s.machine.firmware.period.into())])
}

pub(super) fn two_stages(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let said = command::lag(s, rng);
    s.machine.firmware.shaping.two_stages = true;
    said
}

pub(super) fn windup(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let said = command::integral(s, rng);
    s.machine.firmware.control.windup = 0.15 * s.speed();
    said
}

pub(super) fn rounded(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let step = [0.06 * s.strength * s.speed(), 0.06 * s.strength * s.machine.typical[1].abs()];
    s.machine.sensors.rounding = step;
    s.machine.sensors.source = Source::Wheels;
    parameters([("step_v_m_s", step[0].into()), ("step_omega_rad_s", step[1].into())])
}

pub(super) fn one_axis_late(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let mut said = measuring::delay(s, rng);
    let late = usize::from(rng.random::<bool>());
    s.machine.sensors.delay[1 - late] = 0.0;
    said.insert("axis".to_owned(), ["v", "omega"][late].into());
    said
}

pub(super) fn bursts(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let said = measuring::jitter(s, rng);
    s.machine.sensors.lateness = Lateness::Bursts;
    said
}
