//! `box`: the regression of `ols` within bounds.
//!
//! minimise Σ ‖F Φ θ_app(θ) − F y‖² subject to lower ≤ θ ≤ upper.
//!
//! Bounds are physical and so act on θ, not on the apparent values that held inputs turn it into; as the two differ by
//! a smooth and nearly linear law (see [`Hold`](crate::Hold)), a few quadratic programmes, each linearised about the last θ, reach the
//! optimum. Without the law it is one.

use std::collections::BTreeMap;

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};
use wheelwright_core::model::ParameterMap;
use wheelwright_core::regression::Settings;
use wheelwright_core::solver::{Problem, Solution, SolveError, Solver, Status};

use crate::ols::{Ols, say};
use crate::quadratic::Quadratic;
use crate::regression::{SolverRegression, System};

/// Distance to a bound, relative, at which a parameter is reported to sit there.
const AT: f64 = 1e-9;

/// Settings of the `box` solver.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BoundedSolver {
    /// How the rows are made: a table `conditioning` with the keys of [`Settings`].
    pub conditioning: Settings,
    /// Undo the effect of held inputs on parameters that multiply accelerations. Default true.
    pub undo_hold: bool,
    /// Bounds by parameter name, `theta5 = [0, 0.1]`, within those that the problem already has.
    pub bounds: BTreeMap<String, (f64, f64)>,
}

impl Default for BoundedSolver {
    fn default() -> Self {
        Self { conditioning: Settings::default(), undo_hold: true, bounds: BTreeMap::new() }
    }
}

#[typetag::serde(name = "box")]
impl Solver for BoundedSolver {
    fn name(&self) -> &str {
        "box"
    }

    fn about(&self) -> String {
        "the regression of `ols` within bounds on any parameter".to_owned()
    }

    fn solve(&self, problem: &Problem<'_>) -> Result<Solution, SolveError> {
        let bounds = self.merged(problem)?;
        let limits = Limits::new(problem, &bounds)?;
        let regression = SolverRegression::new(problem, &self.conditioning)?;
        let solved = regression.solve(problem.model, &problem.map)?;
        let ols = Ols { conditioning: self.conditioning.clone(), undo_hold: self.undo_hold };
        let hold = ols.hold(problem, &regression);
        let within = |map: &ParameterMap| limits.solve(&regression.system(map, &solved.weights));
        let apparent = within(&problem.map)?;
        let undone = hold.as_ref().and_then(|h| h.undo(&problem.map, &apparent, within));
        let mut theta = problem.map.theta(undone.as_ref().unwrap_or(&apparent));
        // Rounding may leave a value one unit beyond its bound.
        let at_bound = (0..theta.len()).filter(|&i| limits.snap(i, &mut theta[i])).collect::<Vec<_>>();
        let mut solution = regression.into_solution(theta, solved.condition);
        say(&mut solution, hold.as_ref(), undone.is_some());
        solution.warnings.extend(limits.warnings);
        solution.status = if at_bound.is_empty() { Status::Solved } else { Status::SolvedAtBound };
        solution.at_bound = at_bound;
        Ok(solution)
    }
}

impl BoundedSolver {
    /// Bounds of the problem narrowed by the solver's own.
    fn merged(&self, problem: &Problem<'_>) -> Result<Vec<(f64, f64)>, SolveError> {
        let parameters = problem.model.parameters();
        let mut bounds = problem.bounds.clone();
        for (name, (lower, upper)) in &self.bounds {
            let Some(i) = parameters.iter().position(|p| &p.name == name) else {
                let known = parameters.iter().map(|p| p.name.as_str()).collect::<Vec<_>>().join(", ");
                let reason = format!("the model has no parameter of this name; it has {known}");
                return Err(SolveError::Setting { key: format!("bounds.{name}"), reason });
            };
            bounds[i] = (bounds[i].0.max(*lower), bounds[i].1.min(*upper));
        }
        for (parameter, (lower, upper)) in parameters.iter().zip(&bounds) {
            if lower > upper || lower.is_nan() || upper.is_nan() {
                return Err(SolveError::EmptyBounds { parameter: parameter.name.clone(), lower: *lower, upper: *upper });
            }
        }
        Ok(bounds)
    }
}

/// Bounds on θ = T z + c as bounds on combinations of z.
#[derive(Debug)]
struct Limits {
    theta: Vec<(f64, f64)>,
    rows: Vec<(Vec<f64>, f64, f64)>,
    free: usize,
    warnings: Vec<String>,
}

impl Limits {
    fn new(problem: &Problem<'_>, bounds: &[(f64, f64)]) -> Result<Self, SolveError> {
        let (map, parameters) = (&problem.map, problem.model.parameters());
        let z = map.free.len();
        let mut limits = Self { theta: bounds.to_vec(), rows: Vec::new(), free: z, warnings: Vec::new() };
        for (i, &(lower, upper)) in bounds.iter().enumerate() {
            let (row, c) = (&map.matrix[i * z..(i + 1) * z], map.offset[i]);
            let Some(&lead) = row.iter().find(|t| **t != 0.0) else {
                if c < lower || c > upper {
                    let name = &parameters[i].name;
                    limits.warnings.push(format!("{name} is fixed at {c}, outside its bounds [{lower}, {upper}]"));
                }
                limits.theta[i] = (f64::NEG_INFINITY, f64::INFINITY);
                continue;
            };
            // In units of the first coefficient, so that parallel rows are seen to be.
            let direction: Vec<f64> = row.iter().map(|t| t / lead).collect();
            let ends = ((lower - c) / lead, (upper - c) / lead);
            let (low, high) = if lead > 0.0 { ends } else { (ends.1, ends.0) };
            if low.is_infinite() && high.is_infinite() {
                continue;
            }
            match limits.rows.iter_mut().find(|(d, _, _)| d.iter().zip(&direction).all(|(a, b)| (a - b).abs() <= 1e-12)) {
                Some((_, l, h)) => {
                    (*l, *h) = (l.max(low), h.min(high));
                    if *l > *h {
                        return Err(SolveError::EmptyBounds { parameter: parameters[i].name.clone(), lower: *l, upper: *h });
                    }
                }
                None => limits.rows.push((direction, low, high)),
            }
        }
        Ok(limits)
    }

    fn solve(&self, system: &System) -> Result<Vec<f64>, SolveError> {
        if self.free == 0 {
            return Ok(Vec::new());
        }
        let c = DMatrix::from_fn(self.rows.len(), self.free, |i, j| self.rows[i].0[j]);
        let bounds = self.rows.iter().map(|(_, low, high)| (*low, *high)).collect();
        Quadratic { a: system.a.clone(), b: system.b.clone(), c, bounds }.solve()
    }

    /// True if a parameter sits at one of its bounds, to which it is then set.
    fn snap(&self, i: usize, value: &mut f64) -> bool {
        let (lower, upper) = self.theta[i];
        for bound in [lower, upper] {
            if bound.is_finite() && (*value - bound).abs() <= AT * bound.abs().max(1e-3) {
                *value = bound;
                return true;
            }
        }
        false
    }
}
