//! What a readout of few digits adds to a recording on average, taken off.
//!
//! A value x with noise of deviation σ that is rounded to multiples of q is recorded as x + b(x) + chance. b is a saw of period q that noise of half a step
//! and more blurs to nothing (Widrow and Kollár, *Quantization Noise*, 2008, on dither). Behind less of it b(x) stays as long as the robot keeps its
//! speed: no noise forgets so slowly, and motion would be made of it. It is known as soon as the motion is known to a part of a step. So where the
//! values of an output are multiples of a step, and what a first diagnosis leaves is decisively smaller without b of the motion that it simulates, the
//! recording is diagnosed again without it. How far chance scatters depends on x as well, from nothing amid a step to half a step at its edge.

use std::f64::consts::SQRT_2;

use statrs::function::erf::erfc;
use wheelwright_core::Dataset;

use crate::comparison::Channels;
use crate::diagnose::DECISIVE;

/// Distance of two values, as a share of the largest, that is the arithmetic of whoever wrote them.
const SAME: f64 = 1e-9;
/// Distance of a value from its multiple, as a share of a step, that printed digits leave.
const PRINTED: f64 = 0.1;
/// Deviations of the noise before the rounding that are tried, as shares of a step: the least is what a simulated motion is off by, behind the most nothing
/// shows.
const NOISE: [f64; 7] = [0.1, 0.14, 0.2, 0.28, 0.4, 0.56, 0.8];
/// Least probability of a value: others are mishaps.
const MISHAP: f64 = 1e-6;
/// Multiples to either side that a value may be rounded to.
const AWAY: i32 = 5;

/// The step of which all values of an output are multiples; `None` where they are not.
pub(crate) fn step(data: &Dataset, output: usize) -> Option<f64> {
    step_of(data.stretches.iter().flat_map(|s| s.outputs[output].iter().copied()).collect())
}

/// The largest number of which all values are multiples: the least distance of two of them, as all together tell it.
fn step_of(mut values: Vec<f64>) -> Option<f64> {
    values.iter_mut().for_each(|x| *x = x.abs());
    values.sort_by(f64::total_cmp);
    let same = SAME * values.last()?;
    values.dedup_by(|b, a| *b - *a <= same);
    let mut step = values.windows(2).map(|w| w[1] - w[0]).reduce(f64::min)?;
    // From the least multiple up: a step that is known to a share is known to the same share of each.
    let (mut products, mut squares) = (0.0, 0.0);
    for x in &values {
        let multiple = (x / step).round();
        if (x - multiple * step).abs() > PRINTED * step {
            return None;
        }
        (products, squares) = (products + multiple * x, squares + multiple * multiple);
        if squares > 0.0 {
            step = products / squares;
        }
    }
    Some(step)
}

/// A readout that rounds.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Readout {
    step: f64,
    /// Deviation of the noise before the rounding. What a simulated motion is off by blurs as noise does.
    deviation: f64,
}

impl Readout {
    /// The likeliest one of so much a step, by recorded and simulated values.
    fn likeliest(step: f64, values: &[(f64, f64)]) -> Self {
        let likelihood = |readout: &Self| values.iter().map(|(y, x)| readout.probability(y - x).max(MISHAP).ln()).sum::<f64>();
        let tried = NOISE.map(|share| Self { step, deviation: share * step });
        let first = (f64::NEG_INFINITY, tried[0]);
        let better = |best: (f64, Self), readout| {
            let own = likelihood(&readout);
            if own > best.0 { (own, readout) } else { best }
        };
        tried.into_iter().fold(first, better).1
    }

    /// Probability that a value is rounded to a multiple so far from it.
    fn probability(&self, distance: f64) -> f64 {
        let below = |x: f64| 0.5 * erfc(-x / (self.deviation * SQRT_2));
        below(0.5 * self.step - distance.abs()) - below(-0.5 * self.step - distance.abs())
    }

    /// What is added to a value on average, and the variance about that.
    pub(crate) fn moments(&self, value: f64) -> (f64, f64) {
        let nearest = (value / self.step).round();
        let (mut all, mut first, mut second) = (0.0, 0.0, 0.0);
        for k in -AWAY..=AWAY {
            let distance = (nearest + f64::from(k)) * self.step - value;
            let share = self.probability(distance);
            (all, first, second) = (all + share, first + share * distance, second + share * distance * distance);
        }
        let mean = first / all;
        (mean, second / all - mean * mean)
    }
}

