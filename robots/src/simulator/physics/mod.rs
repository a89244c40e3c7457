//! The physics that a robot has beyond rigid wheels and ideal motors, each part switched on by its own table.
//!
//! One file a part: it holds the part's settings and the forces, torques, voltages or times it makes. `machine` puts the parts that are
//! on together and integrates them. Nothing here speaks of θ or of what a diagnosis could fit: a part knows newtons and volts only.
//! Without any table the simulator is the rigid plant it always was, to the last bit.

pub mod battery;
pub mod body;
pub mod castor;
pub mod contact;
pub mod firmware;
pub mod friction;
pub mod gear;
pub mod link;
pub(super) mod machine;
pub mod motor;
pub mod payload;
pub mod sensing;
pub mod terrain;
pub mod wheel;

use serde::{Deserialize, Serialize};
use wheelwright_core::robot::RobotError;

pub use battery::Battery;
pub use body::Body;
pub use castor::Castor;
pub use contact::Contact;
pub use firmware::Firmware;
pub use friction::Friction;
pub use gear::Gear;
pub use link::Link;
pub use motor::Motors;
pub use payload::Payload;
pub use sensing::Sensing;
pub use terrain::Terrain;
pub use wheel::Wheels;

/// Gravity \[m/s²\].
pub const GRAVITY: f64 = 9.80665;

/// The parts that are on; none by default.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Physics {
    /// A battery with resistance, that empties.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub battery: Option<Battery>,
    /// Drag of the air and a centre of mass beside the middle.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub body: Option<Body>,
    /// A castor behind or ahead.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub castor: Option<Castor>,
    /// What happens between tyre and ground.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contact: Option<Contact>,
    /// A sampled controller in place of the continuous one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub firmware: Option<Firmware>,
    /// Dry friction of gears and bearings.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<Friction>,
    /// Play of the gears.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gear: Option<Gear>,
    /// The way of commands into the robot.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub link: Option<Link>,
    /// Motors that differ, with inductance and limited current.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motors: Option<Motors>,
    /// A load put on, and taken off.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub payload: Option<Payload>,
    /// The way of measurements out of the robot.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensing: Option<Sensing>,
    /// Ground that is not level.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub terrain: Option<Terrain>,
    /// Wheels that are not what the firmware believes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wheels: Option<Wheels>,
}

/// A value that cannot be: key inside the part's table, value, and what it must be.
pub(super) type Flaw = (&'static str, f64, &'static str);

/// The first of the values that does not hold.
pub(super) fn first_flaw(checks: &[(&'static str, f64, bool, &'static str)]) -> Option<Flaw> {
    checks.iter().find(|(_, value, holds, _)| !(value.is_finite() && *holds)).map(|(key, value, _, what)| (*key, *value, *what))
}

/// Words for what values must be.
pub(super) const POSITIVE: &str = "a positive number";
pub(super) const NOT_NEGATIVE: &str = "zero or a positive number";
pub(super) const FINITE: &str = "a finite number";

impl Physics {
    /// True if no part is on.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// True if a part is on that the rigid plant does not have; the ways of commands and measurements are around any plant.
    pub(super) fn is_mechanical(&self) -> bool {
        !Self { link: None, sensing: None, ..self.clone() }.is_none()
    }

    /// Every value must be possible.
    ///
    /// # Errors
    /// [`RobotError::Config`] with the key.
    pub fn check(&self) -> Result<(), RobotError> {
        let flaws = [
            ("battery", self.battery.as_ref().and_then(Battery::flaw)),
            ("body", self.body.as_ref().and_then(Body::flaw)),
            ("castor", self.castor.as_ref().and_then(Castor::flaw)),
            ("contact", self.contact.as_ref().and_then(Contact::flaw)),
            ("firmware", self.firmware.as_ref().and_then(Firmware::flaw)),
            ("friction", self.friction.as_ref().and_then(Friction::flaw)),
            ("gear", self.gear.as_ref().and_then(Gear::flaw)),
            ("link", self.link.as_ref().and_then(Link::flaw)),
            ("motors", self.motors.as_ref().and_then(Motors::flaw)),
            ("payload", self.payload.as_ref().and_then(Payload::flaw)),
            ("sensing", self.sensing.as_ref().and_then(Sensing::flaw)),
            ("terrain", self.terrain.as_ref().and_then(Terrain::flaw)),
            ("wheels", self.wheels.as_ref().and_then(Wheels::flaw)),
        ];
        match flaws.into_iter().find_map(|(part, flaw)| flaw.map(|flaw| (part, flaw))) {
            Some((part, (key, value, what))) => {
                Err(RobotError::Config { key: format!("physics.{part}.{key}"), reason: format!("must be {what}, not {value}") })
            }
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests;
