//! Candidates for an excitation: for each command a train of levels, each held for a while, about which it may swing.
//!
//! On a floor a candidate goes there and back: each outing is followed by its own commands backwards in time and negated, which
//! leads a robot that turns and drives back along its path.

use std::f64::consts::TAU;

use rand::Rng;
use rand::rngs::StdRng;

/// Holds last between this many control periods...
const SHORTEST_HOLD: f64 = 3.0;
/// ...and this many seconds.
const LONGEST_HOLD: f64 = 6.0;

/// One level of one command, as a share of its reach.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Level {
    start: f64,
    value: f64,
    /// A swing about the level: share of the reach, and frequency \[Hz\].
    swing: (f64, f64),
}

/// Length of an outing \[s\], from and to.
const OUTING: (f64, f64) = (1.0, 8.0);

/// A candidate: the levels of each command by time, and the length of an outing \[s\] if it goes there and back.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Candidate {
    trains: Vec<Vec<Level>>,
    outing: Option<f64>,
}

impl Candidate {
    /// A random candidate for so many commands, over `duration` \[s\]; `returning` makes it go there and back.
    pub(super) fn draw(rng: &mut StdRng, commands: usize, period: f64, duration: f64, returning: bool) -> Self {
        let shortest = SHORTEST_HOLD * period;
        // One typical length of hold a candidate and command: fast ones show lags, slow ones gains.
        let train = |rng: &mut StdRng| {
            let typical = shortest * (LONGEST_HOLD / shortest).max(1.0).powf(rng.random_range(0.0..1.0));
            let mut levels = Vec::new();
            let mut start = 0.0;
            while start < duration {
                levels.push(Level::draw(rng, start));
                start += (typical * rng.random_range(0.5..1.5_f64)).max(shortest);
            }
            levels
        };
        let trains = (0..commands).map(|_| train(rng)).collect();
        let outing = returning.then(|| OUTING.0 * (OUTING.1 / OUTING.0).powf(rng.random_range(0.0..1.0)));
        Self { trains, outing }
    }

    /// The same with some of its levels drawn again.
    pub(super) fn changed(mut self, rng: &mut StdRng) -> Self {
        for train in &mut self.trains {
            let share: f64 = rng.random_range(0.0..0.3);
            for level in train.iter_mut() {
                if rng.random_range(0.0..1.0) < share {
                    *level = Level { start: level.start, ..Level::draw(rng, level.start) };
                }
            }
        }
        self
    }

    /// Writes the commands at a time \[s\].
    pub(super) fn command(&self, t: f64, reach: &[f64], command: &mut [f64]) {
        let (t, sign) = self.outing.map_or((t, 1.0), |outing| folded(t, outing));
        for ((train, reach), command) in self.trains.iter().zip(reach).zip(command) {
            let at = train.partition_point(|level| level.start <= t).max(1) - 1;
            *command = sign * train.get(at).map_or(0.0, |level| level.at(t)).clamp(-1.0, 1.0) * reach;
        }
    }
}

/// There and back: each stretch of the levels' time, of length `outing`, forwards and then backwards and negated.
fn folded(t: f64, outing: f64) -> (f64, f64) {
    let (round, within) = ((t / (2.0 * outing)).floor(), t % (2.0 * outing));
    let begin = round * outing;
    if within < outing { (begin + within, 1.0) } else { (begin + 2.0 * outing - within, -1.0) }
}

impl Level {
    fn draw(rng: &mut StdRng, start: f64) -> Self {
        // Extremes tell most, so half of the levels are at one.
        let value = match rng.random_range(0..4) {
            0 => 1.0,
            1 => -1.0,
            _ => rng.random_range(-1.0..1.0),
        };
        let swing = if rng.random_range(0..3) == 0 { (rng.random_range(0.1..0.6), rng.random_range(0.1..1.0)) } else { (0.0, 1.0) };
        Self { start, value, swing }
    }

    fn at(&self, t: f64) -> f64 {
        self.value + self.swing.0 * (TAU * self.swing.1 * (t - self.start)).sin()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn an_outing_leads_back_to_where_it_began() {
        let candidate = Candidate::draw(&mut StdRng::seed_from_u64(4), 2, 0.1, 60.0, true);
        let outing = candidate.outing.unwrap();
        let (mut x, mut y, mut phi, mut farthest) = (0.0, 0.0, 0.0, 0.0_f64);
        let steps = 4000;
        let dt = 2.0 * outing / f64::from(steps);
        for k in 0..steps {
            let mut c = [0.0; 2];
            candidate.command((f64::from(k) + 0.5) * dt, &[0.5, 1.0], &mut c);
            let (sin, cos) = (phi + 0.5 * dt * c[1]).sin_cos();
            (x, y, phi) = (x + dt * c[0] * cos, y + dt * c[0] * sin, phi + dt * c[1]);
            farthest = farthest.max(f64::hypot(x, y));
        }
        assert!(f64::hypot(x, y) < 1e-6 && phi.abs() < 1e-6 && farthest > 0.1, "{x} {y} {phi} {farthest}");
    }
}
