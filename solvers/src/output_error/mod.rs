//! `output-error`: the parameters whose free-run simulation comes nearest to the recording.
//!
//! minimise Σ ‖W (ŷ(θ, x0) − y)‖² over θ and the outputs x0 at the start of each stretch, where ŷ is simulated from
//! held inputs and never corrected, and W whitens the error: alternately the fit with the noise model known and the
//! noise model with the fit known, until neither moves, which is maximum likelihood for Gaussian noise. Noise in the
//! measurement biases nothing, and neither does the sampling, because the hold is simulated as it is.

mod free_run;
mod intervals;
mod noise;
mod specification;
mod start;

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use wheelwright_core::Stretch;
use wheelwright_core::simulation::Readout;
use wheelwright_core::solver::{Problem, Solution, SolveError, Solver, Status};

use crate::Ols;
use crate::iv::orthogonalise;
pub(crate) use free_run::{FreeRun, Instrumental, Method};
use intervals::Intervals;
pub(crate) use intervals::not_identifiable;
pub(crate) use noise::{Channels, Noise};
use specification::{Scores, Specification};
use start::Integrals;
use wheelwright_core::least_squares::{Limits, Options, Outcome, Residuals, minimise};

/// Simulation error below this share of an output's largest value is numerical error, not noise.
const NUMERICAL: f64 = 1e-8;
/// Most alternations between fit and noise model.
const ROUNDS: usize = 10;
/// A fit that moves by less than this share of every standard error has settled.
const SETTLED: f64 = 0.05;

/// What the recorded velocities are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Velocity {
    /// The value at the time of the sample, as from a gyroscope or a fast filter.
    #[default]
    Instantaneous,
    /// The mean since the sample before, as from a driver that differences encoder counts.
    Difference,
}

impl Velocity {
    /// What a simulation reads out to be compared with such a recording.
    pub(crate) fn readout(self) -> Readout {
        match self {
            Self::Instantaneous => Readout::Instantaneous,
            Self::Difference => Readout::IntervalMean,
        }
    }
}

/// What the error of the fit is taken for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NoiseModel {
    /// Autoregressive noise if a specification test finds the error to be noise; else the error is a fault of the model,
    /// and the parameters are those whose free run comes nearest.
    #[default]
    Auto,
    /// Autoregressive noise in any case: maximum likelihood if the model is right.
    Autoregressive,
    /// Every sample counts alike: the parameters whose free run comes nearest, with intervals that allow for any colour.
    White,
}

/// Settings of the `output-error` solver.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OutputError {
    /// What the recorded velocities are: `"instantaneous"` (default) or `"difference"`. Mistaking one for the other
    /// shifts every time constant by half a sample.
    pub velocity: Velocity,
    /// What the error left is taken for: `"auto"` (default), `"autoregressive"` or `"white"`.
    pub noise: NoiseModel,
    /// Most iterations of each fit. Default 100.
    pub max_iterations: usize,
}

impl Default for OutputError {
    fn default() -> Self {
        Self { velocity: Velocity::default(), noise: NoiseModel::default(), max_iterations: 100 }
    }
}

#[typetag::serde(name = "output-error")]
impl Solver for OutputError {
    fn name(&self) -> &str {
        "output-error"
    }

    fn about(&self) -> String {
        "nonlinear least squares on the free-run simulation error, weighted by its noise model: unbiased, with intervals that cover"
            .to_owned()
    }

    fn solve(&self, problem: &Problem<'_>) -> Result<Solution, SolveError> {
        Fit::new("output-error", Method::Sensitivities, self, problem)?.solve()
    }
}

/// How errors are weighted.
#[derive(Debug, Clone, Copy)]
enum Weights {
    /// By the root mean square error of their output.
    White,
    /// By the autoregression that describes them.
    Autoregressive,
}

/// A fit that has settled.
struct Fitted {
    outcome: Outcome,
    rounds: usize,
    /// For a plain fit.
    scores: Option<Scores>,
    /// The test that found the error to be no noise.
    structured: Option<Specification>,
}

/// One run of the solver, or of one that also rests on free runs.
pub(crate) struct Fit<'a> {
    method: Method,
    settings: &'a OutputError,
    problem: &'a Problem<'a>,
    pub(crate) transform: DMatrix<f64>,
    offset: DVector<f64>,
    pub(crate) limits: Limits,
    pub(crate) integrals: Integrals,
    /// Numerical error of each output.
    pub(crate) floor: Vec<f64>,
}

