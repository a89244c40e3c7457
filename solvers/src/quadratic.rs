//! Least squares within bounds on linear combinations, by clarabel and a polish on the active set.
//!
//! minimise ½ ‖A z − b‖² subject to lower ≤ C z ≤ upper.
//!
//! The interior-point method is given the residual as variables (½ ‖r‖², A z − r = b), so that AᵀA is never formed; its
//! answer names the active bounds, and the equality-constrained problem on those is then solved to rounding.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};
use nalgebra::{DMatrix, DVector};
use wheelwright_core::solver::SolveError;

/// Tolerance of the interior-point method, in column-scaled variables.
const TOLERANCE: f64 = 1e-12;
/// Distance to a bound, in column-scaled variables, from which it is tried as active.
const NEAR: f64 = 1e-6;
/// Changes of the active set while polishing.
const CHANGES: usize = 50;

/// A least-squares problem within bounds.
#[derive(Debug, Clone, PartialEq)]
pub struct Quadratic {
    /// A, at least as many rows as columns, of full column rank.
    pub a: DMatrix<f64>,
    /// b.
    pub b: DVector<f64>,
    /// C, one row a bounded combination, none zero and no two parallel.
    pub c: DMatrix<f64>,
    /// One (lower, upper) a row of C, lower ≤ upper, infinite where there is none.
    pub bounds: Vec<(f64, f64)>,
}

/// Which side of a bound is active.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Lower,
    Upper,
}

impl Quadratic {
    /// The minimiser.
    ///
    /// # Errors
    /// [`SolveError::Failed`] with clarabel's status.
    pub fn solve(&self) -> Result<Vec<f64>, SolveError> {
        let scales: Vec<f64> = self.a.column_iter().map(|c| c.norm()).collect();
        if scales.contains(&0.0) {
            return Err(SolveError::Failed { reason: "a column of the bounded regression is zero".to_owned() });
        }
        let scaled = self.scaled(&scales);
        let rough = scaled.interior_point()?;
        let polished = scaled.polish(&rough).unwrap_or(rough);
        Ok(polished.iter().zip(&scales).map(|(z, s)| z / s).collect())
    }

    /// The same problem in variables that give A columns of unit length, C rows of unit length, and A square.
    fn scaled(&self, scales: &[f64]) -> Self {
        let mut a = self.a.clone();
        a.column_iter_mut().zip(scales).for_each(|(mut column, s)| column /= *s);
        let mut c = self.c.clone();
        c.column_iter_mut().zip(scales).for_each(|(mut column, s)| column /= *s);
        let mut bounds = self.bounds.clone();
        for (mut row, bound) in c.row_iter_mut().zip(&mut bounds) {
            let norm = row.norm();
            row /= norm;
            *bound = (bound.0 / norm, bound.1 / norm);
        }
        let qr = a.qr();
        let mut b = self.b.clone();
        qr.q_tr_mul(&mut b);
        Self { b: b.rows(0, scales.len()).into_owned(), a: qr.r(), c, bounds }
    }

    fn interior_point(&self) -> Result<DVector<f64>, SolveError> {
        let n = self.a.ncols();
        // Rows: A z − r = b, then C z ≤ upper and −C z ≤ −lower where finite.
        let limits: Vec<(usize, f64, f64)> = (0..self.bounds.len())
            .flat_map(|i| [(i, 1.0, self.bounds[i].1), (i, -1.0, -self.bounds[i].0)])
            .filter(|(_, _, limit)| limit.is_finite())
            .collect();
        let mut rows = vec![vec![0.0; 2 * n]; n + limits.len()];
        let mut right: Vec<f64> = self.b.iter().copied().collect();
        for i in 0..n {
            (0..n).for_each(|j| rows[i][j] = self.a[(i, j)]);
            rows[i][n + i] = -1.0;
        }
        for (row, (i, sign, limit)) in rows[n..].iter_mut().zip(&limits) {
            (0..n).for_each(|j| row[j] = sign * self.c[(*i, j)]);
            right.push(*limit);
        }
        let mut hessian = vec![vec![0.0; 2 * n]; 2 * n];
        (n..2 * n).for_each(|i| hessian[i][i] = 1.0);
        let cones = [SupportedConeT::ZeroConeT(n), SupportedConeT::NonnegativeConeT(limits.len())];
        let failed = |reason: String| SolveError::Failed { reason };
        let settings = DefaultSettingsBuilder::default()
            .verbose(false)
            .tol_gap_abs(TOLERANCE)
            .tol_gap_rel(TOLERANCE)
            .tol_feas(TOLERANCE)
            .max_iter(200)
            .max_threads(1)
            .build()
            .map_err(|e| failed(e.to_string()))?;
        let linear = vec![0.0; 2 * n];
        let (p, a) = (CscMatrix::from(&hessian), CscMatrix::from(&rows));
        let mut solver = DefaultSolver::new(&p, &linear, &a, &right, &cones, settings).map_err(|e| failed(e.to_string()))?;
        solver.solve();
        // A tolerance near rounding is not always reached; the polish starts from what was, and checks itself.
        match solver.solution.status {
            SolverStatus::Solved | SolverStatus::AlmostSolved | SolverStatus::InsufficientProgress | SolverStatus::MaxIterations => {
                Ok(DVector::from_column_slice(&solver.solution.x[..n]))
            }
            status => Err(failed(format!("clarabel ended with {status}"))),
        }
    }

