//! Does the drive integrate its error, and could it do so unseen?
//!
//! A controller with integral action obeys u = (terms of the model) + λ ∫(x − u) dt + c on each axis. A regression with those two further
//! columns finds λ; where its free run is better than the model's own, the free run with the integral is fitted, and λ has its size.
//!
//! A quick integral leaves nothing. For ω ≪ λ the drive T = (s + λ)/(θ₁s² + θ₄s + λ) is that of a model without it, with gain 1 and
//! time constant (θ₄ − 1)/λ: the fit is good and its parameters are not the robot's. Only the gain gives it away, because feedback in
//! proportion alone needs a lasting error to overcome friction and back-EMF. `docs/evidence.md` has the derivation.

mod model;
#[cfg(test)]
mod tests;

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use crate::dataset::{Dataset, Stretch};
use crate::local::{self, FreeRun, Local, Point};
use crate::model::{ParameterMap, RegressorModel, Sample};
use crate::solver::SolveError;
use model::{Integrating, axes, integral};

/// Half the width of a 95 % interval in standard errors.
const HALF_WIDTH: f64 = 1.96;
/// Standard errors from which on integral action counts as seen: two axes are asked, and other physics is never quite absent.
const SEEN: f64 = 4.0;
/// A gain this close to one is one, however narrow its interval: it is measured in wheel radii and track widths known no better.
const ONE: f64 = 0.005;
/// A gain known no better than this says nothing of whether it is one.
const KNOWN: f64 = 0.02;
/// Shares c of the command by which feedback in proportion alone would fall short, tried where all gains are one.
const SHARES: [f64; 3] = [0.05, 0.3, 1.5];
/// Twice the difference of log-likelihoods beyond which a drive with integral action is excluded: chance exceeds it once in a thousand.
const EXCLUDED: f64 = 10.83;
/// An integral quicker than this \[1/s\] may have a free run worse by this factor before it is refined.
const QUICK: f64 = 0.5;
const QUICK_MARGIN: f64 = 3.0;
/// Samples looked at: enough to see what matters.
const MOST: usize = 6_000;

/// Integral action on one axis.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AxisIntegral {
    /// Name of the command.
    pub input: String,
    /// Name of the output that follows it.
    pub output: String,
    /// True if the free run shows integral action.
    pub present: bool,
    /// λ, the error's integral over its own size in the command \[1/s\]; `None` where none is seen.
    pub lambda: Option<f64>,
    /// Its 95 % interval \[1/s\].
    pub lambda_ci95: Option<(f64, f64)>,
    /// What the output comes to for one unit of command, as identified.
    pub steady_gain: Option<f64>,
    /// Half the width of its 95 % interval; `None` where no standard errors are known.
    pub steady_gain_half_width: Option<f64>,
    /// The result in a sentence.
    pub statement: String,
}

/// Integral action on every axis.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct IntegralAction {
    /// One entry an axis.
    pub axes: Vec<AxisIntegral>,
    /// Parameters of the model fitted with the integral beside it, by name; `None` where none is seen.
    pub parameters: Option<Vec<(String, f64)>>,
    /// Free-run error of each output without the integral, root mean square.
    pub error_without: Vec<f64>,
    /// The same with it; `None` where none is seen.
    pub error_with: Option<Vec<f64>>,
    /// A warning where integral action could be there and leave nothing to see.
    pub hidden: Option<String>,
}

impl IntegralAction {
    /// What a user should know.
    pub fn concerns(&self) -> Vec<String> {
        self.axes.iter().filter(|a| a.present).map(|a| a.statement.clone()).chain(self.hidden.clone()).collect()
    }
}

