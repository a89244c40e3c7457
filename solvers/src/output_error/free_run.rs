//! The free-run simulation error as a least-squares problem.
//!
//! Unknown are the free parameters z and, as nuisance, the outputs at the start of every stretch. The latter act on
//! their own stretch only: each stretch is triangularised by itself with its start in front, which eliminates it, and
//! only the small triangles are stacked. A hundred stretches cost no more than one as long.
//!
//! Velocities that a driver differenced from counts are summed up again and compared as distances: the rounding of a
//! count is independent from sample to sample, that of a difference is not, and no autoregression of finite order makes
//! it so. Where each encoder stood between two counts at the start is told apart from the velocity at the start only
//! within the first lags, so that one unknown serves for both.
//!
//! How the error moves with the unknowns comes from differences of whole simulations, or from the prefilter.

use nalgebra::{DMatrix, DVector};
use wheelwright_core::Stretch;
use wheelwright_core::model::ModelError;
use wheelwright_core::simulation::{DIFFERENCE, Direction, Readout, Sensitivities, Simulator};
use wheelwright_core::solver::{Problem, SolveError};

use super::Fit;
use super::noise::{Channels, Noise};
use crate::prefilter::{Columns, Prefilter};
use wheelwright_core::least_squares::{Factor, Residuals};

/// Most steps between two samples: where friction makes a kink, shorter ones cost much and gain little against noise.
const FINEST: f64 = 32.0;
/// Distance from a bound in difference steps below which a parameter sits at it, but for rounding.
const AT_BOUND: f64 = 1e-3;

/// Where the columns of the linearised problem come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Method {
    /// Differences of simulations.
    Sensitivities,
    /// The model's equations on the free run, through the model's own lag: instruments.
    Instruments,
}

/// Instruments Z, regressors Ψ and error e, whitened, the starts of all stretches eliminated.
pub(crate) struct Instrumental {
    /// ‖Z s + e‖².
    pub(crate) factor: Factor,
    /// QᵀΨ for Z = Q R.
    pub(crate) regressors: DMatrix<f64>,
}

pub(crate) struct FreeRun<'a> {
    problem: &'a Problem<'a>,
    method: Method,
    simulator: Simulator<'a>,
    transform: DMatrix<f64>,
    /// Plausible size of each free parameter, for the difference steps.
    scale: Vec<f64>,
    readout: Readout,
    pub(crate) noise: Noise,
    z: DVector<f64>,
    starts: Vec<DVector<f64>>,
    trial: (DVector<f64>, Vec<DVector<f64>>),
    eliminated: Vec<Factor>,
}

impl<'a> FreeRun<'a> {
    pub(crate) fn new(fit: &Fit<'a>, noise: Noise, z: DVector<f64>) -> Result<Self, SolveError> {
        let (problem, method, readout, transform) = (fit.problem, fit.method, fit.readout(), fit.transform.clone());
        let theta = problem.map.theta(z.as_slice());
        let scale = fit.integrals.free_scale(&transform, &theta);
        let starts: Vec<DVector<f64>> =
            problem.data.stretches.iter().map(|s| DVector::from_iterator(s.outputs.len(), s.outputs.iter().map(|c| c[0]))).collect();
        let simulator = Simulator::new(problem.model, &theta)?.with_readout(readout);
        let trial = (z.clone(), starts.clone());
        let mut run = Self { problem, method, simulator, transform, scale, readout, noise, z, starts, trial, eliminated: Vec::new() };
        run.choose_step()?;
        Ok(run)
    }

    /// Fixes the step for the current parameters, so that the cost is smooth; true if it had to become shorter.
    pub(crate) fn choose_step(&mut self) -> Result<bool, SolveError> {
        self.simulator.set_theta(&self.problem.map.theta(self.z.as_slice()))?;
        let mut shortest = f64::INFINITY;
        for stretch in &self.problem.data.stretches {
            shortest = shortest.min(self.simulator.chosen_step(stretch)?);
        }
        let shortest = shortest.max(self.problem.data.period() / FINEST);
        let shorter = self.simulator.max_step().is_none_or(|step| shortest < step);
        if shorter {
            self.simulator.set_max_step(shortest);
        }
        Ok(shorter)
    }

