//! Which motions a recording holds: facts of its channels, and the words for one that is missing.

use serde::Serialize;

use super::term::Term;
use crate::channel::Channel;
use crate::dataset::{Dataset, Stretch};

/// A channel moves where it exceeds this share of its largest value.
const MOVING: f64 = 0.05;
/// A channel is steady over a second in which it varies by less than this share of its largest value.
const STEADY: f64 = 0.1;
/// Shares of time below this count as never.
const NEVER: f64 = 0.02;
/// Frequencies at which the power of a channel is looked at.
const FREQUENCIES: usize = 32;

/// What one channel does in a recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChannelFacts {
    /// Name.
    pub name: String,
    /// Largest magnitude, in the channel's unit.
    pub largest: f64,
    /// Share of the samples at which it is away from zero: by a twentieth of its largest value, and for an output by three
    /// times its noise.
    pub moving: f64,
    /// Share of the seconds throughout which it stays within a tenth of its largest value.
    pub steady: f64,
    /// How often it changes sign, from away from zero on one side to away from zero on the other.
    pub reversals: usize,
    /// Changes between neighbouring samples of more than a tenth of its largest value: steps of a command.
    pub steps: usize,
    /// Band between 5 % and 95 % of its power about its mean \[Hz\]; `None` if it never changes.
    pub band_hz: Option<(f64, f64)>,
}

/// How much two outputs move at once.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PairFacts {
    /// Name of one output.
    pub first: String,
    /// Name of the other.
    pub second: String,
    /// Share of the samples at which both are away from zero.
    pub together: f64,
}

/// The motions in a recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Excitation {
    /// One entry an input.
    pub inputs: Vec<ChannelFacts>,
    /// One entry an output.
    pub outputs: Vec<ChannelFacts>,
    /// One entry a pair of outputs.
    pub pairs: Vec<PairFacts>,
}

impl Excitation {
    /// Collects the facts; `noise` is the standard deviation of each output's noise.
    pub fn of(data: &Dataset, noise: &[f64]) -> Self {
        let inputs = (0..data.inputs.len()).map(|i| facts(data, &data.inputs[i], &|s| &s.inputs[i], 0.0)).collect();
        let outputs: Vec<ChannelFacts> =
            (0..data.outputs.len()).map(|i| facts(data, &data.outputs[i], &|s| &s.outputs[i], noise[i])).collect();
        let mut pairs = Vec::new();
        for a in 0..outputs.len() {
            for b in a + 1..outputs.len() {
                let (first, second) = (threshold(outputs[a].largest, noise[a]), threshold(outputs[b].largest, noise[b]));
                let both =
                    |s: &Stretch| s.outputs[a].iter().zip(&s.outputs[b]).filter(|(x, y)| x.abs() > first && y.abs() > second).count();
                let together = data.stretches.iter().map(both).sum::<usize>() as f64 / data.samples().max(1) as f64;
                pairs.push(PairFacts { first: outputs[a].name.clone(), second: outputs[b].name.clone(), together });
            }
        }
        Self { inputs, outputs, pairs }
    }

    /// The motion that a term needs and the recording lacks, in words; `None` if all its factors move.
    pub(super) fn missing(&self, term: &Term) -> Option<String> {
        if let Some(i) = term.inputs.iter().find(|i| self.inputs[**i].moving < NEVER) {
            return Some(format!("{} is never given", self.inputs[*i].name));
        }
        let still = |i: &&usize| self.outputs[**i].moving < NEVER;
        let mut moved: Vec<usize> = term.outputs.iter().chain(&term.accelerations).copied().collect();
        moved.sort_unstable();
        moved.dedup();
        if let [a, b] = moved[..] {
            let names = [&self.outputs[a].name, &self.outputs[b].name];
            let pair = self.pairs.iter().find(|p| p.first == *names[0] && p.second == *names[1]);
            if pair.is_some_and(|p| p.together < NEVER) && moved.iter().all(|i| !still(&i)) {
                return Some(together(names[0], names[1]));
            }
        }
        if let Some(i) = moved.iter().find(still) {
            return Some(never(&self.outputs[*i].name));
        }
        let constant = term.accelerations.iter().find(|i| self.outputs[**i].steady > 1.0 - NEVER);
        constant.map(|i| unchanging(&self.outputs[*i].name))
    }
}

fn never(name: &str) -> String {
    match name {
        "v" => "the robot never drives".to_owned(),
        "omega" => "the robot never turns".to_owned(),
        _ => format!("{name} never leaves zero"),
    }
}

