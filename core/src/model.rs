//! Models: equations linear in their parameters and affine in the accelerations of their outputs.
//!
//! Φ(inputs, outputs, accelerations) θ = y(inputs, outputs)                                              (1)
//!
//! Stacking the rows of (1) over a recording identifies θ; solving it for the accelerations simulates; evaluating
//! Φ θ at a wanted acceleration gives the input that produces it.

use std::fmt::Debug;

use thiserror::Error;

use crate::channel::Channel;

/// One parameter of a model.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Name, such as `theta1`.
    pub name: String,
    /// SI unit; `1` for a pure number.
    pub unit: String,
    /// Physical bounds, infinite where there are none.
    pub bounds: (f64, f64),
    /// What the parameter does, in one plain sentence.
    pub meaning: String,
    /// The motion that shows the parameter, for messages about data that lack it: `changes of v_ref while driving`.
    pub excitation: String,
}

impl Parameter {
    /// An unbounded parameter.
    pub fn new(name: &str, unit: &str, meaning: &str, excitation: &str) -> Self {
        Self {
            name: name.to_owned(),
            unit: unit.to_owned(),
            bounds: (f64::NEG_INFINITY, f64::INFINITY),
            meaning: meaning.to_owned(),
            excitation: excitation.to_owned(),
        }
    }

    /// The same with bounds.
    #[must_use]
    pub fn within(mut self, lower: f64, upper: f64) -> Self {
        self.bounds = (lower, upper);
        self
    }
}

/// The channels of a model at one instant.
#[derive(Debug, Clone, Copy)]
pub struct Sample<'a> {
    /// One value an input channel.
    pub inputs: &'a [f64],
    /// One value an output channel.
    pub outputs: &'a [f64],
    /// Time derivative of each output.
    pub accelerations: &'a [f64],
}

/// Parameters as an affine function of fewer free ones: θ = T z + c.
///
/// A model that knows equalities between its parameters states them so, and a configuration fixes or ties
/// parameters in the same way.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterMap {
    /// Names of the free parameters z.
    pub free: Vec<String>,
    /// T, row-major, parameters × free.
    pub matrix: Vec<f64>,
    /// c, one value a parameter.
    pub offset: Vec<f64>,
}

impl ParameterMap {
    /// Every parameter free.
    pub fn identity(parameters: &[Parameter]) -> Self {
        let n = parameters.len();
        let mut matrix = vec![0.0; n * n];
        for i in 0..n {
            matrix[i * n + i] = 1.0;
        }
        Self { free: parameters.iter().map(|p| p.name.clone()).collect(), matrix, offset: vec![0.0; n] }
    }

    /// Imposes Σ coefficient × θ = value, which leaves one free parameter less: the one the equality speaks of most.
    ///
    /// # Errors
    /// [`ModelError::Contradiction`] if no free parameter is left in the equality.
    pub fn impose(&mut self, equality: &[(usize, f64)], value: f64) -> Result<(), ModelError> {
        let z = self.free.len();
        let row: Vec<f64> = (0..z).map(|j| equality.iter().map(|(i, a)| a * self.matrix[i * z + j]).sum()).collect();
        let rest = value - equality.iter().map(|(i, a)| a * self.offset[*i]).sum::<f64>();
        let pivot = (0..z).filter(|j| row[*j] != 0.0).max_by(|a, b| row[*a].abs().total_cmp(&row[*b].abs()));
        let pivot = pivot.ok_or(ModelError::Contradiction)?;
        let mut matrix = Vec::with_capacity(self.offset.len() * (z - 1));
        for i in 0..self.offset.len() {
            let share = self.matrix[i * z + pivot] / row[pivot];
            self.offset[i] += share * rest;
            matrix.extend((0..z).filter(|j| *j != pivot).map(|j| self.matrix[i * z + j] - share * row[j]));
        }
        self.matrix = matrix;
        self.free.remove(pivot);
        Ok(())
    }

