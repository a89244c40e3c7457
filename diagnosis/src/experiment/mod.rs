//! The next experiment: a short drive whose outcome the remaining explanations foresee differently.
//!
//! Rival a's prediction of a drive u cannot be told from rival b's if b, with its parameters moved as far as the first recording
//! allows, predicts the same:
//!
//! D(a → b; u) = min over δ of ‖W (y_a(u) − y_b(u) − J_b(u) δ)‖² + δᵀ H_b δ
//!
//! with W the noise's whitening and H_b what the first recording knows of b: T-optimality (Atkinson and Fedorov, Biometrika 62,
//! 1975) with prior information. D is the expected gain in twice the log-likelihood if a is the truth. The design maximises
//! Σ ln(1 + D) over all ordered pairs: a nested rival is separable in one direction only.

mod drive;

use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand::rngs::StdRng;
use wheelwright_core::effect::{EffectSimulator, Frame, Scene};
use wheelwright_core::model::{ModelError, ParameterMap};
use wheelwright_core::profile::Limits;
use wheelwright_core::{Dataset, RegressorModel, Stretch};

use crate::finding::Experiment;
use crate::fit::Fitted;
use crate::noise::Noise;
use drive::{Drive, Envelope};

/// Lengths tried \[s\], the shortest that decides is proposed.
const LENGTHS: [f64; 5] = [8.0, 16.0, 32.0, 64.0, 128.0];
/// Expected gain in twice the log-likelihood at which a pair counts as decided: odds of e^10 to one, with the scatter of the gain itself
/// (its standard deviation is 2√D) to spare.
const DECISIVE: f64 = 40.0;
/// Random drives tried of each length, and improvements of the best one.
const PROPOSALS: usize = 30;
const REPLACEMENTS: usize = 30;
/// Difference steps in standard errors of the parameter.
const STEP: f64 = 0.1;

/// The explanations that remain, and what is known besides.
pub struct Rivals<'a> {
    /// The base model.
    pub model: &'a dyn RegressorModel,
    /// Its free parameters.
    pub map: &'a ParameterMap,
    /// Names under which the rivals are told.
    pub names: Vec<String>,
    /// Each with its effects, fitted to the same recording.
    pub fits: Vec<&'a Fitted<'a>>,
    /// The recording's scene.
    pub scene: &'a Scene,
    /// Law of its noise.
    pub noise: &'a Noise,
    /// What the robot can or may do.
    pub limits: Limits,
    /// Seed of the search.
    pub seed: u64,
}

/// Designs the drive; `None` with fewer than two rivals, or where no drive within the limits tells any of them apart.
///
/// # Errors
/// [`ModelError`] if a rival cannot be evaluated. Drives on which one diverges are passed over.
pub fn design(rivals: &Rivals<'_>) -> Result<Option<Experiment>, ModelError> {
    if rivals.fits.len() < 2 {
        return Ok(None);
    }
    let envelope = Envelope::of(rivals.model, rivals.scene, &rivals.limits);
    let mut random = StdRng::seed_from_u64(rivals.seed);
    let mut best: Option<(f64, Drive, Vec<f64>)> = None;
    for seconds in LENGTHS {
        let found = search(rivals, &envelope, seconds, &mut random)?;
        if let Some(found) = found.filter(|f| best.as_ref().is_none_or(|b| f.0 > b.0)) {
            best = Some(found);
        }
        if best.as_ref().is_some_and(|(_, _, pairs)| decided(rivals.fits.len(), pairs)) {
            break;
        }
    }
    Ok(best.filter(|(value, ..)| *value > 0.0).map(|(_, drive, pairs)| experiment(rivals, &envelope, &drive, &pairs)))
}

/// Whether every pair is told apart in one direction at least.
fn decided(n: usize, pairs: &[f64]) -> bool {
    (0..n).all(|a| (0..a).all(|b| pairs[a * n + b].max(pairs[b * n + a]) >= DECISIVE))
}

