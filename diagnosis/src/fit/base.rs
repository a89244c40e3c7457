//! The fit of the base model alone: from a rough start, or about parameters that are held.

use super::search::{Effort, Fit, evaluate, linearise, maximise, settled};
use super::setting::{Runner, Setting};
use super::whitening::Whitening;
use crate::noise::Noise;
use crate::question::{DiagnosisError, Question};

/// Alternations between fit and noise level.
const ROUNDS: usize = 2;

/// Fits the base model under white noise whose level is what the fit leaves.
pub(crate) fn fit(setting: &mut Setting<'_>, question: &Question<'_>) -> Result<Fit, DiagnosisError> {
    let mut starts: Vec<Vec<f64>> = Vec::new();
    if setting.free() == 0 {
        starts.push(Vec::new());
    } else {
        if let Some(theta) = &question.theta {
            starts.extend(free_of(setting, theta));
        }
        match wheelwright_core::start::rough(setting.model, &setting.map, setting.data) {
            Ok(z) => {
                setting.rough = Some(within(setting, z.clone()));
                starts.push(z);
            }
            Err(error) if starts.is_empty() => return Err(error.into()),
            Err(_) => {}
        }
    }
    let best = best_from(setting, &starts).or_else(|| best_from(setting, &tamed(&starts)));
    let fit = best.ok_or_else(|| DiagnosisError::NoStart("its free run leaves the range of numbers".to_owned()))?;
    if setting.free() > 0 {
        let free = fit.point.x.clone();
        setting.measure(&free);
    }
    Ok(fit)
}

/// The starts with each parameter in turn at nothing: a regression of motion that the model lacks can put a coupling of outputs beyond
/// stability, and without it the run is tame.
pub(super) fn tamed(starts: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let without = |start: &[f64], j: usize| start.iter().enumerate().map(|(i, z)| if i == j { 0.0 } else { *z }).collect();
    starts.iter().flat_map(|start| (0..start.len()).map(move |j| without(start, j))).collect()
}

/// The likeliest fit from several starts; none if the model cannot be simulated from any.
pub(super) fn best_from(setting: &mut Setting<'_>, starts: &[Vec<f64>]) -> Option<Fit> {
    let mut best: Option<(f64, Fit)> = None;
    for z in starts {
        let z = within(setting, z.clone());
        let Some(fit) = from(setting, z) else { continue };
        let likelihood = fit.likelihood(setting);
        if best.as_ref().is_none_or(|(b, _)| likelihood > *b) {
            best = Some((likelihood, fit));
        }
    }
    best.map(|(_, fit)| fit)
}

/// The fit from one start, noise white; its likelihood is comparable with that of other starts.
fn from(setting: &mut Setting<'_>, z: Vec<f64>) -> Option<Fit> {
    setting.measure(&z);
    let mut fit: Option<Fit> = None;
    let mut point = setting.point(z);
    for round in 0..ROUNDS {
        let mut runner = Runner::new(setting, &[], &point).ok()?;
        let mut simulated = vec![0.0; setting.layout.len()];
        if !runner.run(&point.x, &point.starts, &mut simulated) {
            return None;
        }
        let unit = Noise::white(&setting.scene.scales.outputs, &setting.layout);
        let whitening = Whitening::new(unit, &setting.layout, &mut runner, &point);
        let first = evaluate(setting, &mut runner, &whitening, &point)?;
        let effort = Effort { trials: 25, worthwhile: if round == 0 { 1.0 } else { 0.02 }, target: f64::NEG_INFINITY };
        let found = maximise(setting, &mut runner, &whitening, first, effort, false);
        let found = settled(setting, &mut runner, &whitening, found);
        point = found.point.clone();
        setting.substeps = runner.substeps();
        fit = Some(found);
    }
    fit
}

/// Everything of a fit under another noise model: residual and columns, starts settled, improved from where it was.
pub(crate) fn renew(
    setting: &Setting<'_>,
    runner: &mut Runner<'_, '_>,
    noise: Noise,
    fit: &Fit,
    effort: Effort,
) -> Option<(Whitening, Fit)> {
    let whitening = Whitening::new(noise, &setting.layout, runner, &fit.point);
    let mut next = evaluate(setting, runner, &whitening, &fit.point)?;
    let unknowns = next.point.x.len();
    linearise(runner, &whitening, &mut next, 0..unknowns);
    let next = maximise(setting, runner, &whitening, next, effort, true);
    let next = settled(setting, runner, &whitening, next);
    Some((whitening, next))
}

/// Free parameters nearest to given θ.
fn free_of(setting: &Setting<'_>, theta: &[f64]) -> Option<Vec<f64>> {
    let free = setting.free();
    if theta.len() != setting.map.offset.len() {
        return None;
    }
    let t = nalgebra::DMatrix::from_row_slice(theta.len(), free, &setting.map.matrix);
    let right = nalgebra::DVector::from_fn(theta.len(), |i, _| theta[i] - setting.map.offset[i]);
    t.svd(true, true).solve(&right, 1e-12).ok().map(|z| z.as_slice().to_vec())
}

/// A start within the bounds: the step of no length that the limits allow.
fn within(setting: &Setting<'_>, z: Vec<f64>) -> Vec<f64> {
    use nalgebra::{DMatrix, DVector};
    use wheelwright_core::least_squares::{Factor, constrained_step};
    let limits = setting.limits(&[]);
    let n = z.len();
    let at = DVector::from_column_slice(&z);
    if n == 0 || (&limits.g * &at).iter().zip(limits.h.iter()).all(|(g, h)| g >= h) {
        return z;
    }
    let unit = Factor { r: DMatrix::identity(n, n), q: DVector::zeros(n), rest: 0.0 };
    match constrained_step(&unit, None, &at, &limits) {
        Ok(step) => (at + step).as_slice().to_vec(),
        Err(_) => z,
    }
}
