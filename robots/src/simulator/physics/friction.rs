//! Dry friction of gears and bearings: bristles that bend before they slide (Canudas de Wit et al. 1995, "A new model for control of
//! systems with friction", equations 1 to 4).
//!
//! z' = ω − σ0 |ω| z / g(ω), torque = σ0 z + σ1 z', g(ω) = Tc + (Ts − Tc) exp(−(ω/ωs)²). At rest the bristles hold like springs up to the
//! breakaway torque; sliding they give Coulomb friction, and between the two the Stribeck curve.

use serde::{Deserialize, Serialize};

use super::{Flaw, NOT_NEGATIVE, POSITIVE, first_flaw};

/// Dry friction of each wheel's drive, seen at the wheel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Friction {
    /// Tc, torque while sliding \[N m\].
    pub coulomb: f64,
    /// Ts, torque at which it breaks away \[N m\]; Tc if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub breakaway: Option<f64>,
    /// ωs, wheel speed at which the Stribeck curve has fallen \[rad/s\].
    #[serde(default = "stribeck")]
    pub stribeck_speed: f64,
    /// Bend of the bristles at breakaway \[rad\].
    #[serde(default = "bend")]
    pub bend: f64,
    /// Factor on the left wheel.
    #[serde(default = "one")]
    pub left: f64,
    /// Factor on the right wheel.
    #[serde(default = "one")]
    pub right: f64,
    /// Factor on a wheel that turns backwards.
    #[serde(default = "one")]
    pub backward: f64,
}

fn stribeck() -> f64 {
    0.5
}

fn bend() -> f64 {
    2e-3
}

fn one() -> f64 {
    1.0
}

impl Friction {
    pub(super) fn flaw(&self) -> Option<Flaw> {
        let breakaway = self.breakaway.unwrap_or(self.coulomb);
        first_flaw(&[
            ("coulomb", self.coulomb, self.coulomb >= 0.0, NOT_NEGATIVE),
            ("breakaway", breakaway, breakaway >= self.coulomb, "at least `coulomb`"),
            ("stribeck_speed", self.stribeck_speed, self.stribeck_speed > 0.0, POSITIVE),
            ("bend", self.bend, self.bend > 0.0, POSITIVE),
            ("left", self.left, self.left >= 0.0, NOT_NEGATIVE),
            ("right", self.right, self.right >= 0.0, NOT_NEGATIVE),
            ("backward", self.backward, self.backward >= 0.0, NOT_NEGATIVE),
        ])
    }

    /// Torque against the motion of a wheel at `speed` \[rad/s\] with its bristles bent by `bent` \[rad\], and their rate \[rad/s\].
    /// `factor` is the side's own.
    pub(super) fn torque(&self, factor: f64, speed: f64, bent: f64, inertia: f64) -> (f64, f64) {
        let direction = if speed < 0.0 { self.backward } else { 1.0 };
        let scale = factor * direction;
        let (coulomb, breakaway) = (scale * self.coulomb, scale * self.breakaway.unwrap_or(self.coulomb));
        if breakaway <= 0.0 {
            return (0.0, 0.0);
        }
        let stiffness = self.stiffness() * factor;
        let level = coulomb + (breakaway - coulomb) * (-(speed / self.stribeck_speed).powi(2)).exp();
        let rate = speed - stiffness * speed.abs() * bent / level.max(1e-12);
        // Bristles damped well enough that the wheel does not ring on them while they hold.
        let damping = (stiffness * inertia).sqrt();
        let fades = (-(speed / self.stribeck_speed).powi(2)).exp();
        (stiffness * bent + damping * fades * rate, rate)
    }

    fn stiffness(&self) -> f64 {
        self.breakaway.unwrap_or(self.coulomb).max(1e-9) / self.bend
    }

    /// Fastest rate of the part \[1/s\], on an inertia and up to a wheel speed \[rad/s\].
    pub(super) fn rate(&self, inertia: f64, speed: f64) -> f64 {
        let factor = self.left.max(self.right);
        (2.0 * (factor * self.stiffness() / inertia).sqrt())
            .max(speed / self.bend * self.breakaway.unwrap_or(self.coulomb) / self.coulomb.max(1e-9))
    }
}
