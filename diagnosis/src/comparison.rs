//! A data set beside simulations of it: what the tests that need no library, and the search for where it hurts, look at.

use nalgebra::DMatrix;
use wheelwright_core::effect::Scene;
use wheelwright_core::model::ModelError;
use wheelwright_core::simulation::linear_part;
use wheelwright_core::{Dataset, RegressorModel};

/// An angle between −π and π.
pub(crate) fn wrapped(angle: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    angle - turn * (angle / turn).round()
}

/// Rate \[1/s\] at which each output of a model forgets, by its linear part.
pub(crate) fn rates(model: &dyn RegressorModel, theta: &[f64]) -> Result<Vec<f64>, ModelError> {
    let outputs = model.outputs().len();
    let mut linear = vec![0.0; outputs * outputs];
    linear_part(model, theta, &mut linear)?;
    Ok((0..outputs).map(|i| -linear[i * outputs + i]).collect())
}

/// One series an output.
pub type Channels = Vec<Vec<f64>>;

/// A data set, what was simulated of it, and the noise between the two.
pub struct Comparison<'a> {
    /// What was measured.
    pub data: &'a Dataset,
    /// Its scene.
    pub scene: &'a Scene,
    /// Free run of the base model fitted by itself, a stretch each.
    pub base: &'a [Channels],
    /// Free run of the model with the effects that were found.
    pub model: &'a [Channels],
    /// Free run with the same parameters and starts, but every effect neutral: what the effects do, nothing refitted.
    pub without: &'a [Channels],
    /// When the first of the effects begins that begin during the recording \[s\].
    pub since: Option<f64>,
    /// By how much commands were found to come late \[s\]: one time for all inputs, one each, or none.
    pub late: &'a [f64],
    /// Whitened measured − `model`, of unit variance, a stretch each.
    pub white: &'a [Channels],
    /// Whitens a series of an output within a stretch, as `white` was.
    pub whiten: &'a dyn Fn(usize, &mut [f64]),
    /// Standard deviation of the noise of each output, before whitening.
    pub noise: &'a [f64],
    /// Rate \[1/s\] at which each output forgets: what a force leaves behind of itself.
    pub rates: &'a [f64],
    /// Whitened derivatives of `model` with respect to everything that was fitted: one matrix an output, its rows the
    /// stretches one after the other.
    pub jacobian: &'a [DMatrix<f64>],
}

impl Comparison<'_> {
    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.data.outputs.len()
    }

    /// Measured less base model, of an output in a row of a stretch.
    pub(crate) fn misfit(&self, stretch: usize, output: usize, row: usize) -> f64 {
        self.data.stretches[stretch].outputs[output][row] - self.base[stretch][output][row]
    }

    /// Measured less model, of an output along a stretch.
    pub(crate) fn left(&self, stretch: usize, output: usize) -> impl Iterator<Item = f64> {
        self.data.stretches[stretch].outputs[output].iter().zip(&self.model[stretch][output]).map(|(y, m)| y - m)
    }

    /// One output's whitened residual, the stretches one after the other.
    pub(crate) fn innovations(&self, output: usize) -> Vec<f64> {
        self.white.iter().flat_map(|s| s[output].iter().copied()).collect()
    }

    /// Row ranges of the stretches in series that hold them one after the other.
    pub(crate) fn ranges(&self) -> Vec<std::ops::Range<usize>> {
        let mut start = 0;
        self.data
            .stretches
            .iter()
            .map(|s| {
                let range = start..start + s.len();
                start = range.end;
                range
            })
            .collect()
    }
}

/// Blocks of about one second within stretches: (stretch, rows).
pub(crate) fn blocks(data: &Dataset, seconds: f64) -> Vec<(usize, std::ops::Range<usize>)> {
    let mut blocks = Vec::new();
    for (s, stretch) in data.stretches.iter().enumerate() {
        let mut start = 0;
        for row in 1..=stretch.len() {
            if row == stretch.len() || stretch.time[row] - stretch.time[start] >= seconds - 1e-9 {
                blocks.push((s, start..row));
                start = row;
            }
        }
    }
    blocks
}
