//! A castor: a wheel on a trailing arm that swivels by itself. Its arm turns into the motion; its bearing and its tyre resist.

use serde::{Deserialize, Serialize};

use super::contact::{CREEP, CREEP_TURN};
use super::{FINITE, Flaw, NOT_NEGATIVE, POSITIVE, first_flaw};

/// A castor without mass.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Castor {
    /// Place of its pivot ahead of the axle \[m\]; negative is behind.
    pub x: f64,
    /// From the pivot back to the contact point \[m\].
    pub trail: f64,
    /// Force against its rolling \[N\].
    #[serde(default)]
    pub drag: f64,
    /// Torque of the bearing against swivelling \[N m\].
    #[serde(default)]
    pub swivel: f64,
    /// Angle of its rolling direction at the start, counter-clockwise from ahead \[rad\].
    #[serde(default)]
    pub angle: f64,
}

impl Castor {
    pub(super) fn flaw(&self) -> Option<Flaw> {
        first_flaw(&[
            ("x", self.x, true, FINITE),
            ("trail", self.trail, self.trail > 0.0, POSITIVE),
            ("drag", self.drag, self.drag >= 0.0, NOT_NEGATIVE),
            ("swivel", self.swivel, self.swivel >= 0.0, NOT_NEGATIVE),
            ("angle", self.angle, true, FINITE),
        ])
    }

    /// Force on the body along and across \[N\], moment about the axle's middle \[N m\], and rate of its angle \[rad/s\], for the body's
    /// velocities along and across at the axle \[m/s\] and its turning \[rad/s\].
    ///
    /// The contact point moves along the rolling direction only: δ' = n·v_pivot/trail − ω. The bearing's torque is balanced by a side
    /// force at the contact point, as the castor has no mass.
    pub(super) fn act(&self, angle: f64, v: f64, across: f64, omega: f64) -> ([f64; 2], f64, f64) {
        let (sin, cos) = angle.sin_cos();
        let pivot = [v, across + omega * self.x];
        let along = cos * pivot[0] + sin * pivot[1];
        let sideways = cos * pivot[1] - sin * pivot[0];
        let rate = sideways / self.trail - omega;
        let drag = -self.drag * (along / CREEP).tanh();
        let torque = -self.swivel * (rate / CREEP_TURN).tanh();
        let side = torque / self.trail;
        let force = [drag * cos - side * sin, drag * sin + side * cos];
        (force, self.x * force[1] - torque, rate)
    }

    /// Fastest rate of the part \[1/s\] up to a speed \[m/s\].
    pub(super) fn rate(&self, speed: f64) -> f64 {
        speed / self.trail
    }
}
