//! Nonlinear least squares under linear inequalities: Levenberg-Marquardt on triangular factors.
//!
//! At each point a problem compresses its Jacobian J and residual r to a factor, ‖J s + r‖² = ‖R s + q‖² + rest², so no
//! normal equations are formed and a problem may eliminate nuisance parameters of its own first. The step minimises
//! ‖R s + q‖² + λ‖D s‖² with Moré's scaling D, subject to G (z + s) ≥ h, solved exactly as a least-distance problem
//! (Lawson and Hanson, Solving Least Squares Problems, 1974, chapter 23). λ falls fast after a good step and rises slowly
//! after a bad one, which keeps to curved valleys (Transtrum and Sethna, arXiv:1201.5885, "delayed gratification").

use crate::solver::SolveError;
use nalgebra::{DMatrix, DVector};

/// A sum of squares to be minimised. It keeps the current point; `minimise` only tells it where to go.
pub trait Residuals {
    /// Jacobian and residual at the current point. After an error the last linearisation still serves attempts.
    ///
    /// # Errors
    /// [`SolveError`] if the model cannot be evaluated about this point.
    fn linearise(&mut self) -> Result<Factor, SolveError>;
    /// Sum of squares at current point + step; infinite where the model cannot be evaluated.
    fn attempt(&mut self, step: &DVector<f64>) -> f64;
    /// Exchanges the current point with the last attempt; a second call takes the first back.
    fn accept(&mut self);
}

/// ‖J s + r‖² = ‖R s + q‖² + rest².
#[derive(Debug, Clone)]
pub struct Factor {
    /// Upper triangular R, one row and column an unknown.
    pub r: DMatrix<f64>,
    /// q, what the unknowns can still change of the residual.
    pub q: DVector<f64>,
    /// Length of the part of the residual that they cannot change.
    pub rest: f64,
}

impl Factor {
    /// From a matrix whose last column is the residual. Fewer rows than columns are filled up with zeros.
    pub fn of(augmented: DMatrix<f64>) -> Self {
        let n = augmented.ncols() - 1;
        let upper = augmented.qr().r();
        let mut square = DMatrix::zeros(n + 1, n + 1);
        square.view_mut((0, 0), upper.shape()).copy_from(&upper);
        Self { r: square.view((0, 0), (n, n)).into_owned(), q: square.view((0, n), (n, 1)).column(0).into_owned(), rest: square[(n, n)] }
    }

    /// Sum of squares at the point it belongs to.
    pub fn cost(&self) -> f64 {
        self.q.norm_squared() + self.rest * self.rest
    }

    /// Standard deviation of each unknown for residuals of unit variance; infinite where the factor is singular.
    pub fn deviations(&self) -> DVector<f64> {
        let n = self.r.ncols();
        let inverse = self.r.solve_upper_triangular(&DMatrix::identity(n, n));
        DVector::from_fn(n, |i, _| inverse.as_ref().map_or(f64::INFINITY, |m| m.row(i).norm()))
    }

    /// Length of each column.
    pub fn norms(&self) -> DVector<f64> {
        DVector::from_iterator(self.r.ncols(), self.r.column_iter().map(|c| c.norm()))
    }
}

/// G z ≥ h.
#[derive(Debug, Clone)]
pub struct Limits {
    /// G, one row an inequality.
    pub g: DMatrix<f64>,
    /// h.
    pub h: DVector<f64>,
}

impl Limits {
    /// Inequalities that hold with equality.
    pub fn active(&self, z: &DVector<f64>) -> Vec<usize> {
        (0..self.h.len()).filter(|&i| at_limit(self, i, z)).collect()
    }
}

/// How far to go.
#[derive(Debug, Clone, Copy)]
pub struct Options {
    /// Most steps.
    pub iterations: usize,
    /// Stop when the linear model promises to lower the cost by less than this share of it.
    pub promise: f64,
    /// The same in absolute terms, for residuals in units of their standard deviation.
    pub absolute: f64,
    /// Stop at a kink, where no step gets far, if the linear model, which knows of one side only, promises less than this:
    /// the square of the share of a standard error that does not matter.
    pub immaterial: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { iterations: 100, promise: 1e-14, absolute: 1e-8, immaterial: 0.0625 }
    }
}

