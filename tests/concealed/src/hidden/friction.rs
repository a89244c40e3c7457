//! Friction in bearings, gears and tyres.

use super::{Parameters, Subject, parameters, side};
use crate::draw::sign;
use crate::plant::bearing::{Dry, Law};
use crate::plant::surroundings::GRAVITY;
use crate::plant::{LEFT, RIGHT};
use rand::Rng;
use rand::rngs::StdRng;

/// Dry friction of one kinetic torque, the same both ways and at rest.
pub(super) fn plain(torque: f64) -> Dry {
    Dry { forward: torque, backward: torque, breakaway: 1.0, stribeck_speed: 1.0, law: Law::SetValued }
}

/// Dry friction on both wheels: 0.12 of the typical speed in set-point.
pub fn coulomb(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let torque = s.wheel_torque(s.force(0.12 * s.strength));
    for wheel in &mut s.machine.rig.wheels {
        wheel.bearing.dry = Some(plain(torque));
    }
    parameters([("torque_per_wheel_n_m", torque.into())])
}

/// Dry friction of both wheels' size on one wheel alone.
pub fn one_wheel(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let torque = 2.0 * s.wheel_torque(s.force(0.12 * s.strength));
    let (which, word) = side(rng);
    s.machine.rig.wheels[which].bearing.dry = Some(plain(torque));
    parameters([("wheel", word.into()), ("torque_n_m", torque.into())])
}

/// Dry friction that holds two and a half to four times as much at rest as it costs in motion.
pub fn stribeck(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let torque = s.wheel_torque(s.force(0.08 * s.strength));
    let breakaway = rng.random_range(2.5..4.0);
    let stribeck_speed = rng.random_range(0.08..0.2) * s.wheel_speed();
    for wheel in &mut s.machine.rig.wheels {
        wheel.bearing.dry = Some(Dry { breakaway, stribeck_speed, ..plain(torque) });
    }
    parameters([
        ("kinetic_torque_per_wheel_n_m", torque.into()),
        ("breakaway_ratio", breakaway.into()),
        ("stribeck_speed_rad_s", stribeck_speed.into()),
    ])
}

/// Rolling resistance of all three wheels by their loads.
pub fn rolling(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let coefficient = s.force(0.12 * s.strength) / (s.machine.rig.body.mass * GRAVITY);
    s.machine.rig.rolling_resistance = coefficient;
    parameters([("coefficient", coefficient.into())])
}

/// One bearing drags more with speed than the other.
pub fn viscous_asymmetry(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let radius = s.machine.firmware.radius;
    let extra = 0.3 * s.strength * 0.5 * s.machine.servo[0] * radius * radius;
    let (which, word) = side(rng);
    s.machine.rig.wheels[which].bearing.viscous += extra;
    parameters([("wheel", word.into()), ("extra_n_m_s", extra.into())])
}

/// Gears that turn more easily one way than the other.
pub fn direction(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let torque = s.wheel_torque(s.force(0.12 * s.strength));
    let lean = 0.7 * sign(rng);
    for i in [LEFT, RIGHT] {
        let dry = Dry { forward: torque * (1.0 + lean), backward: torque * (1.0 - lean), ..plain(torque) };
        s.machine.rig.wheels[i].bearing.dry = Some(dry);
    }
    parameters([("forward_torque_n_m", (torque * (1.0 + lean)).into()), ("backward_torque_n_m", (torque * (1.0 - lean)).into())])
}
