//! When: seconds that hold more than noise, and times from which on the misfit is another one.

use crate::comparison::{Comparison, blocks};
use crate::finding::ChangePoint;

use super::Excess;

/// An effect acts in a second in which it moves an output by this many standard deviations of the noise of one sample, root mean square
/// over outputs: enough to be seen in the average over a second.
const ACTS: f64 = 1.0;
/// Blocks on either side that a change must have.
const EDGE: usize = 5;
/// Twice the log-likelihood ratio by which a change must improve on none, beyond its penalty: chance of a false alarm 1e-3 over about
/// a hundred independent places.
const DISTINCT: f64 = 23.0;
/// Fall of twice the log-likelihood that bounds the 95 % interval.
const WITHIN: f64 = 3.84;

/// Stretches of time that hold more than noise: seconds in which effects act, or else seconds whose energy noise does not explain. What
/// begins at a time of the recording is there from then on.
pub(super) fn intervals(comparison: &Comparison<'_>, excess: &Excess) -> Vec<(f64, f64)> {
    let mut intervals: Vec<(f64, f64)> = Vec::new();
    for (s, rows) in blocks(comparison.data, 1.0) {
        let n = rows.len() as f64;
        let sum: f64 = rows.clone().map(|k| excess.at(s, k)).sum();
        let outputs = comparison.outputs() as f64;
        let acts = if excess.exact { sum > ACTS * ACTS * n } else { sum > 3.0 * (2.0 * n * outputs).sqrt() };
        if !acts {
            continue;
        }
        let time = &comparison.data.stretches[s].time;
        let (from, to) = (time[rows.start], time[rows.end.min(time.len() - 1)]);
        match intervals.last_mut() {
            Some(last) if (from - last.1).abs() < 1e-9 => last.1 = to,
            _ => intervals.push((from, to)),
        }
    }
    match comparison.since {
        Some(since) => from(comparison, intervals, since),
        None => intervals,
    }
}

/// Intervals before a time as they are, and all that was recorded from that time on.
fn from(comparison: &Comparison<'_>, mut intervals: Vec<(f64, f64)>, since: f64) -> Vec<(f64, f64)> {
    intervals.retain(|(from, _)| *from < since);
    intervals.iter_mut().for_each(|(_, to)| *to = to.min(since));
    for stretch in &comparison.data.stretches {
        let (first, last) = (stretch.time[0], stretch.time[stretch.len() - 1]);
        if last > since {
            intervals.push((first.max(since), last));
        }
    }
    intervals
}

/// A time at which the energy of the base model's misfit changes for good.
pub(super) fn changes(comparison: &Comparison<'_>) -> Vec<ChangePoint> {
    let blocks = blocks(comparison.data, 1.0);
    let energy: Vec<f64> = blocks
        .iter()
        .map(|(s, rows)| {
            let one = |i: usize, k: usize| (comparison.misfit(*s, i, k) / comparison.noise[i]).powi(2);
            let sum: f64 = rows.clone().map(|k| (0..comparison.outputs()).map(|i| one(i, k)).sum::<f64>()).sum();
            (sum / (rows.len() * comparison.outputs()) as f64).max(1e-12)
        })
        .collect();
    let n = energy.len();
    if n < 4 * EDGE {
        return Vec::new();
    }
    // Energies of blocks scatter by factors: their logarithms are compared.
    let logs: Vec<f64> = energy.iter().map(|e| e.ln()).collect();
    let means = |k: usize| [&logs[..k], &logs[k..]].map(|part| part.iter().sum::<f64>() / part.len() as f64);
    let step = |k: usize| {
        let [before, after] = means(k);
        (k * (n - k)) as f64 / n as f64 * (before - after).powi(2)
    };
    let Some(at) = (EDGE..n - EDGE).max_by(|a, b| step(*a).total_cmp(&step(*b))) else { return Vec::new() };
    // What is largest at an end of where it is sought grows beyond it: the robot had not moved yet, or no longer did.
    if at == EDGE || at == n - EDGE - 1 {
        return Vec::new();
    }
    let [before, after] = means(at);
    let left: Vec<f64> = logs.iter().enumerate().map(|(k, x)| x - if k < at { before } else { after }).collect();
    // Neighbouring seconds are alike: the variance of a mean is that of independent ones times (1 + r)/(1 - r).
    let square = left.iter().map(|x| x * x).sum::<f64>();
    let alike = (left.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / square.max(f64::MIN_POSITIVE)).clamp(0.0, 0.95);
    let noise = (square / n as f64 * (1.0 + alike) / (1.0 - alike)).max(1e-6);
    let ratios: Vec<(usize, f64)> = (EDGE..n - EDGE).map(|k| (k, step(k) / noise)).collect();
    let best = step(at) / noise;
    if best < DISTINCT {
        return Vec::new();
    }
    let time = |block: usize| comparison.data.stretches[blocks[block].0].time[blocks[block].1.start];
    let within: Vec<usize> = ratios.iter().filter(|(_, r)| best - r <= WITHIN).map(|(k, _)| *k).collect();
    let (first, last) = (within.first().copied().unwrap_or(at), within.last().copied().unwrap_or(at));
    let words = format!("the misfit {} from here on", if after > before { "is larger" } else { "is smaller" });
    vec![ChangePoint { time: time(at), interval: (time(first.saturating_sub(1)), time((last + 1).min(n - 1))), words }]
}
