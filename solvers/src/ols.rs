//! `ols`: least squares on rows that are all filtered alike, then the zero-order hold undone.
//!
//! minimise Σ ‖F Φ θ_app(θ) − F y‖²
//!
//! with F one zero-phase low-pass filter for every column and the response, and θ_app the law of [`Hold`].

use serde::{Deserialize, Serialize};
use wheelwright_core::model::ParameterMap;
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
        let hold = self.hold(problem, &regression);
        let again = |map: &ParameterMap| regression.least_squares(map, &solved.weights);
        let undone = hold.as_ref().and_then(|h| h.undo(&problem.map, &solved.free, again));
        let theta = problem.map.theta(undone.as_ref().unwrap_or(&solved.free));
        let mut solution = regression.into_solution(theta, solved.condition);
        say(&mut solution, hold.as_ref(), undone.is_some());
        Ok(solution)
    }
}

impl Ols {
    /// The law to undo, if it is to be undone and there is one.
    pub(crate) fn hold(&self, problem: &Problem<'_>, regression: &SolverRegression) -> Option<Hold> {
        if self.undo_hold { Hold::new(problem.model, &self.conditioning, regression.preparation.period) } else { None }
    }
}

/// Adds to a solution what became of the hold.
pub(crate) fn say(solution: &mut Solution, hold: Option<&Hold>, undone: bool) {
    match (hold, undone) {
        (Some(hold), true) => solution.steps.push(hold.undone()),
        (Some(hold), false) => solution.warnings.push(hold.kept()),
        (None, _) => {}
    }
}
