//! The regression that `thesis`, `ols`, `box` and `steady-state` share.
//!
//! minimise Σ_e w_e² ‖Φ_e (T z + c) − y_e‖² over z, the sum being over equations.

use nalgebra::{DMatrix, DVector, SVD};
use wheelwright_core::model::{ParameterMap, RegressorModel};
use wheelwright_core::regression::{Form, Preparation, Settings, StretchRows, visit};
use wheelwright_core::solver::{Problem, RegressionRows, Solution, SolveError, Status};

use crate::triangle::Triangle;

/// Ratio of singular values of the column-scaled regression below which a direction counts as not seen at all: filters
/// keep ten digits or so, and what lies below them is rounding.
const RANK: f64 = 1e-8;
/// Share of the largest entry from which a parameter takes part in an undetermined direction.
const PART: f64 = 0.1;
/// An equation is never trusted more than if it held to this share of its response.
const FLOOR: f64 = 1e-6;
/// Rows kept for plots.
const PLOTTED: usize = 20_000;

/// A data set folded into one triangle an equation.
#[derive(Debug, Clone)]
pub struct SolverRegression {
    triangles: Vec<Triangle>,
    parameters: usize,
    /// What was done to the data.
    pub preparation: Preparation,
    /// Rows for plots, thinned evenly to 20 000 at most.
    pub rows: RegressionRows,
}

/// An overdetermined system A z ≈ b in the free parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct System {
    /// A.
    pub a: DMatrix<f64>,
    /// b.
    pub b: DVector<f64>,
}

/// A least-squares solution in the free parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct LeastSquares {
    /// z.
    pub free: Vec<f64>,
    /// Ratio of the largest to the smallest singular value of A with columns scaled to unit length.
    pub condition: f64,
    /// Weight of each equation.
    pub weights: Vec<f64>,
}

impl SolverRegression {
    /// Conditions the data of a problem and folds it.
    ///
    /// # Errors
    /// As [`visit`].
    pub fn new(problem: &Problem<'_>, settings: &Settings) -> Result<Self, SolveError> {
        let mut folded = Self::empty(problem.model);
        folded.rows.integrated = settings.form == Form::Integral;
        let stride = problem.data.samples().div_ceil(PLOTTED).max(1);
        folded.preparation = visit(problem.model, problem.data, settings, &mut |rows| folded.append(&rows, stride))?;
        Ok(folded)
    }

    /// A regression without rows.
    pub(crate) fn empty(model: &dyn RegressorModel) -> Self {
        let (equations, parameters) = (model.equations(), model.parameters().len());
        Self {
            triangles: vec![Triangle::new(parameters + 1); equations],
            parameters,
            preparation: Preparation::default(),
            rows: RegressionRows { phi: vec![Vec::new(); equations], y: vec![Vec::new(); equations], integrated: false },
        }
    }

    /// Folds rows in, keeping every `stride`th for plots.
    pub(crate) fn append(&mut self, rows: &StretchRows, stride: usize) {
        for (e, equation) in rows.equations.iter().enumerate() {
            let columns: Vec<&[f64]> = equation.columns.iter().chain([&equation.response]).map(Vec::as_slice).collect();
            self.triangles[e].append(&columns, equation.response.len());
            for row in (0..equation.response.len()).step_by(stride) {
                self.rows.phi[e].extend(equation.columns.iter().map(|c| c.get(row).copied().unwrap_or(0.0)));
                self.rows.y[e].push(equation.response[row]);
            }
        }
    }

    /// The system in the free parameters of a map, each equation weighted.
    pub fn system(&self, map: &ParameterMap, weights: &[f64]) -> System {
        let (p, z) = (self.parameters, map.free.len());
        let transform = DMatrix::from_row_slice(p, z, &map.matrix);
        let offset = DVector::from_column_slice(&map.offset);
        let height = (p + 1) * self.triangles.len();
        let (mut a, mut b) = (DMatrix::zeros(height, z), DVector::zeros(height));
        for (e, (triangle, weight)) in self.triangles.iter().zip(weights).enumerate() {
            let r = triangle.matrix();
            let phi = r.columns(0, p);
            a.rows_mut(e * (p + 1), p + 1).copy_from(&(phi * &transform * *weight));
            b.rows_mut(e * (p + 1), p + 1).copy_from(&((r.column(p) - phi * &offset) * *weight));
        }
        System { a, b }
    }

