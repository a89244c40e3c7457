//! The free run about a point: errors, how they change with every unknown, and a quick fit.
//!
//! Unknown are the free parameters z, pure delays of inputs where a caller asks for them, and as nuisance the outputs at the
//! start of every stretch. The latter act on their own stretch only and are projected out of it. This serves the judgements
//! made before and beside a fit; the fit itself, with bounds, intervals and several starts, is a solver's.

mod delay;
mod scale;
mod start;

use std::borrow::Cow;

use nalgebra::{DMatrix, DVector};

use crate::dataset::{Dataset, Stretch};
use crate::model::{ModelError, ParameterMap, RegressorModel};
use crate::noise::Autoregression;
use crate::simulation::{DIFFERENCE, Direction, Simulator};
use delay::{delayed, pick};
pub(crate) use scale::{linear_part, plausible, time_constants};
pub(crate) use start::{about, free_values, quick_fit, regression_start, rough_start, simulable};

/// Columns whose norm is this small a share of the largest carry rounding only.
const RANK: f64 = 1e-7;
/// Steps of the quick fit, and halvings of one.
const ITERATIONS: usize = 12;
const HALVINGS: usize = 8;

/// A free run with its unknowns.
#[derive(Debug)]
pub(crate) struct FreeRun<'a> {
    pub(crate) model: &'a dyn RegressorModel,
    pub(crate) map: &'a ParameterMap,
    pub(crate) data: &'a Dataset,
    /// Which delay shifts each input; `None` for an input that is not delayed.
    axes: Vec<Option<usize>>,
    max_step: f64,
    /// Range that delays stay in \[s\].
    delays: (f64, f64),
}

/// Differences to both sides, for what is reported, or to one, for the steps of a search.
#[derive(Debug, Clone, Copy)]
enum Sides {
    Both,
    One,
}

/// Values of the unknowns.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Point {
    pub(crate) z: Vec<f64>,
    pub(crate) delays: Vec<f64>,
    /// Outputs at the start of each stretch.
    pub(crate) starts: Vec<Vec<f64>>,
}

/// One stretch about a point, everything divided by the noise of its output; rows are those of output 0, then of output 1, ….
#[derive(Debug)]
pub(crate) struct Block {
    /// Measured minus simulated.
    pub(crate) error: DVector<f64>,
    /// d simulated / d (z, delays).
    pub(crate) columns: DMatrix<f64>,
    /// d simulated / d start.
    starts: DMatrix<f64>,
}

/// All stretches about a point with the starts projected out.
#[derive(Debug)]
pub(crate) struct Local {
    pub(crate) blocks: Vec<Block>,
    /// Upper triangle of \[columns | error\] over all stretches.
    pub(crate) triangle: DMatrix<f64>,
}

impl<'a> FreeRun<'a> {
    /// `axes[i]` says which delay shifts input i.
    pub(crate) fn new(model: &'a dyn RegressorModel, map: &'a ParameterMap, data: &'a Dataset, axes: Vec<Option<usize>>) -> Self {
        Self { model, map, data, axes, max_step: f64::INFINITY, delays: (f64::NEG_INFINITY, f64::INFINITY) }
    }

    /// Keeps delays within a range \[s\] from now on.
    pub(crate) fn limit_delays(&mut self, shortest: f64, longest: f64) {
        self.delays = (shortest, longest);
    }

