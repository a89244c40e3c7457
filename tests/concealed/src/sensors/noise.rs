//! Measurement noise of several characters, all of a given standard deviation.

use rand::Rng;
use rand_distr::{Distribution, StandardNormal, StudentT};

/// The character of a noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Character {
    /// Independent Gaussian values.
    White,
    /// First-order autoregressive with the given coefficient.
    Coloured(f64),
    /// Independent Student t values with three degrees of freedom.
    Heavy,
    /// Independent Gaussian values and rounding: step such that rounding makes up 0.6 of the standard deviation.
    Quantised,
}

/// Share of the standard deviation that is rounding in [`Character::Quantised`].
const ROUNDED: f64 = 0.6;

impl Character {
    /// The word the key uses.
    pub fn word(&self) -> &'static str {
        match self {
            Character::White => "white",
            Character::Coloured(_) => "coloured",
            Character::Heavy => "heavy",
            Character::Quantised => "quantised",
        }
    }

    /// Correlation from one sample to the next.
    pub fn memory(&self) -> f64 {
        if let Character::Coloured(rho) = self { *rho } else { 0.0 }
    }

    /// Adds noise of standard deviation `sigma` to `values`.
    pub fn add<R: Rng>(&self, values: &mut [f64], sigma: f64, rng: &mut R) {
        let normal = |rng: &mut R| -> f64 { StandardNormal.sample(rng) };
        match *self {
            Character::White => values.iter_mut().for_each(|y| *y += sigma * normal(rng)),
            Character::Coloured(rho) => {
                let fresh = (1.0 - rho * rho).sqrt();
                let mut e = normal(rng);
                for y in values {
                    *y += sigma * e;
                    e = rho * e + fresh * normal(rng);
                }
            }
            Character::Heavy => {
                // Three degrees of freedom: variance 3.
                let scale = sigma / 3f64.sqrt();
                if let Ok(student) = StudentT::new(3.0) {
                    values.iter_mut().for_each(|y| *y += scale * student.sample(rng));
                }
            }
            Character::Quantised => {
                let step = ROUNDED * sigma * 12f64.sqrt();
                let rest = (1.0 - ROUNDED * ROUNDED).sqrt() * sigma;
                values.iter_mut().for_each(|y| *y = ((*y + rest * normal(rng)) / step).round() * step);
            }
        }
    }
}
