//! Selection: effects are added one after the other while the evidence asks for it, and exchanged where another does better.
//!
//! The score of an addition is the extended Bayesian information criterion (Chen and Chen, Biometrika 95, 2008):
//! gain − df ln N − 2 ln(size of the library), the gain twice a log-likelihood under noise that is whitened, df by numerical rank.

use wheelwright_core::effect::{Effect, EffectParameter, Stage, Start};

use crate::diagnose::Known;
use crate::fit::Fitted;
use crate::fit::algebra::Directions;
use crate::fit::base::renew;
use crate::fit::search::{Effort, Fit, evaluate, linearise, maximise};
use crate::fit::setting::{Point, Runner, Setting};
use crate::fit::whitening::Whitening;
use crate::noise::Noise;
use crate::question::DiagnosisError;
use crate::screen::{Candidate, Current, Projected, Projection, Response, responses, responses_at};

/// Most effects of one explanation.
const MOST: usize = 3;
/// The same where an effect is found part by part, one side or axis after the other.
const MOST_PARTS: usize = 2 * MOST;
/// Effects, and starts of each, that are simulated again beside the effects of a model.
const RESIMULATED: (usize, usize) = (12, 3);
/// Effects that enter the race after screening.
const ENTRANTS: usize = 20;
/// Rounds of the race: steps, and effects that go on after them. Six finish: the prototype of this method found the truth among so many
/// always.
const RACE: [(usize, usize); 2] = [(3, 10), (5, 6)];
/// The same where a member's place is contested: what could replace it has been seen before.
const CONTEST: [(usize, usize); 2] = [(3, 5), (5, 3)];
/// Effects that enter that race.
const CONTESTANTS: usize = 8;
/// Starts of an effect that are tried beside the parameters of the regression.
const UNBENT: usize = 6;
/// How much coarser the race is stepped than the fit that counts: the error of a step of second order is then still a sixth of the noise.
const COARSE: usize = 4;
/// Variants of one effect that may go on together.
const VARIANTS: usize = 2;
/// Linearised gain below which no refinement makes evidence: a free parameter gains one by chance.
const HOPELESS: f64 = 4.0;
/// Share of what the first effects explain that a further one must add: less is the imperfect form of the first.
const SHARE: f64 = 0.02;
/// Noise whose past tells a third of its variance could as well be motion.
const COLOURED: f64 = 1.2;
/// What an exchange must gain, so that it is no toss of a coin.
const EXCHANGE: f64 = 2.0;

/// Share of a parameter that must lie in directions the data tell, for an interval to mean anything.
pub(crate) const TOLD: f64 = 0.9;

/// Refinement of a candidate: enough to rank it.
const RANKING: Effort = Effort { trials: 14, worthwhile: 0.5, target: f64::NEG_INFINITY };
/// How often a detour may lead on.
const DETOURS: usize = 4;
/// Refinement of what is reported.
pub(crate) const FINAL: Effort = Effort { trials: 20, worthwhile: 0.01, target: f64::NEG_INFINITY };
/// Refinement of a fit that only has to be compared.
const COMPARING: Effort = Effort { trials: 10, worthwhile: 0.1, target: f64::NEG_INFINITY };

/// A model with effects under a noise model.
#[derive(Debug, Clone)]
pub(crate) struct State {
    /// Indices in the library, in the order in which they were added.
    pub(crate) effects: Vec<usize>,
    pub(crate) fit: Fit,
}

/// A refined candidate.
#[derive(Debug, Clone)]
pub(crate) struct Refined {
    pub(crate) effect: usize,
    pub(crate) fit: Fit,
    /// Penalised gain over the model it was added to.
    pub(crate) score: f64,
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

/// Who races, and how.
struct Field<'f> {
    /// Most effects that enter.
    entrants: usize,
    /// Rounds: steps, and effects that go on after them.
    race: [(usize, usize); 2],
    /// The model's unknowns as they are beside an effect whose place is contested: without it they bend to what it did.
    unbent: Option<&'f [f64]>,
}

