//! Draws robots, drives and noise at random.

pub mod excitation;
pub mod robot;

use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

/// A generator for one purpose: `words` say which, so that no two purposes share a stream.
pub fn stream(seed: u64, words: &[u64]) -> StdRng {
    let mut state = seed;
    for &word in words {
        state = mix(state ^ mix(word));
    }
    StdRng::seed_from_u64(state)
}

/// SplitMix64's output function.
fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 31)
}

/// Log-uniform between two positive numbers.
pub fn log_uniform<R: Rng>(rng: &mut R, from: f64, to: f64) -> f64 {
    (rng.random_range(from.ln()..to.ln())).exp()
}

/// Plus or minus one.
pub fn sign<R: Rng>(rng: &mut R) -> f64 {
    if rng.random::<bool>() { 1.0 } else { -1.0 }
}

/// One of several.
pub fn pick<'a, T, R: Rng>(rng: &mut R, from: &'a [T]) -> &'a T {
    &from[rng.random_range(0..from.len())]
}