/// Where it ended.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The point.
    pub z: DVector<f64>,
    /// The problem at `z`.
    pub factor: Factor,
    /// False if the iterations ran out or no step got anywhere.
    pub converged: bool,
    /// True if every step did what the linear model promised: the cost was convex along the way.
    pub smooth: bool,
    /// Inequalities that hold with equality.
    pub active: Vec<usize>,
}

/// A step this much shorter than the point, both scaled, no longer moves it: the search has run aground.
const SHORT: f64 = 1e-15;
/// Share of the cost below which a decrease is lost in rounding.
const ROUNDING: f64 = 1e-12;
/// A step that gains no more than this share of its promise led across a valley or a kink.
const LITTLE: f64 = 0.25;
/// Where a step gains little that promises only this share of what does not matter, there is a kink.
const KINK: f64 = 1e-3;
/// λ of the first step.
const FIRST_DAMPING: f64 = 1e-2;
/// Least λ, so that it can grow again.
const LEAST_DAMPING: f64 = 1e-30;

/// Minimises from `z`, the current point of `problem`, which must satisfy the limits.
///
/// # Errors
/// [`SolveError`] if the problem cannot be linearised at the start, or the limits exclude each other.
pub fn minimise(problem: &mut dyn Residuals, mut z: DVector<f64>, limits: &Limits, options: Options) -> Result<Outcome, SolveError> {
    let mut factor = problem.linearise()?;
    let mut scale = DVector::zeros(z.len());
    let (first_cost, mut last_promise) = (factor.cost(), f64::INFINITY);
    let (mut damping, mut smooth, mut converged) = (FIRST_DAMPING, true, false);
    for _ in 0..options.iterations {
        let cost = factor.cost();
        scale.zip_apply(&factor.norms(), |s: &mut f64, c| *s = s.max(c));
        let undamped = constrained_step(&factor, None, &z, limits)?;
        let promised = promise(&factor, &undamped);
        if promised <= options.absolute {
            converged = true;
            break;
        }
        if promised <= ROUNDING * cost {
            // So near, costs differ by rounding only: the linear model alone leads on, as long as it gets anywhere.
            if promised <= options.promise * cost || promised > 0.5 * last_promise {
                converged = true;
                break;
            }
            last_promise = promised;
            problem.attempt(&undamped);
            problem.accept();
            factor = problem.linearise()?;
            z += undamped;
            continue;
        }
        let damped = scale.map(|s| damping.sqrt() * if s > 0.0 { s } else { 1.0 });
        let step = constrained_step(&factor, Some(&damped), &z, limits)?;
        let expected = promise(&factor, &step);
        let gain = (cost - problem.attempt(&step)) / expected;
        let short = step.component_mul(&scale).norm() <= SHORT * z.component_mul(&scale).norm();
        // A point about which the model cannot be linearised is as bad as one where it cannot be evaluated.
        let next = (gain > 0.0).then(|| {
            problem.accept();
            problem.linearise()
        });
        if let Some(Err(_)) = next {
            problem.accept();
        }
        if let Some(Ok(next)) = next {
            z += step;
            factor = next;
            damping = (damping * damping_factor(gain)).max(LEAST_DAMPING);
        } else {
            damping *= 2.0;
        }
        if gain <= LITTLE && promised <= options.immaterial && expected <= KINK * options.immaterial {
            (converged, smooth) = (true, false);
            break;
        }
        if short {
            converged = promised <= ROUNDING * first_cost;
            break;
        }
        smooth &= gain > 0.5;
    }
    Ok(Outcome { active: limits.active(&z), z, factor, converged, smooth })
}

/// What a step that gained this share of its promise does to the damping.
fn damping_factor(gain: f64) -> f64 {
    match gain {
        _ if gain > 0.9 => 0.03,
        _ if gain > LITTLE => 0.2,
        _ => 2.0,
    }
}

/// By how much a step lowers the cost of the linear model.
fn promise(factor: &Factor, step: &DVector<f64>) -> f64 {
    factor.q.norm_squared() - (&factor.r * step + &factor.q).norm_squared()
}

/// True if an inequality holds with equality, to rounding.
fn at_limit(limits: &Limits, i: usize, z: &DVector<f64>) -> bool {
    let row = limits.g.row(i);
    let size = limits.h[i].abs() + row.iter().zip(z.iter()).map(|(g, z)| (g * z).abs()).sum::<f64>();
    (row * z)[0] - limits.h[i] <= 1e-9 * size
}

