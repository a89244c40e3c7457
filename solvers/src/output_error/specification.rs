//! Is what a fit leaves noise, or a fault of the model?
//!
//! If the model is right, the fit in which every sample counts alike and the one weighted by the noise model estimate the
//! same parameters, and the latter is efficient; so their difference has the covariance V = cov plain − cov efficient
//! (Hausman, Econometrica 46, 1978), and d'V⁻¹d is a chi-square. If the model is wrong the two come out differently,
//! because whitening looks at other frequencies than the free run does. The efficient fit enters by its first step from the
//! plain one, which is equivalent for many samples and cannot run away.
//!
//! With errors e, their noise model W (W e white) and the weighted sensitivities S of the plain fit, cov(Sᵀ e) =
//! Sᵀ (WᵀW)⁻¹ S, in which both covariances share S and W: V is then positive semidefinite exactly.

use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ChiSquared, ContinuousCDF};
use wheelwright_core::solver::SolveError;

use super::free_run::FreeRun;
use super::intervals::unbounded_directions;
use super::noise::{Channels, Noise};
use wheelwright_core::least_squares::{Factor, Limits, Outcome};

/// Error is taken for a fault of the model if noise would give a statistic as large this seldom.
const LEVEL: f64 = 1e-3;
/// Differences below this share of the efficient standard error are immaterial.
const IMMATERIAL: f64 = 0.25;

/// Covariance of the sum of the scores, sensitivity × error, at the plain fit.
pub(super) struct Scores {
    /// For errors that are noise with an autoregression.
    pub(super) autoregressive: DMatrix<f64>,
    /// For errors of any origin.
    pub(super) robust: DMatrix<f64>,
}

impl Scores {
    /// `run` stands at the plain fit with its diagonal weights; `noise` describes the errors there.
    pub(super) fn new(run: &mut FreeRun<'_>, noise: &Noise) -> Result<Self, SolveError> {
        let plain = run.noise.clone();
        let free = run.z().len();
        let mut autoregressive = DMatrix::zeros(free, free);
        let mut series: Vec<DMatrix<f64>> = Vec::new();
        run.cleared(|stretch, columns, error| {
            let rows = stretch.len();
            let mut coloured = DMatrix::zeros(columns.nrows(), free);
            for (from, mut to) in columns.column_iter().zip(coloured.column_iter_mut()) {
                let mut column: Channels = from.as_slice().chunks(rows).map(<[f64]>::to_vec).collect();
                // The weights of the plain fit are diagonal, so they are their own transposed.
                plain.whiten(&mut column);
                noise.unwhiten_transposed(&mut column);
                to.iter_mut().zip(column.iter().flatten()).for_each(|(t, x)| *t = *x);
            }
            autoregressive += coloured.tr_mul(&coloured);
            let outputs = columns.nrows() / rows;
            let score = |k: usize, j: usize| (0..outputs).map(|c| columns[(c * rows + k, j)] * error[c * rows + k]).sum();
            series.push(DMatrix::from_fn(rows, free, score));
        })?;
        Ok(Self { autoregressive, robust: long_run(&series) })
    }
}

/// Covariance of the sum of correlated rows: Bartlett's kernel (Newey and West, Econometrica 55, 1987) as the mean over
/// overlapping blocks, which do not span stretches; their length after Andrews (Econometrica 59, 1991).
fn long_run(series: &[DMatrix<f64>]) -> DMatrix<f64> {
    let free = series.first().map_or(0, DMatrix::ncols);
    let rows: usize = series.iter().map(DMatrix::nrows).sum();
    let (mut above, mut below) = (0.0, 0.0);
    for j in 0..free {
        let sum = |lag: usize| series.iter().map(|s| (lag..s.nrows()).map(|k| s[(k, j)] * s[(k - lag, j)]).sum::<f64>()).sum::<f64>();
        let variance = sum(0);
        if variance > 0.0 {
            let rho = (sum(1) / variance).clamp(-0.99, 0.99);
            above += 4.0 * rho * rho / ((1.0 - rho).powi(6) * (1.0 + rho).powi(2));
            below += 1.0 / (1.0 - rho).powi(4);
        }
    }
    let length = if below > 0.0 { (1.1447 * (above / below * rows as f64).cbrt()).ceil().max(1.0) as usize } else { 1 };
    let mut covariance = DMatrix::zeros(free, free);
    for s in series {
        let mut block = DVector::zeros(free);
        for k in 0..s.nrows() + length - 1 {
            if k < s.nrows() {
                block += s.row(k).transpose();
            }
            if k >= length {
                block -= s.row(k - length).transpose();
            }
            covariance.ger(1.0 / length as f64, &block, &block, 1.0);
        }
    }
    covariance
}

/// The outcome of the test.
#[derive(Debug, Clone, Copy)]
pub(super) struct Specification {
    statistic: f64,
    p: f64,
}

impl Specification {
    /// `efficient` is the problem weighted by the noise model, linearised at the plain fit.
    pub(super) fn new(limits: &Limits, plain: &Outcome, efficient: &Factor, scores: &DMatrix<f64>) -> Self {
        let none = Self { statistic: 0.0, p: 1.0 };
        let basis = unbounded_directions(limits, &plain.active);
        let k = basis.ncols();
        if k == 0 {
            return none;
        }
        // In units of the efficient fit: its covariance is the identity, the difference is −q.
        let stacked = |factor: &Factor| {
            let mut matrix = DMatrix::zeros(factor.r.nrows(), k + 1);
            matrix.view_mut((0, 0), (factor.r.nrows(), k)).copy_from(&(&factor.r * &basis));
            matrix.view_mut((0, k), (factor.r.nrows(), 1)).copy_from(&factor.q);
            Factor::of(matrix)
        };
        let (own, other) = (stacked(&plain.factor), stacked(efficient));
        let Some(ratio) = own.r.tr_solve_upper_triangular(&other.r.transpose()) else { return none };
        let Some(half) = own.r.tr_solve_upper_triangular(&basis.transpose()) else { return none };
        let covariance = ratio.transpose() * &half * scores * half.transpose() * &ratio - DMatrix::identity(k, k);
        if covariance.iter().any(|x| !x.is_finite()) {
            return none;
        }
        // A plain fit that ended at a kink has a step of its own left, which is no difference.
        let Some(left) = own.r.solve_upper_triangular(&own.q) else { return none };
        let eigen = covariance.symmetric_eigen();
        let along = eigen.eigenvectors.tr_mul(&(&other.q - &other.r * left));
        let terms = along.iter().zip(eigen.eigenvalues.iter()).map(|(d, v)| d * d / (v.max(0.0) + IMMATERIAL * IMMATERIAL));
        let statistic = terms.sum();
        Self { statistic, p: ChiSquared::new(k as f64).map_or(1.0, |d| d.sf(statistic)) }
    }

    /// True if noise can explain the difference.
    pub(super) fn is_noise(&self) -> bool {
        self.p >= LEVEL
    }

    pub(super) fn warning(&self) -> String {
        format!(
            "the model leaves structured error that is no noise (specification test: {:.0}, p = {:.0e}): parameters are those whose free \
             run comes nearest, and would be others with other motion; `noise = \"autoregressive\"` takes the error for noise all the same",
            self.statistic, self.p
        )
    }
}
