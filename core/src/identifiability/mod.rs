//! Before the fit: which parameters a recording can tell, how well, and which motion is missing for the others.
//!
//! A parameter is as well known as the free run is sensitive to it against the noise. A quick free-run fit gives the noise of each
//! output, with its colour, and the sensitivities; from them follow the standard errors that the planned fit will have. They are
//! held against two sizes: the value itself, and the size at which the parameter's term alone would take the largest command in
//! the recording. The regressor itself says which channels a term is made of, so that the missing motion can be named.
//! `docs/evidence.md` gives the definitions and where the thresholds come from.

mod excitation;
mod foresight;
mod sampling;
pub(crate) mod term;
#[cfg(test)]
pub(crate) mod tests;

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use crate::dataset::Dataset;
use crate::local::{self, Local};
use crate::model::{ParameterMap, RegressorModel};
use crate::noise::Autoregression;
use crate::solver::SolveError;
pub use excitation::{ChannelFacts, Excitation, PairFacts};
pub use foresight::{Foresight, foresee};
pub use sampling::{Rate, Sampling};
use term::Term;

/// Half the width of a 95 % interval in standard errors.
const HALF_WIDTH: f64 = 1.96;
/// An interval wider than ± this share of the value is weak, unless the parameter matters little.
const WEAK_OF_VALUE: f64 = 0.5;
/// A parameter known to ± this share of its plausible size is known, however near zero it lies.
const KNOWN_OF_PLAUSIBLE: f64 = 0.1;
/// Singular values below this share of the largest are rounding of the sensitivities.
const RANK: f64 = 1e-7;
/// Share of a parameter's own direction that lies in directions the data do not show, from which on it is not identifiable.
const SHARE: f64 = 0.05;
/// Correlation from which on two parameters are said to act alike.
const ALIKE: f64 = 0.9;

/// Whether a recording can tell a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Verdict {
    /// Its 95 % interval will be narrower than ±50 % of its value, or than ±10 % of its plausible size.
    Identifiable,
    /// Wider than that, but narrower than its value or its plausible size.
    Weak,
    /// The data do not show it, or leave it free within more than its value and its plausible size.
    Not,
    /// A constraint gives its value; nothing is left to identify.
    Fixed,
}

/// One parameter judged.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Judgement {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// The verdict.
    pub verdict: Verdict,
    /// Quick estimate, about which everything was evaluated.
    pub value: f64,
    /// Standard error that a free-run fit of this recording will have; `None` where the data do not show the parameter at all.
    pub predicted_std: Option<f64>,
    /// Value at which the parameter's term alone would take the largest command in the recording.
    pub plausible: f64,
    /// The parameter that acts most alike, and the correlation of the two estimates.
    pub alike: Option<(String, f64)>,
    /// The verdict's reason, in words that tell which motion is missing.
    pub reason: String,
}

/// A recording judged before the fit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Identifiability {
    /// One entry a parameter, in the model's order.
    pub parameters: Vec<Judgement>,
    /// Largest over smallest singular value of the sensitivities, columns scaled to norm one; `None` if the smallest is rounding.
    pub condition: Option<f64>,
    /// Standard deviation of each output about the quick fit: its noise, and whatever the model leaves out.
    pub noise: Vec<f64>,
    /// The motions in the recording.
    pub excitation: Excitation,
    /// The sampling rate judged; `None` where the time constants are not identifiable themselves.
    pub sampling: Option<Sampling>,
}

impl Identifiability {
    /// A sentence for each parameter that is not plainly identifiable, and one on the sampling rate if it is not adequate.
    pub fn concerns(&self) -> Vec<String> {
        let doubtful = |j: &&Judgement| matches!(j.verdict, Verdict::Weak | Verdict::Not);
        let parameters = self.parameters.iter().filter(doubtful).map(Judgement::statement);
        let sampling = self.sampling.iter().filter(|s| s.rate != Rate::Adequate).map(|s| s.statement.clone());
        parameters.chain(sampling).collect()
    }
}