/// Looks for integral action about a fitted θ with standard errors `std` (not numbers where unknown). `None` for a model without an
/// axis on which a command stands against an output of its own unit.
///
/// # Errors
/// [`SolveError`] if the model cannot be simulated with θ.
pub fn assess(
    model: &dyn RegressorModel,
    map: &ParameterMap,
    theta: &[f64],
    std: &[f64],
    data: &Dataset,
) -> Result<Option<IntegralAction>, SolveError> {
    let places = axes(model);
    if places.is_empty() {
        return Ok(None);
    }
    let data = data.shortened(MOST);
    let (run, point, sigma) = local::about(model, map, theta, &data)?;
    let fitted = Fitted::find(model, map, &run, &sigma, &places)?;
    let gains = gains(model, theta, std);
    let mut found = IntegralAction { axes: Vec::new(), parameters: None, error_with: None, hidden: None, error_without: sigma.clone() };
    for (k, &i) in places.iter().enumerate() {
        let lambda = fitted.as_ref().map(|f| f.lambdas[k]).filter(|(lambda, std)| *lambda > SEEN * std);
        let gain = gains.as_ref().map(|g| g[i]);
        let mut axis = AxisIntegral {
            input: data.inputs[i].name.to_string(),
            output: data.outputs[i].name.to_string(),
            present: lambda.is_some(),
            lambda: lambda.map(|l| l.0),
            lambda_ci95: lambda.map(|(l, std)| (l - HALF_WIDTH * std, l + HALF_WIDTH * std)),
            steady_gain: gain.map(|g| g.0),
            steady_gain_half_width: gain.map(|g| g.1).filter(|h| h.is_finite()),
            statement: String::new(),
        };
        axis.statement = statement(&axis);
        found.axes.push(axis);
    }
    if let Some(fitted) = fitted.filter(|_| found.axes.iter().any(|a| a.present)) {
        let names = model.parameters().iter().map(|p| p.name.clone());
        found.parameters = Some(names.zip(fitted.theta).collect());
        found.error_with = Some(fitted.error);
    } else {
        let constants = local::time_constants(model, theta, &data);
        let constants: Vec<f64> = places.iter().map(|i| constants[*i]).collect();
        if let Some(warning) = hidden(&found.axes, &constants) {
            let rival = Rival { model, map, theta, places: &places, constants: &constants };
            found.hidden = rival.holds(&run, &point, &sigma)?.then_some(warning);
        }
    }
    Ok(Some(found))
}

/// Standard errors of all unknowns under noise of the residual's colour.
fn deviations(local: &Local, outputs: usize) -> DVector<f64> {
    local.covariance(&local.autoregressions(outputs)).diagonal().map(|v| v.max(0.0).sqrt())
}

/// The model fitted with the integral beside it.
struct Fitted {
    theta: Vec<f64>,
    /// λ of each axis with its standard error.
    lambdas: Vec<(f64, f64)>,
    error: Vec<f64>,
}

impl Fitted {
    /// `None` where no integral makes the free run better than the model's own.
    fn find(
        model: &dyn RegressorModel,
        map: &ParameterMap,
        run: &FreeRun<'_>,
        sigma: &[f64],
        places: &[usize],
    ) -> Result<Option<Self>, SolveError> {
        let data = run.data;
        let integrating = Integrating::new(model, places, false);
        let wider = integrating.extend(map);
        let Some(z) = regressed(model, map, data, places) else { return Ok(None) };
        let mut run = FreeRun::new(&integrating, &wider, data, Vec::new());
        let theta = wider.theta(&z);
        let point = begun(&run, model, z, &theta, places);
        // An integral that is there betters the free run before anything is refined, unless it is quick against the sampling; most
        // recordings end here.
        let quick = theta[map.offset.len()..].iter().any(|lambda| *lambda > QUICK);
        let allowed = likelihood(sigma) + if quick { 2.0 * sigma.len() as f64 * QUICK_MARGIN.ln() } else { 0.0 };
        let begins_well = run.fix_step(&point.z).and_then(|()| run.noise(&point)).is_ok_and(|error| likelihood(&error) < allowed);
        if !begins_well {
            return Ok(None);
        }
        let Ok((point, error)) = run.fit(point) else { return Ok(None) };
        let deviations = deviations(&run.linearise(&point, &error)?, error.len());
        let mut theta = wider.theta(&point.z);
        theta.truncate(map.offset.len());
        let lambdas = (map.free.len()..point.z.len()).map(|at| (point.z[at], deviations[at])).collect();
        Ok((likelihood(&error) < likelihood(sigma)).then_some(Self { theta, lambdas, error }))
    }
}

/// The free parameters and λ by regression with the integrals of the measured errors and constants as further columns; `None` where
/// it finds no integral or nothing that can be simulated.
fn regressed(model: &dyn RegressorModel, map: &ParameterMap, data: &Dataset, places: &[usize]) -> Option<Vec<f64>> {
    let regressing = Integrating::new(model, places, true);
    let (mut wider, with) = (regressing.extend(map), regressing.with_integrals(data));
    let (free, count, known) = (map.free.len(), places.len(), map.offset.len());
    let mut z = local::regression_start(&regressing, &wider, &with).ok()?;
    let mut lambdas = z[free..free + count].to_vec();
    let largest = lambdas.iter().copied().fold(0.0, f64::max);
    if largest <= 0.0 {
        return None;
    }
    // An axis too quick for this sampling may come out below zero, and its parameters with it: it starts as the others do, which
    // the same firmware mostly controls alike.
    if lambdas.iter().any(|l| *l <= 0.0) {
        lambdas.iter_mut().filter(|l| **l <= 0.0).for_each(|l| *l = largest);
        for (k, lambda) in lambdas.iter().enumerate() {
            wider.impose(&[(known + k, 1.0)], *lambda).ok()?;
        }
        z = local::regression_start(&regressing, &wider, &with).ok()?;
    }
    z.truncate(free);
    Some(local::simulable(model, map, data, z).into_iter().chain(lambdas).collect())
}

