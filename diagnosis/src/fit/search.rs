//! The search for the most likely point: Levenberg-Marquardt on whitened free-run residuals, bounds kept.
//!
//! Noise levels are known up to one factor an output, so twice the log-likelihood is −Σ N ln(mean r²) over the outputs. Its
//! quadratic model at a point is a sum of squares with output weights N / Σ r², which is renewed at every step. Columns of the
//! Jacobian are simulated once and then kept up to date by Broyden's formula: a column costs a simulation, an update a sum. They
//! are simulated again where a step disappoints.

use nalgebra::{DMatrix, DVector};
use wheelwright_core::least_squares::{Limits, constrained_step};

use super::algebra::{Directions, add, dot, factor, gram};
use super::setting::{Point, Runner, Setting};
use super::whitening::Whitening;

/// How much more than it promises a step may bring in the end.
pub(crate) const OPTIMISM: f64 = 4.0;
/// Distance in twice the log-likelihood at which a rival is none.
pub(crate) const OUT_OF_REACH: f64 = 40.0;
/// By how much twice the log-likelihood may fall where starts are moved: more, and they are not as linear as the move takes them to be, and
/// the other unknowns have to follow.
const STRAIGHT: f64 = 1.0;
/// How far they follow.
const ADJUSTING: Effort = Effort { trials: 6, worthwhile: 0.1, target: f64::NEG_INFINITY };
/// Damping of the first step.
const FIRST_DAMPING: f64 = 1e-3;
/// Least damping.
const LEAST_DAMPING: f64 = 1e-12;

/// How far to search.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Effort {
    /// Most simulated trial points.
    pub(crate) trials: usize,
    /// Gain of twice the log-likelihood below which a promised step is not worth its simulation.
    pub(crate) worthwhile: f64,
    /// Twice a log-likelihood that others have reached: a search that cannot come near it gives up.
    pub(crate) target: f64,
}

/// A point with everything that follows from it.
#[derive(Debug, Clone)]
pub(crate) struct Fit {
    pub(crate) point: Point,
    /// Free run, flat.
    pub(crate) simulated: Vec<f64>,
    /// Whitened residual, initial outputs projected out.
    pub(crate) residual: Vec<f64>,
    /// Whitened responses to the unknowns, projected likewise.
    pub(crate) columns: Vec<Vec<f64>>,
    /// Sum of squares of each output.
    pub(crate) squares: Vec<f64>,
    /// Sum of squared distances of effects' parameters from what they usually are, in units of their spread.
    unusual: f64,
    /// Damping of the next step: a search that goes on knows how far steps could be trusted.
    damping: f64,
}

impl Fit {
    /// A column as far as it is known: an empty one is simulated by the next search.
    pub(crate) fn column(&self, unknown: usize) -> Vec<f64> {
        self.columns.get(unknown).cloned().unwrap_or_default()
    }

    /// Twice the log-likelihood up to a constant.
    pub(crate) fn likelihood(&self, setting: &Setting<'_>) -> f64 {
        likelihood(&self.squares, setting.layout.counted()) - self.unusual
    }

    /// Whether the last steps that were tried led nowhere, and the next would be shorter.
    pub(crate) fn held_back(&self) -> bool {
        self.damping > FIRST_DAMPING
    }

    /// Weight of each output's squares.
    pub(crate) fn weights(&self, setting: &Setting<'_>) -> Vec<f64> {
        weights(&self.squares, setting.layout.counted())
    }

    /// Products of all columns, with the outputs' weights.
    pub(crate) fn information(&self, setting: &Setting<'_>) -> DMatrix<f64> {
        let columns: Vec<&[f64]> = self.columns.iter().map(Vec::as_slice).collect();
        gram(&columns, &parts(setting), &self.weights(setting))
    }

    /// Number of directions that the data tell.
    pub(crate) fn rank(&self, setting: &Setting<'_>) -> usize {
        Directions::of(&self.information(setting)).rank()
    }
}

/// Slices of the outputs.
pub(crate) fn parts(setting: &Setting<'_>) -> Vec<std::ops::Range<usize>> {
    (0..setting.layout.outputs()).map(|c| setting.layout.output(c)).collect()
}

/// Twice the log-likelihood of sums of squares, up to a constant.
pub(crate) fn likelihood(squares: &[f64], rows: usize) -> f64 {
    -squares.iter().map(|s| rows as f64 * (s / rows as f64).max(f64::MIN_POSITIVE).ln()).sum::<f64>()
}

pub(crate) fn weights(squares: &[f64], rows: usize) -> Vec<f64> {
    squares.iter().map(|s| rows as f64 / s.max(f64::MIN_POSITIVE)).collect()
}

