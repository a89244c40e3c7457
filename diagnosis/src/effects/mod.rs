//! The library of effects, one file each.
//!
//! | name | place | in one line |
//! |---|---|---|
//! | `actuator_lag` | command | the drive follows its command with a second time constant |
//! | `command_delay` | command | commands arrive late |
//! | `coulomb_friction` | dynamics | dry friction of constant size at both wheels |
//! | `coulomb_friction_one_wheel` | dynamics | dry friction at one wheel |
//! | `direction_asymmetry` | dynamics | dry friction that differs forwards and backwards |
//! | `quadratic_drag` | dynamics | drag with the square of speed |
//! | `rolling_resistance` | dynamics | a constant force against forward motion that leaves turning alone |
//! | `stribeck_friction` | dynamics | dry friction that is greater near standstill |
//! | `viscous_asymmetry` | dynamics | viscous friction that differs between wheels or directions |

mod actuator_lag;
mod command_delay;
mod coulomb_friction;
mod coulomb_friction_one_wheel;
mod direction_asymmetry;
mod force;
mod quadratic_drag;
mod rolling_resistance;
mod stribeck_friction;
mod viscous_asymmetry;
mod words;

use wheelwright_core::Effect;

pub(crate) use words::digits;

pub use actuator_lag::ActuatorLag;
pub use command_delay::CommandDelay;
pub use coulomb_friction::CoulombFriction;
pub use coulomb_friction_one_wheel::CoulombFrictionOneWheel;
pub use direction_asymmetry::DirectionAsymmetry;
pub use force::Wheel;
pub use quadratic_drag::QuadraticDrag;
pub use rolling_resistance::RollingResistance;
pub use stribeck_friction::StribeckFriction;
pub use viscous_asymmetry::{Between, ViscousAsymmetry};

/// The built-in effects in the order in which they are tried; effects with a side or an axis stand once for each.
pub fn library() -> Vec<Box<dyn Effect>> {
    let mut all: Vec<Box<dyn Effect>> = vec![Box::new(CommandDelay {}), Box::new(ActuatorLag {})];
    all.extend(dynamics());
    all
}

/// Effects on the dynamics.
fn dynamics() -> Vec<Box<dyn Effect>> {
    vec![
        Box::new(CoulombFriction {}),
        Box::new(CoulombFrictionOneWheel { wheel: Wheel::Left }),
        Box::new(CoulombFrictionOneWheel { wheel: Wheel::Right }),
        Box::new(StribeckFriction {}),
        Box::new(RollingResistance {}),
        Box::new(DirectionAsymmetry {}),
        Box::new(ViscousAsymmetry { between: Between::Wheels }),
        Box::new(ViscousAsymmetry { between: Between::Directions }),
        Box::new(QuadraticDrag {}),
    ]
}
