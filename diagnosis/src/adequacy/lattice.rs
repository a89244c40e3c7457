//! A lattice of values: velocities that are differences of counts come in multiples of a quantum.
//!
//! For a quantum q the mean of e^{2πi x/q} is 1 where all values are multiples, and small where they are spread. Steady speeds
//! with little noise stand together too: the motion as simulated says how much, and noise of standard deviation σ leaves
//! (1 + 2πσ/q) e^{−2πσ/q} of that if its tails are as heavy as those of Student's law with three degrees of freedom, less if they are
//! lighter. A quantum is believed only well above it. The noise is no smaller than what the quantum itself makes, q/√12, so a true one
//! always can be. Wheels are counted, not the robot: their steps are twice as high as those of forward speed and stand out of noise where
//! these do not. The track is known to a few percent only, and found with them. Multiples of a quantum are multiples of its fractions too: the coarsest that agrees is meant.

use wheelwright_core::effect::Frame;

use crate::comparison::Comparison;

use super::bursts::FALSE_ALARM;
use super::sweep::Sweep;

/// Share of the values left out at either end, where limits pile them up.
const EXTREMES: f64 = 0.02;
/// Most quanta tried for a channel.
const MOST: usize = 3000;
/// Least coherence of an output's lattice: e^{−2π²σ²/q²} is a half where other noise of deviation σ has not quite half the variance of
/// rounding to q.
const HALF: f64 = 0.5;
/// The same of a wheel's, which is believed only where the other wheel has it too: it comes to a fifth where the noise has the variance
/// of the rounding, and chance does not come to it.
const FIFTH: f64 = 0.2;
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
/// Share by which a track width may be off that a person measured.
const TRACK: f64 = 0.03;
/// Part of a quantum by which a wrong track may shift the typical value.
const SHIFT: f64 = 0.1;
/// Most track widths tried to either side.
const TRACKS: i32 = 8;
/// Difference of two wheels' quanta: that of their radii.
const ALIKE: f64 = 0.03;

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

/// Counts of both wheels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Counts {
    /// Travel of a wheel between two counts \[m\].
    pub travel: f64,
    /// How much of the values agrees with it: 1 is all.
    pub coherence: f64,
    /// Variance that counting makes as a share of the wheels' noise: two counts are differenced, each rounded by itself.
    pub share: f64,
}

/// Measured and simulated value.
type Pair = (f64, f64);

/// Values as velocities and, at an unsteady rate where they are not the same, as distances between samples; with the latter's mark.
fn readings<'c>(comparison: &'c Comparison<'_>, of: impl Fn(&[Vec<f64>], usize) -> f64 + Copy + 'c) -> Vec<(bool, Vec<Pair>)> {
    let period = comparison.scene.scales.period;
    let rows = || comparison.data.stretches.iter().zip(comparison.model);
    let speeds = rows().flat_map(|(s, run)| (0..s.len()).map(move |k| (of(&s.outputs, k), of(run, k))));
    let mut all = vec![(false, speeds.collect())];
    if rows().any(|(s, _)| s.time.windows(2).any(|w| (w[1] - w[0] - period).abs() > STEADY * period)) {
        let distances = rows().flat_map(|(s, run)| {
            (1..s.len()).map(move |k| {
                let share = (s.time[k] - s.time[k - 1]) / period;
                (of(&s.outputs, k) * share, of(run, k) * share)
            })
        });
        all.push((true, distances.collect()));
    }
    all
}

/// The clearest lattice of each output that has one.
pub(super) fn find(comparison: &Comparison<'_>) -> Vec<Lattice> {
    let of = |output: usize| {
        let best = readings(comparison, move |columns, k| columns[output][k]).into_iter().filter_map(|(of_distance, values)| {
            let (quantum, coherence) = clearest(&values, comparison.noise[output], HALF)?;
            Some(Lattice { output, quantum, coherence, of_distance })
        });
        best.reduce(|a, b| if b.coherence > a.coherence + 1e-9 { b } else { a })
    };
    (0..comparison.outputs()).filter_map(of).collect()
}

