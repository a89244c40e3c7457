//! From what a fit leaves to flags that a verdict can weigh.

use nalgebra::DMatrix;
use wheelwright_core::effect::Scene;
use wheelwright_core::model::ModelError;

use super::{Adequacy, Scatter, examine, memory, structure};
use crate::comparison::{Channels, Comparison, rates};
use crate::finding::Location;
use crate::locate::locate;
use crate::residuals::{Flag, Residuals, Series};

/// What the effects that were found do.
pub struct Explained<'a> {
    /// Free run of the final fit with every effect neutral, nothing refitted.
    pub without: &'a Series,
    /// When the first of them begins that begin during the recording \[s\].
    pub since: Option<f64>,
    /// By how much they let commands come late \[s\]: one time for all inputs, one each, or none.
    pub late: Vec<f64>,
    /// Twice the log-likelihood that they gained on the base model.
    pub gain: f64,
    /// Whether what one of them does hangs on moments, such as when teeth meet.
    pub moments: bool,
}

/// The tests' flags and where the misfit lies.
///
/// # Errors
/// [`ModelError`] if the model cannot be evaluated at the fitted parameters.
pub fn review(residuals: &Residuals<'_>, scene: &Scene, explained: &Explained<'_>, seed: u64) -> Result<(Vec<Flag>, Location), ModelError> {
    let outputs = residuals.data.outputs.len();
    let rates = rates(residuals.model, &residuals.theta_final)?;
    let noise = &residuals.noise;
    // Each output by its own past: the tests take one output after the other.
    let whiten = |output: usize, series: &mut [f64]| noise.whiten_output(output, series);
    let whitened = |series: Series| -> Vec<Channels> {
        series
            .into_iter()
            .map(|mut stretch| {
                stretch.iter_mut().enumerate().for_each(|(i, c)| whiten(i, c));
                stretch
            })
            .collect()
    };
    let white = whitened(residuals.left.clone());
    let rows = residuals.data.samples();
    let mut jacobian = vec![DMatrix::zeros(rows, residuals.jacobian.len()); outputs];
    for (p, direction) in residuals.jacobian.iter().enumerate() {
        let mut start = 0;
        for stretch in whitened(direction.clone()) {
            for (i, column) in stretch.iter().enumerate() {
                jacobian[i].view_mut((start, p), (column.len(), 1)).copy_from_slice(column);
            }
            start += stretch.first().map_or(0, Vec::len);
        }
    }
    let comparison = Comparison {
        data: residuals.data,
        scene,
        base: &residuals.base,
        model: &residuals.last,
        without: explained.without,
        moments: explained.moments,
        since: explained.since,
        late: &explained.late,
        rest: &residuals.left,
        white: &white,
        whiten: &whiten,
        rounded: &residuals.rounded,
        noise: &noise.deviation,
        rates: &rates,
        jacobian: &jacobian,
    };
    let found = examine(&comparison, seed);
    let flags = flags(&found, &comparison, explained.gain);
    let location = locate(&comparison, found.sentences(&comparison));
    Ok((flags, location))
}

/// Share of the noise's variance that rounding to a lattice, quantum²/12, must make before it counts as something left out.
const QUANTISED: f64 = 0.1;

/// Timers of ordinary systems tick at a millisecond: stamps that they set are off by as much \[s\].
const TICK: f64 = 1e-3;
/// Share of the sampling interval up to which that is no mismatch.
const UNEVEN: f64 = 0.05;

/// One flag a test that found something.
fn flags(found: &Adequacy, comparison: &Comparison<'_>, explained: f64) -> Vec<Flag> {
    let sentences = found.sentences(comparison);
    let mut sentences = sentences.into_iter();
    let mut all = Vec::new();
    // Of all that there was to explain.
    let share = |left: f64| Some(left / (left + explained.max(0.0)));
    let mut flag = |test, value, threshold, left_over, effect| {
        all.push(Flag { test, value, threshold, left_over, statement: sentences.next().unwrap_or_default(), effect, instead: Vec::new() });
    };
    if let Some(rounding) = &found.rounding {
        flag("rounded commands", rounding.gain, 0.0, share(rounding.gain), None);
    }
    if found.structure.significant() {
        flag("input-driven structure", found.structure.z, structure::LIMIT, share(found.structure.excess), None);
    }
    for burst in &found.bursts {
        flag("bursts", burst.z, 0.0, share(burst.excess), None);
    }
    if let Some(events) = &found.events {
        flag("events", events.excess, 0.0, share(events.excess), None);
    }
    if let Some(memory) = &found.memory {
        flag("memory of the rest", memory.correlation, memory::LASTS, Some(memory.share), None);
    }
    if let Some(line) = &found.order {
        flag("wheel-order line", line.power, 0.0, share(line.power), None);
    }
    if let Some(rhythm) = &found.rhythm {
        flag("rhythm", rhythm.power, 0.0, share(rhythm.power), None);
    }
    if let Some(jitter) = &found.jitter {
        // Messages that are late by chance are late, which has a name already; and what a law misses of moments is loud where the robot accelerates.
        let ordinary = jitter.deviation < TICK.min(UNEVEN * comparison.scene.scales.period);
        let named = jitter.of == Scatter::Stamps && !ordinary && !comparison.moments;
        let effect = named.then(|| ("timestamp_jitter".to_owned(), vec![jitter.deviation]));
        flag("variance against acceleration", jitter.z, 0.0, None, effect);
    }
    for lattice in &found.lattices {
        let variance = (lattice.quantum / comparison.noise[lattice.output]).powi(2) / 12.0;
        flag("value lattice", variance, QUANTISED, None, None);
    }
    if let Some(counts) = &found.counts {
        // Counting that other noise covers is no physics that a simulation would miss.
        let effect = (counts.share > QUANTISED).then(|| ("encoder_quantisation".to_owned(), vec![counts.travel]));
        flag("counts of the wheels", counts.share, QUANTISED, None, effect);
    }
    if !found.coarse.is_empty() {
        let step = |output: usize| found.coarse.iter().find(|coarse| coarse.output == output).map_or(0.0, |coarse| coarse.step);
        let effect = Some(("encoder_quantisation".to_owned(), (0..comparison.outputs()).map(step).collect()));
        flag("coarse readout", found.coarse.iter().map(|coarse| coarse.gain).sum(), 0.0, None, effect);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::{Case, NOISE, normal, stamps};

    #[test]
    fn stamps_that_are_off_by_what_any_timer_is_are_no_mismatch() {
        for (deviation, named) in [(0.0008, false), (0.003, true)] {
            let off = stamps(4);
            let mut case = Case::new(4, |t, i, y, slope, random| y + 0.05 * NOISE[i] * normal(random) + deviation * slope * off(t));
            case.noise = NOISE.map(|noise| 0.05 * noise);
            let told = |moments: bool| {
                let flags = case.compare(None, |c| flags(&examine(c, 1), &Comparison { moments, ..*c }, 0.0));
                flags.into_iter().find(|flag| flag.test == "variance against acceleration").map(|flag| flag.effect.is_some())
            };
            assert_eq!(told(false), Some(named), "{deviation}");
            assert_eq!(told(true), Some(false), "beside what hangs on moments");
        }
    }
}
