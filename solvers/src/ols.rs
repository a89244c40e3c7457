//! `ols`: least squares on rows that are all filtered alike, then the zero-order hold undone.
//!
//! minimise Σ ‖F Φ θ_app − F y‖² with F one zero-phase low-pass filter for every column and the response, then solve
//! M_app(θ) = M(θ_app) for θ (see [`Hold`]).

use serde::{Deserialize, Serialize};
use wheelwright_core::regression::Settings;
use wheelwright_core::solver::{Problem, Solution, SolveError, Solver};

use crate::hold::Hold;
use crate::regression::SolverRegression;

/// Settings of the `ols` solver.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Ols {
    /// How the rows are made: a table `conditioning` with the keys of [`Settings`].
    pub conditioning: Settings,
    /// Undo the effect of held inputs on parameters that multiply accelerations. Default true.
    pub undo_hold: bool,
}

impl Default for Ols {
    fn default() -> Self {
        Self { conditioning: Settings::default(), undo_hold: true }
    }
}

#[typetag::serde(name = "ols")]
impl Solver for Ols {
    fn name(&self) -> &str {
        "ols"
    }

    fn about(&self) -> String {
        "least squares on rows filtered alike, paired with the held input, ends trimmed, zero-order hold undone".to_owned()
    }

    fn solve(&self, problem: &Problem<'_>) -> Result<Solution, SolveError> {
        let regression = SolverRegression::new(problem, &self.conditioning)?;
        let solved = regression.solve(problem.model, &problem.map)?;
        let hold = self.hold(problem, regression.preparation.period);
        let period = regression.preparation.period;
        let undone = hold.as_ref().and_then(|h| h.invert(&solved.free));
        let theta = problem.map.theta(undone.as_ref().unwrap_or(&solved.free));
        let mut solution = regression.into_solution(theta, solved.condition);
        match (&hold, undone) {
            (Some(hold), Some(_)) => solution.steps.push(hold_undone(hold, problem, period)),
            (Some(hold), None) => solution.warnings.push(hold_kept(hold, problem, period)),
            (None, _) => {}
        }
        Ok(solution)
    }
}

impl Ols {
    /// The law to undo, if it is to be undone and there is one.
    pub(crate) fn hold(&self, problem: &Problem<'_>, period: f64) -> Option<Hold> {
        if self.undo_hold { Hold::new(problem.model, &problem.map, &self.conditioning, period) } else { None }
    }
}

pub(crate) fn hold_undone(hold: &Hold, problem: &Problem<'_>, period: f64) -> String {
    format!("undid the zero-order hold of {period:.4} s in {}", hold.names(&problem.map))
}

pub(crate) fn hold_kept(hold: &Hold, problem: &Problem<'_>, period: f64) -> String {
    format!(
        "the zero-order hold could not be undone: a time constant in {} is below what one sample every {period:.4} s can show, so these \
         values are upper limits; record at a higher rate",
        hold.names(&problem.map)
    )
}
