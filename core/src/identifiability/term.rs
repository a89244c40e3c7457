//! What a parameter's term is made of, found by asking the regressor.

use crate::model::{RegressorModel, Sample};

/// The channels without which a parameter's term vanishes, by index.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Term {
    /// Inputs that are factors of the term.
    pub(crate) inputs: Vec<usize>,
    /// Outputs that are factors of the term.
    pub(crate) outputs: Vec<usize>,
    /// Outputs whose acceleration is a factor of the term.
    pub(crate) accelerations: Vec<usize>,
}

impl Term {
    /// Sets each channel to zero in turn at a point where nothing else is and looks whether the parameter's column vanishes.
    pub(crate) fn of(model: &dyn RegressorModel, parameter: usize) -> Self {
        let value = |i: usize, shift: f64| shift + 0.37 * (i as f64 + 1.0);
        let point = |n: usize, shift: f64| (0..n).map(|i| value(i, shift)).collect::<Vec<_>>();
        let (inputs, outputs) = (point(model.inputs().len(), 0.21), point(model.outputs().len(), 0.53));
        let accelerations = point(outputs.len(), 0.81);
        let whole = size(model, parameter, &inputs, &outputs, &accelerations);
        let factors = |from: &[f64], with: &dyn Fn(&[f64]) -> f64| -> Vec<usize> {
            let vanishes = |i: &usize| {
                let mut without = from.to_vec();
                without[*i] = 0.0;
                with(&without) <= 1e-12 * whole
            };
            if whole > 0.0 { (0..from.len()).filter(vanishes).collect() } else { Vec::new() }
        };
        Self {
            inputs: factors(&inputs, &|u| size(model, parameter, u, &outputs, &accelerations)),
            outputs: factors(&outputs, &|x| size(model, parameter, &inputs, x, &accelerations)),
            accelerations: factors(&accelerations, &|a| size(model, parameter, &inputs, &outputs, a)),
        }
    }
}

/// Size of a parameter's column of Φ at a sample.
fn size(model: &dyn RegressorModel, parameter: usize, inputs: &[f64], outputs: &[f64], accelerations: &[f64]) -> f64 {
    let (equations, parameters) = (model.equations(), model.parameters().len());
    let (mut phi, mut y) = (vec![0.0; equations * parameters], vec![0.0; equations]);
    model.regressor(Sample { inputs, outputs, accelerations }, &mut phi, &mut y);
    (0..equations).map(|e| phi[e * parameters + parameter].abs()).fold(0.0, f64::max)
}
