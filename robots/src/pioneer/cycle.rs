//! When a server packet was made. Packets carry no time, and arrive 10 to 30 ms late by chance; the robot makes them at
//! a steady rate. Its time is therefore the count of its cycles times their length, and the arrivals only say how long a
//! cycle really is and whether one was lost.

/// Arrivals before their slope is more exact than the length that the firmware states.
const LEAST_ARRIVALS: f64 = 100.0;
/// A robot's crystal is not off by more; arrivals that say so are of a loaded machine or of a clock that is not real.
const MOST_DEVIATION: f64 = 0.02;

/// The robot's clock, in cycles.
#[derive(Debug, Clone)]
pub(super) struct CycleClock {
    nominal: f64,
    time: f64,
    cycles: u64,
    fit: Line,
}

impl CycleClock {
    /// A clock of that nominal cycle \[s\].
    pub(super) fn new(nominal: f64) -> Self {
        Self { nominal, time: 0.0, cycles: 0, fit: Line::default() }
    }

    /// Takes a packet that arrived `arrival` seconds after the first; `damaged` if bytes were lost since the one before.
    /// Returns the time at which it was made.
    pub(super) fn tick(&mut self, arrival: f64, damaged: bool) -> f64 {
        let cycle = self.cycle();
        let passed = if self.fit.count == 0.0 {
            0
        } else if damaged {
            // Only then may a cycle be missing: a line that is merely late delivers all of them.
            let expected = self.fit.at(self.cycles as f64, self.nominal);
            ((arrival - expected) / cycle).round().max(1.0) as u64
        } else {
            1
        };
        self.cycles += passed;
        self.time += passed as f64 * cycle;
        self.fit.add(self.cycles as f64, arrival);
        self.time
    }

    /// Length of a cycle \[s\], as well as it is known.
    pub(super) fn cycle(&self) -> f64 {
        match self.fit.slope() {
            Some(slope) if self.fit.count >= LEAST_ARRIVALS && (slope / self.nominal - 1.0).abs() <= MOST_DEVIATION => slope,
            _ => self.nominal,
        }
    }

    /// Time of the last packet \[s\].
    pub(super) fn time(&self) -> f64 {
        self.time
    }
}

/// A line fitted by least squares as the points come.
#[derive(Debug, Clone, Default)]
struct Line {
    count: f64,
    mean: [f64; 2],
    /// Sums of (x − mean x)² and (x − mean x)(y − mean y).
    moments: [f64; 2],
}

impl Line {
    fn add(&mut self, x: f64, y: f64) {
        self.count += 1.0;
        let [dx, dy] = [x - self.mean[0], y - self.mean[1]];
        self.mean[0] += dx / self.count;
        self.mean[1] += dy / self.count;
        self.moments[0] += dx * (x - self.mean[0]);
        self.moments[1] += dx * (y - self.mean[1]);
    }

    fn slope(&self) -> Option<f64> {
        (self.moments[0] > 0.0).then(|| self.moments[1] / self.moments[0])
    }

    /// The line's value, with another slope than its own.
    fn at(&self, x: f64, slope: f64) -> f64 {
        self.mean[1] + slope * (x - self.mean[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Delays without a pattern that a fit could follow, in [0, 1).
    fn noise(k: u64) -> f64 {
        (k.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 11) as f64 / (1_u64 << 53) as f64
    }

    #[test]
    fn late_arrivals_do_not_move_the_stamps() {
        let mut clock = CycleClock::new(0.1);
        // Cycles of 100.3 ms, each delivered up to 30 ms late.
        let times: Vec<f64> = (0..3000).map(|k| clock.tick(0.1003 * k as f64 + 0.03 * noise(k), false)).collect();
        for pair in times[200..].windows(2) {
            assert!((pair[1] - pair[0] - 0.1003).abs() < 1e-4, "a cycle of {} s", pair[1] - pair[0]);
        }
        assert!((times[2999] - times[999] - 2000.0 * 0.1003).abs() < 2e-3);
    }

    #[test]
    fn a_burst_after_a_stall_is_counted_and_not_timed() {
        let mut clock = CycleClock::new(0.1);
        for k in 0..50 {
            clock.tick(0.1 * f64::from(k), false);
        }
        for arrival in [5.4, 5.4, 5.4, 5.4, 5.4] {
            clock.tick(arrival, false);
        }
        assert!((clock.time() - 5.4).abs() < 1e-9, "{}", clock.time());
    }

    #[test]
    fn a_damaged_stream_shows_how_many_cycles_are_missing() {
        let mut clock = CycleClock::new(0.1);
        for k in 0..50 {
            clock.tick(0.1 * f64::from(k) + 0.01, false);
        }
        let before = clock.time();
        let after = clock.tick(5.3, true);
        assert!((after - before - 0.4).abs() < 1e-9, "{after} after {before}");
        assert!((clock.tick(5.4, true) - after - 0.1).abs() < 1e-9, "damage without a gap loses nothing");
    }

    #[test]
    fn a_clock_that_is_not_real_keeps_the_firmwares_cycle() {
        let mut clock = CycleClock::new(0.1);
        for k in 0..1000 {
            clock.tick(1e-4 * f64::from(k), false);
        }
        assert!((clock.cycle() - 0.1).abs() < 1e-12 && (clock.time() - 99.9).abs() < 1e-9);
    }
}