    fn simulator(&self, z: &[f64]) -> Result<Simulator<'a>, ModelError> {
        let simulator = Simulator::new(self.model, &self.map.theta(z))?;
        Ok(if self.max_step.is_finite() { simulator.with_max_step(self.max_step) } else { simulator })
    }

    /// Fixes the step for the parameters of a point, so that runs near it differ smoothly.
    pub(crate) fn fix_step(&mut self, z: &[f64]) -> Result<(), ModelError> {
        self.max_step = f64::INFINITY;
        let mut simulator = self.simulator(z)?;
        let mut step = f64::INFINITY;
        for stretch in &self.data.stretches {
            step = step.min(simulator.chosen_step(stretch)?);
        }
        self.max_step = step;
        Ok(())
    }

    /// A point with the measured starts.
    pub(crate) fn point(&self, z: Vec<f64>, delays: Vec<f64>) -> Point {
        let start = |s: &Stretch| -> Vec<f64> { s.outputs.iter().map(|c| c[0]).collect() };
        // Outputs that are not measured, behind the others, start at zero.
        let padded = |mut start: Vec<f64>| {
            start.resize(self.model.outputs().len(), 0.0);
            start
        };
        let starts = self.data.stretches.iter().map(|s| padded(start(s))).collect();
        Point { z, delays, starts }
    }

    /// Simulated outputs of every stretch.
    pub(crate) fn simulate(&self, point: &Point) -> Result<Vec<Vec<Vec<f64>>>, ModelError> {
        let mut simulator = self.simulator(&point.z)?;
        let run = |(stretch, start): (&Stretch, &Vec<f64>)| self.run(&mut simulator, stretch, start, &point.delays);
        self.data.stretches.iter().zip(&point.starts).map(run).collect()
    }

    fn run(&self, simulator: &mut Simulator<'_>, stretch: &Stretch, start: &[f64], delays: &[f64]) -> Result<Vec<Vec<f64>>, ModelError> {
        let (driven, rows) = delayed(stretch, &self.axes, delays);
        let mut simulated = vec![Vec::new(); start.len()];
        simulator.run(&driven, start, &mut simulated)?;
        Ok(simulated.into_iter().map(|column| pick(column, rows.as_deref())).collect())
    }

    /// Root mean square error of each output at a point.
    pub(crate) fn noise(&self, point: &Point) -> Result<Vec<f64>, ModelError> {
        let simulated = self.simulate(point)?;
        let samples = self.data.samples() as f64;
        let of = |i: usize| {
            let pairs = self.data.stretches.iter().zip(&simulated).flat_map(|(s, run)| s.outputs[i].iter().zip(&run[i]));
            let (error, size) = pairs.fold((0.0, 0.0), |(e, s), (y, x)| (e + (y - x).powi(2), s + y * y));
            // Data without noise: rounding stands for it. An output that is zero throughout has no scale of its own.
            let floor = 1e-9 * (size / samples).sqrt();
            let sigma = (error / samples).sqrt().max(floor);
            if sigma > 0.0 { sigma } else { 1.0 }
        };
        Ok((0..self.data.outputs.len()).map(of).collect())
    }

    /// Sum of squared errors in units of `sigma`; infinite where it cannot be simulated.
    pub(crate) fn cost(&self, point: &Point, sigma: &[f64]) -> f64 {
        let Ok(simulated) = self.simulate(point) else { return f64::INFINITY };
        let mut sum = 0.0;
        for (stretch, run) in self.data.stretches.iter().zip(&simulated) {
            for ((y, x), s) in stretch.outputs.iter().zip(run).zip(sigma) {
                sum += y.iter().zip(x).map(|(y, x)| ((y - x) / s).powi(2)).sum::<f64>();
            }
        }
        if sum.is_finite() { sum } else { f64::INFINITY }
    }

    /// Errors and their derivatives about a point.
    pub(crate) fn linearise(&self, point: &Point, sigma: &[f64]) -> Result<Local, ModelError> {
        self.differentiate(point, sigma, Sides::Both)
    }

    fn differentiate(&self, point: &Point, sigma: &[f64], sides: Sides) -> Result<Local, ModelError> {
        let theta = self.map.theta(&point.z);
        let free = point.z.len();
        let sizes = plausible(self.model, self.data, &theta);
        let directions: Vec<Direction> = (0..free).map(|j| direction(self.map, j, &sizes)).collect();
        let shift = DIFFERENCE.sqrt() * self.data.period();
        let mut simulator = self.simulator(&point.z)?;
        let mut blocks = Vec::with_capacity(self.data.stretches.len());
        for (stretch, start) in self.data.stretches.iter().zip(&point.starts) {
            let (driven, rows) = delayed(stretch, &self.axes, &point.delays);
            let mut run = vec![Vec::new(); start.len()];
            simulator.run(&driven, start, &mut run)?;
            let found = match sides {
                Sides::Both => simulator.sensitivities(&driven, start, &directions)?,
                Sides::One => simulator.slopes(&driven, start, &directions, &run)?,
            };
            let simulated: Vec<Vec<f64>> = run.into_iter().map(|column| pick(column, rows.as_deref())).collect();
            let mut columns: Vec<Vec<Vec<f64>>> =
                found.parameters.into_iter().map(|by_output| by_output.into_iter().map(|c| pick(c, rows.as_deref())).collect()).collect();
            for axis in 0..point.delays.len() {
                let mut side = |sign: f64| {
                    let mut delays = point.delays.clone();
                    delays[axis] += sign * shift;
                    self.run(&mut simulator, stretch, start, &delays)
                };
                let up = side(1.0)?;
                let (down, apart) = match sides {
                    Sides::Both => (Cow::Owned(side(-1.0)?), 2.0 * shift),
                    Sides::One => (Cow::Borrowed(&simulated), shift),
                };
                let slope = |(u, d): (&Vec<f64>, &Vec<f64>)| u.iter().zip(d).map(|(u, d)| (u - d) / apart).collect();
                columns.push(up.iter().zip(down.iter()).map(slope).collect());
            }
            let starts: Vec<Vec<Vec<f64>>> =
                found.initial.into_iter().map(|by_output| by_output.into_iter().map(|c| pick(c, rows.as_deref())).collect()).collect();
            let error: Vec<Vec<f64>> =
                stretch.outputs.iter().zip(&simulated).map(|(y, x)| y.iter().zip(x).map(|(y, x)| y - x).collect()).collect();
            let stacked = |columns: &[Vec<Vec<f64>>]| {
                let values = columns.iter().flat_map(|c| c.iter().zip(sigma).flat_map(|(c, s)| c.iter().map(move |x| x / s)));
                DMatrix::from_iterator(stretch.len() * sigma.len(), columns.len(), values)
            };
            let error = DVector::from_column_slice(stacked(std::slice::from_ref(&error)).as_slice());
            blocks.push(Block { error, columns: stacked(&columns), starts: stacked(&starts) });
        }
        Ok(Local::new(blocks, free + point.delays.len()))
    }

    /// One damped Gauss-Newton step; the new point with its cost, or `None` where no step lowers it.
    fn step(&self, point: &Point, local: &Local, sigma: &[f64], cost: f64) -> Option<(Point, f64)> {
        let (dp, dstarts) = local.newton();
        let mut share = 1.0;
        for _ in 0..HALVINGS {
            let mut trial = point.clone();
            for (x, d) in trial.z.iter_mut().chain(&mut trial.delays).zip(dp.iter()) {
                *x += share * d;
            }
            trial.delays.iter_mut().for_each(|d| *d = d.max(self.delays.0).min(self.delays.1));
            for (start, d) in trial.starts.iter_mut().zip(&dstarts) {
                start.iter_mut().zip(d.iter()).for_each(|(x, d)| *x += share * d);
            }
            let reached = self.cost(&trial, sigma);
            if reached < cost {
                return Some((trial, reached));
            }
            share *= 0.5;
        }
        None
    }

    /// Least squares on the free-run error from a point, outputs weighted by their own error: the point and its noise.
    pub(crate) fn fit(&mut self, mut point: Point) -> Result<(Point, Vec<f64>), ModelError> {
        self.fix_step(&point.z)?;
        let mut sigma = self.noise(&point)?;
        for _ in 0..ITERATIONS {
            let cost = self.cost(&point, &sigma);
            let local = self.differentiate(&point, &sigma, Sides::One)?;
            let Some((next, reached)) = self.step(&point, &local, &sigma, cost) else { break };
            point = next;
            sigma = self.noise(&point)?;
            if cost - reached < 1e-6 * cost {
                break;
            }
        }
        Ok((point, sigma))
    }
}