/// Any effect, beside a model as it is.
const OPEN: Field<'static> = Field { entrants: ENTRANTS, race: RACE, unbent: None };

/// An effect on its way to the end of its fit.
struct Racing<'s, 'a> {
    effect: usize,
    name: &'a str,
    runner: Runner<'s, 'a>,
    fit: Fit,
    /// Twice the log-likelihood less what the effect's parameters cost.
    value: f64,
}

impl<'s, 'a> Racing<'s, 'a> {
    fn new(search: &'s Search<'a>, effect: usize, runner: Runner<'s, 'a>, fit: Fit) -> Self {
        let cost = search.effect(effect).parameters(search.setting.scene).len() as f64 * search.log_values();
        let value = fit.likelihood(&search.setting) - cost;
        Self { effect, name: search.effect(effect).name(), runner, fit, value }
    }

    /// The same some steps further.
    fn on(self, search: &'s Search<'a>, whitening: &Whitening, effort: Effort) -> Self {
        let Self { effect, mut runner, fit, .. } = self;
        let fit = maximise(&search.setting, &mut runner, whitening, fit, effort, false);
        Self::new(search, effect, runner, fit)
    }
}

/// Whether a start has the same value for all parameters.
fn even(start: &Start) -> bool {
    start.values.windows(2).all(|w| w[0] == w[1])
}

/// Whether noise is so coloured that a misfit could hide in it.
fn coloured(noise: &Noise) -> bool {
    noise.deviation.iter().zip(&noise.innovation).any(|(all, new)| *all > COLOURED * new)
}

/// Whether one family is the other or a part of it.
fn related(a: &str, b: &str) -> bool {
    a.split('/').zip(b.split('/')).all(|(a, b)| a == b)
}

/// The first places, best first: each effect once, and not too many variants of one name.
fn thinned<'s, 'a>(racing: Vec<Racing<'s, 'a>>, places: usize) -> Vec<Racing<'s, 'a>> {
    let mut kept: Vec<Racing<'s, 'a>> = Vec::with_capacity(places);
    for racer in racing {
        let variants = kept.iter().filter(|k| k.name == racer.name).count();
        if kept.len() < places && variants < VARIANTS && kept.iter().all(|k| k.effect != racer.effect) {
            kept.push(racer);
        }
    }
    kept
}

impl<'a> Search<'a> {
    /// ln N, N the values that are explained.
    pub(crate) fn log_values(&self) -> f64 {
        ((self.setting.layout.counted() * self.setting.layout.outputs()) as f64).ln()
    }

    /// Penalty of an addition with so many degrees of freedom.
    pub(crate) fn penalty(&self, freedom: usize) -> f64 {
        freedom.max(1) as f64 * self.log_values() + 2.0 * (self.open.len().max(1) as f64).ln()
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
        let effects = self.effects(&state.effects);
        let current = Current { setting: &self.setting, effects: &effects, fit: &state.fit };
        let may = |i: &&usize| self.joins(**i, &state.effects);
        let library: Vec<(usize, &dyn Effect)> = self.open.iter().filter(may).map(|i| (*i, self.effect(*i))).collect();
        responses(&current, &library)
    }

    /// Responses about a model with effects. Those about the base model say which effects and starts are worth a look; these are
    /// simulated anew beside the effects that the model has.
    fn respond_again(&self, state: &State, whitening: &Whitening, first: &[Response]) -> Vec<Response> {
        let effects = self.effects(&state.effects);
        let screened = self.screen(state, whitening, first);
        let current = Current { setting: &self.setting, effects: &effects, fit: &state.fit };
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
        screened.iter().filter(|c| !closes(c)).take(RESIMULATED.0).flat_map(of).chain(loops).collect()
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

    fn projection<'p>(&'p self, state: &'p State, whitening: &'p Whitening) -> Projection<'p, 'a> {
        Projection::new(&self.setting, whitening, &state.fit, &self.parameters(&state.effects))
    }

