//! Solvers: from a model and a data set to parameters.

use std::fmt::Debug;

use serde::Serialize;
use thiserror::Error;

use crate::dataset::Dataset;
use crate::model::{ModelError, ParameterMap, RegressorModel};
use crate::signal::SignalError;

/// What a solver is asked.
#[derive(Debug, Clone)]
pub struct Problem<'a> {
    /// The model whose parameters are wanted.
    pub model: &'a dyn RegressorModel,
    /// The data to fit; held-out data is not in it.
    pub data: &'a Dataset,
    /// Which parameters are free, tied or fixed.
    pub map: ParameterMap,
    /// Bounds of each parameter θ, infinite where there are none. Solvers that cannot keep them say so.
    pub bounds: Vec<(f64, f64)>,
    /// Seed of whatever is random.
    pub seed: u64,
}

impl<'a> Problem<'a> {
    /// The model's own map and bounds.
    pub fn new(model: &'a dyn RegressorModel, data: &'a Dataset) -> Self {
        let bounds = model.parameters().iter().map(|p| p.bounds).collect();
        Self { model, data, map: model.map(), bounds, seed: 0 }
    }
}

/// How a solver ended. An outcome, not an error: the numbers are usable as far as the status says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Status {
    /// The optimum, to the solver's tolerance.
    Solved,
    /// The optimum within bounds, at least one of which is active.
    SolvedAtBound,
    /// The iteration limit came first.
    IterationLimit,
}

/// A linear regression as a solver set it up, kept for plots: rows of equation `e` are `phi[e]` (row-major) and `y[e]`.
#[derive(Debug, Clone, PartialEq)]
pub struct RegressionRows {
    /// Φ of each equation, row-major, rows × parameters.
    pub phi: Vec<Vec<f64>>,
    /// Response of each equation.
    pub y: Vec<Vec<f64>>,
    /// True if rows hold integrals over time of the equations' terms, so that their units are those times a second.
    pub integrated: bool,
}

/// Parameters with what is known about them.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// θ in the model's order.
    pub theta: Vec<f64>,
    /// Standard error of each parameter, if the solver can give honest ones; not a number where one is fixed or at a bound.
    pub std: Option<Vec<f64>>,
    /// 95 % confidence interval of each parameter, if the solver can give honest ones; not numbers where `std` is none.
    pub ci95: Option<Vec<(f64, f64)>>,
    /// Covariance of θ, row-major, if the solver has one behind `std`; rows and columns of parameters that are fixed or at a
    /// bound are zero.
    pub covariance: Option<Vec<f64>>,
    /// How it ended.
    pub status: Status,
    /// Condition number of the scaled problem (largest over smallest singular value).
    pub condition: f64,
    /// Parameters that sit at a bound, by index.
    pub at_bound: Vec<usize>,
    /// What was done to the data, a sentence a step, for the report.
    pub steps: Vec<String>,
    /// What a user should know.
    pub warnings: Vec<String>,
    /// The regression, for solvers that have one.
    pub regression: Option<RegressionRows>,
}

/// Estimates parameters. Plain data with its settings, picked by `type = "NAME"`.
#[typetag::serde]
pub trait Solver: Debug + Send + Sync {
    /// Name under which configurations know it.
    fn name(&self) -> &str;

    /// One line on what the solver is, for `wheelwright plugins`.
    fn about(&self) -> String;

    /// Solves.
    ///
    /// # Errors
    /// [`SolveError`]: what makes an answer impossible, naming the parameter and the motion that is missing.
    fn solve(&self, problem: &Problem<'_>) -> Result<Solution, SolveError>;
}

/// Why there is no answer.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum SolveError {
    /// The data cannot tell these parameters from each other.
    #[error("the data cannot determine {}: missing is {missing}", .parameters.join(", "))]
    NotIdentifiable {
        /// Names of the parameters.
        parameters: Vec<String>,
        /// The motion that would show them.
        missing: String,
    },
    /// Too few samples are left.
    #[error("{samples} usable samples for {parameters} parameters after {what}: record at least {needed_s:.0} s")]
    TooFewSamples {
        /// Samples left.
        samples: usize,
        /// Parameters sought.
        parameters: usize,
        /// What used up the rest: `trimming 5 s at both ends`.
        what: String,
        /// Length of a recording that would do \[s\].
        needed_s: f64,
    },
    /// The solver's settings do not fit the data or the model.
    #[error("solver setting `{key}`: {reason}")]
    Setting {
        /// Key.
        key: String,
        /// What is wrong and what to do.
        reason: String,
    },
    /// The solver does not apply to this model.
    #[error("solver `{solver}` does not apply to model `{model}`: {reason}")]
    NotApplicable {
        /// Solver name.
        solver: String,
        /// Model name.
        model: String,
        /// Why.
        reason: String,
    },
    /// Bounds exclude every value.
    #[error("parameter {parameter}: lower bound {lower} is above upper bound {upper}")]
    EmptyBounds {
        /// Parameter name.
        parameter: String,
        /// Lower bound.
        lower: f64,
        /// Upper bound.
        upper: f64,
    },
    /// A numerical library gave up.
    #[error("no optimum found: {reason}")]
    Failed {
        /// Its status.
        reason: String,
    },
    /// The data cannot be conditioned as the settings ask.
    #[error(transparent)]
    Signal(#[from] SignalError),
    /// The model failed.
    #[error(transparent)]
    Model(#[from] ModelError),
}
