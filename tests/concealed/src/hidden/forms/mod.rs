//! Other physical forms of the effects: the same cause, built another way than usual.

mod command;
mod matter;

use super::{Parameters, Subject};
use rand::rngs::StdRng;

/// Another form of an effect.
#[derive(Clone, Copy, Debug)]
pub struct Form {
    /// The effect.
    pub effect: &'static str,
    /// What is different.
    pub words: &'static str,
    /// How it is hidden.
    pub hide: fn(&mut Subject, &mut StdRng) -> Parameters,
}

/// All other forms.
pub const FORMS: [Form; 31] = [
    Form { effect: "coulomb_friction", words: "bristles (LuGre)", hide: matter::coulomb_bristles },
    Form { effect: "coulomb_friction", words: "a soft sign", hide: matter::coulomb_soft },
    Form { effect: "stribeck_friction", words: "bristles (LuGre) with breakaway", hide: matter::stribeck_bristles },
    Form { effect: "quadratic_drag", words: "power 1.7 of speed", hide: matter::drag_power },
    Form { effect: "dead_zone", words: "dead band, taken off larger set-points", hide: command::dead_band },
    Form { effect: "dead_zone", words: "voltage lost in the bridge", hide: command::bridge_loss },
    Form { effect: "velocity_saturation", words: "forward and turning set-point cut separately", hide: command::axis_limit },
    Form { effect: "velocity_saturation", words: "bends softly", hide: command::soft_limit },
    Form { effect: "slew_limit", words: "ramps of the wheels instead of the axes", hide: command::wheel_ramp },
    Form { effect: "torque_saturation", words: "the bridge's voltage ends instead of its current", hide: matter::voltage_limit },
    Form { effect: "command_delay", words: "latency of each message varies about its mean", hide: command::varying_delay },
    Form { effect: "command_delay", words: "a slow control loop", hide: command::slow_loop },
    Form { effect: "actuator_lag", words: "two stages", hide: command::two_stages },
    Form { effect: "actuator_lag", words: "current builds up slowly in the winding", hide: matter::winding },
    Form { effect: "integral_action", words: "with anti-windup", hide: command::windup },
    Form { effect: "gain_asymmetry", words: "one amplifier gives more than the other", hide: matter::amplifier },
    Form { effect: "wheel_slip", words: "smooth floor: little grip, stiff tyres", hide: matter::smooth_floor },
    Form { effect: "turning_scrub", words: "patches that slide at once", hide: matter::sliding_scrub },
    Form { effect: "slope", words: "ground in waves", hide: matter::waves },
    Form { effect: "payload_change", words: "fills up over time", hide: matter::filling },
    Form { effect: "payload_change", words: "put on and taken off again", hide: matter::on_and_off },
    Form { effect: "battery_sag", words: "falls quickly first, then slowly", hide: matter::settling_sag },
    Form { effect: "backlash", words: "a heavily damped gap", hide: matter::damped_gap },
    Form { effect: "wheel_eccentricity", words: "off-centre encoder discs on round wheels", hide: matter::discs },
    Form { effect: "encoder_quantisation", words: "rounded messages", hide: command::rounded },
    Form { effect: "timestamp_jitter", words: "mostly on time, now and then far off", hide: command::bursts },
    Form { effect: "battery_sag", words: "cells give way under load", hide: matter::weak_cells },
    Form { effect: "battery_sag", words: "a cell drops out", hide: matter::dead_cell },
    Form { effect: "wheel_eccentricity", words: "oval wheels", hide: matter::oval },
    Form { effect: "castor_drag", words: "a ball that drags", hide: matter::ball },
    Form { effect: "sensor_delay", words: "one axis only", hide: command::one_axis_late },
];