/// Sum of squares of each output, with those of the numerical error: what is smaller than that explains nothing.
pub(crate) fn squares(setting: &Setting<'_>, whitening: &Whitening, residual: &[f64]) -> Vec<f64> {
    let rows = setting.layout.counted() as f64;
    let numerical = setting.floor.iter().zip(&whitening.noise.innovation).map(|(floor, unit)| rows * (floor / unit).powi(2));
    parts(setting).into_iter().zip(numerical).map(|(p, numerical)| numerical + dot(&residual[p.clone()], &residual[p])).collect()
}

/// Simulates a point; `None` where it cannot be evaluated.
pub(crate) fn evaluate(setting: &Setting<'_>, runner: &mut Runner<'_, '_>, whitening: &Whitening, point: &Point) -> Option<Fit> {
    let mut simulated = vec![0.0; setting.layout.len()];
    if !runner.run(&point.x, &point.starts, &mut simulated) {
        return None;
    }
    let point = point.clone();
    let mut residual = left(setting, &simulated);
    whitening.settle(&mut residual, &point.starts);
    let squares = squares(setting, whitening, &residual);
    let unusual = usual(setting, runner).map(|(j, value, spread)| ((point.x[j] - value) / spread).powi(2)).sum();
    squares.iter().all(|s| s.is_finite()).then_some(Fit {
        point,
        simulated,
        residual,
        columns: Vec::new(),
        squares,
        unusual,
        damping: FIRST_DAMPING,
    })
}

/// What a free run leaves of the measurement, flat.
pub(crate) fn left(setting: &Setting<'_>, simulated: &[f64]) -> Vec<f64> {
    setting.measured.iter().zip(simulated).map(|(y, s)| y - s).collect()
}

/// A fit from its likeliest initial outputs. A search keeps them where they are: what is linear about a start is not so far from it, and a start
/// that moves with every step would make likelihoods that cannot be compared.
pub(crate) fn settled(setting: &Setting<'_>, runner: &mut Runner<'_, '_>, whitening: &Whitening, fit: Fit) -> Fit {
    let starts = whitening.likeliest(left(setting, &fit.simulated), &fit.point.starts);
    let point = Point { x: fit.point.x.clone(), starts };
    let Some(moved) = evaluate(setting, runner, whitening, &point) else { return fit };
    let mut moved = Fit { columns: fit.columns.clone(), ..moved };
    let least = fit.likelihood(setting) - STRAIGHT;
    if moved.likelihood(setting) < least {
        moved = maximise(setting, runner, whitening, moved, ADJUSTING, true);
    }
    if moved.likelihood(setting) < least { fit } else { moved }
}

/// Unknowns that have a usual value, with it and its spread.
fn usual(setting: &Setting<'_>, runner: &Runner<'_, '_>) -> impl Iterator<Item = (usize, f64, f64)> {
    let free = setting.free();
    runner.parameters.iter().enumerate().filter_map(move |(k, p)| p.usual.map(|(value, spread)| (free + k, value, spread)))
}

/// Simulates the columns of the unknowns in a range anew.
pub(crate) fn linearise(runner: &mut Runner<'_, '_>, whitening: &Whitening, fit: &mut Fit, unknowns: std::ops::Range<usize>) {
    fit.columns.resize(fit.point.x.len(), Vec::new());
    for (j, mut column) in unknowns.clone().zip(runner.columns(&fit.point, unknowns)) {
        whitening.apply(&mut column);
        fit.columns[j] = column;
    }
}

/// Gives a fit the columns of a model that it has joined, as they were there, and simulates those that are its own.
pub(crate) fn join(runner: &mut Runner<'_, '_>, whitening: &Whitening, fit: &mut Fit, known: &[Vec<f64>]) {
    fit.columns = known.to_vec();
    linearise(runner, whitening, fit, known.len()..fit.point.x.len());
}

