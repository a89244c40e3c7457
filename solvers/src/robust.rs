//! `robust`: the free-run fit under Huber's loss, for recordings with outliers and dropouts.
//!
//! minimise Σ ρ(e_k / σ) with ρ quadratic up to 1.345 and linear beyond, which keeps 95 % of the efficiency on Gaussian
//! noise and bounds the pull of a bad sample. σ is the scaled median of |e|, per output. Each step is the Huber regression
//! of the linearised error, solved to optimality by clarabel in its dual form, a quadratic program with one bounded
//! unknown a sample:
//!
//! minimise ½ ‖u‖² − rᵀu − (h − G z)ᵀμ  subject to  Jᵀu = Gᵀμ,  |u| ≤ 1.345,  μ ≥ 0.
//!
//! The multiplier of the equality is the step, negated. No intervals: outliers leave no noise model to take them from.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use wheelwright_core::solver::{Problem, Solution, SolveError, Solver, Status};

use crate::OutputError;
use crate::Velocity;
use crate::output_error::{Channels, Fit, FreeRun, Method, Noise, NoiseModel};
use wheelwright_core::least_squares::{Factor, Limits, constrained_step};

/// Errors beyond this many σ pull no harder.
const CORNER: f64 = 1.345;
/// Errors beyond this many σ are reported as outliers.
const OUTLIER: f64 = 5.0;
/// Standard deviation of a Gaussian over the median of its absolute values.
const MEDIAN: f64 = 1.4826;
/// A step below this share of every parameter's plausible size ends the search.
const SHORT: f64 = 1e-7;

/// Settings of the `robust` solver.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Robust {
    /// As for `output-error`: what the recorded velocities are.
    pub velocity: Velocity,
    /// Most Huber regressions. Default 50.
    pub max_iterations: usize,
}

impl Default for Robust {
    fn default() -> Self {
        Self { velocity: Velocity::default(), max_iterations: 50 }
    }
}

#[typetag::serde(name = "robust")]
impl Solver for Robust {
    fn name(&self) -> &str {
        "robust"
    }

    fn about(&self) -> String {
        "free-run fit under Huber's loss, for recordings with outliers and dropouts".to_owned()
    }

    fn solve(&self, problem: &Problem<'_>) -> Result<Solution, SolveError> {
        let settings = OutputError { velocity: self.velocity, noise: NoiseModel::White, ..OutputError::default() };
        let fit = Fit::new("robust", Method::Sensitivities, &settings, problem)?;
        let (mut run, _) = fit.first_fit()?;
        let mut converged = false;
        let mut iterations = 0;
        while !converged && iterations < self.max_iterations {
            iterations += 1;
            run.choose_step()?;
            run.noise = Noise::white(&deviations(&run.errors()?, &fit.floor));
            let blocks = run.blocks()?;
            let step = huber_step(&blocks, run.z(), &fit.limits)?;
            let scale = fit.integrals.free_scale(&fit.transform, &problem.map.theta(run.z().as_slice()));
            converged = descend(&mut run, &step)? || step.iter().zip(&scale).all(|(s, size)| s.abs() <= SHORT * size);
        }
        let theta = problem.map.theta(run.z().as_slice());
        let at_bound = fit.at_bound(&theta);
        let status = match (converged, at_bound.is_empty()) {
            (false, _) => Status::IterationLimit,
            (true, true) => Status::Solved,
            (true, false) => Status::SolvedAtBound,
        };
        let condition = fit.condition(&mut run)?;
        Ok(Solution {
            theta,
            std: None,
            ci95: None,
            covariance: None,
            status,
            condition,
            at_bound,
            steps: vec![format!("simulated freely, errors beyond {CORNER} deviations weighted down; {iterations} Huber regression(s)")],
            warnings: outliers(&mut run, problem)?,
            regression: None,
        })
    }
}

/// Robust standard deviation of each output's errors.
fn deviations(errors: &[Channels], floor: &[f64]) -> Vec<f64> {
    let of = |(c, floor): (usize, &f64)| {
        let mut sizes: Vec<f64> = errors.iter().flat_map(|e| e[c].iter().map(|x| x.abs())).collect();
        (MEDIAN * wheelwright_core::recording::median(&mut sizes)).max(*floor)
    };
    floor.iter().enumerate().map(of).collect()
}

fn loss(errors: &[Channels]) -> f64 {
    let huber = |e: &f64| if e.abs() <= CORNER { 0.5 * e * e } else { CORNER * (e.abs() - 0.5 * CORNER) };
    errors.iter().flatten().flatten().map(huber).sum()
}

/// Goes along the step, by half as far as often as the loss does not fall; true if it does not fall at all.
fn descend(run: &mut FreeRun<'_>, step: &DVector<f64>) -> Result<bool, SolveError> {
    let whitened = |run: &mut FreeRun<'_>| run.whitened_errors().map(|e| loss(&e)).unwrap_or(f64::INFINITY);
    let before = whitened(run);
    let mut share = 1.0;
    while share > 1e-4 {
        run.shift(step, share);
        if whitened(run) < before {
            return Ok(false);
        }
        run.shift(step, -share);
        share *= 0.5;
    }
    Ok(true)
}

