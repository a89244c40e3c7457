//! `iv`: refined instrumental variables for continuous time (SRIVC, with a noise model RIVC).
//!
//! A regression on noisy outputs is biased, because the noise that is in the response is in the regressors too. Instruments are
//! columns that move as the regressors do but know nothing of the noise: the same regressors on the model's free run. With
//! Z the instruments and Ψ the regressors on the measurement, both through the model's own lag (the `prefilter` module) and
//! the noise model, and e(θ) the free run's error, each step solves
//!
//! Zᵀ (Ψ s + e(θ)) = 0,
//!
//! and the next free run, filter and instruments are made with θ + s. For a linear model Ψ θ − e is the filtered response,
//! so this is the usual Zᵀ Ψ θ = Zᵀ y to the letter; for any other model it leaves out what noise squared and the course
//! between samples would do to a filtered response. Where θ has settled, Zᵀ e(θ) = 0 exactly: estimates are
//! consistent for noise of any colour that does not come from the inputs (closed loops are another matter), and no error
//! of the filter or of straight lines between samples biases them. Zᵀ Ψ is never formed: Z = Q R, and QᵀΨ is solved.

use nalgebra::DVector;
use serde::{Deserialize, Serialize};
use wheelwright_core::least_squares::{Factor, Limits, Options, Outcome, Residuals, constrained_step};
use wheelwright_core::solver::{Problem, Solution, SolveError, Solver, Status};

use crate::output_error::{Fit, FreeRun, Instrumental, Method, NoiseModel, OutputError, Velocity};

/// θ has settled if the next step would move no unknown by more than this share of its standard error,
const SETTLED: f64 = 1e-3;
/// or of itself, which is rounding.
const ROUNDING: f64 = 1e-10;
/// An iteration that goes round in circles, as about kinks of friction, is relaxed: each step is taken by half as far if
/// it is hardly shorter than the one before,
const SHORTER: f64 = 0.95;
/// down to this share; then it has come as near as it will,
const LEAST_SHARE: f64 = 0.1;
/// which is near enough if the next step would be below this share of every standard error.
const IMMATERIAL: f64 = 0.05;
/// A step is halved while it makes the free run this much worse; a little worse is how the iteration may go.
const WORSE: f64 = 2.0;
/// Shortest share of a step that is tried.
const SHORTEST: f64 = 1e-3;
/// Diagonal element of the scaled triangle of QᵀΨ below which instruments and regressors have nothing in common.
const RANK: f64 = 1e-10;

/// Settings of the `iv` solver.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InstrumentalVariables {
    /// What the recorded velocities are, as in `output-error`: `"instantaneous"` (default) or `"difference"`.
    pub velocity: Velocity,
    /// What the error left is taken for, as in `output-error`: `"auto"` (default), `"autoregressive"` or `"white"`.
    pub noise: NoiseModel,
    /// Most steps of each iteration. Default 100.
    pub max_iterations: usize,
}

impl Default for InstrumentalVariables {
    fn default() -> Self {
        Self { velocity: Velocity::default(), noise: NoiseModel::default(), max_iterations: 100 }
    }
}

#[typetag::serde(name = "iv")]
impl Solver for InstrumentalVariables {
    fn name(&self) -> &str {
        "iv"
    }

    fn about(&self) -> String {
        "refined instrumental variables: instruments from the free run, prefiltered by the model's own lag; for high noise".to_owned()
    }

    fn solve(&self, problem: &Problem<'_>) -> Result<Solution, SolveError> {
        let settings = OutputError { velocity: self.velocity, noise: self.noise, max_iterations: self.max_iterations };
        let mut solution = Fit::new("iv", Method::Instruments, &settings, problem)?.solve()?;
        solution.steps.insert(
            1,
            "multiplied the equations, on measured outputs, by themselves on simulated outputs, both through the model's own lag"
                .to_owned(),
        );
        if solution.status == Status::IterationLimit {
            // Intervals belong to the place where instruments and error are orthogonal, and this is not it.
            (solution.std, solution.ci95, solution.covariance) = (None, None, None);
            solution.warnings.push(format!(
                "the instruments did not settle, going in circles or for want of more than {} steps: these values are where the iteration was left; compare with `output-error`",
                self.max_iterations
            ));
        }
        Ok(solution)
    }
}

/// Goes from `z`, the current point of `run`, to where instruments and error are orthogonal, within the limits.
pub(crate) fn orthogonalise(run: &mut FreeRun<'_>, mut z: DVector<f64>, limits: &Limits, options: Options) -> Result<Outcome, SolveError> {
    let mut problem = run.instrumental()?;
    let mut cost = run.cost();
    let (mut smooth, mut converged) = (true, false);
    let (mut share, mut last) = (1.0, f64::INFINITY);
    for _ in 0..options.iterations {
        let Some(wanted) = orthogonal_step(&problem) else { break };
        let Factor { r, rest, .. } = &problem.factor;
        // Within limits the nearest point to the orthogonal one, as far as the instruments can tell.
        let mut step = constrained_step(&Factor { r: r.clone(), q: -(r * wanted), rest: *rest }, None, &z, limits)?;
        let size = step.iter().zip(problem.factor.deviations().iter()).map(|(s, d)| (s / d).abs()).fold(0.0, f64::max);
        let rounding = step.iter().zip(z.iter()).all(|(s, z)| s.abs() <= ROUNDING * z.abs());
        share *= if size > SHORTER * last { 0.5 } else { 1.0 };
        converged = rounding || size <= if share < LEAST_SHARE { IMMATERIAL } else { SETTLED };
        if converged || share < LEAST_SHARE {
            break;
        }
        last = size;
        step *= share;
        let mut reached = run.attempt(&step);
        let mut tried = 1.0;
        // One is the cost of a single error as large as the noise.
        while tried > SHORTEST && reached > WORSE * cost + 1.0 {
            (step, tried, smooth) = (0.5 * step, 0.5 * tried, false);
            reached = run.attempt(&step);
        }
        if !reached.is_finite() {
            break;
        }
        run.accept();
        z += step;
        cost = reached;
        problem = run.instrumental()?;
    }
    Ok(Outcome { active: limits.active(&z), z, factor: problem.factor, converged, smooth })
}

/// The s of QᵀΨ s = −Qᵀe, by QR with columns scaled; `None` if it is singular.
fn orthogonal_step(problem: &Instrumental) -> Option<DVector<f64>> {
    let norms: Vec<f64> = problem.regressors.column_iter().map(|c| c.norm()).collect();
    let mut scaled = problem.regressors.clone();
    scaled.column_iter_mut().zip(&norms).for_each(|(mut c, norm)| c /= if *norm > 0.0 { *norm } else { 1.0 });
    let qr = scaled.qr();
    let mut right = -&problem.factor.q;
    qr.q_tr_mul(&mut right);
    let triangle = qr.r();
    let determined = triangle.diagonal().iter().all(|d| d.abs() > RANK);
    let solved = determined.then(|| triangle.solve_upper_triangular(&right)).flatten()?;
    Some(DVector::from_iterator(norms.len(), solved.iter().zip(&norms).map(|(s, norm)| s / norm)))
}
