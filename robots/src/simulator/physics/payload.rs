//! A load that is put on the robot on its way, and perhaps taken off. It comes with the robot's own velocity, so nothing jerks.

use serde::{Deserialize, Serialize};

use super::{FINITE, Flaw, NOT_NEGATIVE, POSITIVE, first_flaw};

/// A load.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Payload {
    /// Its mass \[kg\].
    pub mass: f64,
    /// Time at which it is put on \[s\].
    pub time: f64,
    /// Time at which it is taken off \[s\]; never if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<f64>,
    /// Its centre ahead of the axle \[m\].
    #[serde(default)]
    pub x: f64,
    /// Its centre left of the middle \[m\].
    #[serde(default)]
    pub y: f64,
    /// Its inertia about the vertical through its centre \[kg m²\].
    #[serde(default)]
    pub inertia: f64,
}

impl Payload {
    pub(super) fn flaw(&self) -> Option<Flaw> {
        let until = self.until.unwrap_or(self.time + 1.0);
        first_flaw(&[
            ("mass", self.mass, self.mass > 0.0, POSITIVE),
            ("time", self.time, self.time >= 0.0, NOT_NEGATIVE),
            ("until", until, until > self.time, "later than `time`"),
            ("x", self.x, true, FINITE),
            ("y", self.y, true, FINITE),
            ("inertia", self.inertia, self.inertia >= 0.0, NOT_NEGATIVE),
        ])
    }

    pub(super) fn is_on(&self, t: f64) -> bool {
        t >= self.time && self.until.is_none_or(|until| t < until)
    }

    /// The next time after `t` at which it is put on or taken off.
    pub(super) fn next_change(&self, t: f64) -> Option<f64> {
        [Some(self.time), self.until].into_iter().flatten().find(|change| *change > t)
    }
}
