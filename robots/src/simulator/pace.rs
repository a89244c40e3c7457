//! Ties the simulator to the world's clock.

use std::time::{Duration, Instant};

/// Lets simulated time pass no faster than real time. Time lost is not made up for: a robot does not hurry either.
#[derive(Debug, Default)]
pub(super) struct Pace {
    /// When the period before ended.
    last: Option<Instant>,
}

impl Pace {
    /// Waits until `interval` \[s\] have passed since the end of the wait before.
    pub(super) fn wait(&mut self, interval: f64) {
        let now = Instant::now();
        let Ok(interval) = Duration::try_from_secs_f64(interval) else { return };
        let due = self.last.map_or(now + interval, |last| last + interval);
        if due > now {
            std::thread::sleep(due - now);
        }
        self.last = Some(due.max(now));
    }
}
