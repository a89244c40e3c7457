//! `thesis`: the identification of Laut (2011), section 4.3.2, to the letter.
//!
//! v_ref = [v' −ω² v][θ1 θ3 θ4]ᵀ, ω_ref = [ω' vω ω][θ2 θ5 θ6]ᵀ, and any other model likewise, in seven steps: record;
//! filter the outputs forward and backward with a Butterworth low-pass of 0.5 Hz; differentiate them; form the products
//! of filtered signals; take the references as they were sent; stack; solve by least squares.
//!
//! The order of the filter is not stated there; 2 is our choice. The result is biased, and by how much is known.

use serde::{Deserialize, Serialize};
use wheelwright_core::regression::{Pairing, Products, Settings};
use wheelwright_core::signal::Padding;
use wheelwright_core::solver::{Problem, Solution, SolveError, Solver};

use crate::regression::SolverRegression;

/// Settings of the `thesis` solver.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Thesis {
    /// Order of the filter. Default 2.
    pub order: usize,
    /// Its cut-off \[Hz\]. Default 0.5.
    pub cutoff_hz: f64,
    /// Padding rule of the filter. Default `scipy`.
    pub padding: Padding,
}

impl Default for Thesis {
    fn default() -> Self {
        Self { order: 2, cutoff_hz: 0.5, padding: Padding::Scipy }
    }
}

#[typetag::serde(name = "thesis")]
impl Solver for Thesis {
    fn name(&self) -> &str {
        "thesis"
    }

    fn about(&self) -> String {
        "least squares of Laut (2011): outputs filtered at 0.5 Hz, references raw; biased, kept for comparison".to_owned()
    }

    fn solve(&self, problem: &Problem<'_>) -> Result<Solution, SolveError> {
        let settings = Settings {
            order: self.order,
            cutoff_hz: Some(self.cutoff_hz),
            padding: self.padding,
            products: Products::AfterFilter,
            filter_response: false,
            pairing: Pairing::Same,
            trim_s: Some(0.0),
            ..Settings::default()
        };
        let regression = SolverRegression::new(problem, &settings)?;
        let solved = regression.solve(problem.model, &problem.map)?;
        let mut solution = regression.into_solution(problem.map.theta(&solved.free), solved.condition);
        solution.warnings.push(
            "the `thesis` solver is biased: unfiltered references, half a sampling period of lag and the ends of the filter make time \
             constants 36 to 112 % too long on its own robots; use `output-error` or `ols` for values to rely on"
                .to_owned(),
        );
        Ok(solution)
    }
}
