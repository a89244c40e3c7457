//! A readout that is so coarse that no other noise hides it: what rounding to a step q adds goes up and down with the motion itself, as a saw of
//! period q. Noise of half a step and more before the rounding makes chance of that, and then it is noise as any other.
//!
//! What is left is taken as a periodogram over the simulated motion. The saw's line stands out of its neighbourhood, as that of a law of speed does not,
//! and is as high as a rounding makes it, q/π.

use std::f64::consts::{PI, TAU};

use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::bursts::FALSE_ALARM;
use super::sweep::{Sweep, stands_out};
use crate::comparison::{Channels, Comparison};
use crate::fit::algebra::{add, dot, orthonormal};

/// Most steps tried for an output, and how finely about the best.
const MOST: usize = 3000;
const FINER: i32 = 8;
/// Steps tried: from so many deviations of the noise, finer ones do not show, to so many of what is left, coarser ones would leave more.
const STEPS: (f64, f64) = (0.5, 4.0);
/// Columns of a saw.
const COLUMNS: f64 = 3.0;
/// Share of the frequency within which the others are neighbours.
const NEIGHBOURHOOD: f64 = 0.25;
/// Height of the line over that of a rounding.
const HEIGHT: std::ops::RangeInclusive<f64> = 0.5..=2.0;

/// An output that is rounded each time it is read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coarse {
    /// Which.
    pub output: usize,
    /// The step, in the output's unit.
    pub step: f64,
    /// Twice the log-likelihood ratio.
    pub gain: f64,
}

/// Outputs of a coarse readout, and the whitened rest without what it adds.
pub(super) fn find(comparison: &Comparison<'_>) -> (Vec<Coarse>, Vec<Channels>) {
    let (mut all, mut rest) = (Vec::new(), comparison.white.to_vec());
    for output in 0..comparison.outputs() {
        let Some((step, tried)) = likeliest(comparison, output) else { continue };
        let saw = saw(comparison, output, step);
        let innovations = comparison.drawn_in(output);
        let along: Vec<f64> = saw.iter().map(|column| dot(column, &innovations)).collect();
        let gain: f64 = along.iter().map(|along| along * along).sum();
        let needed = ChiSquared::new(COLUMNS).map_or(f64::INFINITY, |law| law.inverse_cdf(1.0 - FALSE_ALARM / tried as f64));
        if gain <= needed {
            continue;
        }
        all.push(Coarse { output, step, gain });
        for (rows, stretch) in comparison.ranges().into_iter().zip(&mut rest) {
            saw.iter().zip(&along).for_each(|(column, along)| add(&mut stretch[output], -along, &column[rows.clone()]));
        }
    }
    (all, rest)
}

/// The step whose line stands out most, and how many were tried.
fn likeliest(comparison: &Comparison<'_>, output: usize) -> Option<(f64, usize)> {
    let motion: Vec<f64> = comparison.model.iter().flat_map(|run| run[output].iter().copied()).collect();
    let left: Vec<f64> = (0..comparison.model.len()).flat_map(|s| comparison.left(s, output).collect::<Vec<_>>()).collect();
    let reach = motion.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
    let rest = (left.iter().map(|left| left * left).sum::<f64>() / left.len() as f64).sqrt();
    let (finest, coarsest) = (STEPS.0 * comparison.noise[output], STEPS.1 * rest);
    if reach <= coarsest || coarsest <= finest {
        return None;
    }
    let (low, high) = (1.0 / coarsest, 1.0 / finest);
    let count = ((4.0 * (high - low) * reach) as usize).clamp(16, MOST);
    let spacing = (high - low) / count as f64;
    let left = [left];
    let power = Sweep::new(&motion, low, spacing).powers(&left, count);
    let at = (0..count).max_by(|a, b| power[*a].total_cmp(&power[*b]))?;
    let frequency = low + at as f64 * spacing;
    if !stands_out(&power, at, ((NEIGHBOURHOOD * frequency / spacing) as usize).max(6)) {
        return None;
    }
    let near = (-FINER..=FINER).map(|i| frequency + f64::from(i) * spacing / f64::from(FINER));
    let at = |f: f64| (Sweep::new(&motion, f, 0.0).weighted(&left[0]), f);
    let (power, frequency) = near.map(at).reduce(|a, b| if b.0 > a.0 { b } else { a })?;
    let height = 2.0 * power.sqrt() / left[0].len() as f64 * PI * frequency;
    HEIGHT.contains(&height).then_some((1.0 / frequency, count))
}

/// Whitened orthonormal columns of the saw of an output's simulated motion, the stretches one after the other, cleared of what a refit would take: the saw of
/// rounding itself, and sine and cosine of its line, for one that cuts off or a motion that is not exact.
fn saw(comparison: &Comparison<'_>, output: usize, step: f64) -> Vec<Vec<f64>> {
    let column = |wave: fn(f64) -> f64| -> Vec<f64> {
        let of = |run: &Channels| {
            let mut series: Vec<f64> = run[output].iter().map(|x| wave(x / step)).collect();
            (comparison.whiten)(output, &mut series);
            series
        };
        comparison.model.iter().flat_map(of).collect()
    };
    let waves = [|x: f64| x.round() - x, |x: f64| (TAU * x).sin(), |x: f64| (TAU * x).cos()].map(column);
    let fitted = &comparison.jacobian[output];
    let known = fitted.column_iter().map(|column| column.as_slice().to_vec());
    orthonormal(known.chain(waves), 1e-6, 2).into_iter().skip(fitted.ncols()).flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::{Case, NOISE, normal};

    /// What is found where values are rounded to so many deviations of a noise that comes before or after.
    fn found(seed: u64, steps: f64, before: bool) -> Vec<Coarse> {
        let rounded = move |i: usize, y: f64| (y / (steps * NOISE[i])).round() * steps * NOISE[i];
        let case = Case::new(seed, move |_, i, y, _, random| {
            let noise = NOISE[i] * normal(random);
            if before { rounded(i, y + noise) } else { rounded(i, y) + noise }
        });
        case.compare(None, |c| find(c).0)
    }

    #[test]
    fn a_readout_shows_where_noise_does_not_hide_it() {
        for seed in 0..10 {
            let coarse = found(seed, 2.0, false);
            assert_eq!(coarse.len(), 2, "{seed}: two deviations of a noise that comes behind it");
            for c in coarse {
                assert!((c.step / (2.0 * NOISE[c.output]) - 1.0).abs() < 0.01, "{seed}: {c:?}");
            }
            assert_eq!(found(seed, 2.0, true), [], "{seed}: as much of a noise before it");
            assert_eq!(found(seed, 0.1, false), [], "{seed}: much finer than the noise");
        }
    }
}