impl<'a> Fit<'a> {
    /// `solver` is the name that errors speak of.
    pub(crate) fn new(solver: &str, method: Method, settings: &'a OutputError, problem: &'a Problem<'a>) -> Result<Self, SolveError> {
        let (parameters, free) = (problem.map.offset.len(), problem.map.free.len());
        if free == 0 {
            let reason = "every parameter is fixed: nothing is left to estimate".to_owned();
            return Err(SolveError::Setting { key: "parameters".to_owned(), reason });
        }
        let outputs = problem.data.outputs.len();
        if problem.model.equations() != outputs {
            return Err(SolveError::NotApplicable {
                solver: solver.to_owned(),
                model: problem.model.name().to_owned(),
                reason: format!("it has {} equation(s) for {outputs} output(s) and cannot be simulated", problem.model.equations()),
            });
        }
        let unknowns = free + outputs * problem.data.stretches.len();
        if problem.data.samples() * outputs <= unknowns + outputs {
            let needed_s = problem.data.period() * 10.0 * unknowns as f64;
            let what = "one unknown start a stretch".to_owned();
            return Err(SolveError::TooFewSamples { samples: problem.data.samples(), parameters: free, what, needed_s });
        }
        let transform = DMatrix::from_row_slice(parameters, free, &problem.map.matrix);
        let offset = DVector::from_column_slice(&problem.map.offset);
        let limits = limits(problem, &transform, &offset)?;
        let compared = compared(problem, settings.velocity);
        let largest = |c: usize| compared.iter().flat_map(|s| &s[c]).fold(0.0_f64, |m, x| m.max(x.abs()));
        let all = (0..outputs).map(largest).fold(f64::MIN_POSITIVE, f64::max);
        let floor = (0..outputs).map(|c| NUMERICAL * largest(c).max(1e-6 * all)).collect();
        Ok(Self { method, settings, problem, transform, offset, limits, integrals: Integrals::new(problem), floor })
    }

    pub(crate) fn solve(&self) -> Result<Solution, SolveError> {
        let (mut run, outcome) = self.first_fit()?;
        let fitted = match self.settings.noise {
            NoiseModel::Autoregressive => self.settle(&mut run, outcome, Weights::Autoregressive)?,
            NoiseModel::White => self.plain(&mut run, outcome)?,
            NoiseModel::Auto => self.specified(&mut run, outcome)?,
        };
        self.solution(&run, fitted)
    }

    /// The fit in which every sample counts alike, with the covariance of its scores.
    fn plain(&self, run: &mut FreeRun<'a>, outcome: Outcome) -> Result<Fitted, SolveError> {
        let mut fitted = self.settle(run, outcome, Weights::White)?;
        let noise = Noise::estimate(&run.errors()?, &self.floor, None);
        fitted.scores = Some(Scores::new(run, &noise)?);
        Ok(fitted)
    }

    /// The plain fit, unless what it leaves passes for noise: then the efficient one.
    fn specified(&self, run: &mut FreeRun<'a>, outcome: Outcome) -> Result<Fitted, SolveError> {
        let mut fitted = self.plain(run, outcome)?;
        let Some(scores) = &fitted.scores else { return Ok(fitted) };
        let noise = Noise::estimate(&run.errors()?, &self.floor, None);
        let plain = std::mem::replace(&mut run.noise, noise);
        let test = Specification::new(&self.limits, &fitted.outcome, &run.linearise()?, &scores.autoregressive);
        if test.is_noise() {
            return self.settle(run, fitted.outcome, Weights::Autoregressive);
        }
        run.noise = plain;
        fitted.structured = Some(test);
        Ok(fitted)
    }

    fn solution(&self, run: &FreeRun<'_>, fitted: Fitted) -> Result<Solution, SolveError> {
        let Fitted { outcome, rounds, scores, structured } = fitted;
        let theta = self.problem.map.theta(outcome.z.as_slice());
        let scale = self.integrals.free_scale(&self.transform, &theta);
        let scores = scores.as_ref().map(|s| if structured.is_some() { &s.robust } else { &s.autoregressive });
        let intervals = Intervals::new(&self.transform, &self.limits, &outcome, run.freedom(), scores);
        let condition = intervals.identifiability(self.problem, &scale)?;
        let at_bound = self.at_bound(&theta);
        let status = match (outcome.converged && rounds < ROUNDS, at_bound.is_empty()) {
            (false, _) => Status::IterationLimit,
            (true, true) => Status::Solved,
            (true, false) => Status::SolvedAtBound,
        };
        Ok(Solution {
            ci95: Some(intervals.ci95(&theta)),
            std: Some(intervals.std()),
            covariance: Some(intervals.covariance()),
            status,
            condition,
            steps: self.steps(run, rounds, scores.is_some()),
            warnings: structured.iter().map(Specification::warning).collect(),
            regression: None,
            theta,
            at_bound,
        })
    }

