//! Bursts: seconds in which the innovations are larger than their own distribution allows.
//!
//! The energy of every one-second block is compared with what the same innovations give when shuffled, so that heavy tails raise no
//! alarm: only what stands together in time does.

use rand::SeedableRng;
use rand::rngs::StdRng;
use rand::seq::SliceRandom;

use super::Jitter;
use crate::comparison::{Comparison, blocks};
use crate::unrounded::readout;

/// Shuffles from which the largest block's distribution is taken.
const SHUFFLES: usize = 100;
/// Chance of a false alarm that a test may have.
pub(super) const FALSE_ALARM: f64 = 1e-3;

/// A time in which the model misses something that is not there otherwise.
#[derive(Debug, Clone, PartialEq)]
pub struct Burst {
    /// First and last time \[s\].
    pub time: (f64, f64),
    /// Energy in units of the largest shuffled block's standard deviations above its mean.
    pub z: f64,
    /// Energy above the average, in squared standard deviations of the noise.
    pub excess: f64,
}

pub(super) fn find(comparison: &Comparison<'_>, seed: u64, jitter: Option<&Jitter>) -> Vec<Burst> {
    let energy: Vec<f64> = squares(comparison, jitter);
    let ranges = comparison.ranges();
    let mut blocks = blocks(comparison.data, 1.0);
    // What is left of a stretch behind its last whole second is none: a single value far out would be all of it.
    let whole = blocks.iter().map(|(_, rows)| rows.len()).max().unwrap_or(0);
    blocks.retain(|(_, rows)| 2 * rows.len() >= whole);
    let blocks: Vec<_> = blocks.into_iter().map(|(s, rows)| (s, rows.start + ranges[s].start..rows.end + ranges[s].start, rows)).collect();
    if blocks.len() < 8 {
        return Vec::new();
    }
    let mean = energy.iter().sum::<f64>() / energy.len() as f64;
    // Blocks of unlike length compare by their excess over what as many samples have on average.
    let excess = |values: &[f64], rows: &std::ops::Range<usize>| {
        (values[rows.clone()].iter().sum::<f64>() - mean * rows.len() as f64) / (rows.len() as f64).sqrt()
    };
    let mut random = StdRng::seed_from_u64(seed);
    let mut shuffled = energy.clone();
    let maxima: Vec<f64> = (0..SHUFFLES)
        .map(|_| {
            shuffled.shuffle(&mut random);
            blocks.iter().map(|(_, rows, _)| excess(&shuffled, rows)).fold(f64::NEG_INFINITY, f64::max)
        })
        .collect();
    let average = maxima.iter().sum::<f64>() / SHUFFLES as f64;
    let deviation = (maxima.iter().map(|m| (m - average).powi(2)).sum::<f64>() / (SHUFFLES - 1) as f64).sqrt();
    // Largest values are distributed as Gumbel's law.
    let scale = deviation * 6.0_f64.sqrt() / std::f64::consts::PI;
    let limit = average - 0.577_215_664_9 * scale - scale * (-(1.0 - FALSE_ALARM).ln()).ln();
    let mut bursts: Vec<Burst> = Vec::new();
    for (s, rows, own) in &blocks {
        let value = excess(&energy, rows);
        if value <= limit {
            continue;
        }
        let time = &comparison.data.stretches[*s].time;
        let (from, to) = (time[own.start], time[(own.end).min(time.len() - 1)]);
        let above = value * (rows.len() as f64).sqrt();
        let z = (value - average) / deviation.max(f64::MIN_POSITIVE);
        match bursts.last_mut() {
            Some(last) if (from - last.time.1).abs() < 1e-9 => {
                last.time.1 = to;
                last.z = last.z.max(z);
                last.excess += above;
            }
            _ => bursts.push(Burst { time: (from, to), z, excess: above }),
        }
    }
    bursts
}

/// Squared innovations summed over the outputs, a sample each; scatter of jittering stamps, and of rounding where it is loud, brought back to its usual
/// size.
fn squares(comparison: &Comparison<'_>, jitter: Option<&Jitter>) -> Vec<f64> {
    let mut sum = vec![0.0; comparison.data.samples()];
    for output in 0..comparison.outputs() {
        let weights = jitter.map(|j| j.weights(comparison, output));
        let loudness = loudness(comparison, output);
        for (k, x) in comparison.innovations(output).iter().enumerate() {
            let (weight, loudness) = (weights.as_ref().map_or(1.0, |w| w[k]), loudness.as_ref().map_or(1.0, |l| l[k]));
            sum[k] += (x * weight).powi(2) / loudness;
        }
    }
    sum
}

/// Variance of each value of an output about what rounding adds on average, over its mean; where it is less than that, 1: seldom it is as large all the same.
fn loudness(comparison: &Comparison<'_>, output: usize) -> Option<Vec<f64>> {
    let readout = readout(comparison.rounded[output], comparison.data, comparison.model, output)?;
    let variances: Vec<f64> = comparison.model.iter().flat_map(|run| &run[output]).map(|x| readout.moments(*x).1).collect();
    let mean = variances.iter().sum::<f64>() / variances.len() as f64;
    Some(variances.into_iter().map(|variance| (variance / mean).max(1.0)).collect())
}
