//! A lattice of values: velocities that are differences of counts come in multiples of a quantum.
//!
//! For a quantum q the mean of e^{2πi x/q} is 1 where all values are multiples, and small where they are spread. Steady speeds
//! with little noise stand together too: the motion as simulated says how much, and noise of standard deviation σ leaves
//! (1 + 2πσ/q) e^{−2πσ/q} of that if its tails are as heavy as those of Student's law with three degrees of freedom, less if they are
//! lighter. A quantum is believed only well above it. The noise is no smaller than what the quantum itself makes, q/√12, so a true one
//! always can be. Multiples of a quantum are multiples of its fractions too: the coarsest that agrees is meant.

use crate::comparison::Comparison;

use super::bursts::FALSE_ALARM;

/// Share of the values left out at either end, where limits pile them up.
const EXTREMES: f64 = 0.02;
/// Most quanta tried for a channel.
const MOST: usize = 3000;
/// Least coherence of a lattice: e^{−2π²σ²/q²} is a half where other noise of deviation σ has not quite half the variance of rounding to q.
const HALF: f64 = 0.5;
/// Values that are enough: chance leaves a coherence of a tenth to so many.
const ENOUGH: usize = 2000;
/// Share of the sampling interval by which a steady rate may waver.
const STEADY: f64 = 1e-3;
/// Share of a peak's height that the grid of quanta, four to a width, finds at least; half of it where the grid is thinned to [`MOST`].
const GRID: f64 = 0.5;
/// Fractions of a quantum that could have been found in its place.
const FRACTIONS: u32 = 8;
/// Share of the coherence of a fraction that the whole quantum has.
const AGREES: f64 = 0.8;

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
        let rows = || comparison.data.stretches.iter().zip(comparison.model);
        let speeds = rows().flat_map(|(s, run)| (0..s.len()).map(move |k| (s.outputs[output][k], run[output][k])));
        let distances = rows().flat_map(|(s, run)| {
            (1..s.len()).map(move |k| {
                let share = (s.time[k] - s.time[k - 1]) / period;
                (s.outputs[output][k] * share, run[output][k] * share)
            })
        });
        let mut candidates = vec![(false, speeds.collect::<Vec<(f64, f64)>>())];
        // At a steady rate they are the same.
        if rows().any(|(s, _)| s.time.windows(2).any(|w| (w[1] - w[0] - period).abs() > STEADY * period)) {
            candidates.push((true, distances.collect()));
        }
        let best = candidates.into_iter().filter_map(|(of_distance, values)| {
            let (quantum, coherence) = clearest(values, comparison.noise[output])?;
            Some(Lattice { output, quantum, coherence, of_distance })
        });
        found.extend(best.reduce(|a, b| if b.coherence > a.coherence + 1e-9 { b } else { a }));
    }
    found
}

/// Quantum and coherence of the clearest lattice of measured values beside simulated ones.
fn clearest(pairs: Vec<(f64, f64)>, noise: f64) -> Option<(f64, f64)> {
    let every = pairs.len().div_ceil(ENOUGH);
    let mut pairs: Vec<(f64, f64)> = pairs.into_iter().step_by(every.max(1)).filter(|(x, _)| *x != 0.0).collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let cut = (EXTREMES * pairs.len() as f64) as usize;
    let kept = pairs.get(cut..pairs.len().checked_sub(cut)?)?;
    let (first, last) = (kept.first()?.0, kept.last()?.0);
    let reach = first.abs().max(last.abs());
    // Finer than half the noise no quantum matters; coarser than √12 of it, and the error of its estimate, none can be.
    let (finest, coarsest) = (0.5 * noise, 4.0 * noise);
    if kept.len() < 100 || reach <= coarsest {
        return None;
    }
    let (low, high) = (1.0 / coarsest, 1.0 / finest);
    let count = ((4.0 * (high - low) * reach) as usize).clamp(16, MOST);
    let step = (high - low) / count as f64;
    let chance = (-(FALSE_ALARM / (8 * count) as f64).ln() / kept.len() as f64).sqrt();
    let (measured, simulated): (Vec<f64>, Vec<f64>) = kept.iter().copied().unzip();
    let mut seen = Sweep::new(&measured, low, step);
    let mut best: Option<(f64, f64)> = None;
    for k in 0..count {
        let frequency = low + k as f64 * step;
        let phase = std::f64::consts::TAU * noise * frequency;
        let clear = seen.next();
        if clear <= HALF * GRID {
            continue;
        }
        let margin = clear / (2.0 * coherence(&simulated, frequency) * (1.0 + phase) * (-phase).exp() + chance);
        if margin > 1.0 && best.is_none_or(|(m, _)| margin > m) {
            best = Some((margin, frequency));
        }
    }
    let (_, frequency) = best?;
    // The same values are multiples of fractions of their quantum.
    let sharp = |about: f64| {
        let near = (-8..=8).map(|i| about + f64::from(i) * step / 8.0);
        near.map(|f| (f, coherence(&measured, f))).fold((about, 0.0), |a, b| if b.1 > a.1 { b } else { a })
    };
    let (own, clear) = sharp(frequency);
    let coarser = (2..=FRACTIONS).rev().map(|m| own / f64::from(m)).filter(|f| *f >= low - step);
    let (frequency, coherence) = coarser.map(sharp).find(|(_, c)| *c > AGREES * clear).unwrap_or((own, clear));
    (coherence > HALF).then_some((1.0 / frequency, coherence))
}

/// Length of the mean of e^{2πi f x}.
fn coherence(values: &[f64], frequency: f64) -> f64 {
    let (s, c) = values.iter().map(|x| (std::f64::consts::TAU * frequency * x).sin_cos()).fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
    f64::hypot(s, c) / values.len() as f64
}

/// Coherence at one frequency after the other, by a product a step and value.
struct Sweep {
    phase: Vec<(f64, f64)>,
    turn: Vec<(f64, f64)>,
}

impl Sweep {
    fn new(values: &[f64], first: f64, step: f64) -> Self {
        let at = |frequency: f64| values.iter().map(|x| (std::f64::consts::TAU * frequency * x).sin_cos()).collect();
        Self { phase: at(first), turn: at(step) }
    }

    fn next(&mut self) -> f64 {
        let (s, c) = self.phase.iter().fold((0.0, 0.0), |(s, c), p| (s + p.0, c + p.1));
        for (p, t) in self.phase.iter_mut().zip(&self.turn) {
            *p = (p.0 * t.1 + p.1 * t.0, p.1 * t.1 - p.0 * t.0);
        }
        f64::hypot(s, c) / self.phase.len() as f64
    }
}
