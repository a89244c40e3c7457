//! A lattice of values: velocities that are differences of counts come in multiples of a quantum.
//!
//! For a quantum q the mean of e^{2πi x/q} is 1 where all values are multiples, and small where they are spread. Steady speeds
//! with little noise stand together too; noise of standard deviation σ leaves at most e^{−2π²σ²/q²} of that, so a quantum is
//! believed only well above it. The noise is no smaller than what the quantum itself makes, q/√12, so a true one always can be.

use crate::comparison::Comparison;

use super::bursts::FALSE_ALARM;

/// Share of the values left out at either end, where limits pile them up.
const EXTREMES: f64 = 0.02;
/// Most quanta tried for a channel.
const MOST: usize = 3000;

/// Values of an output that lie on a lattice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lattice {
    /// Which output.
    pub output: usize,
    /// Distance of two neighbours, in the output's unit; or times the sample period, if of distances.
    pub quantum: f64,
    /// How much of the values agrees with it: 1 is all.
    pub coherence: f64,
    /// Whether distances between samples are multiples, rather than velocities: stamps are those of the counts.
    pub of_distance: bool,
}

/// The clearest lattice of each output that has one.
pub(super) fn find(comparison: &Comparison<'_>) -> Vec<Lattice> {
    let period = comparison.scene.scales.period;
    let mut found = Vec::new();
    for output in 0..comparison.outputs() {
        let speeds = || comparison.data.stretches.iter().flat_map(|s| s.outputs[output].iter().copied());
        let distances = comparison
            .data
            .stretches
            .iter()
            .flat_map(|s| (1..s.len()).map(|k| s.outputs[output][k] * (s.time[k] - s.time[k - 1]) / period));
        let candidates = [(false, speeds().collect::<Vec<f64>>()), (true, distances.collect())];
        let best =
            candidates.into_iter().filter_map(|(of_distance, values)| clearest(&values, comparison.noise[output], output, of_distance));
        found.extend(best.reduce(|a, b| if b.coherence > a.coherence + 1e-9 { b } else { a }));
    }
    found
}

fn clearest(values: &[f64], noise: f64, output: usize, of_distance: bool) -> Option<Lattice> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| *v != 0.0).collect();
    sorted.sort_by(f64::total_cmp);
    let cut = (EXTREMES * sorted.len() as f64) as usize;
    let kept = sorted.get(cut..sorted.len().checked_sub(cut)?)?;
    let (first, last) = (kept.first()?, kept.last()?);
    let reach = first.abs().max(last.abs());
    // Finer than half the noise no quantum matters; coarser than √12 of it none can be.
    let (finest, coarsest) = (0.5 * noise, 12.0_f64.sqrt() * noise);
    if kept.len() < 100 || reach <= coarsest {
        return None;
    }
    let (low, high) = (1.0 / coarsest, 1.0 / finest);
    let count = ((4.0 * (high - low) * reach) as usize).clamp(16, MOST);
    let step = (high - low) / count as f64;
    let chance = (-(FALSE_ALARM / (8 * count) as f64).ln() / kept.len() as f64).sqrt();
    let mut phase: Vec<(f64, f64)> = kept.iter().map(|x| (std::f64::consts::TAU * low * x).sin_cos()).collect();
    let turn: Vec<(f64, f64)> = kept.iter().map(|x| (std::f64::consts::TAU * step * x).sin_cos()).collect();
    let mut best: Option<(f64, Lattice)> = None;
    for k in 0..count {
        let (s, c) = phase.iter().fold((0.0, 0.0), |(s, c), p| (s + p.0, c + p.1));
        let coherence = s.hypot(c) / kept.len() as f64;
        let frequency = low + k as f64 * step;
        let spread = (-2.0 * (std::f64::consts::PI * noise * frequency).powi(2)).exp();
        let margin = coherence / (2.0 * spread + chance);
        if margin > 1.0 && best.as_ref().is_none_or(|(m, _)| margin > *m) {
            best = Some((margin, Lattice { output, quantum: 1.0 / frequency, coherence, of_distance }));
        }
        for (p, t) in phase.iter_mut().zip(&turn) {
            *p = (p.0 * t.1 + p.1 * t.0, p.1 * t.1 - p.0 * t.0);
        }
    }
    best.map(|(_, lattice)| lattice)
}