impl Judgement {
    /// Verdict and reason in one sentence.
    pub fn statement(&self) -> String {
        let verdict = match self.verdict {
            Verdict::Identifiable => "is identifiable",
            Verdict::Weak => "is weakly identifiable",
            Verdict::Not => "is not identifiable",
            Verdict::Fixed => "is fixed",
        };
        format!("{} {verdict}: {}", self.name, self.reason)
    }
}

/// Judges what a free-run fit of `data` can tell of each parameter.
///
/// `theta` is where to judge; without one a quick free-run fit finds it.
///
/// # Errors
/// [`SolveError`] if there are too few samples, or no parameters near the quick estimate with which the model can be simulated.
pub fn assess(
    model: &dyn RegressorModel,
    map: &ParameterMap,
    theta: Option<&[f64]>,
    data: &Dataset,
) -> Result<Identifiability, SolveError> {
    let (run, point, sigma) = match theta {
        None => local::quick_fit(model, map, data, Vec::new())?,
        Some(theta) => local::about(model, map, theta, data)?,
    };
    let local = run.linearise(&point, &sigma)?;
    let ar = local.autoregressions(sigma.len());
    let theta = map.theta(&point.z);
    // What a channel does is told from what its neighbouring samples cannot foresee, not from what the model leaves out.
    let unforeseen: Vec<f64> = sigma.iter().zip(&ar).map(|(s, a)| s * a.innovation.sqrt()).collect();
    let excitation = Excitation::of(data, &unforeseen);
    let information = Information::of(&local, map, &ar);
    let sizes = local::plausible(model, data, &theta);
    let judge = |j: usize| judge(model, map, &information, &excitation, (theta[j], sizes[j]), j);
    let parameters: Vec<Judgement> = (0..theta.len()).map(judge).collect();
    let lags_known = (0..theta.len()).all(|j| parameters[j].verdict != Verdict::Not || Term::of(model, j).accelerations.is_empty());
    let samples = data.samples();
    let independent = ar.iter().map(|a| a.effective_samples(samples) / samples as f64).fold(1.0, f64::min);
    let sampling = if lags_known { sampling::judge(model, &theta, data, independent) } else { None };
    Ok(Identifiability { parameters, condition: information.condition, noise: sigma, excitation, sampling })
}

/// What the sensitivities say of θ.
struct Information {
    /// Covariance of θ without the directions that the data do not show.
    covariance: DMatrix<f64>,
    /// Share of each parameter that lies in those directions.
    hidden: Vec<f64>,
    /// The directions themselves, in θ, scaled so that the largest share is one.
    null: Vec<DVector<f64>>,
    condition: Option<f64>,
}

impl Information {
    fn of(local: &Local, map: &ParameterMap, ar: &[Autoregression]) -> Self {
        let (parameters, free) = (map.offset.len(), map.free.len());
        let transform = DMatrix::from_row_slice(parameters, free, &map.matrix);
        let covariance = &transform * local.covariance(ar) * transform.transpose();
        if free == 0 {
            return Self { covariance, hidden: vec![0.0; parameters], null: Vec::new(), condition: None };
        }
        let (scale, values, vectors) = local.directions();
        // Each free parameter in units in which its column has norm one; an invisible one has none and is its own direction.
        let unit = |j: usize| if scale[j] > 0.0 { 1.0 / scale[j] } else { 1.0 };
        let scaled = DMatrix::from_fn(parameters, free, |p, j| transform[(p, j)] * unit(j));
        let whole: Vec<f64> = scaled.row_iter().map(|r| r.norm()).collect();
        let mut hidden = vec![0.0_f64; parameters];
        let mut null = Vec::new();
        for (_, v) in values.iter().zip(vectors.row_iter()).filter(|(s, _)| **s <= RANK * values[0] || values[0] == 0.0) {
            let direction = &scaled * v.transpose();
            let shares = DVector::from_fn(parameters, |p, _| if whole[p] > 0.0 { direction[p] / whole[p] } else { 0.0 });
            hidden.iter_mut().zip(shares.iter()).for_each(|(h, s)| *h = h.max(s.abs()));
            null.push(shares);
        }
        let (first, last) = (values[0], values[free - 1]);
        Self { covariance, hidden, null, condition: (last > RANK * first).then(|| first / last) }
    }