impl Local {
    fn new(blocks: Vec<Block>, unknowns: usize) -> Self {
        let mut triangle = DMatrix::zeros(0, unknowns + 1);
        for block in &blocks {
            let (columns, error) = block.projected();
            let mut stacked = triangle.clone().resize_vertically(triangle.nrows() + columns.nrows(), 0.0);
            stacked.view_mut((triangle.nrows(), 0), columns.shape()).copy_from(&columns);
            stacked.view_mut((triangle.nrows(), unknowns), (error.len(), 1)).copy_from(&error);
            triangle = stacked.qr().r();
        }
        Self { blocks, triangle }
    }

    /// Number of unknowns besides the starts.
    pub(crate) fn unknowns(&self) -> usize {
        self.triangle.ncols() - 1
    }

    /// Step to the least squares solution of the linearised problem, and that of each stretch's start.
    fn newton(&self) -> (DVector<f64>, Vec<DVector<f64>>) {
        let p = self.unknowns();
        let rows = self.triangle.nrows().min(p);
        let (r, e) = (self.triangle.view((0, 0), (rows, p)), self.triangle.view((0, p), (rows, 1)));
        let step = scaled_solve(&r.into_owned(), &e.column(0).into_owned());
        let starts = self.blocks.iter().map(|b| scaled_solve(&b.starts, &(&b.error - &b.columns * &step))).collect();
        (step, starts)
    }

    /// Covariance of the unknowns when the error of each output is the noise `ar` (in units of its standard deviation), by the
    /// sandwich (JᵀJ)⁻¹ Jᵀ R J (JᵀJ)⁻¹; directions that the data do not show are left out.
    pub(crate) fn covariance(&self, ar: &[Autoregression]) -> DMatrix<f64> {
        let p = self.unknowns();
        let mut middle = DMatrix::zeros(p, p);
        for block in &self.blocks {
            let (columns, _) = block.projected();
            let rows = columns.nrows() / ar.len();
            for (i, ar) in ar.iter().enumerate() {
                let mut part = columns.rows(i * rows, rows).into_owned();
                ar.adjoint_all(&mut part);
                middle += ar.innovation * part.tr_mul(&part);
            }
        }
        let inverse = self.inverse();
        &inverse * middle * &inverse
    }