/// The step s that minimises ‖R s + q‖² + ‖diag(damping) s‖² subject to G (z + s) ≥ h.
///
/// # Errors
/// [`SolveError::Failed`] if there is none.
pub fn constrained_step(
    factor: &Factor,
    damping: Option<&DVector<f64>>,
    z: &DVector<f64>,
    limits: &Limits,
) -> Result<DVector<f64>, SolveError> {
    let n = z.len();
    // Directions that the data do not see at all are held where they are by a damping below rounding.
    let floor = factor.norms().max() * f64::EPSILON * 1e-3 + f64::MIN_POSITIVE;
    let mut stacked = DMatrix::zeros(2 * n, n + 1);
    stacked.view_mut((0, 0), (n, n)).copy_from(&factor.r);
    stacked.view_mut((0, n), (n, 1)).copy_from(&factor.q);
    for i in 0..n {
        stacked[(n + i, i)] = damping.map_or(0.0, |d| d[i]).max(floor);
    }
    let Factor { r, q, .. } = Factor::of(stacked);
    let singular = || SolveError::Failed { reason: "a step of the optimizer has no solution".to_owned() };
    let free = r.solve_upper_triangular(&-&q).ok_or_else(singular)?;
    let slack = &limits.h - &limits.g * z;
    if (&limits.g * &free).iter().zip(slack.iter()).all(|(g, s)| g >= s) {
        return Ok(free);
    }
    // y = R s + q turns the problem into the shortest y with (G R⁻¹) y ≥ slack + G R⁻¹ q.
    let transposed = r.tr_solve_upper_triangular(&limits.g.transpose()).ok_or_else(singular)?;
    let bound = slack + transposed.transpose() * &q;
    let y = least_distance(&transposed, &bound).ok_or_else(|| SolveError::Failed { reason: "the bounds exclude each other".to_owned() })?;
    r.solve_upper_triangular(&(y - q)).ok_or_else(singular)
}

/// The shortest y with Gᵀ y ≥ h, for G given by columns; `None` if there is none (Lawson and Hanson, algorithm LDP).
fn least_distance(columns: &DMatrix<f64>, h: &DVector<f64>) -> Option<DVector<f64>> {
    let (n, m) = columns.shape();
    let mut e = DMatrix::zeros(n + 1, m);
    e.view_mut((0, 0), (n, m)).copy_from(columns);
    e.row_mut(n).copy_from(&h.transpose());
    // Scaling an inequality does not change it, but the accuracy of what follows.
    for mut column in e.column_iter_mut() {
        let norm = column.norm();
        if norm > 0.0 {
            column /= norm;
        }
    }
    let mut f = DVector::zeros(n + 1);
    f[n] = 1.0;
    let u = nonnegative_least_squares(&e, &f);
    let rest = &e * u - f;
    (rest[n].abs() > 1e-12).then(|| rest.rows(0, n) / -rest[n])
}

/// Minimises ‖E u − f‖ over u ≥ 0 (Lawson and Hanson, algorithm NNLS).
fn nonnegative_least_squares(e: &DMatrix<f64>, f: &DVector<f64>) -> DVector<f64> {
    let m = e.ncols();
    let mut u = DVector::zeros(m);
    let mut passive: Vec<usize> = Vec::new();
    for _ in 0..10 * m {
        let dual = e.transpose() * (f - e * &u);
        let candidate = (0..m).filter(|j| !passive.contains(j)).max_by(|a, b| dual[*a].total_cmp(&dual[*b]));
        let Some(entering) = candidate.filter(|j| dual[*j] > 1e-13) else { break };
        passive.push(entering);
        while !passive.is_empty() {
            let Ok(trial) = e.select_columns(&passive).svd(true, true).solve(f, 1e-14) else { return u };
            if trial.iter().all(|t| *t > 0.0) {
                u.fill(0.0);
                passive.iter().zip(trial.iter()).for_each(|(&j, t)| u[j] = *t);
                break;
            }
            let ratios = passive.iter().zip(trial.iter()).filter(|(_, t)| **t <= 0.0).map(|(&j, t)| u[j] / (u[j] - t));
            let alpha = ratios.fold(1.0, f64::min);
            passive.iter().zip(trial.iter()).for_each(|(&j, t)| u[j] += alpha * (t - u[j]));
            passive.retain(|&j| u[j] > 1e-15);
            (0..m).filter(|j| !passive.contains(j)).collect::<Vec<_>>().into_iter().for_each(|j| u[j] = 0.0);
        }
    }
    u
}

#[cfg(test)]
mod tests;
