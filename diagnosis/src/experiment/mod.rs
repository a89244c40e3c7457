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
//!
//! The sums of which D is made add over segments that begin and end at rest, but for what outlives a rest. So a pool of short segments
//! is simulated, the drive is put together from it one segment after the other, and simulated as a whole before it is proposed.

mod drive;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rand::SeedableRng;
use rand::rngs::StdRng;
use wheelwright_core::effect::{EffectSimulator, Frame, Scene};
use wheelwright_core::model::{ModelError, ParameterMap};
use wheelwright_core::profile::Limits;
use wheelwright_core::{Dataset, RegressorModel, Stretch};

use crate::finding::Experiment;
use crate::fit::Fitted;
use crate::noise::Noise;
use drive::{Envelope, Segment, rendered};

/// Segments of the drives that are tried: the shortest that decides is proposed.
const SEGMENTS: [usize; 5] = [1, 2, 4, 8, 16];
/// Expected gain in twice the log-likelihood at which a pair counts as decided: odds of e^10 to one, with the scatter of the gain itself
/// (its standard deviation is 2√D) to spare.
const DECISIVE: f64 = 40.0;
/// Random segments in the pool, and variations of the best of them.
const PROPOSALS: usize = 40;
const VARIATIONS: usize = 20;
/// Difference steps in standard errors of the parameter.
const STEP: f64 = 0.1;
/// Most steps between samples.
const MOST_SUBSTEPS: usize = 4;

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
    /// Accuracy of a simulation that is worth its time, relative to the outputs' root mean square.
    pub tolerance: f64,
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
    let pool = pool(rivals, &envelope)?;
    let mut drive: Vec<&Segment> = Vec::new();
    let mut known = Knowledge::none(rivals);
    let mut best: Option<Design> = None;
    for segments in SEGMENTS {
        while drive.len() < segments {
            let added = pool.iter().map(|(segment, own)| {
                let together = known.with(own);
                (objective(&together.separations(rivals)), segment, together)
            });
            let Some((_, segment, together)) = added.max_by(|a, b| a.0.total_cmp(&b.0)) else { return Ok(None) };
            known = together;
            drive.push(segment);
        }
        let stretch = rendered(drive.iter().copied(), &envelope);
        let Some(told) = told(rivals, &stretch)? else { continue };
        let pairs = told.separations(rivals);
        let value = objective(&pairs);
        if best.as_ref().is_none_or(|b| value > b.value) {
            best = Some(Design { value, stretch, pairs });
        }
        if best.as_ref().is_some_and(|b| decided(rivals.fits.len(), &b.pairs)) {
            break;
        }
    }
    Ok(best.filter(|b| b.value > 0.0).map(|b| experiment(rivals, &b)))
}

/// A drive, and what it is expected to tell.
struct Design {
    value: f64,
    stretch: Stretch,
    /// D of every ordered pair, row-major.
    pairs: Vec<f64>,
}

/// What is maximised.
fn objective(pairs: &[f64]) -> f64 {
    pairs.iter().map(|d| d.max(0.0).ln_1p()).sum()
}

/// Whether every pair is told apart in one direction at least.
fn decided(n: usize, pairs: &[f64]) -> bool {
    (0..n).all(|a| (0..a).all(|b| pairs[a * n + b].max(pairs[b * n + a]) >= DECISIVE))
}

/// Random segments and variations of the best, with what each tells.
fn pool(rivals: &Rivals<'_>, envelope: &Envelope) -> Result<Vec<(Segment, Knowledge)>, ModelError> {
    let mut random = StdRng::seed_from_u64(rivals.seed);
    let mut pool: Vec<(Segment, Knowledge)> = Vec::with_capacity(PROPOSALS + VARIATIONS);
    let mut best: Option<(f64, usize)> = None;
    for trial in 0..PROPOSALS + VARIATIONS {
        let segment = match best {
            Some((_, i)) if trial >= PROPOSALS => pool[i].0.varied(envelope, &mut random),
            _ => Segment::random(envelope, &mut random),
        };
        let Some(told) = told(rivals, &rendered([&segment], envelope))? else { continue };
        let value = objective(&told.separations(rivals));
        if best.is_none_or(|b| value > b.0) {
            best = Some((value, pool.len()));
        }
        pool.push((segment, told));
    }
    Ok(pool)
}

/// What a drive tells of the rivals, as sums over its rows.
struct Knowledge {
    /// ‖W (y_a − y_b)‖² of every ordered pair, row-major.
    squares: Vec<f64>,
    /// J_bᵀ W (y_a − y_b) likewise.
    gradients: Vec<DVector<f64>>,
    /// J_bᵀ J_b of every rival.
    curvatures: Vec<DMatrix<f64>>,
}