/// The best of random drives of one length, improved piece by piece: (objective, drive, D of every ordered pair).
fn search(
    rivals: &Rivals<'_>,
    envelope: &Envelope,
    seconds: f64,
    random: &mut StdRng,
) -> Result<Option<(f64, Drive, Vec<f64>)>, ModelError> {
    let mut best: Option<(f64, Drive, Vec<f64>)> = None;
    for trial in 0..PROPOSALS + REPLACEMENTS {
        let drive = match &best {
            Some((_, drive, _)) if trial >= PROPOSALS => drive.varied(envelope, random),
            _ => Drive::random(envelope, seconds, random),
        };
        let Some(pairs) = separations(rivals, &drive.rendered(envelope))? else { continue };
        let value: f64 = pairs.iter().map(|d| d.max(0.0).ln_1p()).sum();
        if best.as_ref().is_none_or(|b| value > b.0) {
            best = Some((value, drive, pairs));
        }
    }
    Ok(best)
}

/// What a rival foresees of a drive, whitened: its response, and the derivatives of it with respect to its parameters.
struct Prediction {
    response: DVector<f64>,
    jacobian: DMatrix<f64>,
}

/// D(a → b) for every ordered pair, row-major; `None` if a rival diverges.
fn separations(rivals: &Rivals<'_>, stretch: &Stretch) -> Result<Option<Vec<f64>>, ModelError> {
    let mut predictions = Vec::with_capacity(rivals.fits.len());
    for fit in &rivals.fits {
        match predict(rivals, fit, stretch) {
            Ok(prediction) => predictions.push(prediction),
            Err(ModelError::Diverged { .. }) => return Ok(None),
            Err(other) => return Err(other),
        }
    }
    let n = predictions.len();
    let mut pairs = vec![0.0; n * n];
    for (a, truth) in predictions.iter().enumerate() {
        for (b, rival) in predictions.iter().enumerate() {
            if a != b {
                pairs[a * n + b] = separation(&(&truth.response - &rival.response), rival, &rivals.fits[b].information);
            }
        }
    }
    Ok(Some(pairs))
}

/// The part of a difference that moved parameters cannot take.
fn separation(difference: &DVector<f64>, rival: &Prediction, information: &DMatrix<f64>) -> f64 {
    let total = difference.norm_squared();
    let gradient = rival.jacobian.tr_mul(difference);
    let mut curvature = rival.jacobian.tr_mul(&rival.jacobian) + information;
    // A parameter of which neither recording knows anything stays where it is.
    for i in 0..curvature.nrows() {
        let entry = curvature[(i, i)];
        curvature[(i, i)] = entry * (1.0 + 1e-9) + f64::MIN_POSITIVE;
    }
    match curvature.cholesky() {
        Some(factor) => (total - gradient.dot(&factor.solve(&gradient))).max(0.0),
        None => 0.0,
    }
}

