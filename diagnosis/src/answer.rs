//! From a finished search to what is said: findings, proof, verdict.

use statrs::distribution::{ChiSquared, ContinuousCDF};
use wheelwright_core::Dataset;
use wheelwright_core::effect::{Confusion, Effect, Estimate, Scene, Stage};
use wheelwright_core::simulation::Readout;

use crate::adequacy;
use crate::decide::{Weighed, decide};
use crate::effects::digits;
use crate::experiment::{Rivals, design};
use crate::finding::Experiment;
use crate::finding::{Alternative, BaseParameter, Diagnosis, Finding, Fits, FoundParameter, Location, Replay, Rung, Verdict, settings};
use crate::fit::Fitted;
use crate::fit::algebra::Directions;
use crate::fit::search::Fit;
use crate::fit::setting::Runner;
use crate::fit::setting::Setting;
use crate::holdout::{BorneOut, Explanation, Ground, Proof, Runs, Transfer, foreign, losses, shifted, transfer};
use crate::leeway::moved;
use crate::noise::Noise;
use crate::question::{DiagnosisError, Question};
use crate::residuals::{Flag, Residuals, Series};
use crate::screen::Response;
use crate::select::{Rival, SHARE, Search, Selected, State, TOLD};
use crate::untestable;

/// Two-sided 95 % point of the normal distribution.
const TWO_SIDED_95: f64 = 1.959_964;
/// Rivals this near in penalised evidence cannot be told from what was found.
pub(crate) const AMBIGUOUS: f64 = 6.0;
/// The parameter of an effect that begins during a recording.
const BEGINS: &str = "time_s";
/// How an effect says of another that no drive tells them apart.
const ALWAYS: &str = "always";
/// Rivals up to here are mentioned.
pub(crate) const MENTIONED: f64 = 10.0;

/// Chance with which the true parameters cost more on the training data, in twice the log-likelihood, than they may to be where held-out data have them.
const UNLUCKY: f64 = 1e-3;

/// Ratio of a rest's deviation to that of its innovations above which it is no noise: its past tells fifteen sixteenths of its variance.
const SLOW: f64 = 4.0;