    pub(crate) fn z(&self) -> &DVector<f64> {
        &self.z
    }

    /// Cost at the current point; infinite where it cannot be simulated.
    pub(crate) fn cost(&mut self) -> f64 {
        self.whitened_errors().map_or(f64::INFINITY, |errors| errors.iter().flatten().flatten().map(|e| e * e).sum())
    }

    /// Simulated minus measured, of every stretch.
    pub(crate) fn errors(&mut self) -> Result<Vec<Channels>, ModelError> {
        self.simulator.set_theta(&self.problem.map.theta(self.z.as_slice()))?;
        (0..self.starts.len()).map(|s| stretch_errors(self.problem, &mut self.simulator, s, self.readout, &self.starts[s])).collect()
    }

    /// Whitened simulated minus measured, of every stretch.
    pub(crate) fn whitened_errors(&mut self) -> Result<Vec<Channels>, ModelError> {
        let mut errors = self.errors()?;
        errors.iter_mut().for_each(|stretch| self.noise.whiten(stretch));
        Ok(errors)
    }

    /// The linearised problem of every stretch: whitened columns of its start, of the free parameters, and the error.
    pub(crate) fn blocks(&mut self) -> Result<Vec<DMatrix<f64>>, SolveError> {
        let directions = self.directions();
        self.simulator.set_theta(&self.problem.map.theta(self.z.as_slice()))?;
        (0..self.starts.len()).map(|s| Ok(self.columns(s, &directions)?)).collect()
    }

    /// Moves by a share of a step of the free parameters followed by the start of each stretch.
    pub(crate) fn shift(&mut self, step: &DVector<f64>, share: f64) {
        let mut first = self.z.len();
        self.z += share * step.rows(0, first);
        for start in &mut self.starts {
            *start += share * step.rows(first, start.len());
            first += start.len();
        }
    }

    /// Compared values less unknowns.
    pub(crate) fn freedom(&self) -> f64 {
        let values: usize = self.problem.data.stretches.iter().map(|s| s.len() * s.outputs.len()).sum();
        let unknowns = self.z.len() + self.starts.iter().map(DVector::len).sum::<usize>();
        values.saturating_sub(unknowns).max(1) as f64
    }

    fn directions(&self) -> Vec<Direction> {
        let theta = self.problem.map.theta(self.z.as_slice());
        let step = |j: usize| {
            // Between the parameter's own size, which bounds the curvature, and its plausible one, which bounds rounding.
            let (own, scale) = (self.z[j].abs(), self.scale[j]);
            let step = DIFFERENCE * if scale.is_finite() { (own.max(1e-4 * scale) * scale).sqrt() } else { own.max(1.0) };
            // Never across a bound: a lag that changes its sign is another robot.
            let column = self.transform.column(j);
            let to_bound = theta.iter().zip(&self.problem.bounds).zip(column.iter()).flat_map(|((t, (low, high)), d)| {
                [(t - low).abs() / d.abs(), (high - t).abs() / d.abs()].into_iter().filter(|distance| *distance > AT_BOUND * step)
            });
            to_bound.fold(step, |step, distance| step.min(0.5 * distance))
        };
        (0..self.z.len()).map(|j| Direction { along: self.transform.column(j).iter().copied().collect(), step: step(j) }).collect()
    }

    /// Whitened columns: start, parameters, error.
    fn columns(&mut self, s: usize, directions: &[Direction]) -> Result<DMatrix<f64>, ModelError> {
        let found = match self.method {
            Method::Sensitivities => {
                let stretch = &self.problem.data.stretches[s];
                self.simulator.sensitivities(stretch, self.starts[s].as_slice(), directions)?
            }
            Method::Instruments => {
                let Columns { initial, instruments, .. } = self.filtered(s)?;
                Sensitivities { parameters: instruments, initial }
            }
        };
        self.whitened(s, found.initial.into_iter().chain(found.parameters))
    }