fn together(first: &str, second: &str) -> String {
    match (first, second) {
        ("v", "omega") | ("omega", "v") => "the robot never turns while driving".to_owned(),
        _ => format!("{first} and {second} are never away from zero at once"),
    }
}

fn unchanging(name: &str) -> String {
    match name {
        "v" => "the forward speed hardly ever changes".to_owned(),
        "omega" => "the turning rate hardly ever changes".to_owned(),
        _ => format!("{name} hardly ever changes"),
    }
}

fn threshold(largest: f64, noise: f64) -> f64 {
    (MOVING * largest).max(3.0 * noise)
}

fn facts(data: &Dataset, channel: &Channel, column: &dyn Fn(&Stretch) -> &Vec<f64>, noise: f64) -> ChannelFacts {
    let values = || data.stretches.iter().flat_map(|s| column(s).iter().copied());
    let largest = values().fold(0.0_f64, |m, x| m.max(x.abs()));
    let away = threshold(largest, noise);
    let moving = values().filter(|x| x.abs() > away).count() as f64 / data.samples().max(1) as f64;
    let (mut reversals, mut steps, mut seconds, mut quiet) = (0, 0, 0, 0);
    for stretch in &data.stretches {
        let x = column(stretch);
        let mut side = 0.0;
        for value in x.iter().filter(|x| x.abs() > away) {
            reversals += usize::from(side * value < 0.0);
            side = value.signum();
        }
        steps += x.windows(2).filter(|w| (w[1] - w[0]).abs() > STEADY * largest).count();
        let (all, still) = steady_seconds(&stretch.time, x, (STEADY * largest).max(6.0 * noise));
        seconds += all;
        quiet += still;
    }
    let steady = if seconds > 0 { quiet as f64 / seconds as f64 } else { 0.0 };
    ChannelFacts { name: channel.name.to_string(), largest, moving, steady, reversals, steps, band_hz: band(data, column) }
}

/// Whole seconds of a stretch, and those in which the value varies by no more than `range`.
fn steady_seconds(time: &[f64], x: &[f64], range: f64) -> (usize, usize) {
    let (mut all, mut steady, mut start) = (0, 0, 0);
    for k in 1..time.len() {
        if time[k] - time[start] >= 1.0 - 1e-9 {
            let (low, high) = x[start..k].iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
            all += 1;
            steady += usize::from(high - low <= range);
            start = k;
        }
    }
    (all, steady)
}

/// Band that holds the middle nine tenths of the power about the mean, from Fourier sums with a Hann window at frequencies evenly
/// spaced in logarithm; true time stamps are used, so that uneven ones do no harm.
fn band(data: &Dataset, column: &dyn Fn(&Stretch) -> &Vec<f64>) -> Option<(f64, f64)> {
    let values = || data.stretches.iter().flat_map(|s| column(s).iter().copied());
    let mean = values().sum::<f64>() / data.samples().max(1) as f64;
    let energy: f64 = values().map(|x| (x - mean).powi(2)).sum();
    let longest = data.stretches.iter().map(|s| s.time[s.len() - 1] - s.time[0]).fold(0.0, f64::max);
    let (low, high) = (1.0 / longest, 0.5 / data.period());
    if energy <= 0.0 || !(low > 0.0 && high > low) {
        return None;
    }
    let ratio = (high / low).powf(1.0 / (FREQUENCIES - 1) as f64);
    let frequencies: Vec<f64> = (0..FREQUENCIES).map(|k| low * ratio.powi(k as i32)).collect();
    // Power density times the width of each frequency's share of the axis.
    let power: Vec<f64> =
        frequencies.iter().map(|f| f * data.stretches.iter().map(|s| power(&s.time, column(s), mean, *f)).sum::<f64>()).collect();
    let total: f64 = power.iter().sum();
    let reached = |share: f64| {
        let mut sum = 0.0;
        let at = power.iter().position(|p| {
            sum += p;
            sum >= share * total
        });
        frequencies[at.unwrap_or(FREQUENCIES - 1)]
    };
    (total > 0.0).then(|| (reached(0.05), reached(0.95)))
}

fn power(time: &[f64], x: &[f64], mean: f64, frequency: f64) -> f64 {
    let (first, span) = (time[0], time[time.len() - 1] - time[0]);
    let (mut re, mut im) = (0.0, 0.0);
    for (t, x) in time.iter().zip(x) {
        let window = 0.5 - 0.5 * (std::f64::consts::TAU * (t - first) / span).cos();
        let (sin, cos) = (std::f64::consts::TAU * frequency * (t - first)).sin_cos();
        re += window * (x - mean) * cos;
        im += window * (x - mean) * sin;
    }
    (re * re + im * im) / time.len() as f64
}
