//! Rounded commands: a message, a register or a driver that knows multiples of a step only. What is lost goes up and down with the command like a
//! saw, which no smooth law does, and is answered as any command is.
//!
//! For steps of which the largest command holds a few to [`MOST`], rounded or cut off, on the forward command, the turning one or both wheels',
//! the answer of each output's own lag to what is lost is held against the rest, both without what a refit would take: twice a log-likelihood
//! ratio. It is a rounding where that stands out from those of other steps, and where the robot answers as much as it does to commands.

use wheelwright_core::effect::Frame;

use crate::comparison::{Channels, Comparison};
use crate::fit::algebra::{clear, dot, orthonormal};

use super::bursts::FALSE_ALARM;

/// Steps that the largest command holds at least and at most.
const FEWEST: f64 = 4.0;
const MOST: f64 = 64.0;
/// Steps tried between two that tell different things.
const DENSE: f64 = 3.0;
/// The rest's answer to what is lost, beside that to any command.
const ANSWERS: std::ops::RangeInclusive<f64> = 0.5..=2.0;
/// The best step explains this many times as much as most others.
const CONTRAST: f64 = 4.0;

/// Commands that are rounded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rounding {
    /// Which: a command, or `None` for both wheels'.
    pub input: Option<usize>,
    /// The step, in the command's unit.
    pub step: f64,
    /// Twice the log-likelihood ratio.
    pub gain: f64,
}

/// What is rounded, and how.
#[derive(Debug, Clone, Copy)]
struct Guess {
    input: Option<usize>,
    step: f64,
    cut_off: bool,
}

impl Guess {
    /// The answer to what is lost, but for the half step that cutting off loses on average: that is a friction's or a dead zone's.
    fn lost(self, answer: &impl Fn(&Loss<'_>) -> Vec<f64>) -> Vec<f64> {
        let Self { input, step, cut_off } = self;
        let cut = |u: f64| step * ((u / step).trunc() - u / step + 0.5 * u.signum());
        let rounded = |u: f64| step * ((u / step).round() - u / step);
        answer(&Loss { input, of: if cut_off { &cut } else { &rounded } })
    }
}

/// What is lost of one command, or of both wheels'.
struct Loss<'a> {
    input: Option<usize>,
    of: &'a dyn Fn(f64) -> f64,
}

impl Loss<'_> {
    /// What is lost of the commands of one row.
    fn row(&self, frame: &Frame, commands: &[f64], lost: &mut [f64]) {
        match self.input {
            Some(input) => lost[input] = (self.of)(commands[input]),
            None => {
                lost.fill(0.0);
                frame.add_at_wheels(frame.wheels(commands).map(self.of), 1.0, lost);
            }
        }
    }
}

/// The answers' lags: by stretch, output, row, what is kept of an output until the next sample.
type Kept = Vec<Channels>;

/// The step to which commands are rounded, if they are.
pub(super) fn find(comparison: &Comparison<'_>) -> Option<Rounding> {
    let outputs = comparison.outputs();
    if comparison.data.inputs.len() != outputs || comparison.rates.iter().any(|r| !(r.is_finite() && *r > 0.0)) {
        return None;
    }
    let kept = kept(comparison);
    let (parts, answer) = (parts(comparison), |loss: &Loss| answer(comparison, &kept, loss));
    let signs = parts.iter().map(|(input, _)| answer(&Loss { input: *input, of: &f64::signum }));
    let taken: Vec<Vec<f64>> = orthonormal(fitted(comparison).chain(signs), 1e-6, 2).into_iter().flatten().collect();
    let rest = beside(&taken, comparison.white.iter().flatten().flatten().copied().collect());
    let guesses = guesses(&parts);
    let gains: Vec<f64> = guesses.iter().map(|guess| gain(&rest, &guess.lost(&answer))).collect();
    let best = (0..guesses.len()).max_by(|a, b| gains[*a].total_cmp(&gains[*b]))?;
    let mut sorted = gains.clone();
    sorted.sort_by(f64::total_cmp);
    let needed = 2.0 * (guesses.len() as f64 / FALSE_ALARM).ln();
    if gains[best] < needed.max(CONTRAST * sorted[sorted.len() * 9 / 10]) {
        return None;
    }
    let answer = beside(&taken, guesses[best].lost(&answer));
    let (gain, size) = (gain(&rest, &answer), size(&rest, &answer));
    let Guess { input, step, .. } = guesses[best];
    ANSWERS.contains(&size).then_some(Rounding { input, step, gain })
}

