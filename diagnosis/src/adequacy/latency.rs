//! Latencies that scatter: each message comes late by a time of its own.
//!
//! Behind a message that is later than the others by δ the robot is where it would have been δ before, and until the next one the model is off by
//! −δ ẏ. So noise grows with acceleration as it does where stamps jitter, but all samples that one message brings share its δ. It is chance if
//! that δ explains most of what is left there, and no δ has to do with what was commanded, with the time, or with the one before it.

use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ContinuousCDF, FisherSnedecor};

use crate::comparison::Comparison;

use super::jitter::{Growth, Jitter, SURE, Scatter, growth, left_of, slopes_of};

/// Samples that a message has to itself, so that it shows whether they share one time.
const ALONE: usize = 4;
/// Messages of which the scatter of anything can be told.
const SEVERAL: usize = 12;
/// Share of what is left behind messages that one time for each has to explain.
const SHARED: f64 = 0.5;
/// What the times of messages may have to do with, and their mean.
const CAUSES: usize = 7;
/// Chance that times which have to do with something are taken for chance, or chance for that.
const DOUBT: f64 = 0.01;
/// Rounds in which how far times scatter, and how far slopes have to reach for that, find each other.
const ROUNDS: usize = 4;

/// A message of one input, with the samples that it brings.
struct Message {
    /// How much later than the mean it comes \[s\], and the information on that.
    delta: f64,
    information: f64,
    /// What is left of its samples, in squares.
    square: f64,
    rows: usize,
    /// The command before it, its step, and when it was sent.
    before: f64,
    step: f64,
    time: f64,
}

pub(super) fn find(comparison: &Comparison<'_>) -> Option<Jitter> {
    let latest = comparison.late.iter().copied().fold(0.0, f64::max);
    if latest <= 0.0 || comparison.data.inputs.len() != comparison.outputs() {
        return None;
    }
    let (mut reach, mut found) = (0.0, None);
    for _ in 0..ROUNDS {
        let (squares, slopes) = spread(comparison, reach);
        let Growth { still, variance, error } = growth(&squares, &slopes)?;
        if variance <= SURE * error || variance - SURE * error > latest * latest {
            return None;
        }
        reach = variance.sqrt();
        found = Some(Jitter { of: Scatter::Messages, deviation: reach, error: error / (2.0 * reach), z: variance / error, still });
    }
    let found = found?;
    let messages: Vec<Vec<Message>> = (0..comparison.outputs()).map(|output| messages(comparison, output, &found)).collect();
    let all = || messages.iter().flatten();
    if all().count() < SEVERAL || shared(all(), found.still) < SHARED {
        return None;
    }
    messages.iter().all(|of| by_chance(of)).then_some(found)
}

/// Squares of what is left and of the model's slopes, all outputs in units of their noise.
fn spread(comparison: &Comparison<'_>, reach: f64) -> (Vec<f64>, Vec<f64>) {
    let (mut squares, mut slopes) = (Vec::new(), Vec::new());
    for (output, noise) in comparison.noise.iter().enumerate() {
        squares.extend(left_of(comparison, output).iter().map(|left| left * left));
        slopes.extend(slopes_of(comparison, output, reach).iter().map(|d| (d / noise).powi(2)));
    }
    (squares, slopes)
}

/// The messages of the input that moves an output, those that have samples to themselves.
fn messages(comparison: &Comparison<'_>, output: usize, scatter: &Jitter) -> Vec<Message> {
    let late = comparison.late.get(output).or(comparison.late.first()).copied().unwrap_or(0.0);
    let noise = comparison.noise[output];
    let mut all = Vec::new();
    for (s, stretch) in comparison.data.stretches.iter().enumerate() {
        let (time, u) = (&stretch.time, &stretch.inputs[output]);
        let left: Vec<f64> = comparison.left(s, output).map(|left| left / noise).collect();
        let slope: Vec<f64> = scatter.slope(time, &comparison.model[s][output]).iter().map(|d| d / noise).collect();
        let sent: Vec<usize> = (1..u.len()).filter(|k| u[*k] != u[k - 1]).collect();
        // One that comes early begins to show before the mean.
        let from = |k: usize| time.partition_point(|t| *t < time[k] + late - scatter.deviation);
        for (i, &k) in sent.iter().enumerate() {
            let rows = from(k)..sent.get(i + 1).map_or(time.len(), |next| from(*next));
            if rows.len() < ALONE {
                continue;
            }
            let (left, slope) = (&left[rows.clone()], &slope[rows.clone()]);
            let information: f64 = slope.iter().map(|d| d * d).sum();
            let along: f64 = left.iter().zip(slope).map(|(left, d)| -left * d).sum();
            let square = left.iter().map(|left| left * left).sum();
            let delta = if information > 0.0 { along / information } else { 0.0 };
            all.push(Message { delta, information, square, rows: rows.len(), before: u[k - 1], step: u[k] - u[k - 1], time: time[k] });
        }
    }
    all
}