    fn value(&self, candidate: &Candidate) -> f64 {
        candidate.gain - candidate.freedom as f64 * self.log_values()
    }

    /// The most promising effects, fitted jointly with the model they join; best first.
    ///
    /// What a response far from the model promises is often not to be had: the base parameters would have to move too far for a
    /// linear answer. So more effects than can be fitted to the end enter a race and are thinned out by the likelihood they have reached.
    fn refine(
        &self,
        state: &State,
        whitening: &Whitening,
        screened: &[Vec<Candidate>],
        responses: &[Response],
        field: &Field<'_>,
    ) -> Vec<Refined> {
        let projection = self.projection(state, whitening);
        let rank = state.fit.rank(&self.setting);
        let before = state.fit.likelihood(&self.setting);
        let closes = |c: &Vec<Candidate>| self.effect(c[0].effect).stage() == Stage::Loop;
        let mut names: Vec<&str> = Vec::new();
        let mut few = |c: &&Vec<Candidate>| {
            let name = self.effect(c[0].effect).name();
            names.push(name);
            names.iter().filter(|n| **n == name).count() <= VARIANTS
        };
        let open = screened.iter().filter(|c| c[0].gain > HOPELESS && !closes(c)).filter(&mut few).take(field.entrants);
        let entrants = open.chain(screened.iter().filter(|c| closes(c)));
        let mut racing: Vec<Racing<'_, 'a>> =
            entrants.flat_map(|candidates| self.enter(state, &projection, whitening, candidates, responses, field)).collect();
        for (trials, places) in field.race {
            let effort = Effort { trials, ..RANKING };
            racing = racing.into_iter().map(|r| r.on(self, whitening, effort)).collect();
            racing.sort_by(|a, b| b.value.total_cmp(&a.value));
            racing = thinned(racing, places);
        }
        let mut refined: Vec<Refined> = Vec::new();
        for Racing { effect, fit: coarse, .. } in racing {
            let indices: Vec<usize> = state.effects.iter().copied().chain([effect]).collect();
            let Some(mut runner) = self.runner(&indices, &coarse.point) else { continue };
            let Some(mut fit) = evaluate(&self.setting, &mut runner, whitening, &coarse.point) else { continue };
            fit.columns = coarse.columns;
            let target = refined.iter().map(|r| r.fit.likelihood(&self.setting)).fold(before, f64::max);
            let effort = Effort { target, ..RANKING };
            let fit = maximise(&self.setting, &mut runner, whitening, fit, effort, false);
            let fit = self.detour(effect, &mut runner, whitening, fit, effort);
            let gain = fit.likelihood(&self.setting) - before;
            let freedom = fit.rank(&self.setting).saturating_sub(rank).max(1);
            refined.push(Refined { effect, fit, score: gain - self.penalty(freedom) });
        }
        refined.sort_by(|a, b| b.score.total_cmp(&a.score));
        // Among equals the library's order decides: the more common cause stands first.
        let best = refined.first().map_or(0.0, |r| r.score);
        let equals = refined.iter().take_while(|r| r.score > best - EXCHANGE).count();
        refined[..equals].sort_by_key(|r| r.effect);
        refined
    }