/// What may be rounded, and its largest magnitude.
fn parts(comparison: &Comparison<'_>) -> Vec<(Option<usize>, f64)> {
    let scales = &comparison.scene.scales;
    let wheels = comparison.scene.frame.has_wheels().then_some((None, scales.largest_command));
    let each = scales.largest.iter().copied().enumerate().map(|(i, u)| (Some(i), u));
    each.chain(wheels).filter(|(_, largest)| *largest > 0.0).collect()
}

fn guesses(parts: &[(Option<usize>, f64)]) -> Vec<Guess> {
    let mut all = Vec::new();
    for &(input, largest) in parts {
        for k in 0..=((MOST - FEWEST) * DENSE) as usize {
            let step = largest / (FEWEST + k as f64 / DENSE);
            all.extend([false, true].map(|cut_off| Guess { input, step, cut_off }));
        }
    }
    all
}

fn kept(comparison: &Comparison<'_>) -> Kept {
    let of = |time: &[f64], rate: f64| time.windows(2).map(|t| (-rate * (t[1] - t[0])).exp()).collect();
    comparison.data.stretches.iter().map(|s| comparison.rates.iter().map(|rate| of(&s.time, *rate)).collect()).collect()
}

/// The whitened answer to a loss, stretch by stretch and output by output: each output approaches its own command with its own lag.
fn answer(comparison: &Comparison<'_>, kept: &Kept, loss: &Loss<'_>) -> Vec<f64> {
    let outputs = comparison.outputs();
    let mut all = Vec::with_capacity(outputs * comparison.data.samples());
    for (stretch, kept) in comparison.data.stretches.iter().zip(kept) {
        let mut out: Channels = vec![vec![0.0; stretch.len()]; outputs];
        let (mut commands, mut lost) = (vec![f64::NAN; outputs], vec![0.0; outputs]);
        for k in 1..stretch.len() {
            if stretch.inputs.iter().zip(&commands).any(|(channel, u)| channel[k - 1] != *u) {
                commands.iter_mut().zip(&stretch.inputs).for_each(|(u, channel)| *u = channel[k - 1]);
                loss.row(&comparison.scene.frame, &commands, &mut lost);
            }
            for (i, out) in out.iter_mut().enumerate() {
                out[k] = lost[i] + (out[k - 1] - lost[i]) * kept[i][k - 1];
            }
        }
        for (i, mut series) in out.into_iter().enumerate() {
            (comparison.whiten)(i, &mut series);
            all.extend(series);
        }
    }
    all
}

/// Directions in which the fit was free, in the order of an answer: a refit would take what lies along them.
fn fitted<'a>(comparison: &'a Comparison<'_>) -> impl Iterator<Item = Vec<f64>> + 'a {
    let directions = comparison.jacobian.first().map_or(0, nalgebra::DMatrix::ncols);
    let ranges = comparison.ranges();
    (0..directions).map(move |j| {
        let part = |range: &std::ops::Range<usize>| {
            let rows = range.clone();
            comparison.jacobian.iter().flat_map(move |columns| rows.clone().map(move |row| columns[(row, j)]))
        };
        ranges.iter().flat_map(part).collect()
    })
}

/// A column without what lies along a basis.
fn beside(basis: &[Vec<f64>], mut column: Vec<f64>) -> Vec<f64> {
    basis.iter().for_each(|direction| clear(&mut column, direction));
    column
}

/// How much of an answer is in the rest.
fn size(rest: &[f64], answer: &[f64]) -> f64 {
    dot(rest, answer) / dot(answer, answer)
}

/// Twice the log-likelihood ratio; nothing where the rest goes the other way.
fn gain(rest: &[f64], answer: &[f64]) -> f64 {
    let gain = dot(rest, answer).max(0.0) * size(rest, answer);
    if gain.is_finite() { gain } else { 0.0 }
}
