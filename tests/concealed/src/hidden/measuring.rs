//! What the sensors do.

use super::{Parameters, Subject, parameters};
use crate::sensors::Source;
use rand::rngs::StdRng;

/// Speeds are made from encoder counts.
pub fn quantisation(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let tick = 0.003 * s.strength * s.speed();
    s.machine.sensors.tick = tick;
    s.machine.sensors.source = Source::Wheels;
    parameters([("tick_at_rim_m", tick.into())])
}

/// Rows are not measured when they are stamped: off by one row at strength 1.
pub fn jitter(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let jitter = s.row * s.strength;
    s.machine.sensors.jitter = jitter;
    parameters([("standard_deviation_s", jitter.into())])
}

/// Speeds are old when they are stamped.
pub fn delay(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let delay = 0.2 * s.strength;
    s.machine.sensors.delay = [delay; 2];
    parameters([("delay_s", delay.into())])
}
