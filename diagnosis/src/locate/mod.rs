//! Where simulation and recording differ, in what exceeds the noise: by channel, wheel, time, state and frequency.
//!
//! Where effects were found, it is what they change: the model with them minus the base model as it is compared, free of noise, in samples
//! in which they act. A base model bent by what it cannot say is wrong elsewhere too; that is the effects' doing, and no place of theirs.
//! Where none was found it is what was measured minus the base model, whose noise is taken off as a variance.

mod regions;
mod spectrum;
mod times;

use crate::comparison::{Channels, Comparison};
use crate::finding::Location;

/// An effect that moves a sample by less than this many standard deviations of its noise does not act there: free runs are no more exact.
const NEVER: f64 = 0.01;

/// Where the base model is off.
pub(crate) struct Excess {
    /// By how much, in each sample: by stretch, output, row.
    pub(crate) off: Vec<Channels>,
    /// The same squared, in units of the noise's variance, without what noise puts in.
    pub(crate) squared: Vec<Channels>,
    /// Whether it is what effects change, free of noise.
    pub(crate) exact: bool,
}

impl Excess {
    /// What the effects change where there are any, else what the base model leaves over.
    pub(crate) fn of(comparison: &Comparison<'_>) -> Self {
        let exact = comparison.model.iter().zip(comparison.without).any(|(a, b)| a != b);
        let off: Vec<Channels> = (0..comparison.data.stretches.len())
            .map(|s| {
                let rows = comparison.data.stretches[s].len();
                (0..comparison.outputs()).map(|i| (0..rows).map(|k| off(comparison, exact, s, i, k)).collect()).collect()
            })
            .collect();
        let noise = if exact { 0.0 } else { 1.0 };
        let square = |i: usize, x: &f64| (x / comparison.noise[i]).powi(2) - noise;
        let squared = off.iter().map(|o| o.iter().enumerate().map(|(i, c)| c.iter().map(|x| square(i, x)).collect()).collect()).collect();
        Self { off, squared, exact }
    }

    /// Excess of a sample, over all outputs.
    pub(crate) fn at(&self, stretch: usize, row: usize) -> f64 {
        self.squared[stretch].iter().map(|c| c[row]).sum()
    }
}

/// By how much the base model is off in a sample. Where effects are to explain it (`exact`): nothing in a sample in which none acts.
fn off(comparison: &Comparison<'_>, exact: bool, s: usize, i: usize, k: usize) -> f64 {
    let model = comparison.model[s][i][k];
    match exact {
        false => comparison.misfit(s, i, k),
        true if (model - comparison.without[s][i][k]).abs() < NEVER * comparison.noise[i] => 0.0,
        true => model - comparison.base[s][i][k],
    }
}

/// Finds where. `tests` are the sentences of the tests that need no library.
pub fn locate(comparison: &Comparison<'_>, tests: Vec<String>) -> Location {
    let excess = Excess::of(comparison);
    let channels = shares_of_channels(comparison, &excess);
    let wheels = shares_of_wheels(comparison, &excess);
    let regions = regions::find(comparison, &excess);
    let times = times::intervals(comparison, &excess);
    let changes = times::changes(comparison);
    let frequencies_hz = spectrum::bands(comparison, &excess);
    let mut location = Location { channels, wheels, times, changes, regions, frequencies_hz, statement: String::new(), tests };
    location.statement = statement(&location, comparison.since);
    location
}

fn shares_of_channels(comparison: &Comparison<'_>, excess: &Excess) -> Vec<(String, f64)> {
    let sums: Vec<f64> = (0..comparison.outputs()).map(|i| excess.squared.iter().flat_map(|s| &s[i]).sum::<f64>().max(0.0)).collect();
    let total = sums.iter().sum::<f64>();
    let share = |sum: f64| if total > 0.0 { sum / total } else { 0.0 };
    comparison.data.outputs.iter().zip(sums).map(|(c, sum)| (c.name.to_string(), share(sum))).collect()
}

/// Shares of the left and the right wheel's ground speed, the outputs' noise carried over to them.
fn shares_of_wheels(comparison: &Comparison<'_>, excess: &Excess) -> Option<(f64, f64)> {
    let frame = comparison.scene.frame;
    if !frame.has_wheels() || comparison.outputs() != 2 {
        return None;
    }
    let mut sums = [0.0; 2];
    for (s, stretch) in comparison.data.stretches.iter().enumerate() {
        for k in 0..stretch.len() {
            let difference: [f64; 2] = std::array::from_fn(|i| excess.off[s][i][k]);
            let noise = if excess.exact { [0.0; 2] } else { [comparison.noise[0], comparison.noise[1]] };
            let [left, right] = frame.wheels(&difference);
            // Independent noises add as squares: the wheels of noise of one output each.
            let (a, b) = (frame.wheels(&[noise[0], 0.0]), frame.wheels(&[0.0, noise[1]]));
            sums[0] += left * left - a[0] * a[0] - b[0] * b[0];
            sums[1] += right * right - a[1] * a[1] - b[1] * b[1];
        }
    }
    let [left, right] = sums.map(|s| s.max(0.0));
    (left + right > 0.0).then(|| (left / (left + right), right / (left + right)))
}

fn statement(location: &Location, since: Option<f64>) -> String {
    let mut parts = Vec::new();
    if let Some(since) = since {
        parts.push(format!("it begins at {since:.1} s"));
    }
    if let Some((name, share)) = location.channels.iter().max_by(|a, b| a.1.total_cmp(&b.1)).filter(|c| c.1 > 0.0) {
        parts.push(format!("{:.0} % of the misfit beyond noise is in {name}", 100.0 * share));
    }
    if let Some(region) = location.regions.iter().find(|r| r.share >= regions::NOTABLE) {
        parts.push(format!(
            "{:.0} % of it lies in {:.0} % of the samples: {}",
            100.0 * region.share,
            100.0 * region.expected,
            region.words
        ));
    }
    if let Some((left, right)) = location.wheels.filter(|(l, r)| (l - r).abs() > 0.3) {
        parts.push(format!("{:.0} % is the {} wheel's", 100.0 * left.max(right), if left > right { "left" } else { "right" }));
    }
    if let Some(change) = location.changes.first() {
        parts.push(format!("it is another from {:.1} s on ({:.1} s to {:.1} s)", change.time, change.interval.0, change.interval.1));
    }
    match parts.is_empty() {
        true => "nothing exceeds the noise anywhere".to_owned(),
        false => parts.join("; "),
    }
}

#[cfg(test)]
mod tests;