    /// An effect at the better of its two best starts, and at the one that changes least: from there the way leads uphill, if slowly.
    fn enter<'s>(
        &'s self,
        state: &State,
        projection: &Projection<'_, '_>,
        whitening: &Whitening,
        candidates: &[Candidate],
        responses: &[Response],
        field: &Field<'_>,
    ) -> Vec<Racing<'s, 'a>> {
        let mut indices = state.effects.clone();
        indices.push(candidates[0].effect);
        let effects = self.effects(&indices);
        let gentle = candidates.iter().filter(|c| c.information > 0.0).min_by(|a, b| a.information.total_cmp(&b.information));
        let mut substeps = None;
        let mut at = |start: Vec<f64>| {
            let point = Point { x: start, starts: state.fit.point.starts.clone() };
            let coarse = match substeps {
                Some(substeps) => substeps,
                None => (Runner::new(&self.setting, &effects, &point).ok()?.substeps() / COARSE).max(self.setting.substeps),
            };
            substeps = Some(coarse);
            let mut runner = Runner::with_substeps(&self.setting, &effects, &point, coarse).ok()?;
            let fit = evaluate(&self.setting, &mut runner, whitening, &point)?;
            Some(Racing::new(self, candidates[0].effect, runner, fit))
        };
        let bold = candidates.iter().take(2).filter_map(|c| at(projection.start(&responses[c.response], c)));
        let bold = bold.reduce(|a, b| if b.value > a.value { b } else { a });
        let gentle = gentle.and_then(|c| at([&state.fit.point.x[..], &responses[c.response].start.values].concat()));
        if self.effect(candidates[0].effect).stage() == Stage::Loop {
            // A loop changes what every parameter does: what is linear about the open one says nothing. It enters closed, all columns new.
            let even = |c: &&Candidate| even(&responses[c.response].start);
            let closed = |c: &Candidate| at([&state.fit.point.x[..], &responses[c.response].start.values].concat());
            return candidates.iter().filter(even).step_by(2).filter_map(closed).collect();
        }
        // The model bends its parameters to what the effect does; where they are otherwise known they may be nearer to the truth.
        let rough = self.setting.rough.as_deref().filter(|_| state.effects.is_empty() && !responses[candidates[0].response].start.linear);
        let unbent = field.unbent.or(rough).and_then(|z| {
            let every = candidates.len().div_ceil(UNBENT);
            let tried = candidates.iter().step_by(every).filter_map(|c| at([z, &responses[c.response].start.values[..]].concat()));
            tried.reduce(|a, b| if b.value > a.value { b } else { a })
        });
        let mut entered: Vec<Racing<'s, 'a>> = bold.into_iter().chain(gentle).collect();
        for racing in &mut entered {
            // The model's own columns are those it had without the effect until a step disappoints.
            racing.fit.columns = state.fit.columns.clone();
            let (own, all) = (racing.fit.columns.len(), racing.fit.point.x.len());
            linearise(&mut racing.runner, whitening, &mut racing.fit, own..all);
        }
        entered.extend(unbent);
        entered
    }

    /// Looks at an effect's other values and goes on from the best of them as long as that leads anywhere.
    fn detour(&self, effect: usize, runner: &mut Runner<'_, '_>, whitening: &Whitening, mut fit: Fit, effort: Effort) -> Fit {
        let effect = self.effect(effect);
        for _ in 0..DETOURS {
            let own = fit.point.x.len() - effect.parameters(self.setting.scene).len();
            let mut best: Option<Fit> = None;
            for values in effect.detours(&fit.point.x[own..], self.setting.scene) {
                let mut point = fit.point.clone();
                point.x[own..].copy_from_slice(&values);
                let Some(there) = evaluate(&self.setting, runner, whitening, &point) else { continue };
                if there.likelihood(&self.setting) > best.as_ref().unwrap_or(&fit).likelihood(&self.setting) + RANKING.worthwhile {
                    best = Some(there);
                }
            }
            let Some(there) = best else { break };
            fit = maximise(&self.setting, runner, whitening, there, effort, false);
        }
        fit
    }

    /// Noise as a fit leaves it.
    fn noise_of(&self, indices: &[usize], fit: &Fit, whitening: &Whitening) -> Option<Noise> {
        let mut runner = self.runner(indices, &fit.point)?;
        let mut residual = vec![0.0; self.setting.layout.len()];
        if !runner.run(&fit.point.x, &fit.point.starts, &mut residual) {
            return None;
        }
        residual.iter_mut().zip(&self.setting.measured).for_each(|(r, y)| *r = y - *r);
        let taken = fit.rank(&self.setting) as f64 + whitening.taken();
        Some(Noise::estimate(&residual, &self.setting.layout, taken, &self.setting.floor))
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
            if self.causes(&selected.state.effects) >= MOST {
                break;
            }
            let (ranking, mut joined) = self.round(&selected, first);
            if depth == 0 {
                selected.ranking = ranking;
            }
            if joined.is_none() && coloured(&selected.whitening.noise) {
                joined = self.plainly(&selected).and_then(|plain| self.round(&plain, first).1);
            }
            let Some(next) = joined else { break };
            selected = Selected { ranking: selected.ranking, ..next };
            if selected.state.effects.len() > 1 {
                self.exchange(&mut selected, first);
            }
        }
        Ok(selected)
    }

    /// What every effect is worth beside a model, and the model with the best that holds its evidence under the noise it leaves: a
    /// candidate that loses it makes room for the next.
    fn round(&self, selected: &Selected, first: &[Response]) -> (Vec<(usize, f64)>, Option<Selected>) {
        let fresh;
        let responses = if selected.state.effects.is_empty() {
            first
        } else {
            fresh = self.respond_again(&selected.state, &selected.whitening, first);
            &fresh
        };
        let screened = self.screen(&selected.state, &selected.whitening, responses);
        let refined = self.refine(&selected.state, &selected.whitening, &screened, responses, &OPEN);
        let joined = (0..refined.len().min(2)).filter(|i| refined[*i].score > 0.0).find_map(|i| self.join(selected, &refined, i));
        (self.ranking(&screened, &refined), joined)
    }

    /// The same model under noise of no colour, for a second look: a misfit that remains passes for coloured noise, and that noise hides it.
    /// What noise really is so coloured is found out when a candidate has to hold its evidence.
    fn plainly(&self, selected: &Selected) -> Option<Selected> {
        let noise = Noise::white(&self.setting.scene.scales.outputs, &self.setting.layout);
        let effects = selected.state.effects.clone();
        let (whitening, fit) = self.under(&effects, &selected.state.fit, &noise, COMPARING)?;
        Some(Selected {
            state: State { effects, fit },
            whitening,
            base: selected.base.clone(),
            rivals: selected.rivals.clone(),
            ranking: Vec::new(),
        })
    }

    fn ranking(&self, screened: &[Vec<Candidate>], refined: &[Refined]) -> Vec<(usize, f64)> {
        let screened = screened.iter().map(|c| (c[0].effect, c[0].gain - self.penalty(c[0].freedom)));
        let mut all: Vec<(usize, f64)> = refined.iter().map(|r| (r.effect, r.score)).collect();
        all.extend(screened.filter(|(e, _)| !refined.iter().any(|r| r.effect == *e)).collect::<Vec<_>>());
        all
    }

    /// Takes a candidate into the model if its evidence holds under the noise that it leaves itself. A misfit hides in the noise of
    /// the model that lacks the effect, but noise cannot hide from the model that has it.
    fn join(&self, selected: &Selected, refined: &[Refined], which: usize) -> Option<Selected> {
        let candidate = &refined[which];
        let mut effects = selected.state.effects.clone();
        effects.push(candidate.effect);
        let noise = self.noise_of(&effects, &candidate.fit, &selected.whitening)?;
        let (whitening, with) = self.under(&effects, &candidate.fit, &noise, FINAL)?;
        let (_, without) = self.under(&selected.state.effects, &selected.state.fit, &noise, COMPARING)?;
        let likelihood = |f: &Fit| f.likelihood(&self.setting);
        let gain = likelihood(&with) - likelihood(&without);
        let freedom = with.rank(&self.setting).saturating_sub(without.rank(&self.setting));
        let score = gain - self.penalty(freedom);
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
        let joined = |r: &Refined| State { effects: rest.effects.iter().copied().chain([r.effect]).collect(), fit: r.fit.clone() };
        others.map(|r| Rival { effect: r.effect, state: joined(r), gap: score - r.score }).collect()
    }

    /// How many members are known and stay.
    pub(crate) fn fixed(&self, selected: &Selected) -> usize {
        selected.state.effects.iter().take_while(|i| **i >= self.library.len()).count()
    }

    /// Drops each member in turn and takes the best replacement if it gains; keeps the others as rivals.
    fn exchange(&self, selected: &mut Selected, first: &[Response]) {
        let fixed = self.fixed(selected);
        let mut member = fixed;
        let mut exchanged = 0;
        selected.rivals = vec![Vec::new(); fixed];
        while member < selected.state.effects.len() {
            let (rest, refined) = self.replacements(selected, member, first);
            let present = self.worth(selected, &rest);
            let better = refined.first().filter(|b| exchanged < MOST && b.score > present + EXCHANGE);
            if let Some(next) = better.and_then(|best| self.replaced(selected, &rest, best)) {
                *selected = next;
                selected.rivals = vec![Vec::new(); fixed];
                exchanged += 1;
                member = fixed;
                continue;
            }
            if let Some(next) = self.pruned(selected, &rest, present) {
                *selected = next;
                member = 0;
                continue;
            }
            selected.rivals.push(self.beside(&rest, &refined, selected.state.effects[member], present));
            member += 1;
        }
    }

    /// The selection without a member that the others have made superfluous: what it adds to them is not worth its parameters, or only the
    /// imperfect form of theirs.
    fn pruned(&self, selected: &Selected, rest: &State, present: f64) -> Option<Selected> {
        if selected.state.effects.len() < 2 || rest.effects.is_empty() {
            return None;
        }
        let explained = rest.fit.likelihood(&self.setting) - selected.base.likelihood(&self.setting);
        let size = || self.sizeable(&selected.base, &rest.fit, &selected.state.fit, &selected.whitening.noise);
        if present > 0.0 && (present >= SHARE * explained || size()) {
            return None;
        }
        let (whitening, fit) = self.under(&rest.effects, &rest.fit, &selected.whitening.noise, FINAL)?;
        let state = State { effects: rest.effects.clone(), fit };
        Some(Selected { state, whitening, base: selected.base.clone(), rivals: Vec::new(), ranking: selected.ranking.clone() })
    }

    /// The model without a member, and what could take its place.
    fn replacements(&self, selected: &Selected, member: usize, first: &[Response]) -> (State, Vec<Refined>) {
        let base = || State { effects: Vec::new(), fit: selected.base.clone() };
        let Some(rest) = self.without(selected, member) else { return (base(), Vec::new()) };
        let responses = self.respond_again(&rest, &selected.whitening, first);
        let dropped = selected.state.effects[member];
        let screened = self.screen(&rest, &selected.whitening, &responses);
        let others: Vec<Vec<Candidate>> = screened.into_iter().filter(|c| c[0].effect != dropped).collect();
        let unbent: Vec<f64> = self.unknowns(&selected.state, &|i| i != member).map(|j| selected.state.fit.point.x[j]).collect();
        let field = Field { entrants: CONTESTANTS, race: CONTEST, unbent: Some(&unbent) };
        let refined = self.refine(&rest, &selected.whitening, &others, &responses, &field);
        (rest, refined)
    }

    /// The selection with a replacement, under the noise that it leaves.
    fn replaced(&self, selected: &Selected, rest: &State, best: &Refined) -> Option<Selected> {
        let effects: Vec<usize> = rest.effects.iter().copied().chain([best.effect]).collect();
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

    /// Indices of the unknowns of a model that stay if some of its effects do.
    fn unknowns(&self, state: &State, keep: &dyn Fn(usize) -> bool) -> impl Iterator<Item = usize> + use<> {
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
        let freedom = selected.state.fit.rank(&self.setting).saturating_sub(rest.fit.rank(&self.setting));
        selected.state.fit.likelihood(&self.setting) - rest.fit.likelihood(&self.setting) - self.penalty(freedom)
    }
}

#[cfg(test)]
mod tests {
    use super::related;

    #[test]
    fn a_family_is_related_to_its_parts_and_they_are_not_to_each_other() {
        assert!(related("slew_limit", "slew_limit/v") && related("slew_limit/v", "slew_limit") && related("friction", "friction"));
        assert!(!related("slew_limit/v", "slew_limit/omega") && !related("friction", "slew_limit/v"));
    }
}
