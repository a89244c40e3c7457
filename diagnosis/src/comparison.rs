//! A data set beside simulations of it: what the tests that need no library, and the search for where it hurts, look at.

use nalgebra::DMatrix;
use wheelwright_core::effect::Scene;
use wheelwright_core::model::ModelError;
use wheelwright_core::simulation::linear_part;
use wheelwright_core::{Dataset, RegressorModel};

use crate::noise::draw_in;

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

/// A data set less a simulation of it, stretch by stretch.
pub(crate) fn less(data: &Dataset, simulated: &[Channels]) -> Vec<Channels> {
    let row = |(y, s): (&Vec<f64>, &Vec<f64>)| y.iter().zip(s).map(|(y, s)| y - s).collect();
    data.stretches.iter().zip(simulated).map(|(stretch, run)| stretch.outputs.iter().zip(run).map(row).collect()).collect()
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
    /// Whether what one of the effects does hangs on moments, such as when teeth meet.
    pub moments: bool,
    /// When the first of the effects begins that begin during the recording \[s\].
    pub since: Option<f64>,
    /// By how much commands were found to come late \[s\]: one time for all inputs, one each, or none.
    pub late: &'a [f64],
    /// Measured − `model`, a stretch each, without what rounding adds on average.
    pub rest: &'a [Channels],
    /// The same whitened, of unit variance.
    pub white: &'a [Channels],
    /// Whitens a series of an output within a stretch, as `white` was.
    pub whiten: &'a dyn Fn(usize, &mut [f64]),
    /// Step in which each output is recorded; zero where there is none, or nothing of it is to be known.
    pub rounded: &'a [f64],
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

    /// What is left of an output along a stretch.
    pub(crate) fn left(&self, stretch: usize, output: usize) -> impl Iterator<Item = f64> {
        self.rest[stretch][output].iter().copied()
    }

    /// Measured − `model` with all that rounding adds.
    pub(crate) fn recorded(&self) -> Vec<Channels> {
        less(self.data, self.model)
    }

    /// What is left, or what would be, whitened as `white` was.
    pub(crate) fn whitened(&self, rest: &[Channels]) -> Vec<Channels> {
        let mut white = rest.to_vec();
        white.iter_mut().for_each(|stretch| stretch.iter_mut().enumerate().for_each(|(output, series)| (self.whiten)(output, series)));
        white
    }

    /// One output's whitened residual, the stretches one after the other.
    pub(crate) fn innovations(&self, output: usize) -> Vec<f64> {
        self.white.iter().flat_map(|s| s[output].iter().copied()).collect()
    }

    /// The same with what is far out drawn in: not what rounding moves to the next step, however seldom it does.
    pub(crate) fn drawn_in(&self, output: usize) -> Vec<f64> {
        let mut innovations = self.innovations(output);
        draw_in(&mut innovations, self.ordinary(output));
        innovations
    }

    /// Size of an output's innovations that rounding alone may have.
    pub(crate) fn ordinary(&self, output: usize) -> f64 {
        self.rounded[output] / self.noise[output]
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
