//! Sums over e^{2πi f x} at one frequency after the other.

use std::f64::consts::TAU;

use super::bursts::FALSE_ALARM;

/// The phases of some places at a frequency, carried to the next one by a product each.
pub(super) struct Sweep {
    phase: Vec<(f64, f64)>,
    turn: Vec<(f64, f64)>,
}

impl Sweep {
    /// At the first frequency.
    pub(super) fn new(places: &[f64], first: f64, step: f64) -> Self {
        let at = |frequency: f64| places.iter().map(|x| (TAU * frequency * x).sin_cos()).collect();
        Self { phase: at(first), turn: at(step) }
    }

    /// Length of the sum.
    pub(super) fn sum(&self) -> f64 {
        let (s, c) = self.phase.iter().fold((0.0, 0.0), |(s, c), p| (s + p.0, c + p.1));
        f64::hypot(s, c)
    }

    /// Square of the length of the sum with a weight at each place.
    pub(super) fn weighted(&self, weights: &[f64]) -> f64 {
        let (s, c) = weights.iter().zip(&self.phase).fold((0.0, 0.0), |(s, c), (w, p)| (s + w * p.0, c + w * p.1));
        s * s + c * c
    }

    /// The same at so many frequencies, the largest of several weightings.
    pub(super) fn powers(mut self, weightings: &[Vec<f64>], count: usize) -> Vec<f64> {
        let mut all = Vec::with_capacity(count);
        for _ in 0..count {
            all.push(weightings.iter().map(|weights| self.weighted(weights)).fold(0.0, f64::max));
            self.advance();
        }
        all
    }

    /// On to the next frequency.
    pub(super) fn advance(&mut self) {
        for (p, t) in self.phase.iter_mut().zip(&self.turn) {
            *p = (p.0 * t.1 + p.1 * t.0, p.1 * t.1 - p.0 * t.0);
        }
    }
}

/// Power of series at each of so many frequencies over some places, with a weight at each place, the largest of the series: twice a log-likelihood ratio of
/// a line there, of two degrees of freedom by chance, of series of unit variance.
pub(super) fn powers(series: &[Vec<f64>], places: &[f64], weight: Option<&[f64]>, [first, step]: [f64; 2], count: usize) -> Vec<f64> {
    let weighted: Vec<Vec<f64>> = match weight {
        Some(weight) => series.iter().map(|s| s.iter().zip(weight).map(|(x, w)| x * w).collect()).collect(),
        None => series.to_vec(),
    };
    let norm = weight.map_or(places.len() as f64, |w| w.iter().map(|x| x * x).sum::<f64>()) / 2.0;
    let mut powers = Sweep::new(places, first, step).powers(&weighted, count);
    powers.iter_mut().for_each(|power| *power /= norm.max(f64::MIN_POSITIVE));
    powers
}

/// The strongest line and its power, if it is beyond chance in so many looks.
pub(super) fn strongest(power: &[f64], looks: usize) -> Option<(usize, f64)> {
    let (at, &largest) = power.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
    (largest >= -2.0 * (FALSE_ALARM / looks as f64).ln()).then_some((at, largest))
}

/// A line stands out from its neighbourhood by this factor.
const CONTRAST: f64 = 4.0;

/// Whether a power stands out of what most of those around it are, within so many to either side.
pub(super) fn stands_out(power: &[f64], at: usize, reach: usize) -> bool {
    let around = at.saturating_sub(reach)..(at + reach + 1).min(power.len());
    let mut near: Vec<f64> = around.filter(|k| k.abs_diff(at) > 2).map(|k| power[k]).collect();
    near.sort_by(f64::total_cmp);
    power[at] > CONTRAST * near.get(near.len() * 9 / 10).copied().unwrap_or(0.0)
}