    /// (JᵀJ)⁻¹ without the directions that the data do not show.
    fn inverse(&self) -> DMatrix<f64> {
        let (scale, values, vectors) = self.directions();
        let p = self.unknowns();
        let mut inverse = DMatrix::zeros(p, p);
        for (s, v) in values.iter().zip(vectors.row_iter()).filter(|(s, _)| **s > RANK * values[0]) {
            let direction = DVector::from_fn(p, |j, _| if scale[j] > 0.0 { v[j] / (scale[j] * s) } else { 0.0 });
            inverse += &direction * direction.transpose();
        }
        inverse
    }

    /// Norm of each column, then singular values (descending) and right singular vectors (rows) of the columns scaled to norm one.
    pub(crate) fn directions(&self) -> (Vec<f64>, Vec<f64>, DMatrix<f64>) {
        let p = self.unknowns();
        let mut r = self.triangle.view((0, 0), (self.triangle.nrows().min(p), p)).into_owned();
        let scale: Vec<f64> = r.column_iter().map(|c| c.norm()).collect();
        for (mut column, s) in r.column_iter_mut().zip(&scale) {
            if *s > 0.0 {
                column /= *s;
            }
        }
        // Rows of zeros make the decomposition return all p directions.
        let r = r.resize_vertically(p, 0.0);
        let svd = r.svd(false, true);
        let vectors = svd.v_t.unwrap_or_else(|| DMatrix::identity(p, p));
        (scale, svd.singular_values.iter().copied().collect(), vectors)
    }

    /// Errors of one output by stretch, in units of its noise.
    pub(crate) fn errors(&self, output: usize, outputs: usize) -> Vec<&[f64]> {
        let of = |b: &'_ Block| -> std::ops::Range<usize> {
            let rows = b.error.len() / outputs;
            output * rows..(output + 1) * rows
        };
        self.blocks.iter().map(|b| &b.error.as_slice()[of(b)]).collect()
    }

    /// Noise of each output as the errors show it.
    pub(crate) fn autoregressions(&self, outputs: usize) -> Vec<Autoregression> {
        (0..outputs).map(|i| Autoregression::fit(&self.errors(i, outputs))).collect()
    }
}

impl Block {
    /// Columns and error without what a change of the start explains.
    fn projected(&self) -> (DMatrix<f64>, DVector<f64>) {
        self.projected_with(&self.error)
    }

    /// The same for another error than that at the point.
    pub(crate) fn projected_with(&self, error: &DVector<f64>) -> (DMatrix<f64>, DVector<f64>) {
        // A start that no row shows (a zero column) projects nothing out.
        let shown: Vec<_> = self.starts.column_iter().filter(|c| c.norm() > 0.0).map(|c| c.normalize()).collect();
        if shown.is_empty() {
            return (self.columns.clone(), error.clone());
        }
        let q = DMatrix::from_columns(&shown).qr().q();
        (&self.columns - &q * q.tr_mul(&self.columns), error - &q * q.tr_mul(error))
    }
}

/// Least squares with columns scaled to norm one and directions below rounding left out.
pub(crate) fn scaled_solve(matrix: &DMatrix<f64>, right: &DVector<f64>) -> DVector<f64> {
    let mut scaled = matrix.clone();
    let scale: Vec<f64> = scaled.column_iter().map(|c| c.norm()).collect();
    for (mut column, s) in scaled.column_iter_mut().zip(&scale) {
        if *s > 0.0 {
            column /= *s;
        }
    }
    let svd = scaled.svd(true, true);
    let tolerance = RANK * svd.singular_values.max();
    match svd.solve(right, tolerance) {
        Ok(x) => DVector::from_fn(x.len(), |j, _| if scale[j] > 0.0 { x[j] / scale[j] } else { 0.0 }),
        Err(_) => DVector::zeros(matrix.ncols()),
    }
}

/// The change of θ along a free parameter, and a step in it that is small against the plausible size of what it moves.
fn direction(map: &ParameterMap, j: usize, sizes: &[f64]) -> Direction {
    let free = map.free.len();
    let along: Vec<f64> = (0..sizes.len()).map(|i| map.matrix[i * free + j]).collect();
    let size = sizes.iter().zip(&along).filter(|(_, a)| **a != 0.0).map(|(s, a)| s / a.abs()).fold(f64::INFINITY, f64::min);
    Direction { along, step: DIFFERENCE * if size.is_finite() { size } else { 1.0 } }
}

/// Rows of the stretch that a sample typically lies in: a mean in which a few short stragglers count for little.
pub(crate) fn typical_rows(data: &Dataset) -> usize {
    let squares: usize = data.stretches.iter().map(|s| s.len() * s.len()).sum();
    squares / data.samples().max(1)
}
