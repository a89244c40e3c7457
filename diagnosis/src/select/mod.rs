//! Selection: effects are added one after the other while the evidence asks for it, and exchanged where another does better.
//!
//! The score of an addition is the extended Bayesian information criterion (Chen and Chen, Biometrika 95, 2008):
//! gain − df ln N − 2 ln(size of the library), the gain twice a log-likelihood under noise that is whitened, df by numerical rank. A
//! parameter that has a usual value counts for as much of one as the data tell more of it than that: its part of the evidence is
//! ln(1 + (spread/standard error)²), by Laplace's approximation.

mod contest;
mod evidence;
mod look;
mod modest;
mod prompt;
mod refit;
mod settle;

use wheelwright_core::effect::{Effect, EffectParameter};

pub(crate) use self::contest::Newest;
use self::contest::of_the_last;
use crate::diagnose::Known;
use crate::fit::algebra::Directions;
use crate::fit::search::{Effort, Fit, OUT_OF_REACH, left};
use crate::fit::setting::{Point, Runner, Setting};
use crate::fit::whitening::Whitening;
use crate::noise::Noise;
use crate::question::DiagnosisError;
use crate::race::{Field, Raced, Refined};
use crate::screen::{Candidate, Response};

/// Most effects of one explanation.
const MOST: usize = 3;
/// The same where an effect is found part by part, one side or axis after the other.
const MOST_PARTS: usize = 2 * MOST;
/// Effects, and starts of each, that are simulated again beside the effects of a model.
const RESIMULATED: (usize, usize) = (24, 3);
/// Share of what the first effects explain that a further one must add: less is the imperfect form of the first.
pub(crate) const SHARE: f64 = 0.02;
/// Noise whose past tells a third of its variance could as well be motion.
const COLOURED: f64 = 1.2;
/// Share of a noise below which another is markedly less.
const QUIETER: f64 = 0.9;
/// What an exchange must gain, so that it is no toss of a coin.
pub(crate) const EXCHANGE: f64 = 2.0;

/// Share of a parameter that must lie in directions the data tell, for an interval to mean anything.
pub(crate) const TOLD: f64 = 0.9;

/// Refinement of what is reported.
pub(crate) const FINAL: Effort = Effort { trials: 20, worthwhile: 0.01, target: f64::NEG_INFINITY };
/// Refinement of a fit that only has to be compared.
pub(crate) const COMPARING: Effort = Effort { trials: 10, worthwhile: 0.1, target: f64::NEG_INFINITY };

/// A model with effects under a noise model.
#[derive(Debug, Clone)]
pub(crate) struct State {
    /// Indices in the library, in the order in which they were added.
    pub(crate) effects: Vec<usize>,
    pub(crate) fit: Fit,
}

impl State {
    /// The base model alone.
    pub(crate) const fn plain(base: Fit) -> Self {
        Self { effects: Vec::new(), fit: base }
    }

    /// Its effects and one more, which stands last.
    pub(crate) fn and(&self, effect: usize) -> Vec<usize> {
        self.effects.iter().copied().chain([effect]).collect()
    }
}

/// Unknowns of a model as they are beside a member, and what moves with them there.
pub(crate) struct Unbent {
    pub(crate) x: Vec<f64>,
    pub(crate) columns: Vec<Vec<f64>>,
}

/// An explanation in which another effect takes a member's place.
#[derive(Debug, Clone)]
pub(crate) struct Rival {
    /// Index of the other effect.
    pub(crate) effect: usize,
    pub(crate) state: State,
    /// By how much its penalised score is worse.
    pub(crate) gap: f64,
    /// What of that its further parameters cost it.
    pub(crate) cost: f64,
}

/// The search's fixed surroundings.
pub(crate) struct Search<'a> {
    pub(crate) setting: Setting<'a>,
    pub(crate) library: &'a [Box<dyn Effect>],
    /// Indices of the effects that apply.
    pub(crate) open: Vec<usize>,
    /// An effect that is known from beside the model's channels: a member from the first, behind the library in number.
    pub(crate) known: Option<&'a Known>,
}