/// The readout of an output that is recorded in so much a step, where decisively less is left beside a simulation without what it adds on average.
pub(crate) fn readout(step: f64, data: &Dataset, simulated: &[Channels], output: usize) -> Option<Readout> {
    let rows = data.stretches.iter().zip(simulated);
    let values: Vec<(f64, f64)> = rows.flat_map(|(s, run)| s.outputs[output].iter().copied().zip(run[output].iter().copied())).collect();
    let left = |added: &dyn Fn(f64) -> f64| values.iter().map(|(y, x)| (y - x - added(*x)).powi(2)).sum::<f64>();
    let (plain, count) = (left(&|_| 0.0), values.len() as f64);
    // A fine step is blurred by whatever is left, and none is nothing.
    let coarse = count * step * step > plain;
    if !coarse {
        return None;
    }
    let readout = Readout::likeliest(step, &values);
    (count * (plain / left(&|x| readout.moments(x).0)).ln() > DECISIVE).then_some(readout)
}

/// A recording without what rounding adds on average, where that shows beside a simulation of it.
pub(crate) fn unrounded(data: &Dataset, simulated: &[Channels]) -> Option<Dataset> {
    let of = |output: usize| readout(step(data, output)?, data, simulated, output);
    let readouts: Vec<Option<Readout>> = (0..data.outputs.len()).map(of).collect();
    let mut read = data.clone();
    for (stretch, run) in read.stretches.iter_mut().zip(simulated) {
        for ((values, run), readout) in stretch.outputs.iter_mut().zip(run).zip(&readouts) {
            let Some(readout) = readout else { continue };
            values.iter_mut().zip(run).for_each(|(y, x)| *y -= readout.moments(*x).0);
        }
    }
    readouts.iter().any(Option::is_some).then_some(read)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

    use super::*;
    use crate::fixture::{Case, NOISE, normal};

    #[test]
    fn the_step_is_that_of_all_values() {
        assert_eq!(step_of(vec![0.3, -0.2, 0.5, 0.30000000000000004]).map(|q| (q * 1e6).round()), Some(1e5));
        // 0.0137, printed with four digits.
        let printed: Vec<f64> = (0..300).map(|k| (f64::from(k) * 0.013_723 * 1e4).round() / 1e4).collect();
        assert!((step_of(printed).unwrap() - 0.013_723).abs() < 1e-6);
        assert_eq!(step_of(vec![0.1, 0.2, 0.35]), None);
        assert_eq!(step_of(vec![1.0]), None);
    }

    #[test]
    fn what_rounding_adds_has_its_mean_and_its_variance() {
        let mut random = rand::SeedableRng::seed_from_u64(3);
        for (deviation, value) in [(0.2, 0.1), (0.2, 0.37), (0.12, 0.45), (0.5, 0.25)] {
            let rounded = |random: &mut rand::rngs::StdRng| (value + deviation * normal(random)).round();
            let all: Vec<f64> = (0..200_000).map(|_| rounded(&mut random) - value).collect();
            let mean = all.iter().sum::<f64>() / 2e5;
            let variance = all.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 2e5;
            let told = Readout { step: 1.0, deviation }.moments(value);
            assert!((mean - told.0).abs() < 0.004 && (variance - told.1).abs() < 0.004, "{deviation} {value}: {mean} {variance}, {told:?}");
        }
    }

    #[test]
    fn a_coarse_readout_is_taken_off_and_a_fine_one_is_not() {
        // Steps in deviations of the noise before the rounding.
        for (steps, coarse) in [(5.0, true), (3.5, true), (1.5, false)] {
            let case = Case::new(3, move |_, i, y, _, random| {
                let step = steps * NOISE[i];
                ((y + NOISE[i] * normal(random)) / step).round() * step
            });
            let read = unrounded(&case.data, &case.truth);
            assert_eq!(read.is_some(), coarse, "{steps}");
            let Some(read) = read else { continue };
            let off = |data: &Dataset| -> f64 {
                let rows = data.stretches.iter().zip(&case.truth).flat_map(|(s, run)| s.outputs[0].iter().zip(&run[0]));
                rows.map(|(y, x)| (y - x).powi(2)).sum()
            };
            // The saw's first harmonic, beside the variances of rounding and noise.
            let blur = (-2.0 * (std::f64::consts::PI / steps).powi(2)).exp();
            let taken = 0.5 * (blur / std::f64::consts::PI).powi(2) / (1.0 / 12.0 + steps.powi(-2));
            let share = 1.0 - off(&read) / off(&case.data);
            assert!((share / taken - 1.0).abs() < 0.4, "{steps}: {share} for {taken}");
        }
    }
}