    /// θ of the free values.
    pub fn theta(&self, free: &[f64]) -> Vec<f64> {
        let z = self.free.len();
        self.offset.iter().enumerate().map(|(i, c)| c + (0..z).map(|j| self.matrix[i * z + j] * free[j]).sum::<f64>()).collect()
    }
}

/// A model of a robot. Live object, built from a [`ModelConfig`].
///
/// Only [`regressor`](Self::regressor) carries the physics; the other required methods name things.
pub trait RegressorModel: Debug + Send + Sync {
    /// Name under which configurations know it.
    fn name(&self) -> &str;

    /// Input channels, held constant between samples.
    fn inputs(&self) -> &[Channel];

    /// Output channels, whose derivatives appear in the equations.
    fn outputs(&self) -> &[Channel];

    /// Parameters θ in the order of the columns of Φ.
    fn parameters(&self) -> &[Parameter];

    /// Number of equations. A model that is to be simulated has as many as outputs.
    fn equations(&self) -> usize {
        self.outputs().len()
    }

    /// Writes Φ (row-major, equations × parameters) and y (equations) at a sample. Both must be affine in the accelerations.
    fn regressor(&self, sample: Sample<'_>, phi: &mut [f64], y: &mut [f64]);

    /// Why [`regressor`](Self::regressor) failed, if it did: a model whose code lies outside this program can, and then
    /// writes NaN. Identification asks after solving; built-in models never fail.
    fn failure(&self) -> Option<ModelError> {
        None
    }

    /// Equalities between parameters that the physics of this model demands; none by default.
    fn map(&self) -> ParameterMap {
        ParameterMap::identity(self.parameters())
    }

    /// Writes the accelerations that solve (1) for `theta`. Models with a closed form override it; conformance checks
    /// compare the two.
    ///
    /// # Errors
    /// [`ModelError::Singular`] where the equations do not determine the accelerations.
    fn accelerations(&self, theta: &[f64], inputs: &[f64], outputs: &[f64], accelerations: &mut [f64]) -> Result<(), ModelError> {
        solve_accelerations(self, theta, inputs, outputs, accelerations)
    }

    /// The motion under held inputs, for a model that has it in closed form; simulation then takes no steps. None by default.
    fn flow(&self) -> Option<&dyn Flow> {
        None
    }
}

/// The exact motion of a model under held inputs: for equations that jump, as dry friction does, over which no step of an integrator
/// is accurate. Where the equations do not jump, conformance checks compare it with the accelerations.
pub trait Flow: Debug + Send + Sync {
    /// Moves `outputs` on by `interval` \[s\] under held `inputs`, and writes into `travelled` the integral of each over it.
    ///
    /// # Errors
    /// [`ModelError::Singular`] or [`ModelError::Overflow`] where `theta` does not determine the motion.
    fn advance(&self, theta: &[f64], inputs: &[f64], interval: f64, outputs: &mut [f64], travelled: &mut [f64]) -> Result<(), ModelError>;
}

/// Solves Φ θ = y for the accelerations by evaluating (1) at zero and at unit accelerations, which is exact because
/// Φ is affine in them.
///
/// # Errors
/// [`ModelError::Singular`], [`ModelError::Overflow`], or [`ModelError::NotSquare`] if equations and outputs differ in number.
pub fn solve_accelerations<M: RegressorModel + ?Sized>(
    model: &M,
    theta: &[f64],
    inputs: &[f64],
    outputs: &[f64],
    accelerations: &mut [f64],
) -> Result<(), ModelError> {
    let (equations, n) = (model.equations(), model.outputs().len());
    let name = || model.name().to_owned();
    if equations != n {
        return Err(ModelError::NotSquare { model: name(), equations, outputs: n });
    }
    let rows = |trial: &[f64], phi: &mut [f64], y: &mut [f64]| model.regressor(Sample { inputs, outputs, accelerations: trial }, phi, y);
    solve_affine(theta, accelerations, rows).map_err(|unsolved| match unsolved {
        Unsolved::Overflow => ModelError::Overflow { model: name() },
        Unsolved::Singular => ModelError::Singular { model: name() },
    })
}

/// Solves Φ θ = y for the inputs that produce the wanted `accelerations`, which is inverse dynamics. Exact where the
/// equations are affine in the inputs, as those of velocity references and voltages are.
///
/// # Errors
/// [`ModelError::NotInvertible`] where the equations do not determine the inputs, or are beyond the range of numbers.
pub fn solve_inputs<M: RegressorModel + ?Sized>(
    model: &M,
    theta: &[f64],
    outputs: &[f64],
    accelerations: &[f64],
    inputs: &mut [f64],
) -> Result<(), ModelError> {
    let not_invertible =
        || ModelError::NotInvertible { model: model.name().to_owned(), equations: model.equations(), inputs: model.inputs().len() };
    if model.equations() != inputs.len() || model.inputs().len() != inputs.len() {
        return Err(not_invertible());
    }
    let rows = |trial: &[f64], phi: &mut [f64], y: &mut [f64]| model.regressor(Sample { inputs: trial, outputs, accelerations }, phi, y);
    solve_affine(theta, inputs, rows).map_err(|_| not_invertible())
}

/// Why equations were not solved.
enum Unsolved {
    Overflow,
    Singular,
}

/// Solves Φ θ = y for unknowns in which `rows` writes affine equations, by evaluating them at zero and at each unit.
fn solve_affine(theta: &[f64], unknowns: &mut [f64], rows: impl Fn(&[f64], &mut [f64], &mut [f64])) -> Result<(), Unsolved> {
    let n = unknowns.len();
    // A simulation calls this four times a step: models of ordinary size are solved on the stack.
    let needed = n * (theta.len() + n + 4);
    let (mut stack, mut heap) = ([0.0; STACK], Vec::new());
    let buffer = match stack.get_mut(..needed) {
        Some(buffer) => buffer,
        None => {
            heap.resize(needed, 0.0);
            heap.as_mut_slice()
        }
    };
    let (phi, buffer) = buffer.split_at_mut(n * theta.len());
    let (mass, buffer) = buffer.split_at_mut(n * n);
    let (y, buffer) = buffer.split_at_mut(n);
    let (trial, buffer) = buffer.split_at_mut(n);
    let (rest, shifted) = buffer.split_at_mut(n);
    let mut residual = |trial: &[f64], out: &mut [f64]| {
        rows(trial, phi, y);
        for (i, (row, out)) in phi.chunks_exact(theta.len()).zip(out).enumerate() {
            *out = row.iter().zip(theta).map(|(a, b)| a * b).sum::<f64>() - y[i];
        }
    };
    residual(trial, rest);
    for j in 0..n {
        trial[j] = 1.0;
        residual(trial, &mut shifted[..n]);
        trial[j] = 0.0;
        for i in 0..n {
            mass[i * n + j] = shifted[i] - rest[i];
        }
    }
    unknowns.iter_mut().zip(rest.iter()).for_each(|(a, r)| *a = -r);
    // Rows that are beyond the range of numbers before anything is solved say nothing of what they determine.
    if mass.iter().chain(unknowns.iter()).any(|x| !x.is_finite()) {
        return Err(Unsolved::Overflow);
    }
    if eliminate(mass, unknowns) { Ok(()) } else { Err(Unsolved::Singular) }
}

/// Numbers that [`solve_affine`] keeps on the stack: enough for four outputs and twenty parameters.
const STACK: usize = 128;

/// Solves a square system in place by elimination with row pivoting; false if it is singular.
fn eliminate(matrix: &mut [f64], x: &mut [f64]) -> bool {
    let n = x.len();
    for k in 0..n {
        let pivot = (k..n).fold(k, |best, i| if matrix[i * n + k].abs() > matrix[best * n + k].abs() { i } else { best });
        (0..n).for_each(|j| matrix.swap(k * n + j, pivot * n + j));
        x.swap(k, pivot);
        for i in k + 1..n {
            let factor = matrix[i * n + k] / matrix[k * n + k];
            (k..n).for_each(|j| matrix[i * n + j] -= factor * matrix[k * n + j]);
            x[i] -= factor * x[k];
        }
    }
    for k in (0..n).rev() {
        let known: f64 = (k + 1..n).map(|j| matrix[k * n + j] * x[j]).sum();
        x[k] = (x[k] - known) / matrix[k * n + k];
    }
    x.iter().all(|v| v.is_finite())
}

/// Plain data from which a model is built; `type = "NAME"` in a configuration picks it.
#[typetag::serde]
pub trait ModelConfig: Debug + Send + Sync {
    /// One line on what the model is, for `wheelwright plugins`.
    fn about(&self) -> String;