/// What selection ended with.
#[derive(Clone)]
pub(crate) struct Selected {
    pub(crate) state: State,
    pub(crate) whitening: Whitening,
    /// The base fit under the same noise.
    pub(crate) base: Fit,
    /// By member: every effect that was fitted in its place, and by how much its penalised score is worse than the member's.
    pub(crate) rivals: Vec<Vec<Rival>>,
    /// Every effect that was screened on the base model: index, penalised gain, best first. Refined gains where they were refined.
    pub(crate) ranking: Vec<(usize, f64)>,
}

impl Selected {
    /// The base model alone.
    pub(crate) fn plain(&self) -> State {
        State::plain(self.base.clone())
    }

    /// Log-likelihood that a fit under the same noise gains on the base model alone.
    pub(crate) fn gained(&self, setting: &Setting<'_>, fit: &Fit) -> f64 {
        fit.likelihood(setting) - self.base.likelihood(setting)
    }
}

/// Whether noise is so coloured that a misfit could hide in it.
fn coloured(noise: &Noise) -> bool {
    noise.deviation.iter().zip(&noise.innovation).any(|(all, new)| *all > COLOURED * new)
}

/// Whether an output's noise is markedly less than another.
fn quieter(noise: &Noise, than: &Noise) -> bool {
    noise.deviation.iter().zip(&than.deviation).any(|(now, before)| *now < QUIETER * before)
}

/// Those that come near to a candidate: laws that contain another one too, which only loud noise may have covered.
fn near<'r>(raced: &'r Raced, candidate: &Refined) -> Vec<&'r Refined> {
    let within = |r: &&Refined| r.effect != candidate.effect && r.score > candidate.score - OUT_OF_REACH;
    raced.alone.iter().chain(&raced.covered).filter(within).collect()
}

/// Whether one family is the other or a part of it.
fn related(a: &str, b: &str) -> bool {
    a.split('/').zip(b.split('/')).all(|(a, b)| a == b)
}

impl<'a> Search<'a> {
    /// ln N, N the values that are explained.
    pub(crate) fn log_values(&self) -> f64 {
        self.setting.layout.values().ln()
    }

    /// Penalty of an addition with so many degrees of freedom.
    pub(crate) fn penalty(&self, freedom: f64) -> f64 {
        freedom.max(1.0) * self.log_values() + 2.0 * (self.open.len().max(1) as f64).ln()
    }

    /// Degrees of freedom of a model.
    pub(crate) fn freedom(&self, effects: &[usize], fit: &Fit) -> f64 {
        let directions = Directions::of(&fit.information(&self.setting));
        let (covariance, told) = (directions.inverse(), directions.visibility());
        let first = self.setting.free();
        let known = self.parameters(effects).into_iter().enumerate().filter_map(|(k, p)| p.usual.map(|(_, spread)| (first + k, spread)));
        let spare = |(j, spread): (usize, f64)| {
            let own = (spread * spread / covariance[(j, j)]).ln_1p() / self.log_values();
            if told[j] > TOLD { (1.0 - own).max(0.0) } else { 0.0 }
        };
        directions.rank() as f64 - known.map(spare).sum::<f64>()
    }

