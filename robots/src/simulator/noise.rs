//! Randomness, each source with a stream of its own: switching one source on leaves the others' numbers as they were.

use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

/// Sources of randomness. The numbers belong to recorded seeds: never renumber.
#[derive(Debug, Clone, Copy)]
pub(super) enum Source {
    Period = 1,
    LeftWheel = 2,
    RightWheel = 3,
    V = 4,
    Omega = 5,
    Stamp = 6,
}

/// The generator of one source under a seed.
pub(super) fn stream(seed: u64, source: Source) -> StdRng {
    // An odd multiplier keeps all sources of all nearby seeds apart; `seed_from_u64` mixes the bits.
    StdRng::seed_from_u64(seed.wrapping_add((source as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)))
}

/// A uniform number in [-1, 1).
pub(super) fn uniform(rng: &mut StdRng) -> f64 {
    rng.random_range(-1.0..1.0)
}

/// Gaussian noise of standard deviation σ whose samples correlate by ρ from one to the next:
/// n_k = ρ n_k−1 + σ √(1 − ρ²) ε_k, started in its stationary state.
#[derive(Debug, Clone)]
pub(super) struct Noise {
    sigma: f64,
    rho: f64,
    last: Option<f64>,
    rng: StdRng,
}

impl Noise {
    pub(super) fn new(sigma: f64, rho: f64, rng: StdRng) -> Self {
        Self { sigma, rho, last: None, rng }
    }

    /// The next sample.
    pub(super) fn next(&mut self) -> f64 {
        if self.sigma == 0.0 {
            return 0.0;
        }
        let epsilon: f64 = StandardNormal.sample(&mut self.rng);
        let sample = match self.last {
            None => self.sigma * epsilon,
            Some(last) => self.rho * last + self.sigma * (1.0 - self.rho * self.rho).sqrt() * epsilon,
        };
        self.last = Some(sample);
        sample
    }
}
