//! Memory: a rest that is still alike, or again, when the robot itself and the filters of its sensors have forgotten. Something pushes the robot, or
//! drifts, that no command causes: wind, ground, a gyroscope's bias. Its coherence from sample to sample may well pass for coloured noise.
//!
//! The rest's autocorrelation is asked at every lag from [`LONG`] on, or from four of the output's time constants if that is more: what swings is
//! alike again after a whole swing. What a coarse readout adds is there again whenever the robot drives alike, and is no memory. Its standard error is
//! Bartlett's for a rest that forgets before the first of them (Journal of the Royal Statistical Society, Supplement 8, 1946).

use statrs::distribution::{ContinuousCDF, Normal};

use crate::comparison::Comparison;
use crate::noise::products;

use super::bursts::FALSE_ALARM;
use super::readout::Coarse;

/// Lag after which sensors have forgotten \[s\]: a noise of which the next sample remembers 0.9 keeps an eighth of it at 20 Hz.
const LONG: f64 = 1.0;
/// Time constants in which an output forgets a push: two hundredths are left.
const FORGOTTEN: f64 = 4.0;
/// Correlation at that lag that is a memory: a quarter of the variance was there before.
pub(super) const LASTS: f64 = 0.25;
/// Lags that a stretch must hold, and the longest one as many of the longest.
const FEWEST: usize = 4;

/// A rest that lasts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Memory {
    /// Which output.
    pub output: usize,
    /// The lag at which it is most alike \[s\].
    pub lag: f64,
    /// Correlation of the rest at that lag.
    pub correlation: f64,
    /// What lasts of it as a share of the base model's misfit.
    pub share: f64,
}

/// The output whose rest lasts most, of those whose readout is not coarse.
pub(super) fn find(comparison: &Comparison<'_>, coarse: &[Coarse]) -> Option<Memory> {
    let fine = |output: &usize| coarse.iter().all(|coarse| coarse.output != *output);
    let found = (0..comparison.rates.len()).filter(fine).filter_map(|output| of(comparison, output));
    found.max_by(|a, b| a.share.total_cmp(&b.share))
}

fn of(comparison: &Comparison<'_>, output: usize) -> Option<Memory> {
    let time_constant = Some(comparison.rates[output]).filter(|r| *r > 0.0).map_or(0.0, f64::recip);
    let lag = LONG.max(FORGOTTEN * time_constant);
    let period = comparison.scene.scales.period;
    let lags = (lag / period).round() as usize;
    let rest = rest(comparison, output, lags)?;
    let variance = products(&rest, 0);
    let correlation = |k: usize| products(&rest, k) / variance;
    // What forgets before the first lag scatters the more, the longer it remembers.
    let before: f64 = (1..lags).map(|k| correlation(k).powi(2)).sum();
    let most = rest.iter().map(Vec::len).max()? / FEWEST;
    let (at, lasts) = (lags..=most).map(|k| (k, correlation(k))).max_by(|a, b| a.1.total_cmp(&b.1))?;
    let samples: usize = rest.iter().map(|r| r.len().saturating_sub(at)).sum();
    let error = ((1.0 + 2.0 * before) / samples as f64).sqrt();
    let looks = comparison.rates.len() * (most + 1 - lags);
    let chance = Normal::standard().inverse_cdf(1.0 - FALSE_ALARM / looks as f64);
    let squares = |s: usize| (0..comparison.data.stretches[s].len()).map(move |k| comparison.misfit(s, output, k).powi(2)).sum::<f64>();
    let misfit: f64 = (0..comparison.data.stretches.len()).map(squares).sum();
    (lasts > LASTS.max(chance * error)).then(|| Memory {
        output,
        lag: at as f64 * period,
        correlation: lasts,
        share: (lasts * variance / misfit).min(1.0),
    })
}

/// What is left of an output less its mean, in stretches that are long enough.
fn rest(comparison: &Comparison<'_>, output: usize, lags: usize) -> Option<Vec<Vec<f64>>> {
    let stretches = &comparison.data.stretches;
    let long = (0..stretches.len()).filter(|s| stretches[*s].len() >= FEWEST * lags);
    let mut rest: Vec<Vec<f64>> = long.map(|s| comparison.left(s, output).collect()).collect();
    let samples: usize = rest.iter().map(Vec::len).sum();
    let mean = rest.iter().flatten().sum::<f64>() / samples as f64;
    rest.iter_mut().flatten().for_each(|x| *x -= mean);
    (samples > 0 && rest.iter().flatten().any(|x| *x != 0.0)).then_some(rest)
}
