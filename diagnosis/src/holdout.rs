//! The proof: free runs over data that no estimate saw, each stretch from its measured first sample.

use wheelwright_core::effect::{Effect, EffectSimulator, Scene};
use wheelwright_core::model::RegressorModel;
use wheelwright_core::simulation::Readout;
use wheelwright_core::{Dataset, Stretch};

use crate::residuals::Series;

/// A model as it is simulated on other data.
#[derive(Debug, Clone)]
pub(crate) struct Explanation<'a> {
    pub(crate) effects: Vec<&'a dyn Effect>,
    pub(crate) theta: Vec<f64>,
    pub(crate) values: Vec<f64>,
}

/// Data to simulate on.
pub(crate) struct Ground<'a> {
    pub(crate) model: &'a dyn RegressorModel,
    pub(crate) data: &'a Dataset,
    pub(crate) scene: &'a Scene,
    pub(crate) readout: Readout,
}

/// A free run, and its squared errors.
#[derive(Debug, Clone)]
pub(crate) struct Proof {
    pub(crate) simulated: Series,
    /// Fit of each output in percent; not a number where an output never changes or the run diverged.
    pub(crate) fit: Vec<f64>,
    /// Mean squared error of each output; infinite where the run diverged.
    pub(crate) error: Vec<f64>,
}

impl Ground<'_> {
    /// Simulates every stretch from its measured first sample.
    pub(crate) fn prove(&self, explanation: &Explanation<'_>) -> Proof {
        let n = self.data.outputs.len();
        let Explanation { effects, theta, values } = explanation;
        let mut simulated: Series = Vec::with_capacity(self.data.stretches.len());
        let mut whole = true;
        match EffectSimulator::new(self.model, theta, effects, self.scene) {
            Ok(simulator) => {
                let mut simulator = simulator.with_readout(self.readout);
                whole &= simulator.set(theta, values).is_ok() && simulator.choose_substeps(&self.data.stretches).is_ok();
                for (s, stretch) in self.data.stretches.iter().enumerate() {
                    let initial: Vec<f64> = stretch.outputs.iter().map(|c| c[0]).collect();
                    let mut run = vec![Vec::new(); n];
                    whole &= simulator.run(s, stretch, &initial, &mut run).is_ok();
                    // A run that diverged stands still from there on, so that pictures have all rows.
                    for series in &mut run {
                        let last = series.iter().rev().copied().find(|x| x.is_finite()).unwrap_or(0.0);
                        series.iter_mut().filter(|x| !x.is_finite()).for_each(|x| *x = last);
                        series.resize(stretch.len(), last);
                    }
                    simulated.push(run);
                }
            }
            Err(_) => {
                whole = false;
                simulated.extend(self.data.stretches.iter().map(|s| s.outputs.iter().map(|c| vec![c[0]; s.len()]).collect::<Vec<_>>()));
            }
        }
        let error: Vec<f64> = (0..n).map(|c| if whole { mean_square(self.data, &simulated, c) } else { f64::INFINITY }).collect();
        let fit = error.iter().enumerate().map(|(c, e)| percent(*e, variance(self.data, c))).collect();
        Proof { simulated, fit, error }
    }

    /// The fit that noise of this deviation leaves to any model.
    pub(crate) fn ceiling(&self, output: usize, deviation: f64) -> f64 {
        percent(deviation * deviation, variance(self.data, output))
    }
}

fn percent(error: f64, variance: f64) -> f64 {
    if variance > 0.0 && error.is_finite() { 100.0 * (1.0 - (error / variance).sqrt()) } else { f64::NAN }
}

fn mean_square(data: &Dataset, simulated: &Series, c: usize) -> f64 {
    let stretch = |s: &Stretch, y: &Vec<Vec<f64>>| s.outputs[c].iter().zip(&y[c]).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    data.stretches.iter().zip(simulated).map(|(s, y)| stretch(s, y)).sum::<f64>() / data.samples().max(1) as f64
}

fn variance(data: &Dataset, c: usize) -> f64 {
    let all = || data.stretches.iter().flat_map(|s| s.outputs[c].iter());
    let n = data.samples().max(1) as f64;
    let mean = all().sum::<f64>() / n;
    all().map(|y| (y - mean).powi(2)).sum::<f64>() / n
}

/// What held-out data say of an explanation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Transfer {
    /// It is as good there, or nothing there needs explaining.
    Holds,
    /// It does not bring the error down there as it does on the data it was fitted to.
    Fails,
}

/// Ratio of an error to the noise, in variance, up to which nothing needs explaining: the fifteen percent in amplitude that the
/// errors of parameters and of the first sample make.
const NEAR: f64 = 1.15 * 1.15;
/// Share of the excess that must go.
const CLOSED: f64 = 0.5;

/// Weighs errors before and after against the noise, in units of its variance, mean over the outputs.
pub(crate) fn transfer(before: &[f64], after: &[f64], noise: &[f64]) -> Transfer {
    let mean = |error: &[f64]| error.iter().zip(noise).map(|(e, n)| e / (n * n)).sum::<f64>() / noise.len().max(1) as f64;
    let (before, after) = (mean(before), mean(after));
    let near = after <= NEAR;
    let closed = after < before && before - after >= CLOSED * (before - 1.0);
    if closed || (near && after <= before.max(1.0) * 1.02) { Transfer::Holds } else { Transfer::Fails }
}

/// Held-out data on a clock of their own: the same stretches with their times moved.
pub(crate) fn shifted(data: &Dataset, by: f64) -> Dataset {
    let mut moved = data.clone();
    moved.stretches.iter_mut().flat_map(|s| &mut s.time).for_each(|t| *t += by);
    moved
}
