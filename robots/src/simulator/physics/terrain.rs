//! Ground that is not level: a slope, everywhere or on a strip of the floor.

use serde::{Deserialize, Serialize};

use super::{FINITE, Flaw, GRAVITY, first_flaw};

/// A slope.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Terrain {
    /// Angle of the slope \[rad\].
    pub slope: f64,
    /// Heading that leads straight uphill \[rad\].
    #[serde(default)]
    pub uphill: f64,
    /// Only between these places along x \[m\]; everywhere if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strip: Option<[f64; 2]>,
}

impl Terrain {
    pub(super) fn flaw(&self) -> Option<Flaw> {
        let [from, to] = self.strip.unwrap_or([0.0, 1.0]);
        first_flaw(&[
            ("slope", self.slope, self.slope.abs() < 1.0, "an angle below 1 rad"),
            ("uphill", self.uphill, true, FINITE),
            ("strip", from, true, FINITE),
            ("strip", to, to > from, "two places, the first the smaller"),
        ])
    }

    /// Gravity along and across the body per mass \[m/s²\], at a place \[m\] and a heading \[rad\].
    pub(super) fn pull(&self, x: f64, phi: f64) -> [f64; 2] {
        if self.strip.is_some_and(|[from, to]| x < from || x > to) {
            return [0.0, 0.0];
        }
        let (sin, cos) = (phi - self.uphill).sin_cos();
        let downhill = GRAVITY * self.slope.sin();
        [-downhill * cos, downhill * sin]
    }
}