/// Counts, if both wheels' speeds are multiples of one quantum. Outputs that are rounded each by itself have a readout of few digits,
/// which is a noise: then forward speed agrees with the wheels' quantum as well as they do, where that of counted wheels has half of it; or,
/// by chance near a multiple of the wheels', with a lattice of its own better than they do with theirs, where noise blurs the half of counts
/// more than the whole. `lattices` are those of the outputs.
pub(super) fn counts(comparison: &Comparison<'_>, lattices: &[Lattice]) -> Option<Counts> {
    let scene = comparison.scene;
    let clear = lattices.iter().filter(|l| l.output == 0).map(|l| l.coherence).fold(0.0, f64::max);
    let tracks: Vec<Frame> = match scene.frame {
        Frame::Channels => return None,
        Frame::Sides { .. } => vec![scene.frame],
        Frame::Body { half_track } => {
            let typical = half_track * scene.scales.outputs[1];
            let noise = f64::hypot(comparison.noise[0], half_track * comparison.noise[1]);
            let steps = (TRACK * typical / (SHIFT * noise)).ceil().min(f64::from(TRACKS)) as i32;
            let share = |i: i32| 1.0 + TRACK * f64::from(i) / f64::from(steps.max(1));
            let measured = (-steps..=steps).map(|i| half_track * share(i));
            measured.chain(between(lattices)).map(|half_track| Frame::Body { half_track }).collect()
        }
    };
    let body = matches!(scene.frame, Frame::Body { .. });
    let own = |found: &Counts| !body || AGREES * clear <= found.coherence;
    let best = tracks.into_iter().filter_map(|frame| of_wheels(comparison, frame)).filter(own);
    best.reduce(|a, b| if b.coherence > a.coherence { b } else { a })
}

/// Half the track by the outputs' own lattices, whatever a person measured: half the sum of two wheels' counts comes in steps of h times those in which
/// their difference over the track does.
fn between(lattices: &[Lattice]) -> Option<f64> {
    let of = |output: usize| lattices.iter().find(|l| l.output == output);
    let (forward, turning) = (of(0)?, of(1)?);
    (forward.of_distance == turning.of_distance).then(|| forward.quantum / turning.quantum)
}

fn of_wheels(comparison: &Comparison<'_>, frame: Frame) -> Option<Counts> {
    let both = |columns: &[Vec<f64>], k: usize| frame.wheels(&[columns[0][k], columns[1][k]]);
    let noise = match frame {
        Frame::Body { half_track } => f64::hypot(comparison.noise[0], half_track * comparison.noise[1]),
        _ => comparison.noise[0],
    };
    let left = readings(comparison, move |columns, k| both(columns, k)[0]);
    let right = readings(comparison, move |columns, k| both(columns, k)[1]);
    let forward = readings(comparison, move |columns, k| columns[0][k]);
    let body = matches!(frame, Frame::Body { .. });
    let of = |((values, others), forward): ((&Vec<Pair>, &Vec<Pair>), &Vec<Pair>)| {
        let (quantum, one) = clearest(values, noise, FIFTH)?;
        let thin = |pairs: &[Pair]| -> Vec<f64> { thinned(pairs).into_iter().map(|p| p.0).collect() };
        let (others, forward) = (thin(others), thin(forward));
        let (at, other) = (-16..=16)
            .map(|i| quantum * (1.0 + ALIKE * f64::from(i) / 16.0))
            .map(|q| (q, coherence(&others, 1.0 / q)))
            .fold((quantum, 0.0), |a, b| if b.1 > a.1 { b } else { a });
        let least = one.min(other);
        let rounded = body && coherence(&forward, 1.0 / quantum) > AGREES * least;
        (other > FIFTH && !rounded).then_some((0.5 * (quantum + at), least))
    };
    let found = left.iter().zip(&right).zip(&forward).filter_map(|((l, r), f)| of(((&l.1, &r.1), &f.1)));
    let (quantum, coherence) = found.reduce(|a, b| if b.1 > a.1 { b } else { a })?;
    Some(Counts { travel: quantum * comparison.scene.scales.period, coherence, share: (quantum / noise).powi(2) / 6.0 })
}

/// As many pairs as are enough, in the order of what was measured, without zeros.
fn thinned(pairs: &[Pair]) -> Vec<Pair> {
    let every = pairs.len().div_ceil(ENOUGH);
    let mut kept: Vec<Pair> = pairs.iter().copied().step_by(every.max(1)).filter(|(x, _)| *x != 0.0).collect();
    kept.sort_by(|a, b| a.0.total_cmp(&b.0));
    kept
}

/// Quantum and coherence of the clearest lattice of measured values beside simulated ones, of so much coherence at least.
fn clearest(pairs: &[Pair], noise: f64, least: f64) -> Option<(f64, f64)> {
    let pairs = thinned(pairs);
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
        let clear = seen.sum() / measured.len() as f64;
        seen.advance();
        if clear <= least * GRID {
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
    (coherence > least).then_some((1.0 / frequency, coherence))
}

/// Length of the mean of e^{2πi f x}.
fn coherence(values: &[f64], frequency: f64) -> f64 {
    let (s, c) = values.iter().map(|x| (std::f64::consts::TAU * frequency * x).sin_cos()).fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
    f64::hypot(s, c) / values.len() as f64
}
