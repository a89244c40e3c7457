//! Visibility of what is hidden: twice the log-likelihood ratio between the truth and the best robot without it.
//!
//! For hidden physics the ratio is taken in expectation: the lumped robot without it is refitted to the noise-free signals of the truth,
//! and what is left of them, whitened with the noise's own law, is the expected ratio (noise of heavy tails counts by its variance). Effects
//! that change not the mean but the scatter (jitter, coarse encoders) add the expected ratio of their densities.

use super::key::Region;
use super::lumped::{Lumped, Speeds, Weights, fit, residuals, run};
use crate::firmware::Command;

/// Lumped numbers that put nothing into a prior.
const IDEAL_DIMENSIONS: Lumped = [1.0; 8];

/// A recording without noise, and the noise it gets.
#[derive(Clone, Debug)]
pub struct Scene<'a> {
    /// Commands at the rows.
    pub commands: &'a [Command],
    /// What can be foreseen of the measurements.
    pub seen: &'a Speeds,
    /// The noise.
    pub weights: &'a Weights,
    /// Half track, where wheel speeds are recorded \[m\].
    pub half_track: Option<f64>,
}

/// What the refit of a robot without hidden physics leaves.
#[derive(Clone, Debug, PartialEq)]
pub struct Left {
    /// Expected twice log-likelihood ratio.
    pub ratio: f64,
    /// The refitted robot.
    pub refit: Lumped,
    /// Difference between truth and refit, per channel.
    pub difference: Vec<Vec<f64>>,
}

/// Refits the robot without hidden physics.
pub fn left_over(scene: &Scene, start: Lumped) -> Left {
    let (refit, ratio) = fit(start, scene.commands, scene.seen, scene.half_track, scene.weights);
    let ran = run(&refit, scene.commands, scene.half_track);
    let difference = scene.seen.channels.iter().zip(&ran.channels).map(|(y, m)| y.iter().zip(m).map(|(a, b)| a - b).collect()).collect();
    Left { ratio, refit, difference }
}

/// Expected ratio of one effect of several: what is left of its contribution when the robot without it may change its lumped numbers and the
/// strengths of the other effects (one Gauss-Newton step from the truth without it).
///
/// `without` are the signals without the effect, `moved` those without it after another effect was made stronger by some share.
pub fn left_without(scene: &Scene, refit: &Lumped, without: &Speeds, moved: &[Speeds]) -> f64 {
    let whitened = |a: &Speeds, b: &Speeds| {
        let mut all = residuals(&IDEAL_DIMENSIONS, a, b, scene.weights);
        all.truncate(a.channels.iter().map(Vec::len).sum());
        all
    };
    let contribution = whitened(without, scene.seen);
    let ran = run(refit, scene.commands, scene.half_track);
    let mut columns: Vec<Vec<f64>> = (0..if scene.half_track.is_some() { 8 } else { 6 })
        .map(|k| {
            let mut p = *refit;
            p[k] += 1e-4 * p[k].abs().max(1e-2);
            whitened(&ran, &run(&p, scene.commands, scene.half_track))
        })
        .collect();
    columns.extend(moved.iter().map(|m| whitened(without, m)));
    remainder(columns, contribution)
}

/// Squared length of what remains of `x` beside the columns (Gram-Schmidt, twice for safety).
fn remainder(columns: Vec<Vec<f64>>, mut x: Vec<f64>) -> f64 {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(p, q)| p * q).sum::<f64>();
    let mut basis: Vec<Vec<f64>> = Vec::new();
    let clear = |x: &mut Vec<f64>, basis: &[Vec<f64>]| {
        for _ in 0..2 {
            for b in basis {
                let along = dot(x, b);
                x.iter_mut().zip(b).for_each(|(p, q)| *p -= along * q);
            }
        }
    };
    for mut column in columns {
        let before = dot(&column, &column).sqrt();
        clear(&mut column, &basis);
        let length = dot(&column, &column).sqrt();
        if length > 1e-7 * before {
            column.iter_mut().for_each(|p| *p /= length);
            basis.push(column);
        }
    }
    clear(&mut x, &basis);
    dot(&x, &x)
}

