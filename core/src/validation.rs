//! Validation: how well a free-run simulation follows a recording.

use crate::dataset::{Dataset, Stretch};
use crate::effect::{Effect, EffectSimulator, Scene};
use crate::model::{ModelError, RegressorModel};
use crate::simulation::{Readout, Simulator};

/// A stretch beside its free-run simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// The measured stretch.
    pub measured: Stretch,
    /// One vector an output. Where the simulation diverged it ends early.
    pub simulated: Vec<Vec<f64>>,
}

/// Free-run comparison over a data set.
#[derive(Debug, Clone, PartialEq)]
pub struct Validation {
    /// Every stretch with its simulation.
    pub comparisons: Vec<Comparison>,
    /// Fit of each output in percent, 100 (1 − ‖y − ŷ‖ / ‖y − mean y‖), errors pooled over the stretches; `None` where
    /// an output never changes or the simulation diverged.
    pub fit: Vec<Option<f64>>,
    /// Why the simulation ended early, if it did.
    pub failure: Option<ModelError>,
}

/// Simulates each stretch of `data` from its measured first sample and compares. A simulation that diverges is an
/// outcome, kept for the plots.
///
/// # Errors
/// [`ModelError`] if the model cannot be simulated at all.
pub fn validate(model: &dyn RegressorModel, theta: &[f64], data: &Dataset) -> Result<Validation, ModelError> {
    let mut simulator = Simulator::new(model, theta)?;
    Ok(compare(data, |_, stretch, initial, simulated| simulator.run(stretch, initial, simulated)))
}

/// The same with effects beside the model and their values one effect after the other, recorded as `readout` says; `scene` is
/// one of `data`.
///
/// # Errors
/// [`ModelError`] if the model cannot be simulated at all.
pub fn validate_with_effects(
    model: &dyn RegressorModel,
    theta: &[f64],
    effects: &[&dyn Effect],
    values: &[f64],
    (scene, readout): (&Scene, Readout),
    data: &Dataset,
) -> Result<Validation, ModelError> {
    let mut simulator = EffectSimulator::new(model, theta, effects, scene)?.with_readout(readout);
    simulator.set(theta, values)?;
    simulator.choose_substeps(&data.stretches)?;
    Ok(compare(data, |s, stretch, initial, simulated| simulator.run(s, stretch, initial, simulated)))
}

/// Compares each stretch, by number, with what `run` makes of it.
fn compare(data: &Dataset, mut run: impl FnMut(usize, &Stretch, &[f64], &mut [Vec<f64>]) -> Result<(), ModelError>) -> Validation {
    let mut failure = None;
    let simulate = |(s, stretch): (usize, &Stretch)| {
        let initial: Vec<f64> = stretch.outputs.iter().map(|c| c[0]).collect();
        let mut simulated = vec![Vec::new(); initial.len()];
        if let Err(error) = run(s, stretch, &initial, &mut simulated) {
            failure.get_or_insert(error);
        }
        Comparison { measured: stretch.clone(), simulated }
    };
    let comparisons: Vec<Comparison> = data.stretches.iter().enumerate().map(simulate).collect();
    let fit = (0..data.outputs.len()).map(|channel| if failure.is_some() { None } else { fit_percent(&comparisons, channel) }).collect();
    Validation { comparisons, fit, failure }
}

/// Fit of one output over all comparisons, in percent.
fn fit_percent(comparisons: &[Comparison], channel: usize) -> Option<f64> {
    let measured = || comparisons.iter().flat_map(|c| c.measured.outputs[channel].iter());
    let simulated = comparisons.iter().flat_map(|c| c.simulated[channel].iter());
    let count = measured().count();
    if count == 0 {
        return None;
    }
    let mean = measured().sum::<f64>() / count as f64;
    let spread: f64 = measured().map(|y| (y - mean).powi(2)).sum();
    let error: f64 = measured().zip(simulated).map(|(y, s)| (y - s).powi(2)).sum();
    (spread > 0.0).then(|| 100.0 * (1.0 - (error / spread).sqrt()))
}
