//! The motors: two that differ, with an inductance that delays the current and a driver that limits it.

use serde::{Deserialize, Serialize};

use super::super::plant::Sides;
use super::{Flaw, NOT_NEGATIVE, POSITIVE, first_flaw};

/// Motors as they were built.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Motors {
    /// Torque and back-EMF of the left motor over their nominal values.
    pub left: f64,
    /// The same of the right motor.
    pub right: f64,
    /// Viscous friction added on the left \[N m s/rad\].
    pub left_friction: f64,
    /// The same on the right \[N m s/rad\].
    pub right_friction: f64,
    /// Inductance of each winding \[H\]; currents follow voltages at once without.
    pub inductance: f64,
    /// Largest current of each motor \[A\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub current_limit: Option<f64>,
}

impl Default for Motors {
    fn default() -> Self {
        Self { left: 1.0, right: 1.0, left_friction: 0.0, right_friction: 0.0, inductance: 0.0, current_limit: None }
    }
}

impl Motors {
    pub(super) fn flaw(&self) -> Option<Flaw> {
        first_flaw(&[
            ("left", self.left, self.left > 0.0, POSITIVE),
            ("right", self.right, self.right > 0.0, POSITIVE),
            ("left_friction", self.left_friction, self.left_friction >= 0.0, NOT_NEGATIVE),
            ("right_friction", self.right_friction, self.right_friction >= 0.0, NOT_NEGATIVE),
            ("inductance", self.inductance, self.inductance >= 0.0, NOT_NEGATIVE),
            ("current_limit", self.current_limit.unwrap_or(1.0), self.current_limit.unwrap_or(1.0) > 0.0, POSITIVE),
        ])
    }

    pub(super) fn strength(&self) -> Sides {
        Sides { left: self.left, right: self.right }
    }

    pub(super) fn friction(&self) -> Sides {
        Sides { left: self.left_friction, right: self.right_friction }
    }
}