/// Expected ratio for measuring at moments that scatter by `jitter` \[s\]: the noise's variance grows with the square of the slope.
pub fn jitter_ratio(signal: &[f64], dt: f64, sigma: f64, jitter: f64) -> f64 {
    let variance: Vec<f64> = signal.windows(2).map(|w| sigma * sigma + (jitter * (w[1] - w[0]) / dt).powi(2)).collect();
    let mean = variance.iter().sum::<f64>() / variance.len().max(1) as f64;
    variance.iter().map(|v| (mean / v).ln()).sum()
}

/// Expected ratio for values on a lattice of `step` under noise `sigma`, against the same scatter without a lattice.
pub fn lattice_ratio(rows: usize, step: f64, sigma: f64) -> f64 {
    rows as f64 * (1.0 + step * step / (12.0 * sigma * sigma)).ln()
}

/// Blocks of one second in which the difference is louder than the noise, joined; none if that is most of the time.
pub fn times(commands: &[Command], difference: &[Vec<f64>], sigma: &[f64]) -> Option<Vec<[f64; 2]>> {
    let (start, end) = (commands.first()?.t, commands.last()?.t);
    let blocks = ((end - start).ceil() as usize).max(1);
    let mut energy = vec![0.0; blocks];
    let mut rows = vec![0usize; blocks];
    for (k, c) in commands.iter().enumerate() {
        let b = ((c.t - start) as usize).min(blocks - 1);
        rows[b] += 1;
        energy[b] += difference.iter().zip(sigma).take(2).map(|(d, s)| (d[k] / s).powi(2)).fold(0.0, f64::max);
    }
    let loud: Vec<bool> = energy.iter().zip(&rows).map(|(e, n)| *n > 0 && *e > *n as f64).collect();
    let share = loud.iter().filter(|l| **l).count() as f64 / blocks as f64;
    if share == 0.0 || share > 0.6 {
        return None;
    }
    let mut out: Vec<[f64; 2]> = Vec::new();
    for (b, _) in loud.iter().enumerate().filter(|(_, l)| **l) {
        let from = start + b as f64;
        match out.last_mut() {
            Some(last) if last[1] >= from - 1e-9 => last[1] = from + 1.0,
            _ => out.push([from, from + 1.0]),
        }
    }
    Some(out)
}

/// Ranges of a channel's values in which the difference is at least twice as loud as on average and louder than the noise.
pub fn regions(name: &str, values: &[f64], difference: &[Vec<f64>], sigma: &[f64]) -> Vec<Region> {
    const BINS: usize = 16;
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let width = (high - low) / BINS as f64;
    if width.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
        return Vec::new();
    }
    let mut bins = [(0.0f64, 0usize); BINS];
    for (k, y) in values.iter().enumerate() {
        let b = (((y - low) / width) as usize).min(BINS - 1);
        bins[b].0 += difference.iter().zip(sigma).take(2).map(|(d, s)| (d[k] / s).powi(2)).sum::<f64>();
        bins[b].1 += 1;
    }
    let mean = bins.iter().map(|b| b.0).sum::<f64>() / values.len() as f64;
    let mut out: Vec<Region> = Vec::new();
    for (b, (energy, rows)) in bins.iter().enumerate() {
        let here = energy / (*rows).max(1) as f64;
        if *rows * 100 < values.len() || here < 2.0 * mean || here < 1.0 {
            continue;
        }
        let (from, to) = (low + b as f64 * width, low + (b + 1) as f64 * width);
        match out.last_mut() {
            Some(last) if last.to >= from - 1e-9 * width => last.to = to,
            _ => out.push(Region { of: name.to_owned(), from, to }),
        }
    }
    out
}

/// Fit of a prediction to measured values in percent: `100 (1 - |y - m| / |y - mean y|)`.
pub fn percent(measured: &[f64], predicted: &[f64]) -> f64 {
    let mean = measured.iter().sum::<f64>() / measured.len().max(1) as f64;
    let off: f64 = measured.iter().zip(predicted).map(|(y, m)| (y - m).powi(2)).sum();
    let all: f64 = measured.iter().map(|y| (y - mean).powi(2)).sum();
    100.0 * (1.0 - (off / all).sqrt())
}
