//! The library of effects, one file each.
//!
//! | name | place | in one line |
//! |---|---|---|
//! | `actuator_lag` | command | the drive follows its command with a second time constant |
//! | `command_delay` | command | commands arrive late |
//! | `coulomb_friction` | dynamics | dry friction of constant size at both wheels |

mod actuator_lag;
mod command_delay;
mod coulomb_friction;
mod words;

use wheelwright_core::Effect;

pub(crate) use words::digits;

pub use actuator_lag::ActuatorLag;
pub use command_delay::CommandDelay;
pub use coulomb_friction::CoulombFriction;

/// The built-in effects in the order in which they are tried; effects with a side or an axis stand once for each.
pub fn library() -> Vec<Box<dyn Effect>> {
    vec![Box::new(CommandDelay {}), Box::new(ActuatorLag {}), Box::new(CoulombFriction {})]
}