    pub(crate) fn effect(&self, index: usize) -> &'a dyn Effect {
        match self.known {
            Some((effect, _)) if index >= self.library.len() => &**effect,
            _ => &*self.library[index],
        }
    }

    pub(crate) fn effects(&self, indices: &[usize]) -> Vec<&'a dyn Effect> {
        indices.iter().map(|i| self.effect(*i)).collect()
    }

    pub(crate) fn parameters(&self, indices: &[usize]) -> Vec<EffectParameter> {
        indices.iter().flat_map(|i| self.effect(*i).parameters(self.setting.scene)).collect()
    }

    pub(crate) fn runner(&self, indices: &[usize], at: &Point) -> Option<Runner<'_, 'a>> {
        Runner::new(&self.setting, &self.effects(indices), at).ok()
    }

    /// Whether an effect may stand beside others: none of them is of its family.
    pub(crate) fn joins(&self, effect: usize, members: &[usize]) -> bool {
        members.iter().all(|m| !related(self.effect(*m).family(), self.effect(effect).family()))
    }

    /// The causes that a model has: parts of one, a side or an axis each, are one.
    pub(crate) fn names(&self, state: &State) -> Vec<&'a str> {
        let mut names: Vec<&str> = state.effects.iter().map(|m| self.effect(*m).name()).collect();
        names.sort_unstable();
        names.dedup();
        names
    }

    /// Whether a selection has room for no further cause, or the search is at its limit.
    pub(crate) fn full(&self, selected: &Selected) -> bool {
        self.names(&selected.state).len() >= MOST || self.setting.exhausted()
    }

    /// The selection with the best of some effects, if any holds its evidence beside it.
    pub(crate) fn joined(&self, selected: &Selected, responses: &[Response]) -> Option<Selected> {
        self.round(selected, responses, SHARE).1
    }

    /// The selection, of which a member goes round with a wheel, with the other wheel's as well, if that holds its evidence beside it.
    pub(crate) fn other_wheel(&self, selected: &mut Selected, about: &[Response], first: &[Response]) {
        if let Some(both) = self.joined(selected, about) {
            *selected = both;
            self.exchange(selected, first, Newest::Open);
        }
    }

    /// The selection with an effect of which the evidence may be a small share: the imperfect form of what was found, or one that is small beside it.
    pub(crate) fn joined_by_little(&self, selected: &Selected, first: &[Response]) -> Option<Selected> {
        let mut more = self.round(selected, first, 0.0).1?;
        let mut rivals = selected.rivals.clone();
        rivals.resize(selected.state.effects.len(), Vec::new());
        rivals.extend(more.rivals.pop());
        Some(Selected { rivals, ..more })
    }

    /// Adds effects to the base while they are worth it.
    pub(crate) fn run(
        &self,
        base: State,
        known: Option<State>,
        whitening: Whitening,
        first: &[Response],
    ) -> Result<Selected, DiagnosisError> {
        let mut selected =
            Selected { base: base.fit.clone(), state: known.unwrap_or(base), whitening, rivals: Vec::new(), ranking: Vec::new() };
        if self.fixed(&selected) > 0 {
            // What a known effect does passed for noise beside the base model alone.
            let renewed = self.renewed(&selected, selected.state.effects.clone(), &selected.state.fit);
            selected = renewed.unwrap_or(selected);
        }
        selected.rivals.resize(self.fixed(&selected), Vec::new());
        for depth in 0..MOST_PARTS {
            if self.full(&selected) {
                break;
            }
            let (ranking, mut joined) = self.round(&selected, first, SHARE);
            if depth == 0 {
                selected.ranking = ranking;
            }
            let hidden = joined.is_none() && coloured(&selected.whitening.noise) && !self.setting.exhausted();
            if let Some(plain) = hidden.then(|| self.plainly(&selected)).flatten() {
                joined = self.joined(&plain, first);
                if joined.is_none() {
                    selected = self.or_as_plain(selected, &plain);
                }
            }
            let Some(next) = joined else { break };
            selected = Selected { ranking: selected.ranking, ..next };
            self.contest(&mut selected, first);
        }
        self.think_over(&mut selected, first);
        self.simplify(&mut selected, first);
        Ok(selected)
    }

    /// What every effect is worth beside a model, and the model with the best that holds its evidence under the noise it leaves: a
    /// candidate that loses it makes room for the next. `share` is the least one of what the model explains that it has to add.
    fn round(&self, selected: &Selected, first: &[Response], share: f64) -> (Vec<(usize, f64)>, Option<Selected>) {
        let responses = self.responses_beside(&selected.state, selected, first);
        let screened = self.screen(&selected.state, &selected.whitening, &responses);
        let field = Field::open(share / SHARE * selected.gained(&self.setting, &selected.state.fit));
        let raced = self.refine(&selected.state, &selected.whitening, &screened, &responses, &field);
        let worthwhile = raced.alone.iter().take(2).filter(|candidate| candidate.score > 0.0);
        let joined = worthwhile.filter_map(|candidate| self.join(selected, &raced, candidate, share)).next();
        (self.ranking(&screened, &raced.alone), joined)
    }

    /// The same model under noise of no colour, for a second look: a misfit that remains passes for coloured noise, and that noise hides it.
    /// What noise really is so coloured is found out when a candidate has to hold its evidence.
    fn plainly(&self, selected: &Selected) -> Option<Selected> {
        let noise = Noise::white(&self.setting.scene.scales.outputs, &self.setting.layout);
        let effects = selected.state.effects.clone();
        let (whitening, fit) = self.under(&effects, &selected.state.fit, &noise, COMPARING)?;
        let (_, base) = self.under(&[], &selected.base, &noise, COMPARING)?;
        Some(Selected {
            state: State { effects, fit },
            whitening,
            base,
            rivals: selected.rivals.clone(),
            ranking: selected.ranking.clone(),
        })
    }

    /// A selection, or the same from the place that it has under plain noise, if it leaves less from there, each under the noise that it leaves itself: a fit
    /// may have stopped where its misfit passes for noise.
    fn or_as_plain(&self, selected: Selected, plain: &Selected) -> Selected {
        let setting = &self.setting;
        let squares = |fit: &Fit| -> f64 {
            let (rest, scales) = (left(setting, &fit.simulated), &setting.scene.scales.outputs);
            scales.iter().enumerate().map(|(c, scale)| setting.layout.output(c).map(|k| (rest[k] / scale).powi(2)).sum::<f64>()).sum()
        };
        if squares(&plain.state.fit) > (1.0 - SHARE) * squares(&selected.state.fit) {
            return selected;
        }
        let scale = |selected: &Selected| selected.whitening.noise.scale(setting.layout.counted());
        let own = |selected: &Selected| selected.state.fit.likelihood(setting) - scale(selected);
        let Some(there) = self.renewed(plain, plain.state.effects.clone(), &plain.state.fit) else { return selected };
        let Some(here) = self.renewed(&selected, selected.state.effects.clone(), &selected.state.fit) else { return selected };
        if own(&there) > own(&here) + EXCHANGE { Selected { rivals: selected.rivals, ..there } } else { selected }
    }

    fn ranking(&self, screened: &[Vec<Candidate>], refined: &[Refined]) -> Vec<(usize, f64)> {
        let screened = screened.iter().map(|c| (c[0].effect, c[0].gain - self.penalty(c[0].freedom as f64)));
        let mut all: Vec<(usize, f64)> = refined.iter().map(|r| (r.effect, r.score)).collect();
        all.extend(screened.filter(|(e, _)| !refined.iter().any(|r| r.effect == *e)).collect::<Vec<_>>());
        all
    }

    /// Takes a candidate into the model if its evidence holds under the noise that it leaves itself. A misfit hides in the noise of
    /// the model that lacks the effect, but noise cannot hide from the model that has it: nor can what tells the candidate from those that came near it,
    /// and one of them may take its place.
    fn join(&self, selected: &Selected, raced: &Raced, candidate: &Refined, share: f64) -> Option<Selected> {
        let (held, rest) = self.held(selected, raced, candidate, share)?;
        let near = if quieter(&held.whitening.noise, &selected.whitening.noise) { near(raced, candidate) } else { Vec::new() };
        let instead = self.instead(near, candidate, &held, &rest).and_then(|other| self.held(selected, raced, other, share));
        Some(instead.map_or(held, |(other, _)| other))
    }

    /// A candidate in the model, if its evidence holds there, and the model without it under the same noise.
    fn held(&self, selected: &Selected, raced: &Raced, candidate: &Refined, share: f64) -> Option<(Selected, State)> {
        let effects = selected.state.and(candidate.effect);
        let (whitening, with) = self.under_its_own(&effects, &candidate.fit, &selected.whitening, FINAL)?;
        let with = self.look_round(&effects, &whitening, with, FINAL);
        let (whitening, with) = self.quieted(&effects, whitening, with, FINAL);
        let noise = &whitening.noise;
        let (_, without) = self.under(&selected.state.effects, &selected.state.fit, noise, COMPARING)?;
        let base = if selected.state.effects.is_empty() { without.clone() } else { self.under(&[], &selected.base, noise, COMPARING)?.1 };
        let rest = State { effects: selected.state.effects.clone(), fit: without };
        let (_, score) = self.beyond(&effects, &with, &rest);
        let explained = with.likelihood(&self.setting) - base.likelihood(&self.setting) - self.gain(&with, &rest);
        let matters = score >= share * explained || self.sizeable(&base, &rest.fit, &with, noise);
        (score > 0.0 && matters).then(|| {
            let rivals = of_the_last(effects.len(), self.beside(&selected.state, &raced.alone, candidate));
            let ranking = selected.ranking.clone();
            (Selected { rivals, state: State { effects, fit: with }, whitening, base, ranking }, rest)
        })
    }

    /// One of those that came near a candidate, if it explains more under the noise that is left where that is held.
    fn instead<'r>(&self, near: Vec<&'r Refined>, candidate: &Refined, held: &Selected, rest: &State) -> Option<&'r Refined> {
        let beside = |effect: usize, fit: Fit| {
            let (freedom, score) = self.beyond(&rest.and(effect), &fit, rest);
            Refined { effect, fit, freedom, score }
        };
        let again = |rival: &'r Refined| {
            let (_, fit) = self.under(&rest.and(rival.effect), &rival.fit, &held.whitening.noise, COMPARING)?;
            Some((rival, beside(rival.effect, fit)))
        };
        let (near, others): (Vec<&Refined>, Vec<Refined>) = near.into_iter().filter_map(again).unzip();
        let present = beside(candidate.effect, held.state.fit.clone());
        let scores = self.scores(&others, std::slice::from_ref(&present), rest.fit.likelihood(&self.setting));
        let better = |(rival, score): (&'r Refined, Option<f64>)| Some((rival, score.filter(|s| *s > present.score + EXCHANGE)?));
        near.into_iter().zip(scores).filter_map(better).max_by(|a, b| a.1.total_cmp(&b.1)).map(|(rival, _)| rival)
    }

    /// Whether a member that is worth so much beside the rest is more than the imperfect form of what that explains.
    fn matters(&self, selected: &Selected, rest: &State, worth: f64) -> bool {
        let size = || self.sizeable(&selected.base, &rest.fit, &selected.state.fit, &selected.whitening.noise);
        worth >= SHARE * selected.gained(&self.setting, &rest.fit) || size()
    }

    /// Whether a further effect takes a share worth naming off the misfit itself. Evidence says less of it where a misfit remains that
    /// passes for coloured noise.
    fn sizeable(&self, base: &Fit, without: &Fit, with: &Fit, noise: &Noise) -> bool {
        let [base, without, with] = [base, without, with].map(|fit| self.misfit(fit, noise));
        without - with >= SHARE * (base - without)
    }

    /// Sum of squares of what a fit leaves, outputs in units of their innovations, rows by what their noise lets them count.
    fn misfit(&self, fit: &Fit, noise: &Noise) -> f64 {
        let layout = &self.setting.layout;
        let of = |c: usize, s: usize| {
            let first = layout.part(c, s).start;
            let left = |k: usize| noise.weights[s][c][k - first] * (self.setting.measured[k] - fit.simulated[k]);
            layout.settled(c, s).map(|k| left(k).powi(2)).sum::<f64>()
        };
        let output = |c: usize| (0..layout.stretches()).map(|s| of(c, s)).sum::<f64>() / noise.innovation[c].powi(2);
        (0..layout.outputs()).map(output).sum()
    }

    /// The refined effects other than the one that was taken, as rivals of it.
    fn beside(&self, rest: &State, refined: &[Refined], taken: &Refined) -> Vec<Rival> {
        let rival = |r: &Refined| Rival {
            effect: r.effect,
            state: State { effects: rest.and(r.effect), fit: r.fit.clone() },
            gap: taken.score - r.score,
            cost: self.penalty(r.freedom) - self.penalty(taken.freedom),
        };
        refined.iter().filter(|r| r.effect != taken.effect).map(rival).collect()
    }

    /// How many members are known and stay.
    pub(crate) fn fixed(&self, selected: &Selected) -> usize {
        selected.state.effects.iter().take_while(|i| **i >= self.library.len()).count()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

    use rand::SeedableRng;
    use rand::rngs::StdRng;

    use super::*;
    use crate::effects::{CoulombFriction, StribeckFriction};
    use crate::fixture::{Case, NOISE, THETA, TRACK, normal, with_selected};

    #[test]
    fn a_family_is_related_to_its_parts_and_they_are_not_to_each_other() {
        assert!(related("slew_limit", "slew_limit/v") && related("slew_limit/v", "slew_limit") && related("friction", "friction"));
        assert!(!related("slew_limit/v", "slew_limit/omega") && !related("friction", "slew_limit/v"));
    }

    /// A case whose wheels rub, and more so near standstill: in steps of a millisecond.
    fn rubbing() -> Case {
        const STEPS: usize = 50;
        let (mut case, mut random) = (Case::clean(6), StdRng::seed_from_u64(8));
        let rub = |s: f64| (0.03 + 0.012 * (-(s / 0.1).powi(2)).exp()) * (s / 0.003).tanh();
        for stretch in &mut case.data.stretches {
            let [mut v, mut w] = [0.0_f64; 2];
            for k in 0..stretch.time.len() {
                for (y, (x, noise)) in stretch.outputs.iter_mut().zip([(v, NOISE[0]), (w, NOISE[1])]) {
                    y[k] = x + 0.2 * noise * normal(&mut random);
                }
                for _ in 0..STEPS {
                    let [left, right] = [v - 0.5 * TRACK * w, v + 0.5 * TRACK * w].map(rub);
                    let (forward, turning) = (0.5 * (left + right), (right - left) / TRACK);
                    let (a, b) = (stretch.inputs[0][k] - forward - THETA[3] * v, stretch.inputs[1][k] - turning - THETA[5] * w);
                    v += 0.05 / STEPS as f64 * (a + THETA[2] * w * w) / THETA[0];
                    w += 0.05 / STEPS as f64 * (b - THETA[4] * v * w) / THETA[1];
                }
            }
        }
        case
    }

    /// What a misfit hides in the noise that it makes itself tells a candidate from one that came near it.
    #[test]
    fn those_that_came_near_are_asked_again_under_the_noise_that_is_left() {
        let library: Vec<Box<dyn Effect>> = vec![Box::new(CoulombFriction::default()), Box::new(StribeckFriction::default())];
        with_selected(&rubbing(), &library, 0, |search, plain| {
            let (whitening, fit) = search.under_its_own(&[], &plain.base, &plain.whitening, COMPARING).unwrap();
            let selected = Selected { base: fit.clone(), state: State::plain(fit), whitening, ..plain };
            let refined = |effect: usize, values: &[f64], score: f64| {
                let Point { x, starts } = selected.base.point.clone();
                let fit = search.at(&[effect], Point { x: [&x, values].concat(), starts }, &selected.whitening.noise).unwrap().1;
                Refined { effect, fit, freedom: 2.0, score }
            };
            for (behind, taken) in [(10.0, 1), (2.0 * OUT_OF_REACH, 0)] {
                let covered = vec![refined(1, &[0.03, 0.012, 0.08, 1.0], 1000.0 - behind)];
                let raced = Raced { alone: vec![refined(0, &[0.03, 1.0], 1000.0)], covered };
                let joined = search.join(&selected, &raced, &raced.alone[0], SHARE).unwrap();
                assert_eq!(joined.state.effects, [taken], "{behind}");
            }
        });
    }
}