    /// Solves by least squares. Equations that share a free parameter are weighted by the inverse of their residuals,
    /// which a first solution supplies; where none is shared, weights change nothing.
    ///
    /// # Errors
    /// [`SolveError::NotIdentifiable`], [`SolveError::TooFewSamples`].
    pub fn solve(&self, model: &dyn RegressorModel, map: &ParameterMap) -> Result<LeastSquares, SolveError> {
        let samples = self.preparation.rows;
        if samples * self.triangles.len() < map.free.len() {
            let (parameters, what) = (map.free.len(), "conditioning".to_owned());
            return Err(SolveError::TooFewSamples { samples, parameters, what, needed_s: 10.0 });
        }
        let scales = self.scales();
        let mut weights = self.unit_weights();
        let (mut free, mut condition) = determinate(&self.system(map, &weights), model, map)?;
        for _ in 0..if self.shared(map) { 3 } else { 0 } {
            let residuals = self.residuals(map, &free);
            for ((weight, residual), scale) in weights.iter_mut().zip(&residuals).zip(&scales) {
                let spread = residual.max(FLOOR * scale);
                *weight = if spread > 0.0 { 1.0 / spread } else { 1.0 };
            }
            (free, condition) = determinate(&self.system(map, &weights), model, map)?;
        }
        Ok(LeastSquares { free, condition, weights })
    }

    /// Solves with weights as they are, for a system known to be determined.
    ///
    /// # Errors
    /// [`SolveError::Failed`] if it is not.
    pub(crate) fn least_squares(&self, map: &ParameterMap, weights: &[f64]) -> Result<Vec<f64>, SolveError> {
        let (triangle, right, norms) = self.system(map, weights).triangle();
        back_substitute(&triangle, &right, &norms)
    }

    /// Weights that bring every equation's response to unit size.
    pub(crate) fn unit_weights(&self) -> Vec<f64> {
        self.scales().iter().map(|s| if *s > 0.0 { 1.0 / s } else { 1.0 }).collect()
    }

    /// Root mean square response of each equation.
    fn scales(&self) -> Vec<f64> {
        self.triangles.iter().map(|t| rms(t.matrix().column(self.parameters).norm(), t.rows())).collect()
    }

    /// Root mean square residual of each equation.
    pub fn residuals(&self, map: &ParameterMap, free: &[f64]) -> Vec<f64> {
        let theta = DVector::from_vec(map.theta(free));
        let each = self.triangles.iter().map(|t| {
            let r = t.matrix();
            rms((r.columns(0, self.parameters) * &theta - r.column(self.parameters)).norm(), t.rows())
        });
        each.collect()
    }

    /// True if a free parameter appears in more than one equation.
    fn shared(&self, map: &ParameterMap) -> bool {
        let height = self.parameters + 1;
        let a = self.system(map, &vec![1.0; self.triangles.len()]).a;
        let appears = |e: usize, j: usize| a.column(j).rows(e * height, height).iter().any(|x| *x != 0.0);
        (0..map.free.len()).any(|j| (0..self.triangles.len()).filter(|&e| appears(e, j)).count() > 1)
    }

    /// A solution with what is known so far; the regression's rows, steps and warnings move into it.
    pub fn into_solution(self, theta: Vec<f64>, condition: f64) -> Solution {
        let Preparation { steps, warnings, .. } = self.preparation;
        let regression = Some(self.rows);
        Solution {
            theta,
            std: None,
            ci95: None,
            covariance: None,
            status: Status::Solved,
            condition,
            at_bound: Vec::new(),
            steps,
            warnings,
            regression,
        }
    }
}

fn rms(norm: f64, rows: usize) -> f64 {
    norm / (rows.max(1) as f64).sqrt()
}

