//! Selection: effects are added one after the other while the evidence asks for it, and exchanged where another does better.
//!
//! The score of an addition is the extended Bayesian information criterion (Chen and Chen, Biometrika 95, 2008):
//! gain − df ln N − 2 ln(size of the library), the gain twice a log-likelihood under noise that is whitened, df by numerical rank. A
//! parameter that has a usual value counts for as much of one as the data tell more of it than that: its part of the evidence is
//! ln(1 + (spread/standard error)²), by Laplace's approximation.

use std::borrow::Cow;

use wheelwright_core::effect::{Effect, EffectParameter, Stage};

use crate::adequacy::{Jitter, jittered};
use crate::answer::always;
use crate::comparison::Comparison;
use crate::diagnose::Known;
use crate::fit::Fitted;
use crate::fit::algebra::Directions;
use crate::fit::base::renew;
use crate::fit::search::{Effort, Fit, evaluate, left, maximise};
use crate::fit::setting::{Point, Runner, Setting};
use crate::fit::whitening::Whitening;
use crate::noise::Noise;
use crate::question::DiagnosisError;
use crate::race::{Field, Refined, distinct, even};
use crate::screen::{Candidate, Current, Projected, Projection, Response, responses, responses_at};

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
    /// Its effects and one more, which stands last.
    pub(crate) fn and(&self, effect: usize) -> Vec<usize> {
        self.effects.iter().copied().chain([effect]).collect()
    }
}

/// An explanation in which another effect takes a member's place.
#[derive(Debug, Clone)]
pub(crate) struct Rival {
    /// Index of the other effect.
    pub(crate) effect: usize,
    pub(crate) state: State,
    /// By how much its penalised score is worse.
    pub(crate) gap: f64,
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
    /// Log-likelihood that a fit under the same noise gains on the base model alone.
    pub(crate) fn gained(&self, setting: &Setting<'_>, fit: &Fit) -> f64 {
        fit.likelihood(setting) - self.base.likelihood(setting)
    }
}

/// Whether noise is so coloured that a misfit could hide in it.
fn coloured(noise: &Noise) -> bool {
    noise.deviation.iter().zip(&noise.innovation).any(|(all, new)| *all > COLOURED * new)
}

