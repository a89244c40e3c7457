//! `recursive`: least squares sample by sample, for running on the robot.
//!
//! Rows are those of the integral form of the regression: the equation integrated over a sliding window, inputs held,
//! outputs by the trapezoid rule. Each row is rotated into one triangle ([`givens`]), which after any number of samples holds
//! the batch solution ([`estimator`]). A free run beside the robot takes out the bias that measured columns bring, and gives
//! intervals ([`free_run`]). Memory is fixed when the estimator is made, and a sample allocates nothing. With forgetting, rows
//! fade by e^{−Δt / memory}.

mod colour;
mod estimator;
mod free_run;
mod givens;

use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};
use wheelwright_core::model::{ParameterMap, RegressorModel};
use wheelwright_core::solver::{Problem, Solution, SolveError, Solver, Status};

use crate::output_error::{Velocity, not_identifiable};
pub use estimator::{Estimator, Stage};

/// Rows of the regression, as a multiple of the free parameters, before the free run starts.
const FIRST_ROWS: f64 = 10.0;

/// Settings of the `recursive` solver.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Recursive {
    /// Window of the integral in samples. Default 10.
    pub window: usize,
    /// Time after which a row counts 1/e of a new one \[s\]; no forgetting by default.
    pub memory_s: Option<f64>,
    /// Follow the regression with a free run, which takes out its bias and gives intervals. Default true; false leaves the
    /// regression alone, which equals the batch solution of the same rows.
    pub refine: bool,
    /// What the recorded velocities are, for the free run: `instantaneous` (default) or `difference`. A recording that is replayed is
    /// replayed as `difference` where the errors show that it is.
    pub velocity: Velocity,
}

impl Default for Recursive {
    fn default() -> Self {
        Self { window: 10, memory_s: None, refine: true, velocity: Velocity::default() }
    }
}

impl Recursive {
    /// An estimator for a model, parameters tied or fixed by `map`.
    ///
    /// # Errors
    /// [`SolveError::Setting`].
    pub fn start<'a>(&self, model: &'a dyn RegressorModel, map: &ParameterMap) -> Result<Estimator<'a>, SolveError> {
        let wrong = |key: &str, reason: &str| Err(SolveError::Setting { key: key.to_owned(), reason: reason.to_owned() });
        if self.window == 0 {
            return wrong("window", "0 samples: at least one interval is needed");
        }
        if self.memory_s.is_some_and(|m| !(m > 0.0 && m.is_finite())) {
            return wrong("memory_s", "must be a positive time in seconds; leave it out for no forgetting");
        }
        Ok(Estimator::new(self, model, map))
    }

    /// The same for velocities that are differenced from encoder counts, where they are not said to be and a free run could tell.
    pub fn on_differences(&self) -> Option<Self> {
        (self.refine && self.velocity == Velocity::Instantaneous).then(|| Self { velocity: Velocity::Difference, ..self.clone() })
    }
}

/// What is said where a recording was replayed as one of differenced counts without having been said to be one.
pub const DIFFERENCED: &str = "velocities taken as differenced from encoder counts, because each error undoes half of the one before: set \
                               `velocity = \"difference\"`";

/// Normal quantile of a 95 % interval.
const NORMAL: f64 = 1.959_963_984_540_054;
/// Degrees of freedom from which the quantile of Student's t is expanded about the normal one, to better than 1e-6.
const FEW: f64 = 100.0;

/// Half the width of a 95 % interval in standard errors, for errors of this many degrees of freedom.
pub(crate) fn half_width(freedom: f64) -> f64 {
    if freedom < FEW {
        return StudentsT::new(0.0, 1.0, freedom.max(1.0)).map_or(NORMAL, |t| t.inverse_cdf(0.975));
    }
    // Cornish and Fisher's expansion (Abramowitz and Stegun, 26.7.5): a search for the quantile would take longer than all else.
    let (x, n) = (NORMAL, freedom.recip());
    let first = (x.powi(3) + x) / 4.0;
    let second = (5.0 * x.powi(5) + 16.0 * x.powi(3) + 3.0 * x) / 96.0;
    let third = (3.0 * x.powi(7) + 19.0 * x.powi(5) + 17.0 * x.powi(3) - 15.0 * x) / 384.0;
    x + n * (first + n * (second + n * third))
}