/// The effect whose encoders' counts are recorded as means over the interval.
const COUNTED: &str = "encoder_quantisation";

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
    /// The name of what makes the outputs late where they are not read so.
    pub(crate) instead: Option<String>,
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
    flags.extend(search.effects(&selected.state.effects).iter().zip(&findings).filter_map(|(effect, finding)| beyond(*effect, finding)));
    if !numerical(setting, &selected.state.fit) {
        flags.extend(following(setting, noise, &selected.base));
    }
    flags.extend(story.means.clone().map(|found| means(found, setting.scene)));
    let base_state = State { effects: Vec::new(), fit: selected.base.clone() };
    let screened = search.screen(&base_state, &selected.whitening, responses);
    let untestable = untestable::list(search, &screened, responses, &selected.state);
    let ranking = selected.ranking.iter().map(|(i, score)| (search.effect(*i).name().to_owned(), *score)).collect();
    let weighed = decide(Weighed {
        findings,
        track,
        flags,
        transfer: proof.transfer,
        foreign: proof.foreign,
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

/// Where noise happens to be largest is no place.
fn nowhere(location: Location) -> Location {
    Location {
        channels: location.channels.into_iter().map(|(name, _)| (name, 0.0)).collect(),
        statement: "nothing beyond noise, and so nowhere".to_owned(),
        tests: location.tests,
        ..Location::default()
    }
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

/// Outputs that are means over the interval are those of an encoder, whether or not its counts show. No drive tells the mean from the delay by
/// half a sample that it would otherwise be: they differ by what is faster than the samples.
fn means(means: Means, scene: &Scene) -> Flag {
    let Means { evidence, instead, .. } = means;
    let statement = "speeds are recorded as means over the sampling interval".to_owned();
    let because = format!(
        "always, but for what is faster than the samples: a mean over an interval is late by half of it, {} s",
        digits(0.5 * scene.scales.period)
    );
    let instead = instead.map(|name| Alternative { name, gap: evidence, because, always: true, open: false });
    let effect = Some((COUNTED.to_owned(), vec![0.0]));
    Flag { test: "means over the interval", value: evidence, threshold: 0.0, left_over: None, statement, effect, instead }
}

/// What a finding's values say that its effect does not explain: all of it is left over.
fn beyond(effect: &dyn Effect, finding: &Finding) -> Option<Flag> {
    let estimates: Vec<Estimate> = finding.parameters.iter().map(|p| Estimate { value: p.value, ci95: p.ci95 }).collect();
    let statement = effect.beyond(&estimates)?;
    Some(Flag {
        test: "values beyond the effect",
        value: 1.0,
        threshold: 0.0,
        left_over: Some(1.0),
        statement,
        effect: None,
        instead: None,
    })
}

/// A rest that hardly changes from sample to sample: motion, however well an autoregression takes it for noise.
fn following(setting: &Setting<'_>, noise: &Noise, base: &Fit) -> Option<Flag> {
    let layout = &setting.layout;
    let of = |c: usize| {
        let before: f64 = layout.output(c).map(|k| (setting.measured[k] - base.simulated[k]).powi(2)).sum::<f64>() / layout.rows() as f64;
        let slow = noise.deviation[c].powi(2) - noise.innovation[c].powi(2);
        (c, noise.deviation[c] / noise.innovation[c], (slow / before).clamp(0.0, 1.0))
    };
    let worst = (0..layout.outputs()).map(of).filter(|(_, ratio, _)| *ratio > SLOW).max_by(|a, b| a.2.total_cmp(&b.2))?;
    let (output, value, share) = worst;
    let statement = format!(
        "what is left of {} hardly changes from sample to sample: motion that these effects do not explain, not noise",
        setting.data.outputs[output].name
    );
    Some(Flag {
        test: "a rest that follows its past",
        value,
        threshold: SLOW,
        left_over: Some(share),
        statement,
        effect: None,
        instead: None,
    })
}

/// θ and effects' values of a state.
pub(crate) fn explanation<'a>(search: &Search<'a>, state: &State) -> Explanation<'a> {
    let free = search.setting.free();
    let x = &state.fit.point.x;
    Explanation { effects: search.effects(&state.effects), theta: search.setting.map.theta(&x[..free]), values: x[free..].to_vec() }
}

/// The free run of a state over other data.
pub(crate) fn proven(search: &Search<'_>, state: &State, data: &Dataset, scene: &Scene) -> Proof {
    let Setting { model, readout, .. } = search.setting;
    Ground { model, data, scene, readout }.prove(&explanation(search, state))
}

/// What free runs over training and held-out data show.
struct Proven {
    fits: Fits,
    waterfall: Vec<Rung>,
    transfer: Transfer,
    /// Whether held-out data show motion that the training data lack.
    foreign: bool,
    /// Held-out fit gained by each effect when it is added last.
    gains: Vec<Option<f64>>,
    training: Replay,
    held_out: Option<Replay>,
}

impl Proven {
    fn new(question: &Question<'_>, story: &Story<'_>, rests: &[Option<State>]) -> Self {
        let Story { search, selected, .. } = story;
        let setting = &search.setting;
        let base = explanation(search, &State { effects: Vec::new(), fit: story.compared().clone() });
        let on = |data: &Dataset, scene: &Scene, state: &State| proven(search, state, data, scene);
        let compared =
            |data: &Dataset, scene: &Scene| Ground { model: setting.model, data, scene, readout: story.compared_readout() }.prove(&base);
        let whole = setting.scene.like(question.training, question.training_headings.as_deref());
        let replay = |data: &Dataset, before: &Proof, after: &Proof| Replay {
            measured: data.clone(),
            before: before.simulated.clone(),
            after: after.simulated.clone(),
        };
        let trained = on(question.training, &whole, &selected.state);
        let training = replay(question.training, &compared(question.training, &whole), &trained);
        let mut made = Self {
            fits: Fits::default(),
            waterfall: Vec::new(),
            transfer: Transfer::Holds,
            foreign: false,
            gains: vec![None; selected.state.effects.len()],
            training,
            held_out: None,
        };
        let Some(held) = question.held_out.filter(|h| !h.stretches.is_empty()) else { return made };
        let headings = question.held_out_headings.as_deref();
        let clock = clock(question.training, held, &setting.scene.like(held, headings), |moved, scene| {
            on(moved, scene, &selected.state).error.iter().zip(&selected.whitening.noise.deviation).map(|(e, n)| e / (n * n)).sum()
        });
        let shifted = shifted(held, clock);
        let scene = setting.scene.like(&shifted, headings);
        let (before, after) = (compared(&shifted, &scene), on(&shifted, &scene, &selected.state));
        let ground = Ground { model: setting.model, data: &shifted, scene: &scene, readout: setting.readout };
        let noise = &selected.whitening.noise.deviation;
        let jitter = search.jitter(selected);
        // What was reached is possible.
        let ceiling = (0..noise.len()).map(|c| ground.ceiling(c, noise[c]).max(after.fit[c])).collect();
        let left = [&before, &after].map(|proof| losses(&shifted, &proof.simulated, noise, jitter));
        let runs = Runs { training: (question.training, &trained.simulated), held_out: (&shifted, &after.simulated), noise, jitter };
        let floor = runs.floor();
        let withouts: Vec<Option<(&State, Proof)>> = rests.iter().map(|r| r.as_ref().map(|r| (r, on(&shifted, &scene, r)))).collect();
        let refuted = |(rest, without): &(&State, Proof)| {
            let gain = search.gain(&selected.state.fit, rest);
            BorneOut::new(&selected.whitening.noise, &shifted, &after.simulated, &without.simulated, gain).refuted()
        };
        let with_leeway = || {
            let leeway = moved(search, &selected.state, &shifted, &scene, &selected.whitening.noise);
            leeway
                .filter(|there| there.cost < affordable(selected.state.fit.rank(setting)))
                .map(|there| losses(&shifted, &there.simulated, noise, jitter))
        };
        made.transfer = match transfer(&left[0], &left[1], &floor) {
            _ if withouts.iter().flatten().any(refuted) => Transfer::Fails,
            Transfer::Fails if with_leeway().is_some_and(|after| transfer(&left[0], &after, &floor) == Transfer::Holds) => Transfer::Open,
            as_fitted => as_fitted,
        };
        made.foreign = foreign(&left[1], &floor);
        made.waterfall = waterfall(story, &before, &after, &|state| on(&shifted, &scene, state).fit);
        let gained = |(_, without): &(&State, Proof)| {
            let gains: Vec<f64> = after.fit.iter().zip(&without.fit).map(|(a, b)| a - b).filter(|g| g.is_finite()).collect();
            gains.iter().sum::<f64>() / gains.len().max(1) as f64
        };
        made.gains = withouts.iter().map(|without| without.as_ref().map(gained)).collect();
        made.held_out = Some(replay(held, &before, &after));
        let narx = question.yardstick.then(|| yardstick(question, held, &base.theta)).flatten();
        made.fits = Fits { before: before.fit, after: after.fit, noise_ceiling: Some(ceiling), narx };
        made
    }
}

/// What so many parameters cost at their true values, but for bad luck: chi-squared.
fn affordable(freedom: usize) -> f64 {
    ChiSquared::new(freedom.max(1) as f64).map_or(0.0, |cost| cost.inverse_cdf(1.0 - UNLUCKY))
}

/// The time by which a held-out recording's clock is moved. One that goes on where the training data end has its clock. Of another
/// recording nobody knows whether what changed in time had happened before it, happens in it alike, or was yet to come: the likeliest
/// of the three counts, for all effects together.
fn clock(training: &Dataset, held: &Dataset, scene: &Scene, error: impl Fn(&Dataset, &Scene) -> f64) -> f64 {
    let options = clocks(training, held);
    let errors: Vec<f64> = options.iter().map(|by| if options.len() > 1 { error(&shifted(held, *by), scene) } else { 0.0 }).collect();
    options[(0..options.len()).fold(0, |best, i| if errors[i] < errors[best] { i } else { best })]
}

/// By how much a held-out recording's clock may be off from that of the training data.
pub(crate) fn clocks(training: &Dataset, held: &Dataset) -> Vec<f64> {
    let span = |d: &Dataset| {
        let first = d.stretches.iter().map(|s| s.time[0]).fold(f64::INFINITY, f64::min);
        let last = d.stretches.iter().map(|s| s.time[s.len() - 1]).fold(f64::NEG_INFINITY, f64::max);
        (first, last)
    };
    let ((first, last), (start, end)) = (span(training), span(held));
    if start >= last || end <= first { vec![0.0] } else { vec![0.0, last - start, first - end] }
}

/// Held-out fit effect by effect, the way of reading before all others.
fn waterfall(story: &Story<'_>, before: &Proof, after: &Proof, fit: &dyn Fn(&State) -> Vec<f64>) -> Vec<Rung> {
    let Story { search, selected, means, .. } = story;
    let read = means.iter().map(|_| COUNTED.to_owned());
    let reading = read.len();
    let names: Vec<String> = read.chain(selected.state.effects.iter().map(|i| search.effect(*i).name().to_owned())).collect();
    let mut rungs = vec![Rung { effects: Vec::new(), fit: before.fit.clone() }];
    for n in 1..names.len() {
        if let Some(state) = search.keeping(selected, &|i| i + reading < n) {
            rungs.push(Rung { effects: names[..n].to_vec(), fit: fit(&state) });
        }
    }
    if !names.is_empty() {
        rungs.push(Rung { effects: names, fit: after.fit.clone() });
    }
    rungs
}

fn yardstick(question: &Question<'_>, held: &Dataset, theta: &[f64]) -> Option<Vec<f64>> {
    let all = wheelwright_core::ceiling::estimate(question.model, theta, question.training, held).ok()?;
    Some(all.iter().map(|c| c.narx.unwrap_or(f64::NAN)).collect())
}

/// Estimates of all unknowns with their intervals.
fn intervals(fit: &Fit, search: &Search<'_>) -> Vec<Option<f64>> {
    let directions = Directions::of(&fit.information(&search.setting));
    let (covariance, told) = (directions.inverse(), directions.visibility());
    (0..told.len())
        .map(|j| (told[j] > TOLD && covariance[(j, j)].is_finite()).then(|| TWO_SIDED_95 * covariance[(j, j)].max(0.0).sqrt()))
        .collect()
}

/// Findings, and the explanations that could take that of the whole's place.
fn findings(search: &Search<'_>, selected: &Selected, rests: &[Option<State>], proof: &Proven) -> (Vec<Finding>, Vec<State>) {
    let mut open = Vec::new();
    let setting = &search.setting;
    let state = &selected.state;
    let halves = intervals(&state.fit, search);
    let mut at = setting.free();
    let mut all = Vec::with_capacity(state.effects.len());
    for (member, index) in state.effects.iter().enumerate() {
        let effect = search.effect(*index);
        let parameters = effect.parameters(setting.scene);
        let range = at..at + parameters.len();
        at = range.end;
        let values = state.fit.point.x[range.clone()].to_vec();
        let estimate = |(i, p): (usize, &wheelwright_core::effect::EffectParameter)| {
            let value = values[i];
            let inside = |half: f64| {
                (half < p.scale.abs().max(value.abs()) * 100.0).then(|| ((value - half).max(p.bounds.0), (value + half).min(p.bounds.1)))
            };
            Estimate { value, ci95: halves[range.start + i].and_then(inside) }
        };
        let estimates: Vec<Estimate> = parameters.iter().enumerate().map(estimate).collect();
        let rivals = selected.rivals.get(member).map_or(&[][..], Vec::as_slice);
        let known = search.known.filter(|_| *index >= search.library.len()).map(|(_, evidence)| *evidence);
        let delta_bic = known.unwrap_or_else(|| rests[member].as_ref().map_or(0.0, |rest| search.worth(selected, rest)));
        all.push(Finding {
            name: effect.name().to_owned(),
            place: effect.stage().place(),
            statement: effect.statement(&estimates, setting.scene),
            parameters: parameters
                .into_iter()
                .zip(&estimates)
                .map(|(p, e)| FoundParameter { name: p.name, value: e.value, ci95: e.ci95, unit: p.unit, label: p.label })
                .collect(),
            values,
            settings: settings(effect),
            delta_bic,
            holdout_gain: proof.gains[member],
            alternatives: alternatives(search, effect, delta_bic, rivals),
        });
        let told = |r: &&Rival| {
            all.last().is_some_and(|f: &Finding| f.alternatives.iter().any(|a| a.name == search.effect(r.effect).name() && a.open))
        };
        let near = rivals.iter().filter(|r| r.gap < reach(AMBIGUOUS, effect, search.effect(r.effect), delta_bic)).filter(told);
        open.extend(near.map(|r| r.state.clone()));
    }
    (all, open)
}

/// What the library says of two effects that look alike.
fn confusion(a: &dyn Effect, b: &dyn Effect) -> Option<&'static Confusion> {
    let declared = a.confusions().iter().find(|c| c.with == b.name());
    declared.or_else(|| b.confusions().iter().find(|c| c.with == a.name()))
}