    /// From the bounds that are near, solves with them as equalities, releases what pulls inwards, adds what is violated,
    /// until neither is left: the exact optimum. `None` if that does not come to an end.
    fn polish(&self, rough: &DVector<f64>) -> Option<DVector<f64>> {
        let value = |z: &DVector<f64>, i: usize| (self.c.row(i) * z)[0];
        let size = 1.0 + rough.amax();
        let mut active: Vec<(usize, Side)> = Vec::new();
        for (i, (lower, upper)) in self.bounds.iter().enumerate() {
            let at = value(rough, i);
            if at - lower <= NEAR * size && at - lower <= upper - at {
                active.push((i, Side::Lower));
            } else if upper - at <= NEAR * size {
                active.push((i, Side::Upper));
            }
        }
        for _ in 0..CHANGES {
            let (z, pull) = self.equality(&active)?;
            let inward = active.iter().zip(pull.iter()).enumerate().filter(|(_, ((i, side), pull))| {
                let fixed = self.bounds[*i].0 == self.bounds[*i].1;
                !fixed && if *side == Side::Upper { **pull < 0.0 } else { **pull > 0.0 }
            });
            if let Some((worst, _)) = inward.max_by(|a, b| a.1.1.abs().total_cmp(&b.1.1.abs())) {
                active.remove(worst);
                continue;
            }
            let violated = (0..self.bounds.len()).filter(|i| active.iter().all(|(j, _)| j != i)).map(|i| {
                let (at, (lower, upper)) = (value(&z, i), self.bounds[i]);
                if lower - at > at - upper { (i, Side::Lower, lower - at) } else { (i, Side::Upper, at - upper) }
            });
            match violated.max_by(|a, b| a.2.total_cmp(&b.2)) {
                Some((i, side, by)) if by > 1e-14 * size => active.push((i, side)),
                _ => return Some(z),
            }
        }
        None
    }

    /// Minimiser with bounds held as equalities, and the multiplier of each: Aᵀ(A z − b) + Cᵀ pull = 0. Solved with the
    /// residual as unknowns, which keeps the digits that AᵀA would lose.
    fn equality(&self, active: &[(usize, Side)]) -> Option<(DVector<f64>, DVector<f64>)> {
        let (n, k) = (self.a.ncols(), active.len());
        let size = 2 * n + k;
        let (mut matrix, mut right) = (DMatrix::zeros(size, size), DVector::zeros(size));
        matrix.view_mut((0, 0), (n, n)).fill_with_identity();
        matrix.view_mut((0, n), (n, n)).copy_from(&self.a);
        matrix.view_mut((n, 0), (n, n)).copy_from(&self.a.transpose());
        right.rows_mut(0, n).copy_from(&self.b);
        for (row, (i, side)) in active.iter().enumerate() {
            let c = self.c.row(*i);
            matrix.view_mut((2 * n + row, n), (1, n)).copy_from(&c);
            matrix.view_mut((n, 2 * n + row), (n, 1)).copy_from(&(-c.transpose()));
            right[2 * n + row] = if *side == Side::Lower { self.bounds[*i].0 } else { self.bounds[*i].1 };
        }
        let solved = matrix.lu().solve(&right).filter(|s| s.iter().all(|x| x.is_finite()))?;
        Some((solved.rows(n, n).into_owned(), solved.rows(2 * n, k).into_owned()))
    }
}