/// Share of what is left behind messages, beyond the noise, that one time for each explains.
fn shared<'m>(messages: impl Iterator<Item = &'m Message>, still: f64) -> f64 {
    let (mut explained, mut excess) = (0.0, 0.0);
    for m in messages {
        explained += m.delta * m.delta * m.information - still;
        excess += m.square - still * m.rows as f64;
    }
    if excess > 0.0 { explained / excess } else { 0.0 }
}

/// Whether the times of an output's messages have to do with nothing: as much of them as of chance goes with the command, its step, the time and
/// the message before.
fn by_chance(messages: &[Message]) -> bool {
    let mean = |of: &dyn Fn(&Message) -> f64| messages.iter().map(of).sum::<f64>() / messages.len() as f64;
    let size = mean(&|m| m.step.abs());
    let last = |i: usize| if i > 0 { messages[i - 1].delta } else { 0.0 };
    // A message counts by how well its time shows, within the scatter that all have.
    let spread = mean(&|m| m.delta * m.delta);
    let weight = |m: &Message| (m.information / (1.0 + spread * m.information)).sqrt();
    let causes = |(i, m): (usize, &Message)| {
        let after = m.before + m.step;
        [1.0, m.before, m.step, after.abs() - m.before.abs(), m.step.abs() - size, m.time, last(i)].map(|cause| weight(m) * cause)
    };
    let rows: Vec<[f64; CAUSES]> = messages.iter().enumerate().map(causes).collect();
    if rows.len() < 2 * CAUSES {
        return true;
    }
    let causes = DMatrix::from_fn(rows.len(), CAUSES, |i, j| rows[i][j]);
    let times = DVector::from_iterator(rows.len(), messages.iter().map(|m| weight(m) * m.delta));
    let Ok(by) = causes.clone().svd(true, true).solve(&times, 1e-9) else { return false };
    let (all, left) = (times.norm_squared(), (&times - causes * by).norm_squared());
    let (by, beside) = (CAUSES as f64, (rows.len() - CAUSES) as f64);
    let ratio = (all - left) / by / (left / beside).max(f64::MIN_POSITIVE);
    FisherSnedecor::new(by, beside).is_ok_and(|chance| chance.sf(ratio) > DOUBT)
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand::rngs::StdRng;

    use super::*;
    use crate::fixture::{Case, normal};

    /// How late commands come [s], and by how much that scatters.
    const LATE: f64 = 0.1;
    const SCATTERS: f64 = 0.03;

    /// A clean case whose commands were sent two samples before they act; `off(before, after, random)` is by how much later each acts.
    fn case(seed: u64, off: impl Fn(f64, f64, &mut StdRng) -> f64) -> Case {
        let (mut case, mut random) = (Case::clean(seed), StdRng::seed_from_u64(seed));
        for (stretch, truth) in case.data.stretches.iter_mut().zip(&case.truth) {
            for (i, run) in truth.iter().enumerate() {
                let (slopes, mut delta) = (super::super::slope(&stretch.time, run), 0.0);
                for (k, slope) in slopes.iter().enumerate().skip(1) {
                    let [before, after] = [k - 1, k].map(|k| stretch.inputs[i][k]);
                    if before != after {
                        delta = off(before, after, &mut random);
                    }
                    stretch.outputs[i][k] -= delta * slope;
                }
                stretch.inputs[i].rotate_left(2);
            }
        }
        case
    }

    fn found(case: &Case, late: &[f64]) -> Option<Jitter> {
        case.compare(None, |c| find(&Comparison { late, ..*c }))
    }

    #[test]
    fn latencies_that_scatter_are_found_with_their_size() {
        let seen = (0..10).filter(|seed| {
            let case = case(*seed, |_, _, random| SCATTERS * normal(random));
            assert_eq!(found(&case, &[]), None, "nothing comes late");
            found(&case, &[LATE]).is_some_and(|found| (found.deviation / SCATTERS - 1.0).abs() < 0.35)
        });
        assert!(seen.count() >= 9);
    }

    #[test]
    fn what_goes_with_the_command_is_no_chance_nor_is_what_changes_behind_a_message() {
        for seed in 0..10 {
            assert_eq!(found(&case(seed, |_, _, _| 0.0), &[LATE]), None, "{seed}: nothing scatters");
            let step = case(seed, |before, after, _| SCATTERS * (after - before).signum());
            assert_eq!(found(&step, &[LATE]), None, "{seed}");
            let stamps = Case::jittering(seed, SCATTERS);
            assert_eq!(found(&stamps, &[LATE]), None, "{seed}");
        }
    }
}
