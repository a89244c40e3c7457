//! Motors at their limit and batteries that give way.

use super::{Parameters, Subject, parameters};
use crate::firmware::control::Style;
use crate::plant::motor::{Battery, Discharge};
use rand::rngs::StdRng;

/// The driver limits the current.
pub fn torque_saturation(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let torque = s.asked.hardest * (1.0 - 0.8 * s.strength) * s.machine.firmware.radius;
    for motor in &mut s.machine.rig.motors {
        motor.current_limit = torque / motor.torque_constant;
    }
    parameters([("limit_n_m", torque.into())])
}

/// Voltage lost over a recording at strength 1: what a loop hides of it is made up for, so that it leaves a trace.
pub(super) fn voltage_loss(s: &Subject) -> f64 {
    if s.machine.firmware.control.style == Style::Open { 0.15 * s.strength } else { 0.45 * s.strength }
}

/// The battery runs down evenly.
pub fn sag(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let loss = voltage_loss(s);
    s.machine.rig.battery = Battery { loss, span: s.span.1 - s.span.0, shape: Discharge::Even, per_ampere: 0.0 };
    parameters([("voltage_lost_over_recording", loss.into())])
}
