//! Tyre and ground: rolling resistance, the scrub of turning tyres, and slip.
//!
//! With slip the ground's force on a tyre grows with the velocity at which it slides, and ends at the Coulomb limit:
//! F = C s / √(1 + (C |s| / μN)²), along and across together, so that braking costs hold in the curve.

use serde::{Deserialize, Serialize};

use super::{Flaw, NOT_NEGATIVE, POSITIVE, first_flaw};

/// Below this speed \[m/s\] dry resistances fade, so that they hold nothing back at rest.
pub(super) const CREEP: f64 = 2e-3;
/// The same for turning \[rad/s\].
pub(super) const CREEP_TURN: f64 = 1e-2;

/// Contact of the driven wheels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Contact {
    /// Rolling resistance over the load.
    pub rolling_resistance: f64,
    /// Moment of the tyres against turning on the spot \[N m\].
    pub scrub: f64,
    /// Share of the weight on the driven wheels.
    pub load_share: f64,
    /// How the tyres slip; they roll without slip if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slip: Option<Slip>,
}

/// Slip of the tyres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Slip {
    /// μ, most force over load.
    pub friction: f64,
    /// C, force per sliding velocity of one tyre \[N s/m\].
    pub stiffness: f64,
}

impl Default for Contact {
    fn default() -> Self {
        Self { rolling_resistance: 0.0, scrub: 0.0, load_share: 1.0, slip: None }
    }
}

impl Contact {
    pub(super) fn flaw(&self) -> Option<Flaw> {
        let (friction, stiffness) = self.slip.as_ref().map_or((1.0, 1.0), |s| (s.friction, s.stiffness));
        first_flaw(&[
            ("rolling_resistance", self.rolling_resistance, self.rolling_resistance >= 0.0, NOT_NEGATIVE),
            ("scrub", self.scrub, self.scrub >= 0.0, NOT_NEGATIVE),
            ("load_share", self.load_share, self.load_share > 0.0 && self.load_share <= 1.0, "above 0 and at most 1"),
            ("slip.friction", friction, friction > 0.0, POSITIVE),
            ("slip.stiffness", stiffness, stiffness > 0.0, POSITIVE),
        ])
    }

    /// Force against the rolling of a tyre under `load` \[N\] at `speed` over ground \[m/s\].
    pub(super) fn rolling(&self, load: f64, speed: f64) -> f64 {
        -self.rolling_resistance * load * (speed / CREEP).tanh()
    }

    /// Moment against turning \[N m\].
    pub(super) fn turning(&self, omega: f64) -> f64 {
        -self.scrub * (omega / CREEP_TURN).tanh()
    }
}

impl Slip {
    /// Force on the robot \[N\], along and across, of a tyre under `load` \[N\] that slides with those velocities \[m/s\].
    pub(super) fn force(&self, load: f64, along: f64, across: f64) -> [f64; 2] {
        let most = self.friction * load;
        let sliding = along.hypot(across);
        let factor = self.stiffness / (1.0 + (self.stiffness * sliding / most).powi(2)).sqrt();
        [factor * along, factor * across]
    }

    /// Fastest rate of the part \[1/s\]: two tyres on the body, one on its wheel.
    pub(super) fn rate(&self, mass: f64, inertia: f64, radius: f64) -> f64 {
        self.stiffness * (2.0 / mass + radius * radius / inertia)
    }
}