    /// Fits from the best of the regressions; where the cost proves not to be convex on the way, from the others too.
    pub(crate) fn first_fit(&self) -> Result<(FreeRun<'a>, Outcome), SolveError> {
        if let Some(error) = not_identifiable(self.problem, &self.transform, &self.integrals.hidden(&self.transform)) {
            return Err(error);
        }
        let noise = Noise::white(&self.spread());
        let ols = Ols::default().solve(self.problem);
        let mut candidates = self.integrals.starts(&self.transform, &self.offset, &self.limits)?;
        candidates.extend(ols.as_ref().ok().and_then(|solution| self.free_values(&solution.theta)));
        let mut runs = self.runs(&noise, &candidates);
        if runs.is_empty() {
            // A lag that a regression puts at its bound of zero: what answers at once cannot be simulated.
            let inside: Vec<DVector<f64>> = candidates.iter().map(|z| self.off_the_limits(z)).collect();
            runs = self.runs(&noise, &inside);
        }
        runs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut best: Option<(FreeRun<'a>, Outcome)> = None;
        let mut failure = ols.err();
        for (_, mut run) in runs {
            let z = run.z().clone();
            let outcome = match self.search(&mut run, z) {
                Ok(outcome) => outcome,
                Err(error) => {
                    failure.get_or_insert(error);
                    continue;
                }
            };

            let convex = outcome.smooth && outcome.converged;
            if best.as_ref().is_none_or(|(_, b)| outcome.factor.cost() < b.factor.cost()) {
                best = Some((run, outcome));
            }
            if convex {
                break;
            }
        }
        best.ok_or_else(|| {
            let reason = "no regression gives parameters that can be simulated over this recording".to_owned();
            failure.unwrap_or(SolveError::Failed { reason })
        })
    }

    /// Free runs from those points that can be simulated, with their costs.
    fn runs(&self, noise: &Noise, points: &[DVector<f64>]) -> Vec<(f64, FreeRun<'a>)> {
        let run = |z: &DVector<f64>| {
            let mut run = FreeRun::new(self, noise.clone(), z.clone()).ok()?;
            let cost = run.cost();
            cost.is_finite().then_some((cost, run))
        };
        points.iter().filter_map(run).collect()
    }

    /// A point with what sits at a limit moved inside by a tenth of its plausible size.
    fn off_the_limits(&self, z: &DVector<f64>) -> DVector<f64> {
        let scale = self.integrals.free_scale(&self.transform, &self.problem.map.theta(z.as_slice()));
        let mut inside = z.clone();
        for limit in self.limits.active(z) {
            for (j, towards) in self.limits.g.row(limit).iter().enumerate().filter(|(j, g)| **g != 0.0 && scale[*j].is_finite()) {
                inside[j] += 0.1 * scale[j] * towards.signum();
            }
        }
        let kept = (&self.limits.g * &inside).iter().zip(self.limits.h.iter()).all(|(g, h)| g >= h);
        if kept { inside } else { z.clone() }
    }

    /// Condition of the scaled problem at the current point.
    ///
    /// # Errors
    /// [`SolveError::NotIdentifiable`].
    pub(crate) fn condition(&self, run: &mut FreeRun<'_>) -> Result<f64, SolveError> {
        let (z, factor) = (run.z().clone(), run.linearise()?);
        let scale = self.integrals.free_scale(&self.transform, &self.problem.map.theta(z.as_slice()));
        let outcome = Outcome { z, factor, converged: true, smooth: true, active: Vec::new() };
        Intervals::new(&self.transform, &self.limits, &outcome, run.freedom(), None).identifiability(self.problem, &scale)
    }

    /// Alternates between weights and fit until the fit has settled.
    fn settle(&self, run: &mut FreeRun<'a>, mut outcome: Outcome, weights: Weights) -> Result<Fitted, SolveError> {
        let mut orders = None;
        let mut rounds = ROUNDS;
        for round in 1..=ROUNDS {
            let shorter = run.choose_step()?;
            let errors = run.errors()?;
            run.noise = match weights {
                Weights::White => Noise::white(&root_mean_squares(&errors, &self.floor)),
                Weights::Autoregressive => Noise::estimate(&errors, &self.floor, orders.as_deref()),
            };
            let fitted = self.search(run, outcome.z.clone())?;
            let moved = &fitted.z - &outcome.z;
            let settled = fitted.factor.deviations().iter().zip(moved.iter()).all(|(d, m)| m.abs() <= SETTLED * d);
            outcome = fitted;
            if settled && round > 1 && !shorter {
                rounds = round;
                break;
            }
            // An order that keeps changing its mind would keep the fit from settling.
            if round == 2 {
                orders.get_or_insert(run.noise.orders());
            }
        }
        Ok(Fitted { outcome, rounds, scores: None, structured: None })
    }

    /// From the current point of a run to the best one for its weights.
    fn search(&self, run: &mut FreeRun<'a>, z: DVector<f64>) -> Result<Outcome, SolveError> {
        let options = Options { iterations: self.settings.max_iterations, ..Options::default() };
        match self.method {
            Method::Sensitivities => minimise(run, z, &self.limits, options),
            Method::Instruments => orthogonalise(run, z, &self.limits, options),
        }
    }

    fn readout(&self) -> Readout {
        self.settings.velocity.readout()
    }

    /// The free values that make θ, if they exist and keep the limits.
    fn free_values(&self, theta: &[f64]) -> Option<DVector<f64>> {
        let wanted = DVector::from_column_slice(theta) - &self.offset;
        let z = self.transform.clone().svd(true, true).solve(&wanted, 1e-12).ok()?;
        let kept = (&self.limits.g * &z).iter().zip(self.limits.h.iter()).all(|(g, h)| g >= h);
        (kept && z.iter().all(|v| v.is_finite())).then_some(z)
    }

    /// Root mean square of each output about its mean, at least its numerical error.
    fn spread(&self) -> Vec<f64> {
        let compared = compared(self.problem, self.settings.velocity);
        let of = |(c, floor): (usize, &f64)| {
            let values = || compared.iter().flat_map(|s| &s[c]);
            let count = values().count() as f64;
            let mean = values().sum::<f64>() / count;
            (values().map(|v| (v - mean).powi(2)).sum::<f64>() / count).sqrt().max(*floor)
        };
        self.floor.iter().enumerate().map(of).collect()
    }

    pub(crate) fn at_bound(&self, theta: &[f64]) -> Vec<usize> {
        let near = |value: f64, bound: f64| bound.is_finite() && (value - bound).abs() <= 1e-9 * bound.abs().max(value.abs()).max(1e-12);
        let fixed = |i: usize| self.transform.row(i).iter().all(|t| *t == 0.0);
        let bounds = self.problem.bounds.iter().enumerate();
        bounds.filter(|(i, (low, high))| !fixed(*i) && (near(theta[*i], *low) || near(theta[*i], *high))).map(|(i, _)| i).collect()
    }

    fn steps(&self, run: &FreeRun<'_>, rounds: usize, plain: bool) -> Vec<String> {
        let outputs = self.problem.data.outputs.iter().zip(run.noise.orders());
        let noise: Vec<String> = outputs.map(|(channel, order)| format!("{} of order {order}", channel.name)).collect();
        let weights = if plain {
            "every sample of an output counts alike, outputs by the size of their error; weights".to_owned()
        } else {
            format!("autoregressive noise: {}; noise model", noise.join(", "))
        };
        let readout = match self.settings.velocity {
            Velocity::Instantaneous => "at the time of the sample",
            Velocity::Difference => "as the mean since the sample before",
        };
        vec![
            format!(
                "simulated {} stretch(es) freely from inputs held between samples, outputs read {readout}, the start of each stretch estimated",
                self.problem.data.stretches.len()
            ),
            format!("{weights} and fit settled in {rounds} round(s)"),
        ]
    }
}

/// The recording as it is compared: outputs, or distances if they are means over intervals.
fn compared(problem: &Problem<'_>, velocity: Velocity) -> Vec<Channels> {
    let of = |stretch: &Stretch| {
        let mut outputs = stretch.outputs.clone();
        if velocity == Velocity::Difference {
            free_run::sum_up(&mut outputs, &stretch.time);
        }
        outputs
    };
    problem.data.stretches.iter().map(of).collect()
}

fn root_mean_squares(errors: &[Channels], floor: &[f64]) -> Vec<f64> {
    let of = |(c, floor): (usize, &f64)| {
        let count: usize = errors.iter().map(|e| e[c].len()).sum();
        (errors.iter().flat_map(|e| &e[c]).map(|x| x * x).sum::<f64>() / count as f64).sqrt().max(*floor)
    };
    floor.iter().enumerate().map(of).collect()
}

/// Bounds of θ = T z + c as G z ≥ h.
fn limits(problem: &Problem<'_>, transform: &DMatrix<f64>, offset: &DVector<f64>) -> Result<Limits, SolveError> {
    let (mut rows, mut h) = (Vec::new(), Vec::new());
    for (i, &(lower, upper)) in problem.bounds.iter().enumerate() {
        let fixed = transform.row(i).iter().all(|t| *t == 0.0);
        if lower > upper || (fixed && !(lower..=upper).contains(&offset[i])) {
            let parameter = problem.model.parameters()[i].name.clone();
            return Err(SolveError::EmptyBounds { parameter, lower, upper });
        }
        for (bound, sign) in [(lower, 1.0), (upper, -1.0)] {
            if bound.is_finite() && !fixed {
                rows.push(transform.row(i) * sign);
                h.push(sign * (bound - offset[i]));
            }
        }
    }
    let g = if rows.is_empty() { DMatrix::zeros(0, transform.ncols()) } else { DMatrix::from_rows(&rows) };
    Ok(Limits { g, h: DVector::from_vec(h) })
}
