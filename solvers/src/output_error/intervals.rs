//! Standard errors and confidence intervals from the whitened sensitivities, and what they say about identifiability.
//!
//! With white residuals of variance s², cov z = s² (RᵀR)⁻¹, taken through the singular values of R with its columns
//! scaled to unit length. Unknowns that sit at a bound are taken as known.

use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ContinuousCDF, StudentsT};
use wheelwright_core::solver::{Problem, SolveError};

use wheelwright_core::least_squares::{Limits, Outcome};

/// Condition of the scaled problem above which directions are lost in rounding and in the sensitivities' own error.
const WORST_CONDITION: f64 = 1e8;
/// A parameter is not seen if its term could be this many times as large as its whole equation, within one deviation.
const UNSEEN: f64 = 3.0;

pub(super) struct Intervals {
    /// Covariance of the free parameters.
    covariance: DMatrix<f64>,
    transform: DMatrix<f64>,
    /// Student's t for 95 %.
    quantile: f64,
    condition: f64,
    /// Share of each free parameter in the direction that the data see least.
    weakest: DVector<f64>,
}

impl Intervals {
    /// `scores` is the covariance of Σ (∂error/∂z) error where errors are not white; then cov z = (RᵀR)⁻¹ scores (RᵀR)⁻¹.
    pub(super) fn new(transform: &DMatrix<f64>, limits: &Limits, outcome: &Outcome, freedom: f64, scores: Option<&DMatrix<f64>>) -> Self {
        let variance = outcome.factor.cost() / freedom;
        let basis = unbounded_directions(limits, &outcome.active);
        let seen = &outcome.factor.r * &basis;
        let lengths: Vec<f64> = seen.column_iter().map(|c| c.norm()).collect();
        let scaled = DMatrix::from_fn(seen.nrows(), seen.ncols(), |i, j| if lengths[j] > 0.0 { seen[(i, j)] / lengths[j] } else { 0.0 });
        let svd = scaled.svd(false, true);
        let v = svd.v_t.unwrap_or_else(|| DMatrix::zeros(0, 0)).transpose();
        let values = svd.singular_values;
        let inverse = |k: usize, j: usize| v[(k, j)] / (values[j] * lengths[k]);
        let root = &basis * DMatrix::from_fn(lengths.len(), values.len(), inverse);
        let inverse = &root * root.transpose();
        let (largest, smallest) = (values.iter().copied().fold(0.0, f64::max), values.iter().copied().fold(f64::INFINITY, f64::min));
        let least = values.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(j, _)| j);
        Self {
            covariance: scores.map_or_else(|| variance * &inverse, |scores| &inverse * scores * &inverse),
            transform: transform.clone(),
            quantile: StudentsT::new(0.0, 1.0, freedom).map_or(1.96, |t| t.inverse_cdf(0.975)),
            condition: if values.is_empty() { 1.0 } else { largest / smallest },
            weakest: if values.is_empty() { DVector::zeros(basis.nrows()) } else { (&basis * v.column(least)).map(f64::abs) },
        }
    }

    /// Covariance of θ, row-major; zero for parameters that are fixed or at a bound.
    pub(super) fn covariance(&self) -> Vec<f64> {
        let covariance = &self.transform * &self.covariance * self.transform.transpose();
        // Symmetric, so the order of its entries is either.
        covariance.as_slice().to_vec()
    }

    /// Standard errors of θ; not a number for parameters that are fixed or at a bound.
    pub(super) fn std(&self) -> Vec<f64> {
        let of = |row: usize| {
            let t = self.transform.row(row);
            let variance = (t * &self.covariance * t.transpose())[0];
            if variance == 0.0 { f64::NAN } else { variance.sqrt() }
        };
        (0..self.transform.nrows()).map(of).collect()
    }

    /// 95 % intervals of θ.
    pub(super) fn ci95(&self, theta: &[f64]) -> Vec<(f64, f64)> {
        self.std().iter().zip(theta).map(|(s, t)| (t - self.quantile * s, t + self.quantile * s)).collect()
    }

    /// The condition number, if every parameter can be told from the data: no direction is lost in rounding, and none is
    /// so uncertain that its term could be larger than its whole equation.
    ///
    /// # Errors
    /// [`SolveError::NotIdentifiable`] naming the parameters and the motion that would show them.
    pub(super) fn identifiability(&self, problem: &Problem<'_>, scale: &[f64]) -> Result<f64, SolveError> {
        let hidden: Vec<usize> = if self.condition <= WORST_CONDITION {
            (0..scale.len()).filter(|&j| self.covariance[(j, j)].sqrt() > UNSEEN * scale[j]).collect()
        } else {
            let most = self.weakest.max();
            (0..scale.len()).filter(|&j| self.weakest[j] >= 0.3 * most || !self.covariance[(j, j)].is_finite()).collect()
        };
        not_identifiable(problem, &self.transform, &hidden).map_or(Ok(self.condition), Err)
    }
}

/// The error for free parameters that cannot be told from the data, with the motion that would show them.
pub(crate) fn not_identifiable(problem: &Problem<'_>, transform: &DMatrix<f64>, hidden: &[usize]) -> Option<SolveError> {
    let mut missing: Vec<&str> = Vec::new();
    for (i, parameter) in problem.model.parameters().iter().enumerate() {
        let touched = hidden.iter().any(|&j| transform[(i, j)] != 0.0);
        if touched && !missing.contains(&parameter.excitation.as_str()) {
            missing.push(&parameter.excitation);
        }
    }
    let parameters = hidden.iter().map(|&j| problem.map.free[j].clone()).collect();
    (!hidden.is_empty()).then(|| SolveError::NotIdentifiable { parameters, missing: missing.join("; ") })
}

/// A basis of the directions in which no active limit is left.
pub(super) fn unbounded_directions(limits: &Limits, active: &[usize]) -> DMatrix<f64> {
    let n = limits.g.ncols();
    if active.is_empty() {
        return DMatrix::identity(n, n);
    }
    let mut rows = limits.g.select_rows(active);
    rows.row_iter_mut().for_each(|mut r| {
        let norm = r.norm();
        r /= norm;
    });
    let eigen = (rows.transpose() * rows).symmetric_eigen();
    let kept: Vec<usize> = (0..n).filter(|&j| eigen.eigenvalues[j] < 1e-9).collect();
    // Directions along the axes stay exactly so, or a fixed unknown would get a rounding error for a variance.
    eigen.eigenvectors.select_columns(&kept).map(|x| if x.abs() < 1e-12 { 0.0 } else { x })
}
