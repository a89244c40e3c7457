//! The proof: free runs over held-out data, before and after, effect by effect.

use wheelwright_core::Dataset;
use wheelwright_core::effect::Scene;

use crate::finding::{Fits, Replay, Rung};
use crate::fit::setting::Setting;
use crate::holdout::{Explanation, Ground, Proof, Run, Runs, Transfer, shifted};
use crate::question::Question;
use crate::residuals::Series;
use crate::select::{Search, State};

use super::transferred::{There, Transferred};
use super::{COUNTED, Story};

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
    pub(super) transferred: Transferred,
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
            transferred: Transferred { transfer: Transfer::Holds, foreign: false, unseen: None },
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
        let held_out = |simulated| Run { data: &shifted, scene: &scene, simulated };
        let left = held_out(&before.simulated).losses(noise, jitter);
        let noise = &selected.whitening.noise;
        let training_run = Run { data: question.training, scene: &whole, simulated: &trained.simulated };
        let runs = Runs { training: training_run, held_out: held_out(&after.simulated), noise, jitter };
        let withouts: Vec<Option<(&State, Proof)>> = rests.iter().map(|r| r.as_ref().map(|r| (r, on(&shifted, &scene, r)))).collect();
        let there = There { search, selected, data: &shifted, scene: &scene, jitter, before: left, floor: runs.floor() };
        let runs: Vec<(&State, &Series)> = withouts.iter().flatten().map(|(rest, without)| (*rest, &without.simulated)).collect();
        made.transferred = there.weigh(&after.simulated, &runs);
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