/// The search from a fit whose columns may be those of somewhere near. Returns the best point; its columns are exact if `exact`.
pub(crate) fn maximise(
    setting: &Setting<'_>,
    runner: &mut Runner<'_, '_>,
    whitening: &Whitening,
    mut fit: Fit,
    effort: Effort,
    exact: bool,
) -> Fit {
    let limits = setting.limits(&runner.parameters);
    let usual: Vec<(usize, f64, f64)> = usual(setting, runner).collect();
    let unknowns = fit.point.x.len();
    if unknowns == 0 {
        return fit;
    }
    let fastest = setting.fastest(&fit.point.x);
    let mut fresh = fit.columns.len() < unknowns || fit.columns.iter().any(Vec::is_empty);
    if fresh {
        linearise(runner, whitening, &mut fit, 0..unknowns);
    }
    let mut damping = fit.damping.max(FIRST_DAMPING);
    let mut trials = 0;
    while trials < effort.trials {
        let Some((step, promised)) = step(setting, &fit, &limits, damping, &usual) else { break };
        if fresh && fit.likelihood(setting) + OPTIMISM * logarithmic(promised, setting) < effort.target - OUT_OF_REACH {
            break;
        }
        if promised < effort.worthwhile {
            // Little is promised: by old columns, or where damping holds it back, that is no proof.
            if fresh || promised < 0.01 * effort.worthwhile {
                break;
            }
            linearise(runner, whitening, &mut fit, 0..unknowns);
            fresh = true;
            continue;
        }
        trials += 1;
        let mut trial = fit.point.clone();
        trial.x.iter_mut().zip(step.iter()).for_each(|(x, s)| *x += s);
        clamp(&mut trial, setting.free(), runner);
        let reached = if setting.rate(&trial.x) > fastest { None } else { evaluate(setting, runner, whitening, &trial) };
        let gain = reached.as_ref().map_or(f64::NEG_INFINITY, |r| r.likelihood(setting) - fit.likelihood(setting));
        match reached {
            Some(mut next) if gain > 0.0 => {
                next.columns = std::mem::take(&mut fit.columns);
                let changed = fit.residual.iter().zip(&next.residual).map(|(before, now)| before - now).collect();
                let missed = missed(&next.columns, changed, &step);
                broyden(&mut next.columns, &missed, &step);
                let disappointing = gain < 0.5 * promised;
                fit = next;
                fresh = false;
                damping = (damping * if disappointing { 1.0 } else { 0.1 }).max(LEAST_DAMPING);
                if disappointing {
                    // Kinks are in the effects: their columns age first.
                    linearise(runner, whitening, &mut fit, setting.free()..unknowns);
                }
            }
            _ if !fresh => {
                linearise(runner, whitening, &mut fit, 0..unknowns);
                fresh = true;
            }
            _ => damping = (damping * 8.0).max(FIRST_DAMPING),
        }
        if damping > 1e6 {
            break;
        }
    }
    fit.damping = damping;
    if exact && !fresh {
        linearise(runner, whitening, &mut fit, 0..unknowns);
    }
    fit
}

/// The gain of twice the log-likelihood that goes with a decrease of the weighted sum of squares.
fn logarithmic(promised: f64, setting: &Setting<'_>) -> f64 {
    let values = setting.layout.values();
    -values * (1.0 - promised / values).max(1e-9).ln()
}

/// Keeps effects' parameters within their bounds to the last bit.
fn clamp(point: &mut Point, free: usize, runner: &Runner<'_, '_>) {
    for (x, p) in point.x[free..].iter_mut().zip(&runner.parameters) {
        *x = x.max(p.bounds.0).min(p.bounds.1);
    }
}

/// The damped step within limits, and what it promises of twice the log-likelihood.
fn step(setting: &Setting<'_>, fit: &Fit, limits: &Limits, damping: f64, usual: &[(usize, f64, f64)]) -> Option<(DVector<f64>, f64)> {
    let weights = fit.weights(setting);
    let negative: Vec<f64> = fit.residual.iter().map(|r| -r).collect();
    let columns: Vec<&[f64]> = fit.columns.iter().map(Vec::as_slice).chain(std::iter::once(negative.as_slice())).collect();
    let mut gram = gram(&columns, &parts(setting), &weights);
    let n = fit.columns.len();
    for &(j, value, spread) in usual {
        let (one, off) = (1.0 / spread, (fit.point.x[j] - value) / spread);
        gram[(j, j)] += one * one;
        gram[(j, n)] += one * off;
        gram[(n, j)] += one * off;
        gram[(n, n)] += off * off;
    }
    let factor = factor(&gram);
    let scale = DVector::from_fn(n, |j, _| damping.sqrt() * gram[(j, j)].max(0.0).sqrt());
    let z = DVector::from_column_slice(&fit.point.x);
    let step = constrained_step(&factor, Some(&scale), &z, limits).ok()?;
    let promised = factor.q.norm_squared() - (&factor.r * &step + &factor.q).norm_squared();
    step.iter().all(|s| s.is_finite()).then_some((step, promised))
}

/// What columns did not foretell of what a step has changed.
pub(crate) fn missed(columns: &[Vec<f64>], mut changed: Vec<f64>, step: &DVector<f64>) -> Vec<f64> {
    columns.iter().zip(step.iter()).for_each(|(c, s)| add(&mut changed, -s, c));
    changed
}

/// Broyden's rank-one update: the columns that foretell what they have missed of a step, nearest to the old ones.
pub(crate) fn broyden(columns: &mut [Vec<f64>], missed: &[f64], step: &DVector<f64>) {
    let sizes: Vec<f64> = columns.iter().map(|c| dot(c, c)).collect();
    let length: f64 = step.iter().zip(&sizes).map(|(s, d)| s * s * d).sum();
    if length.is_nan() || length <= 0.0 {
        return;
    }
    for ((column, s), d) in columns.iter_mut().zip(step.iter()).zip(&sizes) {
        add(column, s * d / length, missed);
    }
}
