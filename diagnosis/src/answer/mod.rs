//! From a finished search to what is said: findings, proof, verdict.

mod findings;
mod proof;
mod review;
mod transferred;
mod unseen;

use wheelwright_core::simulation::Readout;

use crate::decide::{Weighed, decide};
use crate::experiment::{Rivals, design};
use crate::finding::{BaseParameter, Diagnosis, Experiment, Finding, Verdict};
use crate::fit::Fitted;
use crate::fit::algebra::Directions;
use crate::fit::search::Fit;
use crate::question::{DiagnosisError, Question};
use crate::screen::Response;
use crate::select::{Search, Selected, State, TOLD};
use crate::untestable;

pub(crate) use findings::{AMBIGUOUS, MENTIONED, always, like_a_threshold, mentioned};
pub(crate) use proof::{clocks, proven};

use findings::findings;
use proof::Proven;
use review::{beyond, following, means, nowhere, numerical, review};

/// Two-sided 95 % point of the normal distribution.
const TWO_SIDED_95: f64 = 1.959_964;
/// The effect whose encoders' counts are recorded as means over the interval.
pub(crate) const COUNTED: &str = "encoder_quantisation";

/// A finished search.
pub(crate) struct Story<'a> {
    pub(crate) search: Search<'a>,
    pub(crate) selected: Selected,
    /// Responses about the rough base fit.
    pub(crate) responses: Vec<Response>,
    /// Twice the log-likelihood of the rough base fit under white noise.
    pub(crate) first: f64,
    /// Where the outputs are read as means over the interval: why.
    pub(crate) means: Option<Means>,
}

impl Story<'_> {
    /// The base model that the recording is compared with. Reading means over the interval is a part of the explanation: this one reads values
    /// at their time.
    fn compared(&self) -> &Fit {
        self.means.as_ref().map_or(&self.selected.base, |means| &means.base)
    }

    /// How that base model is read.
    fn compared_readout(&self) -> Readout {
        if self.means.is_some() { Readout::Instantaneous } else { self.search.setting.readout }
    }
}

/// What speaks for reading the outputs as means over the interval.
#[derive(Clone)]
pub(crate) struct Means {
    /// The evidence.
    pub(crate) evidence: f64,
    /// The names of what may make the outputs late where they are not read so.
    pub(crate) instead: Vec<String>,
    /// The base model of outputs that are read at their time.
    pub(crate) base: Fit,
}

/// Writes the answer; `rests` is the explanation without each of its members.
pub(crate) fn tell(
    question: &Question<'_>,
    story: Story<'_>,
    rests: &[Option<State>],
    track: Option<Finding>,
    warnings: Vec<String>,
) -> Result<Diagnosis, DiagnosisError> {
    let Story { search, selected, responses, .. } = &story;
    let setting = &search.setting;
    let noise = &selected.whitening.noise;
    let proof = Proven::new(question, &story, rests);
    let (findings, open) = findings(search, selected, rests, &proof);
    let (mut flags, location) = review(question, &story, &findings)?;
    let found = search.effects(&selected.state.effects);
    flags.extend(found.iter().zip(&findings).filter_map(|(effect, finding)| beyond(*effect, finding, setting.scene)));
    if !numerical(setting, &selected.state.fit) {
        flags.extend(following(setting, noise, &selected.base));
    }
    flags.extend(story.means.clone().map(|found| means(found, setting.scene)));
    let base_state = selected.plain();
    let screened = search.screen(&base_state, &selected.whitening, responses);
    let untestable = untestable::list(search, &screened, responses, &selected.state);
    let ranking = selected.ranking.iter().map(|(i, score)| (search.effect(*i).name().to_owned(), *score)).collect();
    let weighed = decide(Weighed {
        findings,
        track,
        flags,
        transfer: proof.transferred.transfer,
        unseen: proof.transferred.unseen,
        foreign: proof.transferred.foreign,
        warnings,
        effects: search.library,
        scene: setting.scene,
    });
    let location = if weighed.verdict == Verdict::NoMismatch { nowhere(location) } else { location };
    let next_experiment = match weighed.verdict {
        Verdict::Ambiguous if question.experiment => next_experiment(question, search, selected, &open)?,
        _ => None,
    };
    Ok(Diagnosis {
        verdict: weighed.verdict,
        headline: weighed.headline,
        effects: weighed.effects,
        partial: weighed.partial,
        location,
        fit: proof.fits,
        waterfall: proof.waterfall,
        next_experiment,
        untestable,
        base: base_parameters(search, selected),
        scene: setting.scene.clone(),
        readout: setting.readout,
        noise: noise.deviation.clone(),
        training: proof.training,
        held_out: proof.held_out,
        ranking,
        warnings: weighed.warnings,
    })
}

/// The drive that would tell the remaining explanations apart.
fn next_experiment(
    question: &Question<'_>,
    search: &Search<'_>,
    selected: &Selected,
    open: &[State],
) -> Result<Option<Experiment>, DiagnosisError> {
    let states: Vec<&State> = std::iter::once(&selected.state).chain(open).collect();
    let fits: Vec<Fitted<'_>> = states.iter().map(|s| search.fitted(s)).collect();
    let name = |s: &&State| s.effects.iter().map(|i| search.effect(*i).name()).collect::<Vec<_>>().join(" + ");
    let rivals = Rivals {
        model: search.setting.model,
        map: &search.setting.map,
        names: states.iter().map(name).collect(),
        fits: fits.iter().collect(),
        scene: search.setting.scene,
        noise: &selected.whitening.noise,
        tolerance: search.setting.tolerance,
        limits: question.limits,
        seed: question.seed,
    };
    Ok(design(&rivals)?)
}

fn base_parameters(search: &Search<'_>, selected: &Selected) -> Vec<BaseParameter> {
    let setting = &search.setting;
    let free = setting.free();
    let theta = |fit: &Fit| setting.map.theta(&fit.point.x[..free]);
    let (before, after) = (theta(&selected.base), theta(&selected.state.fit));
    let directions = Directions::of(&selected.state.fit.information(setting));
    let (covariance, told) = (directions.inverse(), directions.visibility());
    let half = |i: usize| {
        let along = &setting.map.matrix[i * free..(i + 1) * free];
        if along.iter().all(|a| *a == 0.0) || along.iter().zip(&told).any(|(a, t)| *a != 0.0 && *t < TOLD) {
            return None;
        }
        let variance: f64 =
            (0..free).flat_map(|j| (0..free).map(move |k| (j, k))).map(|(j, k)| along[j] * along[k] * covariance[(j, k)]).sum();
        Some(TWO_SIDED_95 * variance.max(0.0).sqrt())
    };
    let parameters = setting.model.parameters().iter().enumerate();
    parameters
        .map(|(i, p)| BaseParameter {
            name: p.name.clone(),
            unit: p.unit.clone(),
            before: before[i],
            after: after[i],
            ci95: half(i).map(|h| (after[i] - h, after[i] + h)),
        })
        .collect()
}