    /// What comes through the model's own lag over a stretch.
    fn filtered(&self, s: usize) -> Result<Columns, ModelError> {
        let stretch = &self.problem.data.stretches[s];
        let step = self.simulator.max_step().unwrap_or(f64::INFINITY);
        let theta = self.problem.map.theta(self.z.as_slice());
        let mut filter = Prefilter::new(self.problem.model, &theta, &self.transform, self.readout, step)?;
        filter.columns(stretch, self.starts[s].as_slice())
    }

    /// Columns as they are compared, whitened, with the error as the last.
    fn whitened(&mut self, s: usize, columns: impl Iterator<Item = Channels>) -> Result<DMatrix<f64>, ModelError> {
        let stretch = &self.problem.data.stretches[s];
        let (rows, outputs) = (stretch.len(), stretch.outputs.len());
        let error = stretch_errors(self.problem, &mut self.simulator, s, self.readout, &self.starts[s])?;
        let summed = |mut column: Channels| {
            if self.readout == Readout::IntervalMean {
                sum_up(&mut column, &stretch.time);
            }
            column
        };
        let mut values = Vec::new();
        for mut column in columns.map(summed).chain(std::iter::once(error)) {
            self.noise.whiten(&mut column);
            column.iter().for_each(|series| values.extend_from_slice(series));
        }
        Ok(DMatrix::from_vec(rows * outputs, values.len() / (rows * outputs), values))
    }

    /// The problem of instrumental variables at the current point.
    pub(crate) fn instrumental(&mut self) -> Result<Instrumental, SolveError> {
        self.simulator.set_theta(&self.problem.map.theta(self.z.as_slice()))?;
        let (n, free) = (self.starts.first().map_or(0, DVector::len), self.z.len());
        let mut eliminated = Vec::with_capacity(self.starts.len());
        let width = 2 * free + 1;
        let mut stacked = DMatrix::zeros(self.starts.len() * width, width);
        for s in 0..self.starts.len() {
            let Columns { initial, instruments, regressors } = self.filtered(s)?;
            let columns = self.whitened(s, initial.into_iter().chain(instruments).chain(regressors))?;
            let Factor { r, q, rest } = Factor::of(columns);
            stacked.view_mut((s * width, 0), (2 * free, 2 * free)).copy_from(&r.view((n, n), (2 * free, 2 * free)));
            stacked.view_mut((s * width, 2 * free), (2 * free, 1)).copy_from(&q.rows(n, 2 * free));
            stacked[((s + 1) * width - 1, 2 * free)] = rest;
            eliminated.push(of_instruments(&Factor { r, q, rest }, n + free));
        }
        self.eliminated = eliminated;
        let whole = Factor::of(stacked);
        let regressors = whole.r.view((0, free), (free, free)).into_owned();
        Ok(Instrumental { factor: of_instruments(&whole, free), regressors })
    }
}

/// The factor of the first columns and the error, from one that holds others between them.
fn of_instruments(whole: &Factor, first: usize) -> Factor {
    let others = whole.q.rows(first, whole.q.len() - first).norm();
    Factor { r: whole.r.view((0, 0), (first, first)).into_owned(), q: whole.q.rows(0, first).into_owned(), rest: others.hypot(whole.rest) }
}

/// Interval means times intervals, summed up; the first row, of which there is no mean, is where the sum starts.
pub(crate) fn sum_up(column: &mut Channels, time: &[f64]) {
    for series in column {
        let mut sum = 0.0;
        for k in 0..series.len() {
            sum += if k == 0 { 0.0 } else { series[k] * (time[k] - time[k - 1]) };
            series[k] = sum;
        }
    }
}

fn stretch_errors(
    problem: &Problem<'_>,
    simulator: &mut Simulator<'_>,
    s: usize,
    readout: Readout,
    start: &DVector<f64>,
) -> Result<Channels, ModelError> {
    let stretch = &problem.data.stretches[s];
    let mut run = vec![Vec::new(); stretch.outputs.len()];
    simulator.run(stretch, start.as_slice(), &mut run)?;
    for (simulated, measured) in run.iter_mut().zip(&stretch.outputs) {
        simulated.iter_mut().zip(measured).for_each(|(s, m)| *s -= m);
    }
    if readout == Readout::IntervalMean {
        sum_up(&mut run, &stretch.time);
    }
    Ok(run)
}