/// The same, of effects that are one mathematics under every drive.
pub(crate) fn always(a: &dyn Effect, b: &dyn Effect) -> Option<&'static Confusion> {
    confusion(a, b).filter(|c| c.because.starts_with(ALWAYS))
}

/// How much worse a rival may be in penalised evidence for these data to leave it so open: two frictions turn over near standstill each in its own
/// way, and no model of them is exact there.
pub(crate) fn reach(least: f64, found: &dyn Effect, rival: &dyn Effect, worth: f64) -> f64 {
    let frictions = found.stage() == Stage::Bearing && found.family() == rival.family();
    if always(found, rival).is_some() || frictions { least.max(SHARE * worth) } else { least }
}

/// Rivals near enough to be mentioned, each name once. What is the same under every drive differs by what nobody recorded before the first
/// sample: it is mentioned unless that is more than the imperfect form of an effect is.
fn alternatives(search: &Search<'_>, found: &dyn Effect, worth: f64, rivals: &[Rival]) -> Vec<Alternative> {
    let mut all: Vec<Alternative> = Vec::new();
    for rival in rivals {
        let effect = search.effect(rival.effect);
        if rival.gap >= reach(MENTIONED, found, effect, worth) {
            continue;
        }
        if effect.name() == found.name() || all.iter().any(|a| a.name == effect.name()) {
            continue;
        }
        let declared = confusion(found, effect);
        let always = always(found, effect).is_some();
        let why = declared.map_or_else(|| "it explains this recording nearly as well".to_owned(), |c| c.because.to_owned());
        all.push(Alternative {
            name: effect.name().to_owned(),
            gap: rival.gap,
            always,
            open: !always && rival.gap < reach(AMBIGUOUS, found, effect, worth),
            because: if always { why } else { format!("{why}; what tells them apart is {}", effect.excitation()) },
        });
    }
    all
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

/// Whether no output leaves more than the numerical error of a free run.
fn numerical(setting: &Setting<'_>, fit: &Fit) -> bool {
    (0..setting.layout.outputs()).all(|c| {
        let left = setting.layout.output(c).map(|k| (setting.measured[k] - fit.simulated[k]).powi(2));
        left.sum::<f64>() <= setting.floor[c].powi(2) * setting.layout.counted() as f64
    })
}

/// Tests without a library on what the final model leaves, and where the base model is off.
fn review(question: &Question<'_>, story: &Story<'_>, findings: &[Finding]) -> Result<(Vec<Flag>, Location), DiagnosisError> {
    let Story { search, selected, .. } = story;
    let setting = &search.setting;
    let free = setting.free();
    let state = &selected.state;
    let (plain, base) = (Setting { readout: story.compared_readout(), ..setting.clone() }, story.compared());
    let simulate = |setting: &Setting<'_>, effects: &[usize], fit: &Fit, x: &[f64]| -> Result<Series, DiagnosisError> {
        let mut runner = Runner::new(setting, &search.effects(effects), &fit.point)?;
        let mut out = fit.simulated.clone();
        if !runner.run(x, &fit.point.starts, &mut out) {
            out.clone_from(&fit.simulated);
        }
        // What nobody recorded the cause of is no misfit.
        for c in 0..setting.layout.outputs() {
            for s in 0..setting.layout.stretches() {
                let part = setting.layout.part(c, s);
                let rows = part.start..part.start + setting.layout.unsettled(s);
                out[rows.clone()].copy_from_slice(&setting.measured[rows]);
            }
        }
        Ok(setting.layout.series(&out))
    };
    let last = simulate(setting, &state.effects, &state.fit, &state.fit.point.x)?;
    let without = simulate(&plain, &[], &state.fit, &state.fit.point.x[..free])?;
    let effects = search.effects(&state.effects);
    let mut runner = Runner::new(setting, &effects, &state.fit.point)?;
    let jacobian = (0..state.fit.point.x.len()).map(|j| setting.layout.series(&runner.column(&state.fit.point, j, &state.fit.simulated)));
    let residuals = Residuals {
        model: setting.model,
        data: setting.data,
        theta_base: setting.map.theta(&base.point.x[..free]),
        theta_final: setting.map.theta(&state.fit.point.x[..free]),
        base: simulate(&plain, &[], base, &base.point.x)?,
        last,
        noise: selected.whitening.noise.clone(),
        jacobian: jacobian.collect(),
        half_track: setting.scene.frame.half_track(),
    };
    let gain = selected.gained(setting, &state.fit);
    let times = findings.iter().flat_map(|f| &f.parameters).filter(|p| p.name == BEGINS).map(|p| p.value);
    let explained = adequacy::Explained { without: &without, since: times.min_by(f64::total_cmp), gain };
    let (flags, location) = adequacy::review(&residuals, setting.scene, &explained, question.seed)?;
    // The pattern of numerical error is nobody's physics.
    Ok((if numerical(setting, &selected.state.fit) { Vec::new() } else { flags }, location))
}
