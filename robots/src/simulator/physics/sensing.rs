//! The way of measurements out of the robot: they are old when they come, and their stamps are not exact.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use super::super::plant::Sides;
use super::{Flaw, NOT_NEGATIVE, first_flaw};

/// The way of measurements.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Sensing {
    /// Age of what is measured \[s\].
    pub delay: f64,
    /// Standard deviation of the stamps \[s\]; no stamp goes back.
    pub stamp_jitter: f64,
}

impl Sensing {
    pub(super) fn flaw(&self) -> Option<Flaw> {
        first_flaw(&[
            ("delay", self.delay, (0.0..=10.0).contains(&self.delay), "between 0 and 10 (it is in seconds)"),
            ("stamp_jitter", self.stamp_jitter, self.stamp_jitter >= 0.0, NOT_NEGATIVE),
        ])
    }
}

/// What sensors look at.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(in super::super) struct Observed {
    /// Angles of the shafts that carry the encoders, seen at the wheels \[rad\].
    pub(in super::super) angles: Sides,
    /// Their speeds \[rad/s\].
    pub(in super::super) speeds: Sides,
    /// Where the robot is: x, y \[m\], heading \[rad\].
    pub(in super::super) pose: [f64; 3],
}

impl Observed {
    fn between(&self, other: &Self, share: f64) -> Self {
        let mix = |a: f64, b: f64| a + share * (b - a);
        let sides = |a: Sides, b: Sides| Sides { left: mix(a.left, b.left), right: mix(a.right, b.right) };
        Self {
            angles: sides(self.angles, other.angles),
            speeds: sides(self.speeds, other.speeds),
            pose: std::array::from_fn(|i| mix(self.pose[i], other.pose[i])),
        }
    }
}

/// The recent past, as far back as sensors look.
#[derive(Debug, Clone)]
pub(in super::super) struct History {
    delay: f64,
    past: VecDeque<(f64, Observed)>,
}

impl History {
    pub(in super::super) fn new(delay: f64) -> Self {
        Self { delay, past: VecDeque::from([(0.0, Observed::default())]) }
    }

    pub(in super::super) fn push(&mut self, t: f64, observed: Observed) {
        self.past.push_back((t, observed));
        // One entry from before the time looked at is kept, to look between.
        while self.past.len() > 2 && self.past[1].0 <= t - self.delay {
            self.past.pop_front();
        }
    }

    /// What was there `delay` ago; before its history, which begins at rest at time zero, the robot stood.
    pub(in super::super) fn seen(&self, t: f64) -> Observed {
        let at = t - self.delay;
        let after = self.past.partition_point(|(time, _)| *time <= at);
        match (after.checked_sub(1).and_then(|i| self.past.get(i)), self.past.get(after)) {
            (Some((t0, a)), Some((t1, b))) if t1 > t0 => a.between(b, (at - t0) / (t1 - t0)),
            (Some((_, a)), _) => *a,
            (None, Some((_, b))) => *b,
            (None, None) => Observed::default(),
        }
    }
}