/// Solves A z ≈ b by QR with columns scaled to unit length and tells the condition number; the singular values only say
/// how well that went.
fn determinate(system: &System, model: &dyn RegressorModel, map: &ParameterMap) -> Result<(Vec<f64>, f64), SolveError> {
    let (triangle, right, norms) = system.triangle();
    match determined(&triangle, &norms, RANK)? {
        Ok(condition) => Ok((back_substitute(&triangle, &right, &norms)?, condition)),
        Err(undetermined) => Err(not_identifiable(model, map, &undetermined)),
    }
}

/// Unknowns of a triangle with scaled columns.
fn back_substitute(triangle: &DMatrix<f64>, right: &DVector<f64>, norms: &[f64]) -> Result<Vec<f64>, SolveError> {
    if norms.is_empty() {
        return Ok(Vec::new());
    }
    let singular = || SolveError::Failed { reason: "the regression is singular".to_owned() };
    let solved = triangle.solve_upper_triangular(right).ok_or_else(singular)?;
    Ok(solved.iter().zip(norms).map(|(z, norm)| z / norm).collect())
}

impl System {
    /// R of A with columns scaled to unit length, Qᵀ b, and the lengths.
    fn triangle(&self) -> (DMatrix<f64>, DVector<f64>, Vec<f64>) {
        if self.a.ncols() == 0 {
            return (DMatrix::zeros(0, 0), DVector::zeros(0), Vec::new());
        }
        let norms: Vec<f64> = self.a.column_iter().map(|c| c.norm()).collect();
        let mut scaled = self.a.clone();
        scaled.column_iter_mut().zip(&norms).filter(|(_, norm)| **norm > 0.0).for_each(|(mut c, norm)| c /= *norm);
        let (qr, mut right) = (scaled.qr(), self.b.clone());
        qr.q_tr_mul(&mut right);
        (qr.r(), right.rows(0, norms.len()).into_owned(), norms)
    }

    /// The free parameters that this system leaves open, as seen with a tolerance: `Ok` with the condition number if
    /// there are none.
    pub(crate) fn undetermined(&self, rank: f64) -> Result<Result<f64, Vec<usize>>, SolveError> {
        let (triangle, _, norms) = self.triangle();
        determined(&triangle, &norms, rank)
    }
}

/// The condition number, or the unknowns that take part in a direction below `rank` of the largest singular value, the
/// most involved first.
fn determined(triangle: &DMatrix<f64>, norms: &[f64], rank: f64) -> Result<Result<f64, Vec<usize>>, SolveError> {
    let n = norms.len();
    if n == 0 {
        return Ok(Ok(1.0));
    }
    let silent: Vec<usize> = (0..n).filter(|&j| norms[j] == 0.0).collect();
    if !silent.is_empty() {
        return Ok(Err(silent));
    }
    let svd = SVD::new(triangle.clone(), false, true);
    let none = || SolveError::Failed { reason: "the regression has no singular value decomposition".to_owned() };
    let vt = svd.v_t.as_ref().ok_or_else(none)?;
    let (low, high) = (svd.singular_values.imin(), svd.singular_values.max());
    let least = svd.singular_values[low];
    if least > rank * high {
        return Ok(Ok(high / least));
    }
    let direction: Vec<f64> = vt.row(low).iter().map(|x| x.abs()).collect();
    let largest = direction.iter().copied().fold(0.0, f64::max);
    let mut part: Vec<usize> = (0..n).filter(|&j| direction[j] >= PART * largest).collect();
    part.sort_by(|&i, &j| direction[j].total_cmp(&direction[i]));
    Ok(Err(part))
}

/// The error that names free parameters and the motion each of them needs.
pub(crate) fn not_identifiable(model: &dyn RegressorModel, map: &ParameterMap, free: &[usize]) -> SolveError {
    let mut named = free.to_vec();
    named.sort_unstable();
    let parameters = named.iter().map(|&j| map.free[j].clone()).collect();
    let mut missing: Vec<&str> = Vec::new();
    for (i, parameter) in model.parameters().iter().enumerate() {
        let moves = free.iter().any(|&j| map.matrix[i * map.free.len() + j] != 0.0);
        if moves && !parameter.excitation.is_empty() && !missing.contains(&parameter.excitation.as_str()) {
            missing.push(&parameter.excitation);
        }
    }
    SolveError::NotIdentifiable { parameters, missing: missing.join("; ") }
}
