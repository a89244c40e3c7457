//! Wheels as they are: radii that differ, wheels off their centre, a track other than the firmware believes.

use serde::{Deserialize, Serialize};

use super::super::plant::{PlantConstants, Sides};
use super::{FINITE, Flaw, POSITIVE, first_flaw};

/// True wheels beside the believed ones of `plant`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Wheels {
    /// Radius of the left wheel over the believed one.
    pub left: f64,
    /// Radius of the right wheel over the believed one.
    pub right: f64,
    /// Distance between the contact points over the believed one.
    pub track: f64,
    /// How far the left wheel's hub lies off its centre, over the radius.
    pub left_eccentricity: f64,
    /// The same of the right wheel.
    pub right_eccentricity: f64,
    /// Angle from the start at which the left wheel's radius is largest \[rad\].
    pub left_phase: f64,
    /// The same of the right wheel \[rad\].
    pub right_phase: f64,
}

impl Default for Wheels {
    fn default() -> Self {
        Self { left: 1.0, right: 1.0, track: 1.0, left_eccentricity: 0.0, right_eccentricity: 0.0, left_phase: 0.0, right_phase: 0.0 }
    }
}

impl Wheels {
    pub(super) fn flaw(&self) -> Option<Flaw> {
        let small = |e: f64| (0.0..0.5).contains(&e);
        first_flaw(&[
            ("left", self.left, self.left > 0.0, POSITIVE),
            ("right", self.right, self.right > 0.0, POSITIVE),
            ("track", self.track, self.track > 0.0, POSITIVE),
            ("left_eccentricity", self.left_eccentricity, small(self.left_eccentricity), "at least 0 and below 0.5"),
            ("right_eccentricity", self.right_eccentricity, small(self.right_eccentricity), "at least 0 and below 0.5"),
            ("left_phase", self.left_phase, true, FINITE),
            ("right_phase", self.right_phase, true, FINITE),
        ])
    }

    /// Rolling radius of each wheel at its angle \[m\], and its change with the angle \[m/rad\].
    pub(super) fn radii(&self, c: &PlantConstants, angle: Sides) -> (Sides, Sides) {
        let of = |scale: f64, eccentricity: f64, angle: f64, phase: f64| {
            let (sin, cos) = (angle - phase).sin_cos();
            let mean = scale * c.wheel_radius;
            (mean * (1.0 + eccentricity * cos), -mean * eccentricity * sin)
        };
        let left = of(self.left, self.left_eccentricity, angle.left, self.left_phase);
        let right = of(self.right, self.right_eccentricity, angle.right, self.right_phase);
        (Sides { left: left.0, right: right.0 }, Sides { left: left.1, right: right.1 })
    }
}