/// The step of free parameters, then of the start of each stretch, that minimises Huber's loss of the linearised errors.
/// `blocks` are [start, parameters, error] of each stretch.
fn huber_step(blocks: &[DMatrix<f64>], z: &DVector<f64>, limits: &Limits) -> Result<DVector<f64>, SolveError> {
    let free = z.len();
    let nuisance = |b: &DMatrix<f64>| b.ncols() - free - 1;
    let samples: usize = blocks.iter().map(DMatrix::nrows).sum();
    let equalities = free + blocks.iter().map(nuisance).sum::<usize>();
    let lengths = column_lengths(blocks, free, equalities);
    let (mut rows, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
    let mut set = |row: usize, column: usize, value: f64| {
        rows.push(row);
        columns.push(column);
        values.push(value);
    };
    let mut linear = Vec::with_capacity(samples + limits.h.len());
    let (mut first, mut start) = (0, free);
    for block in blocks {
        let own = nuisance(block);
        for k in 0..block.nrows() {
            (0..own).for_each(|j| set(start + j, first + k, block[(k, j)] / lengths[start + j]));
            (0..free).for_each(|j| set(j, first + k, block[(k, own + j)] / lengths[j]));
            set(equalities + first + k, first + k, 1.0);
            set(equalities + samples + first + k, first + k, -1.0);
            linear.push(-block[(k, own + free)]);
        }
        first += block.nrows();
        start += own;
    }
    let slack = &limits.h - &limits.g * z;
    for i in 0..limits.h.len() {
        (0..free).for_each(|j| set(j, samples + i, -limits.g[(i, j)] / lengths[j]));
        set(equalities + 2 * samples + i, samples + i, -1.0);
        linear.push(-slack[i]);
    }
    let unknowns = samples + limits.h.len();
    let constraints = equalities + 2 * samples + limits.h.len();
    let quadratic = CscMatrix::new_from_triplets(unknowns, unknowns, (0..samples).collect(), (0..samples).collect(), vec![1.0; samples]);
    let matrix = CscMatrix::new_from_triplets(constraints, unknowns, rows, columns, values);
    let right: Vec<f64> =
        (0..constraints).map(|i| if (equalities..equalities + 2 * samples).contains(&i) { CORNER } else { 0.0 }).collect();
    let cones = [SupportedConeT::ZeroConeT(equalities), SupportedConeT::NonnegativeConeT(constraints - equalities)];
    let failed = |reason: String| SolveError::Failed { reason };
    let settings = DefaultSettingsBuilder::default().verbose(false).max_threads(1).build().map_err(|e| failed(e.to_string()))?;
    let mut solver = DefaultSolver::new(&quadratic, &linear, &matrix, &right, &cones, settings).map_err(|e| failed(e.to_string()))?;
    solver.solve();
    match solver.solution.status {
        // As far as rounding lets it come is near enough: a step is taken only where it lowers the loss.
        SolverStatus::Solved | SolverStatus::AlmostSolved | SolverStatus::InsufficientProgress => {
            let mut step = DVector::from_fn(equalities, |j, _| -solver.solution.z[j] / lengths[j]);
            // Bounds hold to the tolerance of the regression only, which is large where errors of outputs differ by orders.
            let lengths = DVector::from_column_slice(&lengths[..free]);
            let nearest = Factor { q: -lengths.component_mul(&step.rows(0, free)), r: DMatrix::from_diagonal(&lengths), rest: 0.0 };
            step.rows_mut(0, free).copy_from(&constrained_step(&nearest, None, z, limits)?);
            Ok(step)
        }
        status => Err(failed(format!("the Huber regression ended with `{status:?}`"))),
    }
}

/// Length of each column of the Jacobian, one where it is zero: parameters of very different size would cost accuracy.
fn column_lengths(blocks: &[DMatrix<f64>], free: usize, unknowns: usize) -> Vec<f64> {
    let mut squares = vec![0.0; unknowns];
    let mut start = free;
    for block in blocks {
        let own = block.ncols() - free - 1;
        (0..own).for_each(|j| squares[start + j] += block.column(j).norm_squared());
        (0..free).for_each(|j| squares[j] += block.column(own + j).norm_squared());
        start += own;
    }
    squares.iter().map(|s: &f64| if *s > 0.0 { s.sqrt() } else { 1.0 }).collect()
}

fn outliers(run: &mut FreeRun<'_>, problem: &Problem<'_>) -> Result<Vec<String>, SolveError> {
    let errors = run.whitened_errors()?;
    let mut warnings = Vec::new();
    for (c, channel) in problem.data.outputs.iter().enumerate() {
        let count = errors.iter().flat_map(|e| &e[c]).filter(|e| e.abs() > OUTLIER).count();
        let all: usize = errors.iter().map(|e| e[c].len()).sum();
        if count > 0 {
            let share = 100.0 * count as f64 / all as f64;
            warnings
                .push(format!("{count} samples of {} ({share:.1} %) lie more than {OUTLIER} deviations from the simulation", channel.name));
        }
    }
    Ok(warnings)
}