fn predict(rivals: &Rivals<'_>, fit: &Fitted<'_>, stretch: &Stretch) -> Result<Prediction, ModelError> {
    // Effects by place take the course that the rival itself foresees.
    let mut stretch = stretch.clone();
    let mut scene = scene_of(rivals, &stretch);
    let values: Vec<f64> = fit.values.iter().flatten().copied().collect();
    let rest = vec![0.0; rivals.model.outputs().len()];
    let mut run = vec![Vec::new(); rest.len()];
    EffectSimulator::new(rivals.model, &fit.theta, &[], &scene)?.run(0, &stretch, &rest, &mut run)?;
    stretch.outputs = run;
    scene = scene_of(rivals, &stretch);
    let mut simulator = EffectSimulator::new(rivals.model, &fit.theta, &fit.effects, &scene)?;
    simulator.set_substeps(2);
    let mut whitened = |free: &[f64], values: &[f64]| -> Result<DVector<f64>, ModelError> {
        let theta = if free.is_empty() { fit.theta.clone() } else { rivals.map.theta(free) };
        simulator.set(&theta, values)?;
        let mut run = vec![Vec::new(); rest.len()];
        simulator.run(0, &stretch, &rest, &mut run)?;
        Ok(whiten(rivals.noise, run))
    };
    let response = whitened(&fit.free, &values)?;
    let mut jacobian = DMatrix::zeros(response.len(), fit.free.len() + values.len());
    for p in 0..jacobian.ncols() {
        let deviation = fit.covariance.get((p, p)).map_or(f64::NAN, |v| v.sqrt());
        let (mut free, mut moved) = (fit.free.clone(), values.clone());
        let value = if p < free.len() { &mut free[p] } else { &mut moved[p - fit.free.len()] };
        let own = value.abs().max(1e-3);
        // An undetermined parameter is moved by a share of itself.
        let step = if deviation.is_finite() && deviation > 0.0 { (STEP * deviation).min(0.1 * own) } else { 1e-2 * own };
        *value += step;
        jacobian.set_column(p, &((whitened(&free, &moved)? - &response) / step));
    }
    Ok(Prediction { response, jacobian })
}

fn scene_of(rivals: &Rivals<'_>, stretch: &Stretch) -> Scene {
    let data =
        Dataset { inputs: rivals.model.inputs().to_vec(), outputs: rivals.model.outputs().to_vec(), stretches: vec![stretch.clone()] };
    rivals.scene.like(&data, None)
}

/// All outputs, one after the other, whitened by their own past.
fn whiten(noise: &Noise, mut run: Vec<Vec<f64>>) -> DVector<f64> {
    for (i, series) in run.iter_mut().enumerate() {
        noise.whiten_output(i, series);
    }
    DVector::from_vec(run.concat())
}

/// The design in the form that is told and written.
fn experiment(rivals: &Rivals<'_>, envelope: &Envelope, drive: &Drive, pairs: &[f64]) -> Experiment {
    let stretch = drive.rendered(envelope);
    let start = stretch.time[0];
    let n = rivals.fits.len();
    let separates = (0..n)
        .flat_map(|a| (a + 1..n).map(move |b| (a, b)))
        .map(|(a, b)| (rivals.names[a].clone(), rivals.names[b].clone(), pairs[a * n + b].max(pairs[b * n + a])))
        .collect::<Vec<_>>();
    let weakest = separates.iter().map(|(_, _, d)| *d).fold(f64::INFINITY, f64::min);
    let sure = if weakest >= DECISIVE {
        "enough to decide".to_owned()
    } else {
        format!("the closest pair is then expected to differ by {weakest:.0} in twice the log-likelihood, of 40 that decide")
    };
    let reversals = match rivals.scene.frame {
        Frame::Channels => String::new(),
        _ => format!(", with {} changes of direction", changes_of_sign(&stretch.inputs[0])),
    };
    let reach: Vec<String> = rivals
        .model
        .inputs()
        .iter()
        .zip(&stretch.inputs)
        .map(|(c, u)| format!("{} up to {:.2} {}", c.name, u.iter().fold(0.0_f64, |m, x| m.max(x.abs())), c.unit))
        .collect();
    let statement = format!(
        "drive {:.0} s{reversals}, {}: it tells {} apart; {sure}",
        stretch.time[stretch.len() - 1] - start,
        reach.join(", "),
        rivals.names.join(" and "),
    );
    Experiment {
        statement,
        time: stretch.time.iter().map(|t| t - start).collect(),
        commands: rivals.model.inputs().iter().zip(stretch.inputs).map(|(c, u)| (c.name.to_string(), u)).collect(),
        separates,
    }
}

fn changes_of_sign(series: &[f64]) -> usize {
    let signs: Vec<bool> = series.iter().filter(|x| **x != 0.0).map(|x| *x > 0.0).collect();
    signs.windows(2).filter(|w| w[0] != w[1]).count()
}

#[cfg(test)]
mod tests;