impl FreeRun<'_> {
    /// For every stretch the whitened columns of the parameters, cleared of what its start can do, and the whitened error.
    pub(super) fn cleared(&mut self, mut each: impl FnMut(&Stretch, DMatrix<f64>, &[f64])) -> Result<(), SolveError> {
        let directions = self.directions();
        self.simulator.set_theta(&self.problem.map.theta(self.z.as_slice()))?;
        let n = self.starts.first().map_or(0, DVector::len);
        for s in 0..self.starts.len() {
            let columns = self.columns(s, &directions)?;
            let free = columns.ncols() - n - 1;
            let Factor { r, .. } = Factor::of(columns.clone());
            let mut cleared = columns.columns(n, free).into_owned();
            if let Some(part) = r.view((0, 0), (n, n)).solve_upper_triangular(&r.view((0, n), (n, free))) {
                cleared -= columns.columns(0, n) * part;
            }
            each(&self.problem.data.stretches[s], cleared, columns.column(n + free).as_slice());
        }
        Ok(())
    }
}

impl FreeRun<'_> {
    /// Moves the start of a stretch as `step` of the free parameters asks; its cost there.
    fn attempt_start(&mut self, s: usize, step: &DVector<f64>) -> f64 {
        let Factor { r, q, .. } = &self.eliminated[s];
        let n = self.starts[s].len();
        let moves = |right: DVector<f64>| r.view((0, 0), (n, n)).solve_upper_triangular(&right).unwrap_or_else(|| DVector::zeros(n));
        let answer = &self.starts[s] + moves(-(r.view((0, n), (n, step.len())) * step));
        let moved = &answer + moves(-q.rows(0, n));
        let (reached, before) = (self.stretch_cost(s, &moved), self.eliminated[s].cost());
        // The start's own step, which no damping shortens, may lead across a kink: a robot with friction that begins at rest.
        let stayed = if reached > before { self.stretch_cost(s, &answer) } else { f64::INFINITY };
        self.trial.1[s] = if stayed < reached { answer } else { moved };
        reached.min(stayed)
    }

    /// Cost of a stretch at the simulator's parameters; infinite where it cannot be simulated.
    fn stretch_cost(&mut self, s: usize, start: &DVector<f64>) -> f64 {
        let Ok(mut errors) = stretch_errors(self.problem, &mut self.simulator, s, self.readout, start) else { return f64::INFINITY };
        self.noise.whiten(&mut errors);
        let cost: f64 = errors.iter().flatten().map(|e| e * e).sum();
        if cost.is_nan() { f64::INFINITY } else { cost }
    }
}

impl Residuals for FreeRun<'_> {
    fn linearise(&mut self) -> Result<Factor, SolveError> {
        let directions = self.directions();
        self.simulator.set_theta(&self.problem.map.theta(self.z.as_slice()))?;
        let (n, free) = (self.starts.first().map_or(0, DVector::len), self.z.len());
        let mut eliminated = Vec::with_capacity(self.starts.len());
        let mut stacked = DMatrix::zeros(self.starts.len() * (free + 1), free + 1);
        for s in 0..self.starts.len() {
            let Factor { r, q, rest } = Factor::of(self.columns(s, &directions)?);
            let below = s * (free + 1);
            stacked.view_mut((below, 0), (free, free)).copy_from(&r.view((n, n), (free, free)));
            stacked.view_mut((below, free), (free, 1)).copy_from(&q.rows(n, free));
            // What the start could still do to the error is not done yet.
            stacked[(below + free, free)] = rest.hypot(q.rows(0, n).norm());
            eliminated.push(Factor { r, q, rest });
        }
        self.eliminated = eliminated;
        Ok(Factor::of(stacked))
    }

    fn attempt(&mut self, step: &DVector<f64>) -> f64 {
        self.trial.0 = &self.z + step;
        if self.simulator.set_theta(&self.problem.map.theta(self.trial.0.as_slice())).is_err() {
            return f64::INFINITY;
        }
        (0..self.starts.len()).map(|s| self.attempt_start(s, step)).sum()
    }

    fn accept(&mut self) {
        std::mem::swap(&mut self.z, &mut self.trial.0);
        std::mem::swap(&mut self.starts, &mut self.trial.1);
    }
}
