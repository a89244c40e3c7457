//! Identification: a model, data and a solver in; parameters with free-run fits out.

use crate::dataset::Dataset;
use crate::model::{ModelError, Parameter, RegressorModel};
use crate::solver::{Problem, Solution, SolveError, Solver};
use crate::validation::{Validation, validate};

/// One parameter as identified.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// The parameter.
    pub parameter: Parameter,
    /// Its value.
    pub value: f64,
    /// Standard error, if the solver gives an honest one.
    pub std: Option<f64>,
    /// 95 % confidence interval, if the solver gives an honest one.
    pub ci95: Option<(f64, f64)>,
    /// True if it sits at a bound.
    pub at_bound: bool,
}

/// An identified model with its proof.
#[derive(Debug, Clone, PartialEq)]
pub struct Identification {
    /// Name of the model.
    pub model: String,
    /// Name of the solver.
    pub solver: String,
    /// One estimate a parameter, in the model's order.
    pub estimates: Vec<Estimate>,
    /// What the solver returned.
    pub solution: Solution,
    /// Free run on the data that was fitted.
    pub train: Validation,
    /// Free run on data no estimate saw; `None` only if nothing was held out.
    pub held_out: Option<Validation>,
}

/// Why there is no identification.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum IdentifyError {
    /// The solver has no answer.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// The identified model cannot be simulated.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// Solves `problem` and validates in free run, on the data fitted and on `held_out` (nothing if it has no stretches).
///
/// # Errors
/// [`IdentifyError`].
pub fn identify(problem: &Problem<'_>, solver: &dyn Solver, held_out: &Dataset) -> Result<Identification, IdentifyError> {
    let solution = solver.solve(problem);
    // A model that failed leaves NaN, and then whatever the solver says of it is not the reason.
    if let Some(failure) = problem.model.failure() {
        return Err(failure.into());
    }
    let solution = solution?;
    let train = validate(problem.model, &solution.theta, problem.data)?;
    let held_out = if held_out.stretches.is_empty() { None } else { Some(validate(problem.model, &solution.theta, held_out)?) };
    Ok(Identification {
        model: problem.model.name().to_owned(),
        solver: solver.name().to_owned(),
        estimates: estimates(problem.model, &solution),
        solution,
        train,
        held_out,
    })
}

fn estimates(model: &dyn RegressorModel, solution: &Solution) -> Vec<Estimate> {
    let each = model.parameters().iter().enumerate().map(|(i, parameter)| Estimate {
        parameter: parameter.clone(),
        value: solution.theta[i],
        std: solution.std.as_ref().map(|s| s[i]).filter(|s| s.is_finite()),
        ci95: solution.ci95.as_ref().map(|c| c[i]).filter(|c| c.0.is_finite() && c.1.is_finite()),
        at_bound: solution.at_bound.contains(&i),
    });
    each.collect()
}