/// A point with measured starts, whose integrals begin where their equations are right in the mean.
fn begun(run: &FreeRun<'_>, model: &dyn RegressorModel, z: Vec<f64>, theta: &[f64], places: &[usize]) -> Point {
    let mut point = run.point(z, Vec::new());
    for (start, stretch) in point.starts.iter_mut().zip(&run.data.stretches) {
        start.truncate(run.data.outputs.len());
        start.extend(offsets(model, theta, stretch, places));
    }
    point
}

/// Where each integral of a stretch begins: what makes its equation right in the mean of the stretch.
fn offsets(model: &dyn RegressorModel, theta: &[f64], stretch: &Stretch, places: &[usize]) -> Vec<f64> {
    let (equations, known) = (model.equations(), model.parameters().len());
    let (mut phi, mut y) = (vec![0.0; equations * known], vec![0.0; equations]);
    let mut missing = vec![0.0; equations];
    for k in 1..stretch.len() {
        let dt = stretch.time[k] - stretch.time[k - 1];
        let inputs: Vec<f64> = stretch.inputs.iter().map(|c| c[k - 1]).collect();
        let outputs: Vec<f64> = stretch.outputs.iter().map(|c| 0.5 * (c[k] + c[k - 1])).collect();
        let accelerations: Vec<f64> = stretch.outputs.iter().map(|c| (c[k] - c[k - 1]) / dt).collect();
        model.regressor(Sample { inputs: &inputs, outputs: &outputs, accelerations: &accelerations }, &mut phi, &mut y);
        for (e, row) in phi.chunks_exact(known).enumerate() {
            missing[e] += dt * (y[e] - row.iter().zip(theta).map(|(a, t)| a * t).sum::<f64>());
        }
    }
    let duration = stretch.time[stretch.len() - 1] - stretch.time[0];
    let of = |(k, &i): (usize, &usize)| {
        let q = integral(stretch, i);
        let mean = q.iter().sum::<f64>() / q.len() as f64;
        let lambda = theta[known + k];
        if lambda > 0.0 { missing[i] / duration / lambda - mean } else { 0.0 }
    };
    places.iter().enumerate().map(of).collect()
}

/// Twice the negative logarithm of the likelihood a sample, up to a constant.
fn likelihood(error: &[f64]) -> f64 {
    error.iter().map(|e| 2.0 * e.ln()).sum()
}

/// Each output's steady answer to one unit of the input of its place, −(L⁻¹B)ᵢᵢ about rest, with half the width of its 95 %
/// interval (the parameters' errors taken as independent).
fn gains(model: &dyn RegressorModel, theta: &[f64], std: &[f64]) -> Option<Vec<(f64, f64)>> {
    let n = model.outputs().len();
    let of = |theta: &[f64]| -> Option<Vec<f64>> {
        let linear = local::linear_part(model, theta)?;
        let outputs = vec![0.0; n];
        let mut given = DMatrix::zeros(n, n);
        for i in 0..n {
            let side = |sign: f64| {
                let (mut inputs, mut a) = (vec![0.0; n], vec![0.0; n]);
                inputs[i] = sign;
                model.accelerations(theta, &inputs, &outputs, &mut a).ok().map(|()| a)
            };
            let (up, down) = (side(1.0)?, side(-1.0)?);
            (0..n).for_each(|k| given[(k, i)] = 0.5 * (up[k] - down[k]));
        }
        linear.lu().solve(&given).map(|g| g.diagonal().iter().map(|x| -x).collect())
    };
    let centre = of(theta)?;
    let mut variances = vec![0.0; n];
    for (j, std) in std.iter().enumerate() {
        let mut moved = theta.to_vec();
        let step = 1e-6 * theta[j].abs().max(1e-3);
        moved[j] += step;
        for (variance, (m, c)) in variances.iter_mut().zip(of(&moved)?.iter().zip(&centre)) {
            let slope = (m - c) / step;
            // A parameter that the gain does not depend on may have any error, or none.
            if slope.abs() > 1e-9 {
                *variance += (slope * std).powi(2);
            }
        }
    }
    Some(centre.into_iter().zip(variances).map(|(gain, v)| (gain, HALF_WIDTH * v.sqrt())).collect())
}

/// The drive that would be taken for the one found: in proportion alone it would reach only 1/(1 + c) of what it is told, and an
/// integral λ = c/T makes up for the rest, T being the time constant found. With the lag found it answers commands exactly as a drive
/// of gain 1 without an integral does, whatever c is: its slow pole lies on its zero.
struct Rival<'r> {
    model: &'r dyn RegressorModel,
    map: &'r ParameterMap,
    theta: &'r [f64],
    places: &'r [usize],
    constants: &'r [f64],
}

