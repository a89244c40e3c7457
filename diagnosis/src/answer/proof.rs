//! The proof: free runs over held-out data, before and after, effect by effect.

use statrs::distribution::{ChiSquared, ContinuousCDF};
use wheelwright_core::Dataset;
use wheelwright_core::effect::Scene;

use crate::finding::{Fits, Replay, Rung};
use crate::fit::setting::Setting;
use crate::holdout::{Explanation, Ground, Loss, Proof, Runs, Transfer, foreign, losses, shifted, transfer};
use crate::leeway::{Leeway, refuted};
use crate::question::Question;
use crate::select::{SHARE, Search, State};

use super::unseen::unseen;
use super::{COUNTED, MENTIONED, Story};

/// Chance with which the true parameters cost more on the training data, in twice the log-likelihood, than they may to be where held-out data have them.
const UNLUCKY: f64 = 1e-3;

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
pub(super) struct Proven {
    pub(super) fits: Fits,
    pub(super) waterfall: Vec<Rung>,
    pub(super) transfer: Transfer,
    /// Whether held-out data show motion that the training data lack.
    pub(super) foreign: bool,
    /// Another part of a cause that was found, which only the held-out data show, if that is what they lack.
    pub(super) unseen: Option<String>,
    /// Held-out fit gained by each effect when it is added last.
    pub(super) gains: Vec<Option<f64>>,
    pub(super) training: Replay,
    pub(super) held_out: Option<Replay>,
}

impl Proven {
    pub(super) fn new(question: &Question<'_>, story: &Story<'_>, rests: &[Option<State>]) -> Self {
        let Story { search, selected, .. } = story;
        let setting = &search.setting;
        let base = explanation(search, &State::plain(story.compared().clone()));
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
            unseen: None,
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
        let unknown = |(rest, without): &(&State, Proof)| {
            let with = (&selected.state, &after.simulated);
            refuted(search, with, (*rest, &without.simulated), &selected.whitening.noise, (&shifted, &scene))
        };
        let holds = |after: &[Loss]| transfer(&left[0], after, &floor) == Transfer::Holds;
        // What the leeway costs with which a state holds.
        let with_leeway = |state: &State| {
            // What parameters cost at their true values, and what the imperfect form of a law makes of them.
            let most = affordable(selected.state.fit.rank(setting)) + SHARE * selected.gained(setting, &selected.state.fit);
            let there = Leeway::new(search, state, &selected.whitening.noise).moved_within(most, &shifted, &scene)?;
            holds(&losses(&shifted, &there.simulated, noise, jitter)).then_some(there.cost)
        };
        // Leeway that saves the base model as well speaks for nothing that was added to it, unless that has to go decisively farther.
        let plain = || if selected.state.effects.is_empty() { None } else { with_leeway(&selected.plain()) };
        let saved = || with_leeway(&selected.state).is_some_and(|cost| plain().is_none_or(|farther| farther > cost + MENTIONED));
        made.transfer = match transfer(&left[0], &left[1], &floor) {
            _ if withouts.iter().flatten().any(unknown) => Transfer::Fails,
            Transfer::Fails if saved() => Transfer::Open,
            Transfer::Fails => {
                let there = unseen(search, selected, &shifted, &scene, |run| losses(&shifted, run, noise, jitter));
                made.unseen = there.filter(|there| holds(&there.losses)).map(|there| there.statement);
                if made.unseen.is_some() { Transfer::Open } else { Transfer::Fails }
            }
            as_fitted => as_fitted,
        };
        made.foreign = made.transfer != Transfer::Open && foreign(&left[1], &floor);
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
