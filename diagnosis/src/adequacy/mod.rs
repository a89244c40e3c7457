//! Whether a model is adequate, asked without any library: tests of what it leaves over.
//!
//! A library always finds something to name. These tests know no effect; they say whether anything is left, and where to look.

mod bursts;
mod events;
mod flags;
mod jitter;
mod latency;
mod lattice;
mod memory;
mod orders;
mod readout;
mod rhythm;
mod rounding;
pub mod structure;
mod sweep;

pub use bursts::Burst;
pub use events::Events;
pub use flags::{Explained, review};
pub use jitter::{Jitter, Scatter};
pub use lattice::{Counts, Lattice};
pub use memory::Memory;
pub use orders::OrderLine;
pub(crate) use orders::find as lined;
pub use readout::Coarse;
pub use rhythm::Rhythm;
pub use rounding::Rounding;
pub use structure::Structure;

use crate::comparison::{Channels, Comparison};
use crate::effects::digits;
use crate::fit::setting::Setting;
use crate::noise::Noise;

/// What the tests found.
#[derive(Debug, Clone, PartialEq)]
pub struct Adequacy {
    /// Commands that are rounded.
    pub rounding: Option<Rounding>,
    /// Anything that depends on what was going on.
    pub structure: Structure,
    /// Times with more than their share.
    pub bursts: Vec<Burst>,
    /// Times far out that come again and again.
    pub events: Option<Events>,
    /// A rest that lasts.
    pub memory: Option<Memory>,
    /// What returns with a wheel's turn.
    pub order: Option<OrderLine>,
    /// What comes again at even times.
    pub rhythm: Option<Rhythm>,
    /// Noise that grows with acceleration: of stamps that jitter, or of messages each of which comes late by a time of its own.
    pub jitter: Option<Jitter>,
    /// Outputs that are multiples of a quantum.
    pub lattices: Vec<Lattice>,
    /// Wheels whose speeds are counts of an encoder.
    pub counts: Option<Counts>,
    /// Outputs of a readout so coarse that no other noise hides it, where they are no counts of the wheels.
    pub coarse: Vec<Coarse>,
}

/// Runs the tests. The same seed gives the same answer.
pub fn examine(comparison: &Comparison<'_>, seed: u64) -> Adequacy {
    let (jitter, lattices) = (scatter(comparison), lattice::find(comparison));
    let counts = lattice::counts(comparison, &lattices);
    let structure = |comparison: &Comparison<'_>| structure::measure(comparison, jitter.as_ref());
    let own = structure(comparison);
    // What a coarse readout adds depends on the motion, and is no motion; where nothing depends on motion, of what was recorded, it is noise.
    let rest = comparison.recorded();
    let unrounded = rest != comparison.rest;
    let white = if unrounded { comparison.whitened(&rest) } else { comparison.white.to_vec() };
    let unknown = vec![0.0; comparison.outputs()];
    let recorded = Comparison { rest: &rest, white: &white, rounded: &unknown, ..*comparison };
    let asked = counts.is_none() && if unrounded { structure(&recorded).significant() } else { own.significant() };
    let (coarse, white) = if asked { readout::find(&recorded) } else { (Vec::new(), Vec::new()) };
    let cleared = Comparison { white: &white, ..*comparison };
    let comparison = if coarse.is_empty() || unrounded { comparison } else { &cleared };
    Adequacy {
        structure: if coarse.is_empty() || unrounded { own } else { structure(comparison) },
        bursts: bursts::find(comparison, seed, jitter.as_ref()),
        events: if jitter.is_none() { events::find(comparison) } else { None },
        memory: memory::find(comparison, &coarse),
        order: orders::find(comparison),
        rhythm: rhythm::find(comparison),
        rounding: rounding::find(comparison),
        jitter,
        counts,
        coarse,
        lattices,
    }
}