/// A member's rivals, and those of the others.
fn others(selected: &mut Selected, member: usize) -> (Vec<Rival>, Vec<Vec<Rival>>) {
    let mut rivals = std::mem::take(&mut selected.rivals);
    rivals.resize(selected.state.effects.len(), Vec::new());
    (rivals.remove(member), rivals)
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
    fn joins(&self, effect: usize, members: &[usize]) -> bool {
        members.iter().all(|m| !related(self.effect(*m).family(), self.effect(effect).family()))
    }

    /// How many causes a model has: parts of one, a side or an axis each, count once.
    fn causes(&self, members: &[usize]) -> usize {
        let mut names: Vec<&str> = members.iter().map(|m| self.effect(*m).name()).collect();
        names.sort_unstable();
        names.dedup();
        names.len()
    }

    /// Raw responses of all effects that may join a model.
    pub(crate) fn respond(&self, state: &State) -> Vec<Response> {
        self.respond_of(&self.open, state)
    }

    /// The same of some of them.
    pub(crate) fn respond_of(&self, indices: &[usize], state: &State) -> Vec<Response> {
        let effects = self.effects(&state.effects);
        let current = Current::new(&self.setting, &effects, &state.fit);
        let may = |i: &&usize| self.joins(**i, &state.effects);
        let library: Vec<(usize, &dyn Effect)> = indices.iter().filter(may).map(|i| (*i, self.effect(*i))).collect();
        responses(&current, &library)
    }

    /// The effects that go round with something, if none of them was selected.
    pub(crate) fn turning(&self, selected: &Selected) -> Vec<usize> {
        let turns = |i: &usize| {
            let start = self.effect(*i).starts(self.setting.scene).into_iter().next();
            start.is_some_and(|start| self.effect(*i).turned(&start.values, 0, 0.0).is_some())
        };
        if selected.state.effects.iter().any(turns) { Vec::new() } else { self.open.iter().copied().filter(turns).collect() }
    }

    /// Whether a selection has room for no further cause, or the search is at its limit.
    pub(crate) fn full(&self, selected: &Selected) -> bool {
        self.causes(&selected.state.effects) >= MOST || self.setting.exhausted()
    }

    /// The selection with the best of some effects, if any holds its evidence beside it.
    pub(crate) fn joined(&self, selected: &Selected, responses: &[Response]) -> Option<Selected> {
        self.round(selected, responses).1
    }

    /// Responses about a model, of which `first` are those about the base model.
    fn responses_beside<'r>(&self, state: &State, selected: &Selected, first: &'r [Response]) -> Cow<'r, [Response]> {
        match state.effects.is_empty() {
            true => Cow::Borrowed(first),
            false => Cow::Owned(self.respond_again(state, &selected.whitening, first, &selected.ranking)),
        }
    }

    /// Responses about a model with effects. Those about the base model say which effects and starts are worth a look; these are
    /// simulated anew beside the effects that the model has.
    fn respond_again(&self, state: &State, whitening: &Whitening, first: &[Response], ranking: &[(usize, f64)]) -> Vec<Response> {
        let effects = self.effects(&state.effects);
        let screened = self.screen(state, whitening, first);
        let current = Current::new(&self.setting, &effects, &state.fit);
        let of = |candidates: &Vec<Candidate>| {
            let starts = candidates.iter().take(RESIMULATED.1).map(|c| first[c.response].start.clone()).collect();
            responses_at(&current, candidates[0].effect, self.effect(candidates[0].effect), starts)
        };
        // What a loop promised beside the base model says nothing of what it does beside another: it is always among them.
        let closes = |c: &Vec<Candidate>| self.effect(c[0].effect).stage() == Stage::Loop;
        let loops = screened.iter().filter(|c| closes(c)).flat_map(|c| {
            let even = self.effect(c[0].effect).starts(self.setting.scene).into_iter().filter(even).collect();
            responses_at(&current, c[0].effect, self.effect(c[0].effect), even)
        });
        // Nor does it of what has to do with what was found: what had evidence by itself is among them too.
        let open = |c: &&Vec<Candidate>| !closes(c);
        let alone = ranking.iter().filter(|(_, score)| *score > 0.0).filter_map(|(i, _)| screened.iter().find(|c| c[0].effect == *i));
        let alone: Vec<_> = alone.filter(open).filter(self.few()).take(RESIMULATED.0 / 2).collect();
        let others = |c: &&Vec<Candidate>| open(c) && alone.iter().all(|a| a[0].effect != c[0].effect);
        let beside = screened.iter().filter(others).filter(self.few()).take(RESIMULATED.0 - alone.len());
        alone.iter().copied().chain(beside).flat_map(of).chain(loops).collect()
    }

    /// Every effect of no family that the model has already, at all its starts; best effect and best start first.
    pub(crate) fn screen(&self, state: &State, whitening: &Whitening, responses: &[Response]) -> Vec<Vec<Candidate>> {
        let projection = self.projection(state, whitening);
        let mut by_effect: Vec<Vec<Candidate>> = Vec::new();
        let mut known = Projected::default();
        for (index, response) in responses.iter().enumerate().filter(|(_, r)| self.joins(r.effect, &state.effects)) {
            if by_effect.last().is_none_or(|c| c[0].effect != response.effect) {
                known = Projected::default();
            }
            let candidate = projection.candidate(index, response, &mut known);
            match by_effect.last_mut().filter(|c| c[0].effect == response.effect) {
                Some(same) => same.push(candidate),
                None => by_effect.push(vec![candidate]),
            }
        }
        by_effect.iter_mut().for_each(|c| c.sort_by(|a, b| self.value(b).total_cmp(&self.value(a))));
        by_effect.sort_by(|a, b| self.value(&b[0]).total_cmp(&self.value(&a[0])));
        by_effect
    }

    pub(crate) fn projection<'p>(&'p self, state: &'p State, whitening: &'p Whitening) -> Projection<'p, 'a> {
        Projection::new(&self.setting, whitening, &state.fit, &self.parameters(&state.effects))
    }

    fn value(&self, candidate: &Candidate) -> f64 {
        candidate.gain - candidate.freedom as f64 * self.log_values()
    }

    /// Noise as a fit leaves it.
    pub(crate) fn noise_of(&self, indices: &[usize], fit: &Fit, whitening: &Whitening) -> Option<Noise> {
        let mut runner = self.runner(indices, &fit.point)?;
        let mut residual = vec![0.0; self.setting.layout.len()];
        if !runner.run(&fit.point.x, &fit.point.starts, &mut residual) {
            return None;
        }
        residual.iter_mut().zip(&self.setting.measured).for_each(|(r, y)| *r = y - *r);
        let taken = fit.rank(&self.setting) as f64 + whitening.taken();
        Some(Noise::estimate(&residual, &self.setting.layout, taken, &self.setting.floor))
    }

    /// The fit from a point under a noise model.
    pub(crate) fn at(&self, indices: &[usize], point: Point, noise: &Noise) -> Option<(Whitening, Fit)> {
        let mut runner = self.runner(indices, &point)?;
        let mut simulated = vec![0.0; self.setting.layout.len()];
        if !runner.run(&point.x, &point.starts, &mut simulated) {
            return None;
        }
        let whitening = Whitening::new(noise.clone(), &self.setting.layout, &mut runner, &point, &simulated);
        let fit = evaluate(&self.setting, &mut runner, &whitening, &point)?;
        let fit = maximise(&self.setting, &mut runner, &whitening, fit, COMPARING, false);
        Some((whitening, fit))
    }

    /// A fit under another noise model.
    pub(crate) fn under(&self, indices: &[usize], fit: &Fit, noise: &Noise, effort: Effort) -> Option<(Whitening, Fit)> {
        let mut runner = self.runner(indices, &fit.point)?;
        renew(&self.setting, &mut runner, noise.clone(), fit, effort)
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
        selected.rivals.resize(self.fixed(&selected), Vec::new());
        for depth in 0..MOST_PARTS {
            if self.full(&selected) {
                break;
            }
            let (ranking, mut joined) = self.round(&selected, first);
            if depth == 0 {
                selected.ranking = ranking;
            }
            if joined.is_none() && coloured(&selected.whitening.noise) && !self.setting.exhausted() {
                joined = self.plainly(&selected).and_then(|plain| self.joined(&plain, first));
            }
            let Some(next) = joined else { break };
            selected = Selected { ranking: selected.ranking, ..next };
            self.contest(&mut selected, first);
        }
        Ok(selected)
    }

    /// The members after another has joined, each contested by what could stand in its place. For the newest that has just been seen; but what
    /// was seen for the first was seen beside a base model that bends to what is missing.
    fn contest(&self, selected: &mut Selected, first: &[Response]) {
        let before = selected.state.effects.clone();
        let seen = selected.rivals.pop();
        if before.len() > self.fixed(selected) + 1 {
            return self.exchange(selected, first, seen);
        }
        self.exchange(selected, first, None);
        let Some(rivals) = selected.rivals.last_mut().filter(|_| selected.state.effects == before) else { return };
        // No look at a rival is worth more than another: the one counts in which it comes nearer.
        for rival in seen.into_iter().flatten() {
            match rivals.iter_mut().find(|known| known.effect == rival.effect) {
                Some(known) if known.gap <= rival.gap => {}
                Some(known) => *known = rival,
                None => rivals.push(rival),
            }
        }
    }

    /// What every effect is worth beside a model, and the model with the best that holds its evidence under the noise it leaves: a
    /// candidate that loses it makes room for the next.
    fn round(&self, selected: &Selected, first: &[Response]) -> (Vec<(usize, f64)>, Option<Selected>) {
        let responses = self.responses_beside(&selected.state, selected, first);
        let screened = self.screen(&selected.state, &selected.whitening, &responses);
        let field = Field::open(selected.gained(&self.setting, &selected.state.fit));
        let refined = self.refine(&selected.state, &selected.whitening, &screened, &responses, &field);
        let joined = (0..refined.len().min(2)).filter(|i| refined[*i].score > 0.0).find_map(|i| self.join(selected, &refined, i));
        (self.ranking(&screened, &refined), joined)
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

    fn ranking(&self, screened: &[Vec<Candidate>], refined: &[Refined]) -> Vec<(usize, f64)> {
        let screened = screened.iter().map(|c| (c[0].effect, c[0].gain - self.penalty(c[0].freedom as f64)));
        let mut all: Vec<(usize, f64)> = refined.iter().map(|r| (r.effect, r.score)).collect();
        all.extend(screened.filter(|(e, _)| !refined.iter().any(|r| r.effect == *e)).collect::<Vec<_>>());
        all
    }

    /// Takes a candidate into the model if its evidence holds under the noise that it leaves itself. A misfit hides in the noise of
    /// the model that lacks the effect, but noise cannot hide from the model that has it.
    fn join(&self, selected: &Selected, refined: &[Refined], which: usize) -> Option<Selected> {
        let candidate = &refined[which];
        let effects = selected.state.and(candidate.effect);
        let noise = self.noise_of(&effects, &candidate.fit, &selected.whitening)?;
        let (whitening, with) = self.under(&effects, &candidate.fit, &noise, FINAL)?;
        let (_, without) = self.under(&selected.state.effects, &selected.state.fit, &noise, COMPARING)?;
        let likelihood = |f: &Fit| f.likelihood(&self.setting);
        let gain = likelihood(&with) - likelihood(&without);
        let score = gain - self.penalty(self.freedom(&effects, &with) - self.freedom(&selected.state.effects, &without));
        let base = if selected.state.effects.is_empty() { without.clone() } else { self.under(&[], &selected.base, &noise, COMPARING)?.1 };
        let explained = likelihood(&with) - likelihood(&base) - gain;
        let matters = score >= SHARE * explained || self.sizeable(&base, &without, &with, &noise);
        (score > 0.0 && matters).then(|| Selected {
            state: State { effects, fit: with },
            whitening,
            base,
            rivals: vec![self.beside(&selected.state, refined, candidate.effect, candidate.score)],
            ranking: selected.ranking.clone(),
        })
    }

    /// Whether a further effect takes a share worth naming off the misfit itself. Evidence says less of it where a misfit remains that
    /// passes for coloured noise.
    fn sizeable(&self, base: &Fit, without: &Fit, with: &Fit, noise: &Noise) -> bool {
        let [base, without, with] = [base, without, with].map(|fit| self.misfit(fit, noise));
        without - with >= SHARE * (base - without)
    }

    /// Sum of squares of what a fit leaves, outputs in units of their innovations.
    fn misfit(&self, fit: &Fit, noise: &Noise) -> f64 {
        let layout = &self.setting.layout;
        let of = |c: usize, s: usize| layout.settled(c, s).map(|k| (self.setting.measured[k] - fit.simulated[k]).powi(2)).sum::<f64>();
        let output = |c: usize| (0..layout.stretches()).map(|s| of(c, s)).sum::<f64>() / noise.innovation[c].powi(2);
        (0..layout.outputs()).map(output).sum()
    }

    /// The refined effects other than the one that was taken, as rivals of it.
    fn beside(&self, rest: &State, refined: &[Refined], taken: usize, score: f64) -> Vec<Rival> {
        let others = refined.iter().filter(|r| r.effect != taken);
        let joined = |r: &Refined| State { effects: rest.and(r.effect), fit: r.fit.clone() };
        others.map(|r| Rival { effect: r.effect, state: joined(r), gap: score - r.score }).collect()
    }

    /// How many members are known and stay.
    pub(crate) fn fixed(&self, selected: &Selected) -> usize {
        selected.state.effects.iter().take_while(|i| **i >= self.library.len()).count()
    }

    /// How the stamps jitter beside a selection, if they do.
    pub(crate) fn jitter(&self, selected: &Selected) -> Option<Jitter> {
        self.jittered(selected, |jitter, _| jitter)
    }

    fn jittered<T>(&self, selected: &Selected, ask: impl FnOnce(Jitter, &Comparison<'_>) -> T) -> Option<T> {
        let Setting { data, scene, layout, .. } = &self.setting;
        let simulated = &selected.state.fit.simulated;
        let rest = layout.series(&left(&self.setting, simulated));
        jittered(data, scene, &layout.series(simulated), rest, &selected.whitening.noise, ask)
    }

    /// The selection, contested again under noise that is louder where the robot accelerates, if stamps jitter: there scatter makes evidence
    /// for whatever acts while the robot accelerates.
    pub(crate) fn unjittered(&self, selected: Selected, first: &[Response]) -> Selected {
        let Selected { state, whitening, .. } = &selected;
        if state.effects.len() == self.fixed(&selected) {
            return selected;
        }
        let Some(factors) = self.jittered(&selected, |jitter, comparison| jitter.factors(comparison)) else { return selected };
        let residual = left(&self.setting, &state.fit.simulated);
        let noise = whitening.noise.evened(&residual, &self.setting.layout, &factors);
        let under = |effects: &[usize], fit: &Fit, effort| self.under(effects, fit, &noise, effort);
        let (Some((whitening, fit)), Some((_, base))) = (under(&state.effects, &state.fit, FINAL), under(&[], &selected.base, COMPARING))
        else {
            return selected;
        };
        let mut evened = Selected { state: State { effects: state.effects.clone(), fit }, whitening, base, ..selected };
        self.exchange(&mut evened, first, None);
        evened
    }

    /// Drops each member in turn and takes the best replacement if it gains; keeps the others as rivals. Those of the newest member need not be
    /// sought if they are known, as long as nothing else changes.
    pub(crate) fn exchange(&self, selected: &mut Selected, first: &[Response], mut newest: Option<Vec<Rival>>) {
        let fixed = self.fixed(selected);
        let mut member = fixed;
        let mut exchanged = 0;
        selected.rivals = vec![Vec::new(); fixed];
        while member < selected.state.effects.len() && !self.setting.exhausted() {
            if let Some(rivals) = newest.take_if(|_| member + 1 == selected.state.effects.len()) {
                selected.rivals.push(rivals);
                break;
            }
            let (rest, refined) = self.replacements(selected, member, first);
            let present = self.present(selected, &rest, member);
            let before = rest.fit.likelihood(&self.setting);
            let scores = self.scores(&refined, std::slice::from_ref(&present), before);
            let refined = distinct(refined, scores);
            let better = refined.first().filter(|b| b.score > present.score + EXCHANGE);
            let simpler = || refined.iter().find(|candidate| self.no_more(&present, candidate, before));
            let better = better.or_else(simpler).filter(|_| exchanged < MOST);
            let replaced = better.and_then(|best| self.replaced(selected, &rest, best));
            exchanged += usize::from(replaced.is_some());
            if let Some(next) = replaced.or_else(|| self.pruned(selected, &rest, present.score)) {
                *selected = next;
                selected.rivals = vec![Vec::new(); fixed];
                newest = None;
                member = fixed;
                continue;
            }
            selected.rivals.push(self.beside(&rest, &refined, selected.state.effects[member], present.score));
            member += 1;
        }
        selected.rivals.resize(selected.state.effects.len(), Vec::new());
    }

    /// A member as it stands beside the candidates for its place.
    fn present(&self, selected: &Selected, rest: &State, member: usize) -> Refined {
        let fit = selected.state.fit.clone();
        let (freedom, score) = self.beyond(&selected.state.effects, &fit, rest);
        Refined { effect: selected.state.effects[member], fit, freedom, score }
    }

    /// The selection without a member that the others have made superfluous: what it adds to them is not worth its parameters, or only the
    /// imperfect form of theirs.
    fn pruned(&self, selected: &Selected, rest: &State, present: f64) -> Option<Selected> {
        if selected.state.effects.len() < 2 || rest.effects.is_empty() {
            return None;
        }
        let explained = selected.gained(&self.setting, &rest.fit);
        let size = || self.sizeable(&selected.base, &rest.fit, &selected.state.fit, &selected.whitening.noise);
        if present > 0.0 && (present >= SHARE * explained || size()) {
            return None;
        }
        self.only(selected, rest)
    }

    /// The selection without members that are worth nothing once all is fitted to the end: a place was contested under other noise, or with others beside
    /// it. And what it is without each that stays.
    pub(crate) fn settled(&self, selected: Selected) -> (Selected, Vec<Option<State>>) {
        let mut selected = self.named(selected);
        let (mut member, mut rests) = (self.fixed(&selected), self.rests(&selected));
        while member < selected.state.effects.len() {
            let rest = rests[member].as_ref().filter(|rest| self.worth(&selected, rest) <= 0.0);
            match rest.and_then(|rest| self.only(&selected, rest)) {
                Some(fewer) => {
                    let (_, rivals) = others(&mut selected, member);
                    selected = Selected { rivals, ..fewer };
                    rests = self.rests(&selected);
                }
                None => member += 1,
            }
        }
        (selected, rests)
    }

    /// The selection with its members by the names of what they are: of a law that one contains, where that explains as much from where the
    /// member is. A contest may have been left before it saw that, or begun too far away.
    fn named(&self, mut selected: Selected) -> Selected {
        for member in (self.fixed(&selected)..selected.state.effects.len()).rev() {
            let Some(narrow) = self.narrowed(&selected, member) else { continue };
            let (mut own, mut rivals) = others(&mut selected, member);
            own.retain(|r| Some(&r.effect) != narrow.state.effects.last());
            // The one that came in stands last.
            rivals.push(own);
            selected = Selected { rivals, ..narrow };
        }
        selected
    }

    /// The selection with a narrower law in the place of a member, if it is all that the member is.
    fn narrowed(&self, selected: &Selected, member: usize) -> Option<Selected> {
        let wide = self.effect(selected.state.effects[member]);
        let values = &self.fitted(&selected.state).values[member];
        let name = wide.narrower(values, self.setting.scene);
        let within = |i: &&usize| {
            let narrow = self.effect(**i).name();
            narrow != wide.name() && (name == Some(narrow) || wide.contains().contains(&narrow))
        };
        let narrow: Vec<usize> = self.open.iter().filter(within).copied().collect();
        if narrow.is_empty() {
            return None;
        }
        let (rest, z) = (self.without(selected, member)?, self.unbent(&selected.state, member));
        let placed = |i: usize| {
            let start = self.as_part_of(i, wide, values);
            let starts = start.map(|values| vec![values]).or_else(|| (name == Some(self.effect(i).name())).then(|| self.starts(i)));
            self.placed(i, starts.filter(|_| self.joins(i, &rest.effects))?, &z, selected, &rest)
        };
        let best = narrow.into_iter().filter_map(placed).max_by(|a, b| a.score.total_cmp(&b.score))?;
        let state = State { effects: rest.and(best.effect), fit: best.fit };
        let narrow = self.only(selected, &state)?;
        let gain = self.gain(&narrow.state.fit, &rest);
        (self.gain(&selected.state.fit, &rest) - gain <= EXCHANGE.max(SHARE * gain)).then_some(narrow)
    }

    /// Values from which an effect may start.
    fn starts(&self, effect: usize) -> Vec<Vec<f64>> {
        self.effect(effect).starts(self.setting.scene).into_iter().map(|start| start.values).collect()
    }

    /// An effect's values as those of a wider one have them, if it has all of them.
    fn as_part_of(&self, effect: usize, wide: &dyn Effect, values: &[f64]) -> Option<Vec<f64>> {
        let whole = wide.parameters(self.setting.scene);
        let same = |p: &EffectParameter, own: &EffectParameter| p.name == own.name && (p.label.is_none() || p.label == own.label);
        let of = |own: &EffectParameter| whole.iter().zip(values).find(|(p, _)| same(p, own)).map(|(_, v)| *v);
        self.effect(effect).parameters(self.setting.scene).iter().map(of).collect()
    }

    /// Each member's rivals with those that are the same under every drive, which a race may have left behind.
    pub(crate) fn twinned(&self, selected: &mut Selected, rests: &[Option<State>]) {
        selected.rivals.resize(selected.state.effects.len(), Vec::new());
        for (member, rest) in rests.iter().enumerate().skip(self.fixed(selected)) {
            let Some(rest) = rest.as_ref().filter(|_| !self.setting.exhausted()) else { continue };
            let found = selected.state.effects[member];
            let known = |i: usize| selected.rivals[member].iter().any(|r| r.effect == i);
            let same = |i: &&usize| always(self.effect(found), self.effect(**i)).is_some() && self.joins(**i, &rest.effects) && !known(**i);
            let z = self.unbent(&selected.state, member);
            let placed = |i: &usize| self.placed(*i, self.starts(*i), &z, selected, rest);
            let twins: Vec<Refined> = self.open.iter().filter(same).filter_map(placed).collect();
            let worth = self.worth(selected, rest);
            selected.rivals[member].extend(self.beside(rest, &twins, found, worth));
        }
    }

    /// The model without each of its members.
    fn rests(&self, selected: &Selected) -> Vec<Option<State>> {
        (0..selected.state.effects.len()).map(|member| self.without(selected, member)).collect()
    }

    /// The selection with fewer members, fitted to the end under the same noise.
    pub(crate) fn only(&self, selected: &Selected, rest: &State) -> Option<Selected> {
        let (whitening, fit) = self.under(&rest.effects, &rest.fit, &selected.whitening.noise, FINAL)?;
        let state = State { effects: rest.effects.clone(), fit };
        Some(Selected { state, whitening, base: selected.base.clone(), rivals: Vec::new(), ranking: selected.ranking.clone() })
    }

    /// The model without a member, and what could take its place.
    fn replacements(&self, selected: &Selected, member: usize, first: &[Response]) -> (State, Vec<Refined>) {
        let base = || State { effects: Vec::new(), fit: selected.base.clone() };
        let Some(rest) = self.without(selected, member) else { return (base(), Vec::new()) };
        let responses = self.responses_beside(&rest, selected, first);
        let dropped = selected.state.effects[member];
        let screened = self.screen(&rest, &selected.whitening, &responses);
        let others: Vec<Vec<Candidate>> = screened.into_iter().filter(|c| c[0].effect != dropped).collect();
        let unbent = self.unbent(&selected.state, member);
        let gain = self.gain(&selected.state.fit, &rest);
        let field = Field::contest(&unbent, gain, selected.gained(&self.setting, &rest.fit));
        let refined = self.refine(&rest, &selected.whitening, &others, &responses, &field);
        (rest, refined)
    }

    /// The selection with a replacement, under the noise that it leaves.
    fn replaced(&self, selected: &Selected, rest: &State, best: &Refined) -> Option<Selected> {
        let effects = rest.and(best.effect);
        let noise = self.noise_of(&effects, &best.fit, &selected.whitening)?;
        let (whitening, fit) = self.under(&effects, &best.fit, &noise, FINAL)?;
        let (_, base) = self.under(&[], &selected.base, &noise, COMPARING)?;
        Some(Selected { state: State { effects, fit }, whitening, base, rivals: Vec::new(), ranking: selected.ranking.clone() })
    }

    /// The model without one of its effects, refitted under the same noise.
    pub(crate) fn without(&self, selected: &Selected, member: usize) -> Option<State> {
        self.keeping(selected, &|i| i != member)
    }

    /// The model with some of its effects, refitted under the same noise.
    pub(crate) fn keeping(&self, selected: &Selected, keep: &dyn Fn(usize) -> bool) -> Option<State> {
        let state = &selected.state;
        let kept: Vec<usize> = (0..state.effects.len()).filter(|i| keep(*i)).collect();
        let effects: Vec<usize> = kept.iter().map(|i| state.effects[*i]).collect();
        if effects.is_empty() {
            return Some(State { effects, fit: selected.base.clone() });
        }
        if effects.len() == state.effects.len() {
            return Some(state.clone());
        }
        let unknowns: Vec<usize> = self.unknowns(state, keep).collect();
        let x = unknowns.iter().map(|j| state.fit.point.x[*j]).collect();
        let point = Point { x, starts: state.fit.point.starts.clone() };
        let mut runner = self.runner(&effects, &point)?;
        let mut fit = evaluate(&self.setting, &mut runner, &selected.whitening, &point)?;
        fit.columns = unknowns.iter().map(|j| state.fit.columns[*j].clone()).collect();
        let fit = maximise(&self.setting, &mut runner, &selected.whitening, fit, COMPARING, true);
        Some(State { effects, fit })
    }

    /// The model's unknowns as they are beside one of its effects.
    fn unbent(&self, state: &State, member: usize) -> Vec<f64> {
        self.unknowns(state, &|i| i != member).map(|j| state.fit.point.x[j]).collect()
    }

    /// Indices of the unknowns of a model that stay if some of its effects do.
    pub(crate) fn unknowns(&self, state: &State, keep: &dyn Fn(usize) -> bool) -> impl Iterator<Item = usize> + use<> {
        let free = self.setting.free();
        let mut all: Vec<usize> = (0..free).collect();
        let mut at = free;
        for (i, index) in state.effects.iter().enumerate() {
            let n = self.effect(*index).parameters(self.setting.scene).len();
            if keep(i) {
                all.extend(at..at + n);
            }
            at += n;
        }
        all.into_iter()
    }

    /// A state in the form that others work with.
    pub(crate) fn fitted(&self, state: &State) -> Fitted<'a> {
        let free = self.setting.free();
        let x = &state.fit.point.x;
        let effects = self.effects(&state.effects);
        let mut at = free;
        let values = effects.iter().map(|e| {
            let n = e.parameters(self.setting.scene).len();
            at += n;
            x[at - n..at].to_vec()
        });
        let information = state.fit.information(&self.setting);
        let directions = Directions::of(&information);
        let (mut covariance, told) = (directions.inverse(), directions.visibility());
        (0..told.len()).filter(|j| told[*j] < TOLD).for_each(|j| covariance[(j, j)] = f64::INFINITY);
        Fitted {
            values: values.collect(),
            effects,
            free: x[..free].to_vec(),
            theta: self.setting.map.theta(&x[..free]),
            initial: state.fit.point.starts.clone(),
            simulated: self.setting.layout.series(&state.fit.simulated),
            likelihood: state.fit.likelihood(&self.setting),
            rank: directions.rank(),
            information,
            covariance,
        }
    }

    /// Penalised gain of a member on top of the others.
    pub(crate) fn worth(&self, selected: &Selected, rest: &State) -> f64 {
        self.beyond(&selected.state.effects, &selected.state.fit, rest).1
    }

    /// What a fit gains on another model under the same noise, in twice the log-likelihood.
    pub(crate) fn gain(&self, fit: &Fit, rest: &State) -> f64 {
        fit.likelihood(&self.setting) - rest.fit.likelihood(&self.setting)
    }

    /// Degrees of freedom that a model has beyond another, and its penalised gain.
    pub(crate) fn beyond(&self, effects: &[usize], fit: &Fit, rest: &State) -> (f64, f64) {
        let freedom = self.freedom(effects, fit) - self.freedom(&rest.effects, &rest.fit);
        (freedom, self.gain(fit, rest) - self.penalty(freedom))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

    use std::cell::OnceCell;

    use wheelwright_core::ModelConfig;
    use wheelwright_core::simulation::Readout;
    use wheelwright_models::VwPdConfig;

    use super::*;
    use crate::diagnose::{Surroundings, setting, surroundings};
    use crate::effects::{CommandDelay, CoulombFriction, QuadraticDrag, SensorDelay, StribeckFriction};
    use crate::fixture::{Case, NOISE, normal};
    use crate::question::Question;

    /// Hands a test a search in which the first effects of a library were selected, and nothing is known of rivals.
    fn with_selected(case: &Case, library: &[Box<dyn Effect>], members: usize, test: impl FnOnce(&Search<'_>, Selected)) {
        let (model, course) = (VwPdConfig::default().build().unwrap(), OnceCell::new());
        let question = Question::new(&*model, &case.data, library);
        let start = surroundings(setting(&question, &case.data, &case.scene, Readout::Instantaneous), &question, &course).unwrap();
        let Surroundings { search, whitening, base, .. } = start;
        let values = library[..members].iter().flat_map(|effect| effect.starts(&case.scene).remove(0).values);
        let point = Point { x: base.point.x.iter().copied().chain(values).collect(), starts: base.point.starts.clone() };
        let effects: Vec<usize> = (0..members).collect();
        let (whitening, fit) = search.at(&effects, point, &whitening.noise).unwrap();
        let state = State { effects, fit };
        test(&search, Selected { state, whitening, base, rivals: vec![Vec::new(); members], ranking: Vec::new() });
    }

    #[test]
    fn members_that_are_worth_nothing_go() {
        let library: Vec<Box<dyn Effect>> = vec![Box::new(CoulombFriction::default()), Box::new(QuadraticDrag::default())];
        with_selected(&Case::clean(5), &library, 2, |search, selected| {
            let (settled, rests) = search.settled(selected);
            assert_eq!((settled.state.effects.len(), settled.rivals.len(), rests.len()), (0, 0, 0));
        });
    }

    #[test]
    fn a_member_part_of_which_does_nothing_gets_the_name_of_what_it_is() {
        let case = Case::new(8, |_, i, y, _, random| y - [0.02, 0.0][i] * (y / 0.005).tanh() + NOISE[i] * normal(random));
        let library: Vec<Box<dyn Effect>> = vec![Box::new(StribeckFriction::default()), Box::new(CoulombFriction::default())];
        with_selected(&case, &library, 1, |search, mut selected| {
            let mut point = selected.state.fit.point.clone();
            point.x[search.setting.free() + 1] = 0.0;
            let mut runner = search.runner(&[0], &point).unwrap();
            selected.state.fit = evaluate(&search.setting, &mut runner, &selected.whitening, &point).unwrap();
            let gain = |selected: &Selected| selected.gained(&search.setting, &selected.state.fit);
            let wide = gain(&selected);
            let (settled, _) = search.settled(selected);
            assert_eq!((&settled.state.effects[..], settled.rivals.len()), (&[1][..], 1));
            assert!(wide > 30.0 && gain(&settled) > wide - EXCHANGE, "{} of {wide}", gain(&settled));
        });
    }

    #[test]
    fn what_is_the_same_under_every_drive_is_a_rival_whatever_the_race_left() {
        let mut case = Case::clean(6);
        for stretch in &mut case.data.stretches {
            stretch.outputs.iter_mut().for_each(|y| y.rotate_right(2));
        }
        let library: Vec<Box<dyn Effect>> =
            vec![Box::new(SensorDelay::default()), Box::new(QuadraticDrag::default()), Box::new(CommandDelay::default())];
        with_selected(&case, &library, 1, |search, selected| {
            let (mut selected, rests) = search.settled(selected);
            assert!((selected.state.fit.point.x[search.setting.free()] - 0.1).abs() < 0.005);
            search.twinned(&mut selected, &rests);
            let names: Vec<&str> = selected.rivals[0].iter().map(|r| search.effect(r.effect).name()).collect();
            assert_eq!(names, ["command_delay"]);
            let (gap, worth) = (selected.rivals[0][0].gap, search.worth(&selected, rests[0].as_ref().unwrap()));
            assert!(gap.abs() < SHARE * worth, "{gap} of {worth}");
        });
    }

    #[test]
    fn a_family_is_related_to_its_parts_and_they_are_not_to_each_other() {
        assert!(related("slew_limit", "slew_limit/v") && related("slew_limit/v", "slew_limit") && related("friction", "friction"));
        assert!(!related("slew_limit/v", "slew_limit/omega") && !related("friction", "slew_limit/v"));
    }
}
