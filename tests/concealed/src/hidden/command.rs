//! Between command and motor: message, set-point, loop.

use super::{Parameters, Subject, parameters};
use crate::draw::sign;
use rand::rngs::StdRng;

/// Set-points of a wheel below a least speed do nothing.
pub fn dead_zone(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let least = 0.35 * s.strength * s.speed();
    s.machine.firmware.shaping.least = least;
    parameters([("least_rim_speed_m_s", least.into())])
}

/// Set-points of a wheel are cut.
pub fn velocity_saturation(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let limit = s.asked.fastest * (1.0 - 0.5 * s.strength);
    s.machine.firmware.shaping.wheel_limit = limit;
    parameters([("limit_rim_speed_m_s", limit.into())])
}

/// Set-points follow ramps.
pub fn slew_limit(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let ramp = [0.3 * s.speed() / s.strength, 0.45 * s.machine.typical[1].abs() / s.strength];
    s.machine.firmware.shaping.ramp = ramp;
    parameters([("v_dot_m_s2", ramp[0].into()), ("omega_dot_rad_s2", ramp[1].into())])
}

/// Messages take their time.
pub fn delay(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let latency = 0.25 * s.strength;
    s.machine.firmware.link.latency += latency;
    parameters([("delay_s", latency.into())])
}

/// Drivers smooth the wheels' set-points.
pub fn lag(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let smoothing = 0.2 * s.strength;
    s.machine.firmware.shaping.smoothing = smoothing;
    parameters([("time_constant_s", smoothing.into())])
}

/// The loops integrate.
pub fn integral(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let integral = 2.5 * s.strength;
    s.machine.firmware.control.integral = [integral; 2];
    parameters([("integral_over_proportional_1_s", integral.into())])
}

/// One side's set-point is worth more than the other's.
pub fn gain_asymmetry(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let off = 0.06 * s.strength * sign(rng);
    s.machine.firmware.shaping.scale = [1.0 - off, 1.0 + off];
    parameters([("wheel", if off > 0.0 { "right" } else { "left" }.into()), ("gain_difference", (2.0 * off.abs()).into())])
}
