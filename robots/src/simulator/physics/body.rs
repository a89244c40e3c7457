//! The body: its mass and where it is, with what was put on it; drag of the air.

use serde::{Deserialize, Serialize};

use super::super::plant::PlantConstants;
use super::{FINITE, Flaw, NOT_NEGATIVE, Payload, first_flaw};

/// What the body has beyond mass and inertia.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Body {
    /// How far the centre of mass lies left of the middle \[m\].
    pub com_left: f64,
    /// Force of the air over the square of the speed \[N s²/m²\].
    pub air_drag: f64,
}

impl Body {
    pub(super) fn flaw(&self) -> Option<Flaw> {
        first_flaw(&[("com_left", self.com_left, true, FINITE), ("air_drag", self.air_drag, self.air_drag >= 0.0, NOT_NEGATIVE)])
    }

    /// Force of the air \[N\].
    pub(super) fn drag(&self, v: f64) -> f64 {
        -self.air_drag * v * v.abs()
    }
}

/// Mass, and where its centre is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Mass {
    /// \[kg\].
    pub(super) mass: f64,
    /// About the vertical through the centre of mass \[kg m²\].
    pub(super) inertia: f64,
    /// Centre of mass ahead of the axle \[m\].
    pub(super) ahead: f64,
    /// Centre of mass left of the middle \[m\].
    pub(super) left: f64,
}

impl Mass {
    /// The robot's own, with its payload if that is on.
    pub(super) fn of(c: &PlantConstants, body: Option<&Body>, payload: Option<&Payload>, t: f64) -> Self {
        let own = Self { mass: c.mass, inertia: c.yaw_inertia, ahead: c.com_offset, left: body.map_or(0.0, |b| b.com_left) };
        payload.filter(|p| p.is_on(t)).map_or(own, |p| own.with(p))
    }

    /// Two bodies as one, by the parallel axis theorem.
    fn with(self, load: &Payload) -> Self {
        let mass = self.mass + load.mass;
        let share = load.mass / mass;
        let (dx, dy) = (load.x - self.ahead, load.y - self.left);
        let reduced = self.mass * share;
        Self {
            mass,
            inertia: self.inertia + load.inertia + reduced * (dx * dx + dy * dy),
            ahead: self.ahead + share * dx,
            left: self.left + share * dy,
        }
    }
}