    /// The other parameter that acts most like this one, with the correlation of their estimates.
    fn alike(&self, j: usize) -> Option<(usize, f64)> {
        let n = self.hidden.len();
        let others = (0..n).filter(|i| *i != j);
        if self.hidden[j] > SHARE {
            let together = |i: usize| self.null.iter().map(|v| if v[j].abs() > SHARE { v[i].abs() } else { 0.0 }).fold(0.0, f64::max);
            let partner = others.filter(|i| together(*i) > SHARE).max_by(|a, b| together(*a).total_cmp(&together(*b)))?;
            return Some((partner, 1.0));
        }
        let c = &self.covariance;
        let correlation = |i: usize| c[(i, j)] / (c[(i, i)] * c[(j, j)]).sqrt();
        let finite = others.filter(|i| correlation(*i).is_finite());
        finite.max_by(|a, b| correlation(*a).abs().total_cmp(&correlation(*b).abs())).map(|i| (i, correlation(i)))
    }
}

fn judge(
    model: &dyn RegressorModel,
    map: &ParameterMap,
    information: &Information,
    excitation: &Excitation,
    (value, plausible): (f64, f64),
    j: usize,
) -> Judgement {
    let parameter = &model.parameters()[j];
    let (name, unit) = (parameter.name.clone(), parameter.unit.clone());
    let free = map.free.len();
    if map.matrix[j * free..(j + 1) * free].iter().all(|t| *t == 0.0) {
        let reason = "its value is given".to_owned();
        return Judgement { name, unit, verdict: Verdict::Fixed, value, predicted_std: Some(0.0), plausible, alike: None, reason };
    }
    let shown = information.hidden[j] <= SHARE;
    let std = information.covariance[(j, j)].max(0.0).sqrt();
    let half = HALF_WIDTH * std;
    let verdict = match half {
        _ if !shown => Verdict::Not,
        h if h >= value.abs().max(plausible) => Verdict::Not,
        h if h > WEAK_OF_VALUE * value.abs() && h > KNOWN_OF_PLAUSIBLE * plausible => Verdict::Weak,
        _ => Verdict::Identifiable,
    };
    let alike = information.alike(j);
    let partner = alike.filter(|(_, r)| r.abs() >= ALIKE).map(|(i, _)| model.parameters()[i].name.as_str());
    let width = if !shown {
        None
    } else if half <= value.abs() {
        let share = 100.0 * half / value.abs();
        Some(if share < 0.1 { "95 % interval below ±0.1 %".to_owned() } else { format!("95 % interval of about ±{share:.1} %") })
    } else {
        let of = if unit == "1" { String::new() } else { format!(" {unit}") };
        // Two digits of the half-width.
        let decimals = (1.0 - half.log10().floor()).clamp(0.0, 9.0) as usize;
        Some(format!("{value:.decimals$} ± {half:.decimals$}{of}, which includes zero"))
    };
    let reason = match verdict {
        Verdict::Identifiable => width.unwrap_or_default(),
        _ => {
            let mut why = match (excitation.missing(&Term::of(model, j)), partner) {
                (Some(missing), _) => missing,
                (None, Some(partner)) => format!("this drive cannot tell it from {partner}"),
                (None, None) if shown => "too little of the motion that shows it, for this noise and length".to_owned(),
                (None, None) => "nothing in this recording depends on it".to_owned(),
            };
            why.push_str(&format!("; {name} needs {}", parameter.excitation));
            width.map_or(why.clone(), |w| format!("{why} ({w})"))
        }
    };
    let alike = alike.map(|(i, r)| (model.parameters()[i].name.clone(), r));
    Judgement { name, unit, verdict, value, predicted_std: shown.then_some(std), plausible, alike, reason }
}
