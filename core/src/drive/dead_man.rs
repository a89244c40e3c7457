//! A dead man's switch: motion is allowed as long as somebody keeps saying so.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Held while the last [`press`](Self::press) is not older than the limit. One thread presses, another asks.
#[derive(Debug)]
pub struct DeadMan {
    born: Instant,
    limit: Duration,
    /// Nanoseconds from `born` until which it is held; zero before the first press.
    until: AtomicU64,
}

impl DeadMan {
    /// A switch that nobody holds. `limit` is how long one press holds.
    pub fn new(limit: Duration) -> Self {
        Self { born: Instant::now(), limit, until: AtomicU64::new(0) }
    }

    /// Says once more that somebody is there.
    pub fn press(&self) {
        let until = self.born.elapsed().saturating_add(self.limit);
        self.until.store(u64::try_from(until.as_nanos()).unwrap_or(u64::MAX), Ordering::Release);
    }

    /// Lets go at once.
    pub fn release(&self) {
        self.until.store(0, Ordering::Release);
    }

    /// True while it is held.
    pub fn held(&self) -> bool {
        self.born.elapsed().as_nanos() < u128::from(self.until.load(Ordering::Acquire))
    }

    /// How long one press holds.
    pub fn limit(&self) -> Duration {
        self.limit
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_held_only_while_pressed_again_and_again() {
        let switch = DeadMan::new(Duration::from_millis(50));
        assert!(!switch.held());
        switch.press();
        assert!(switch.held());
        std::thread::sleep(Duration::from_millis(60));
        assert!(!switch.held());
        switch.press();
        switch.release();
        assert!(!switch.held());
    }
}