impl Rival<'_> {
    /// Whether the recording leaves such a drive standing: for some c its free run, fitted, is not worse than that of the model by
    /// more than chance allows, in the likelihood of as many samples as the residual is worth.
    fn holds(&self, run: &FreeRun<'_>, point: &Point, sigma: &[f64]) -> Result<bool, SolveError> {
        let data = run.data;
        let ar = run.linearise(point, sigma)?.autoregressions(sigma.len());
        let worse = |error: &[f64]| {
            let each = error.iter().zip(sigma).zip(&ar);
            each.map(|((e, s), ar)| ar.effective_samples(data.samples()) * 2.0 * (e / s).ln()).sum::<f64>()
        };
        let integrating = Integrating::new(self.model, self.places, false);
        for share in SHARES {
            let mut wider = integrating.extend(self.map);
            for (k, constant) in self.constants.iter().enumerate() {
                let imposed = wider.impose(&[(self.theta.len() + k, 1.0)], share / constant);
                imposed.map_err(SolveError::from)?;
            }
            let mut run = FreeRun::new(&integrating, &wider, data, Vec::new());
            let z = local::free_values(self.map, &self.weakened(share));
            let theta = wider.theta(&z);
            let started = begun(&run, self.model, z, &theta, self.places);
            if run.fit(started).is_ok_and(|(_, error)| worse(&error) < EXCLUDED) {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// θ with the coefficient of each axis' own output in its equation raised by c.
    fn weakened(&self, share: f64) -> Vec<f64> {
        let (n, known) = (self.model.outputs().len(), self.theta.len());
        let mut theta = self.theta.to_vec();
        let (inputs, accelerations) = (vec![0.0; self.model.inputs().len()], vec![0.0; n]);
        for &axis in self.places {
            let row = |value: f64| {
                let (mut outputs, mut phi, mut y) = (vec![0.0; n], vec![0.0; n * known], vec![0.0; n]);
                outputs[axis] = value;
                self.model.regressor(Sample { inputs: &inputs, outputs: &outputs, accelerations: &accelerations }, &mut phi, &mut y);
                phi[axis * known..(axis + 1) * known].to_vec()
            };
            let (up, down) = (row(1.0), row(-1.0));
            let along: Vec<f64> = up.iter().zip(&down).map(|(u, d)| 0.5 * (u - d)).collect();
            if let Some(j) = (0..known).find(|j| along[*j] != 0.0) {
                theta[j] += share / along[j];
            }
        }
        theta
    }
}

/// The warning of an integral that leaves nothing: every axis reaches what it is told, and is known to. `constants` are the axes' time
/// constants.
fn hidden(axes: &[AxisIntegral], constants: &[f64]) -> Option<String> {
    let exact = |(a, constant): (&AxisIntegral, &f64)| {
        let (gain, half) = (a.steady_gain?, a.steady_gain_half_width?);
        // A gain without an error is the model's own, not the data's.
        (half > 0.0 && half <= KNOWN && (gain - 1.0).abs() <= half.max(ONE)).then(|| {
            // Without its controller a drive of gain g and time constant T has the time constant T/(1 − g).
            let coasting = constant / (1.0 - (gain - half)).max(f64::MIN_POSITIVE);
            (format!("{} {gain:.4} ± {half:.4}", a.output), coasting)
        })
    };
    let found = axes.iter().zip(constants).map(exact).collect::<Option<Vec<_>>>()?;
    let gains: Vec<&str> = found.iter().map(|f| f.0.as_str()).collect();
    let coasting = found.iter().map(|f| f.1).fold(f64::INFINITY, f64::min);
    Some(format!(
        "this recording cannot tell whether the drive integrates the error: it reaches what it is told (steady gain of {}), and a drive \
         with integral action fits as well. If it has none, the parameters are the robot's, and it would coast with a time constant of at least {coasting:.1} s \
         were its controller switched off: an easy test. If it has, time constants and gains are those of the closed loop: an integral action λ shows a gain of 1 and \
         a time constant of (gain − 1)/λ. Steps from one steady speed to another, fast against 1/λ, would tell, or the same drive under load: without \
         integral action the gain falls",
        gains.join(", ")
    ))
}

fn statement(axis: &AxisIntegral) -> String {
    let (input, output) = (&axis.input, &axis.output);
    match (axis.lambda, axis.lambda_ci95) {
        (Some(lambda), Some((low, high))) => format!(
            "{output} follows {input} as a drive does that integrates its error: λ = {lambda:.3} 1/s (95 % interval {low:.3} to {high:.3}), a lasting \
             error is made up for within about {:.2} s. The parameters of a model without it are not the robot's",
            1.0 / lambda
        ),
        _ => format!("no integral action is seen between {input} and {output}"),
    }
}