impl Knowledge {
    fn none(rivals: &Rivals<'_>) -> Self {
        let unknowns: Vec<usize> = rivals.fits.iter().map(|f| f.information.nrows()).collect();
        Self {
            squares: vec![0.0; unknowns.len() * unknowns.len()],
            gradients: unknowns.iter().flat_map(|_| unknowns.iter().map(|n| DVector::zeros(*n))).collect(),
            curvatures: unknowns.iter().map(|n| DMatrix::zeros(*n, *n)).collect(),
        }
    }

    fn of(predictions: &[Prediction]) -> Self {
        let pairs = || predictions.iter().flat_map(|a| predictions.iter().map(move |b| (&a.response - &b.response, b)));
        Self {
            squares: pairs().map(|(difference, _)| difference.norm_squared()).collect(),
            gradients: pairs().map(|(difference, b)| b.jacobian.tr_mul(&difference)).collect(),
            curvatures: predictions.iter().map(|b| b.jacobian.tr_mul(&b.jacobian)).collect(),
        }
    }

    /// What both drives tell together.
    fn with(&self, other: &Self) -> Self {
        Self {
            squares: self.squares.iter().zip(&other.squares).map(|(a, b)| a + b).collect(),
            gradients: self.gradients.iter().zip(&other.gradients).map(|(a, b)| a + b).collect(),
            curvatures: self.curvatures.iter().zip(&other.curvatures).map(|(a, b)| a + b).collect(),
        }
    }

    /// D(a → b) of every ordered pair, row-major.
    fn separations(&self, rivals: &Rivals<'_>) -> Vec<f64> {
        let n = self.curvatures.len();
        let factors: Vec<_> = self.curvatures.iter().zip(&rivals.fits).map(|(own, fit)| determined(own + &fit.information)).collect();
        let separation = |i: usize| match &factors[i % n] {
            Some(factor) => (self.squares[i] - self.gradients[i].dot(&factor.solve(&self.gradients[i]))).max(0.0),
            None => 0.0,
        };
        (0..n * n).map(separation).collect()
    }
}

/// A curvature to divide by: a parameter of which neither recording knows anything stays where it is.
fn determined(mut curvature: DMatrix<f64>) -> Option<Cholesky<f64, Dyn>> {
    for i in 0..curvature.nrows() {
        let entry = curvature[(i, i)];
        curvature[(i, i)] = entry * (1.0 + 1e-9) + f64::MIN_POSITIVE;
    }
    curvature.cholesky()
}

/// What a drive tells; `None` if a rival diverges on it.
fn told(rivals: &Rivals<'_>, stretch: &Stretch) -> Result<Option<Knowledge>, ModelError> {
    let mut predictions = Vec::with_capacity(rivals.fits.len());
    for fit in &rivals.fits {
        match predict(rivals, fit, stretch) {
            Ok(prediction) => predictions.push(prediction),
            Err(ModelError::Diverged { .. }) => return Ok(None),
            Err(other) => return Err(other),
        }
    }
    Ok(Some(Knowledge::of(&predictions)))
}

/// What a rival foresees of a drive, whitened: its response, and the derivatives of it with respect to its parameters.
struct Prediction {
    response: DVector<f64>,
    jacobian: DMatrix<f64>,
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
    simulator.set_accuracy(rivals.tolerance, MOST_SUBSTEPS);
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
fn experiment(rivals: &Rivals<'_>, design: &Design) -> Experiment {
    let Design { stretch, pairs, .. } = design;
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
    // Variants of an effect share its name.
    let mut names: Vec<&str> = rivals.names.iter().map(String::as_str).collect();
    names.dedup();
    let statement = format!(
        "drive {:.0} s{reversals}, {}: it tells {} apart; {sure}",
        stretch.time[stretch.len() - 1] - start,
        reach.join(", "),
        names.join(" and "),
    );
    Experiment {
        statement,
        time: stretch.time.iter().map(|t| t - start).collect(),
        commands: rivals.model.inputs().iter().zip(&stretch.inputs).map(|(c, u)| (c.name.to_string(), u.clone())).collect(),
        separates,
    }
}

fn changes_of_sign(series: &[f64]) -> usize {
    let signs: Vec<bool> = series.iter().filter(|x| **x != 0.0).map(|x| *x > 0.0).collect();
    signs.windows(2).filter(|w| w[0] != w[1]).count()
}

#[cfg(test)]
mod tests;