    /// Builds the model.
    ///
    /// # Errors
    /// [`ModelError`] naming the key that is wrong.
    fn build(&self) -> Result<Box<dyn RegressorModel>, ModelError>;
}

/// Why a model cannot be built or used.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum ModelError {
    /// A configuration value is impossible.
    #[error("`{key}`: {reason}")]
    Config {
        /// Key inside the model's table.
        key: String,
        /// What is wrong and what to do.
        reason: String,
    },
    /// An equality between parameters that are all fixed already.
    #[error("the parameters it speaks of are already fixed by the model or by another constraint")]
    Contradiction,
    /// The equations leave the accelerations undetermined at these parameters.
    #[error(
        "model `{model}` cannot be simulated with these parameters: its equations leave the accelerations undetermined (a time constant is zero?)"
    )]
    Singular {
        /// Model name.
        model: String,
    },
    /// The accelerations leave the range of numbers at these parameters.
    #[error(
        "model `{model}` cannot be simulated with these parameters: its accelerations are beyond the range of numbers (a time constant is nearly zero, or a parameter far too large?)"
    )]
    Overflow {
        /// Model name.
        model: String,
    },
    /// Equations and outputs differ in number.
    #[error("model `{model}` cannot be simulated: {equations} equation(s) for {outputs} output(s)")]
    NotSquare {
        /// Model name.
        model: String,
        /// Number of equations.
        equations: usize,
        /// Number of outputs.
        outputs: usize,
    },
    /// Equations and inputs differ in number, or the equations leave the inputs undetermined.
    #[error("model `{model}` gives no input for a wanted motion: {equations} equation(s) for {inputs} input(s), or a parameter of zero")]
    NotInvertible {
        /// Model name.
        model: String,
        /// Number of equations.
        equations: usize,
        /// Number of inputs.
        inputs: usize,
    },
    /// The simulation left the range of numbers.
    #[error("model `{model}` diverged at t = {time} s with these parameters")]
    Diverged {
        /// Model name.
        model: String,
        /// Time of the first value that is not finite.
        time: f64,
    },
    /// A plugin broke its contract.
    #[error("model plugin `{model}`: {reason}")]
    Plugin {
        /// Model name.
        model: String,
        /// What happened.
        reason: String,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map() -> ParameterMap {
        let each = ["a", "b", "c"].map(|name| Parameter::new(name, "1", "", ""));
        ParameterMap::identity(&each)
    }

    #[test]
    fn a_fixed_parameter_keeps_its_value_and_the_others_their_freedom() {
        let mut map = map();
        map.impose(&[(1, 1.0)], 7.0).unwrap();
        assert_eq!(map.free, ["a", "c"]);
        assert_eq!(map.theta(&[2.0, 3.0]), [2.0, 7.0, 3.0]);
    }

    #[test]
    fn tied_parameters_obey_their_tie_whatever_is_free() {
        let mut map = map();
        map.impose(&[(0, 1.0), (2, -4.0)], 1.0).unwrap();
        assert_eq!(map.free.len(), 2);
        let theta = map.theta(&[0.3, -0.8]);
        assert!((theta[0] - 4.0 * theta[2] - 1.0).abs() < 1e-15);
    }

    #[test]
    fn what_is_fixed_cannot_be_fixed_again() {
        let mut map = map();
        map.impose(&[(1, 1.0)], 7.0).unwrap();
        assert_eq!(map.impose(&[(1, 1.0)], 8.0), Err(ModelError::Contradiction));
    }
}