#[typetag::serde(name = "recursive")]
impl Solver for Recursive {
    fn name(&self) -> &str {
        "recursive"
    }

    fn about(&self) -> String {
        "least squares sample by sample in constant memory, as it runs on the robot; forgetting optional".to_owned()
    }

    fn solve(&self, problem: &Problem<'_>) -> Result<Solution, SolveError> {
        if let Some(differences) = self.on_differences() {
            // A failure is that of the regression, which the other pass meets as well.
            if let Ok((mut solution, true)) = differences.pass(problem) {
                solution.warnings.push(DIFFERENCED.to_owned());
                return Ok(solution);
            }
        }
        self.pass(problem).map(|(solution, _)| solution)
    }
}

impl Recursive {
    /// One pass over a recording; also whether its errors are those of differenced counts.
    fn pass(&self, problem: &Problem<'_>) -> Result<(Solution, bool), SolveError> {
        let mut estimator = self.start(problem.model, &problem.map)?;
        let mut rows = 0;
        for stretch in &problem.data.stretches {
            estimator.new_stretch();
            let (mut inputs, mut outputs) = (vec![0.0; stretch.inputs.len()], vec![0.0; stretch.outputs.len()]);
            for (k, time) in stretch.time.iter().enumerate() {
                inputs.iter_mut().zip(&stretch.inputs).for_each(|(x, c)| *x = c[k]);
                outputs.iter_mut().zip(&stretch.outputs).for_each(|(x, c)| *x = c[k]);
                rows += usize::from(estimator.push(*time, &inputs, &outputs));
            }
        }
        if rows == 0 {
            let needed_s = (10 * self.window.max(problem.map.free.len())) as f64 * problem.data.period();
            let what = format!("filling windows of {} intervals", self.window);
            return Err(SolveError::TooFewSamples { samples: 0, parameters: problem.map.free.len(), what, needed_s });
        }
        let (mut theta, mut std) = (vec![0.0; problem.map.offset.len()], vec![0.0; problem.map.offset.len()]);
        let stage = estimator.estimate(&mut theta, &mut std);
        let (hidden, condition) = estimator.rank();
        let transform = nalgebra::DMatrix::from_row_slice(theta.len(), problem.map.free.len(), &problem.map.matrix);
        if let (Stage::Unknown, Some(error)) = (stage, not_identifiable(problem, &transform, &hidden)) {
            return Err(error);
        }
        let outside = |i: &usize| !(problem.bounds[*i].0..=problem.bounds[*i].1).contains(&theta[*i]);
        let warnings = (0..theta.len()).filter(outside).map(|i| {
            let name = &problem.model.parameters()[i].name;
            format!("{name} = {:.4} is outside its bounds, which `recursive` does not keep", theta[i])
        });
        let mut steps = vec![format!(
            "took {rows} samples in one by one, each as an integral over {} intervals{}",
            self.window,
            self.memory_s.map_or_else(String::new, |m| format!(", forgetting with {m} s of memory"))
        )];
        steps.push(match estimator.obstacle() {
            None => "refined them by a free run beside the robot, linearised anew each time its rows had doubled".to_owned(),
            Some(reason) => format!("no intervals: {reason}"),
        });
        let ci95 = match stage {
            Stage::FreeRun { half_width } => Some(theta.iter().zip(&std).map(|(t, s)| (t - half_width * s, t + half_width * s)).collect()),
            _ => None,
        };
        let solution = Solution {
            std: ci95.is_some().then_some(std),
            ci95,
            covariance: None,
            status: Status::Solved,
            condition,
            at_bound: Vec::new(),
            steps,
            warnings: warnings.collect(),
            regression: None,
            theta,
        };
        Ok((solution, estimator.counts()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_quantile_is_that_of_tables() {
        // scipy.stats.t.ppf(0.975, n)
        for (n, wanted) in
            [(1.0, 12.706_204_736), (10.0, 2.228_138_852), (99.9, 1.983_995_838), (100.0, 1.983_971_519), (1e4, 1.960_201_264)]
        {
            assert!((half_width(n) - wanted).abs() < 1e-6, "{n}: {} {wanted}", half_width(n));
        }
    }
}