impl Adequacy {
    /// A sentence for every test that found something.
    pub fn sentences(&self, comparison: &Comparison<'_>) -> Vec<String> {
        let mut all = Vec::new();
        let name = |output: usize| comparison.data.outputs[output].name.clone();
        if let Some(Rounding { input, step, .. }) = &self.rounding {
            let (whose, unit) = match input {
                Some(input) => (comparison.data.inputs[*input].name.to_string(), comparison.data.inputs[*input].unit.to_string()),
                None => ("each wheel's command".to_owned(), comparison.data.inputs[0].unit.to_string()),
            };
            all.push(format!(
                "{whose} is followed in steps of {} {unit}: commands are rounded, which no effect of the library does",
                digits(*step)
            ));
        }
        if self.structure.significant() {
            let Structure { z, of, output, .. } = &self.structure;
            all.push(format!("what is left of {} depends on {of} ({z:.0} standard deviations beyond chance)", name(*output)));
        }
        for burst in &self.bursts {
            all.push(format!("between {:.1} s and {:.1} s more is left than at other times", burst.time.0, burst.time.1));
        }
        if let Some(Events { output, count, lasts, first, .. }) = &self.events {
            all.push(format!(
                "{count} times, the first at {first:.1} s, {} is missed for {lasts:.2} s by far more than its noise: something happens now and then that no \
                 command causes",
                name(*output)
            ));
        }
        if let Some(Memory { output, lag, correlation, .. }) = &self.memory {
            let (name, of) = (name(*output), 100.0 * correlation);
            all.push(format!(
                "{of:.0} % of what is left of {name} is there after {lag:.1} s still or again: a push or a drift that no command causes"
            ));
        }
        if let Some(OrderLine { wheel, order, kinematic, .. }) = &self.order {
            let side = ["left", "right"][*wheel];
            let kind = if *kinematic { "grows with speed: geometry" } else { "does not grow with speed: a torque" };
            all.push(format!("something returns {order:.2} times per turn of the {side} wheel and {kind}"));
        }
        if let Some(Rhythm { frequency, .. }) = self.rhythm {
            all.push(format!("something comes again every {} s, whatever the robot does: no command causes it", digits(1.0 / frequency)));
        }
        if let Some(jitter) = &self.jitter {
            let size = 1e3 * jitter.deviation;
            all.push(match jitter.of {
                Scatter::Stamps => format!("the noise grows with acceleration as if stamps jittered by {size:.1} ms"),
                Scatter::Messages => format!("each command comes late by a time of its own, that scatters by {size:.0} ms about the mean"),
            });
        }
        for lattice in &self.lattices {
            let unit = &comparison.data.outputs[lattice.output].unit;
            all.push(format!("values of {} are multiples of {:.3e} {unit}", name(lattice.output), lattice.quantum));
        }
        if let Some(counts) = &self.counts {
            all.push(format!("the wheels' speeds come in counts of {:.3e} m of travel", counts.travel));
        }
        if !self.coarse.is_empty() {
            let names: Vec<String> = self.coarse.iter().map(|coarse| name(coarse.output).to_string()).collect();
            all.push(format!("what is left of {} goes up and down with the rounding of its values", names.join(" and ")));
        }
        all
    }
}

/// Stamps that jitter, or else latencies that scatter.
fn scatter(comparison: &Comparison<'_>) -> Option<Jitter> {
    jitter::find(comparison).or_else(|| latency::find(comparison))
}

/// Whether times scatter, and then what is asked of that.
pub(crate) fn jittered<T>(comparison: &Comparison<'_>, ask: impl FnOnce(Jitter, &Comparison<'_>) -> T) -> Option<T> {
    scatter(comparison).map(|found| ask(found, comparison))
}

/// Whether the wheels' speeds come in whole counts.
pub(crate) fn counted(comparison: &Comparison<'_>) -> bool {
    lattice::counts(comparison, &lattice::find(comparison)).is_some()
}

/// Asks a test that looks at the whitened rest of a free run alone, which leaves `left`.
pub(crate) fn whitened<T>(
    setting: &Setting<'_>,
    run: &[Channels],
    left: Vec<Channels>,
    late: &[f64],
    noise: &Noise,
    ask: impl FnOnce(&Comparison<'_>) -> T,
) -> T {
    let mut white = left.clone();
    white.iter_mut().enumerate().for_each(|(s, left)| noise.whiten(s, left));
    let comparison = Comparison {
        data: setting.data,
        scene: setting.scene,
        base: run,
        model: run,
        without: run,
        moments: false,
        since: None,
        late,
        rest: &left,
        white: &white,
        whiten: &|_, _| (),
        rounded: &setting.rounded,
        noise: &noise.deviation,
        rates: &[],
        jacobian: &[],
    };
    ask(&comparison)
}

/// Slope of a series, by central differences.
pub(crate) fn slope(time: &[f64], series: &[f64]) -> Vec<f64> {
    slope_within(time, series, 0.0)
}

/// Slope of a series by differences over so much time to either side, and at least to the next samples.
fn slope_within(time: &[f64], series: &[f64], reach: f64) -> Vec<f64> {
    let of = |(k, t): (usize, &f64)| {
        let a = time.partition_point(|other| *other < t - reach).min(k.saturating_sub(1));
        let b = (time.partition_point(|other| *other <= t + reach) - 1).max((k + 1).min(time.len() - 1));
        if time[b] > time[a] { (series[b] - series[a]) / (time[b] - time[a]) } else { 0.0 }
    };
    time.iter().enumerate().map(of).collect()
}

#[cfg(test)]
mod tests;
