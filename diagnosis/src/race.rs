//! The race: the effects that screening promises most of are fitted jointly with the model they would join, and thinned out by the
//! likelihood they have reached.

use std::ops::Range;

use wheelwright_core::effect::{Effect, Scene, Stage, Start};

use crate::answer::always;
use crate::fit::search::{Effort, Fit, OPTIMISM, OUT_OF_REACH, evaluate, join, maximise};
use crate::fit::setting::{COARSE_ERROR, Point, Runner};
use crate::fit::whitening::Whitening;
use crate::screen::{Candidate, Projection, Response};
use crate::select::{EXCHANGE, SHARE, Search, Selected, State, Unbent};

/// Effects that enter the race after screening. Of the 95 effects that came out first or within a toss of a coin of it, over 58 development
/// cases of two engines, none had stood lower than tenth (loops aside, which always enter).
const ENTRANTS: usize = 12;
/// Rounds of the race: steps, and effects that go on after them. Of the same 95 none stood lower than sixth after either.
const RACE: [(usize, usize); 2] = [(3, 8), (5, 6)];
/// Effects that enter where a member's place is contested: what could replace it has been seen before.
const CONTESTANTS: usize = 8;
/// The rounds of that race.
const CONTEST: [(usize, usize); 2] = [(3, 6), (5, 5)];
/// Starts of an effect that are tried beside the parameters of the regression.
const UNBENT: usize = 6;
/// Starts of one whose likelihood has many maxima that are looked at, as they are and with another size each, and from how many of them it walks.
const STROLLS: (usize, usize) = (3, 2);
/// Effects that go on where the search has had its share of simulation.
const LAST: usize = 1;
/// Variants of one effect that may go on together. What enters is as many beside its plain form.
const VARIANTS: usize = 2;
/// Share of what one parameter costs that an effect's linearised gain has to reach, for a refinement to make evidence of it. Of 97 winners and
/// equals of winners, over 58 development cases of two engines, none had been promised less than all of it.
const PROMISING: f64 = 0.5;
/// Share of the best linearised gain, of what the member gains whose place is contested, or of what an addition has to gain, below which an
/// effect is left behind. Of the same 97 none had less than 0.49 of the first two.
const BEHIND: f64 = 0.25;
/// Refinement of a candidate: enough to rank it.
const RANKING: Effort = Effort { trials: 14, worthwhile: 0.5, target: f64::NEG_INFINITY };
/// Degrees of freedom by which the data tell a law from one that it contains.
const SEEN: f64 = 0.5;
/// How often a detour may lead on.
const DETOURS: usize = 4;

/// Other values of an effect that are worth a look.
#[derive(Debug, Clone, Copy)]
enum Others {
    /// Wherever it is fitted.
    Detours,
    /// Once everything else has been found.
    Afterthoughts,
}

/// A look at other values of a member.
#[derive(Debug, Clone, Copy)]
struct Look<'e> {
    effects: &'e [usize],
    /// Which of them.
    member: usize,
    others: Others,
}

impl Others {
    fn of(self, effect: &dyn Effect, values: &[f64], scene: &Scene) -> Vec<Vec<f64>> {
        match self {
            Self::Detours => effect.detours(values, scene),
            Self::Afterthoughts => effect.afterthoughts(values, scene),
        }
    }
}

/// A refined candidate.
#[derive(Debug, Clone)]
pub(crate) struct Refined {
    pub(crate) effect: usize,
    pub(crate) fit: Fit,
    /// Degrees of freedom that it adds to the model.
    pub(crate) freedom: f64,
    /// Penalised gain over that model.
    pub(crate) score: f64,
}

/// What comes of a race, best first.
pub(crate) struct Raced {
    pub(crate) alone: Vec<Refined>,
    /// Laws that explain hardly more than one of those that they contain, under the noise that this was asked beside.
    pub(crate) covered: Vec<Refined>,
}

/// Who races, and how.
pub(crate) struct Field<'f> {
    /// Most effects that enter.
    entrants: usize,
    /// Steps, and effects that go on after them.
    rounds: [(usize, usize); 2],
    /// The model's unknowns as they are beside an effect whose place is contested: without it they bend to what it did.
    unbent: Option<&'f Unbent>,
    /// What the member gains whose place is contested.
    gain: f64,
    /// What the model explains that is joined.
    explained: f64,
}

impl<'f> Field<'f> {
    /// For a place beside a model that explains so much.
    pub(crate) const fn open(explained: f64) -> Self {
        Self { entrants: ENTRANTS, rounds: RACE, unbent: None, gain: 0.0, explained }
    }

    /// For the place of a member that gains so much, with the other unknowns as they are beside it.
    pub(crate) const fn contest(unbent: &'f Unbent, gain: f64, explained: f64) -> Self {
        Self { entrants: CONTESTANTS, rounds: CONTEST, unbent: Some(unbent), gain, explained }
    }

    /// What an effect has to gain, so that anybody asks for it: as much as the member whose place it contests, but for what laws are inexact
    /// by.
    fn asked(&self) -> f64 {
        (self.gain - SHARE * (self.gain + self.explained)).max(0.0)
    }

    /// What it has to come near to, to be fitted to the end. Where nobody holds the place there is nobody to come near to, and what comes to
    /// less than it costs is none.
    fn least(&self, cost: f64) -> f64 {
        if self.unbent.is_none() { cost + OUT_OF_REACH } else { self.asked() }
    }
}

/// An effect on its way to the end of its fit.
struct Racing<'s, 'a> {
    effect: usize,
    runner: Runner<'s, 'a>,
    fit: Fit,
    /// Twice the log-likelihood less what the effect's parameters cost.
    value: f64,
    /// By how much that has grown over the last round.
    grown: f64,
}

impl<'s, 'a> Racing<'s, 'a> {
    fn new(search: &'s Search<'a>, effect: usize, runner: Runner<'s, 'a>, fit: Fit) -> Self {
        let cost = search.effect(effect).parameters(search.setting.scene).len() as f64 * search.log_values();
        let value = fit.likelihood(&search.setting) - cost;
        Self { effect, runner, fit, value, grown: f64::INFINITY }
    }

    /// The same some steps further.
    fn on(self, search: &'s Search<'a>, whitening: &Whitening, effort: Effort) -> Self {
        let Self { effect, mut runner, fit, value, .. } = self;
        let fit = maximise(&search.setting, &mut runner, whitening, fit, effort, false);
        let further = Self::new(search, effect, runner, fit);
        let grown = further.value - value;
        // One whose steps were all too long has not shown its pace yet.
        let grown = if grown <= 0.0 && further.fit.held_back() { f64::INFINITY } else { grown };
        Self { grown, ..further }
    }

    /// Whether it may yet come near to what is best and to what is asked for, at a few times the pace of its last round.
    fn reaches(&self, search: &Search<'_>, best: f64, asked: f64, near: f64) -> bool {
        let further = OPTIMISM * self.grown + near;
        self.value + further >= best && self.fit.likelihood(&search.setting) + further >= asked
    }
}

/// Whether a start has the same value for all parameters of its columns.
pub(crate) fn even(start: &Start) -> bool {
    let mut tried = start.columns.iter().flatten().map(|j| start.values[*j]);
    let first = tried.next();
    tried.all(|value| Some(value) == first)
}

/// Those that have a score of their own.
pub(crate) fn distinct(refined: Vec<Refined>, scores: Vec<Option<f64>>) -> Vec<Refined> {
    refined.into_iter().zip(scores).filter_map(|(r, score)| score.map(|score| Refined { score, ..r })).collect()
}

impl<'a> Search<'a> {
    /// The most promising effects, fitted jointly with the model they join; best first.
    ///
    /// What a response far from the model promises is often not to be had: the base parameters would have to move too far for a
    /// linear answer. So more effects than can be fitted to the end enter a race and are thinned out by the likelihood they have reached.
    pub(crate) fn refine(
        &self,
        state: &State,
        whitening: &Whitening,
        screened: &[Vec<Candidate>],
        responses: &[Response],
        field: &Field<'_>,
    ) -> Raced {
        let projection = self.projection(state, whitening);
        let freedom = self.freedom(&state.effects, &state.fit);
        let before = state.fit.likelihood(&self.setting);
        let asked = before + field.asked();
        let least = self.least_promise(screened, field);
        let enter = |c: &Vec<Candidate>| self.enter(state, &projection, whitening, (c, least), responses, field);
        let mut racing: Vec<Racing<'_, 'a>> = self.promising(screened, field.entrants, least).flat_map(enter).collect();
        for (trials, places) in field.rounds {
            let effort = Effort { trials, ..RANKING };
            racing = racing.into_iter().map(|r| r.on(self, whitening, effort)).collect();
            racing.sort_by(|a, b| b.value.total_cmp(&a.value));
            let best = racing.first().map_or(f64::NEG_INFINITY, |r| r.value);
            let near = self.near(best - before);
            racing.retain(|r| r.reaches(self, best, asked, near));
            racing = self.thinned(racing, if self.setting.exhausted() { LAST } else { places });
        }
        let least = before + field.least(self.penalty(1.0));
        let mut refined: Vec<Refined> = Vec::new();
        for Racing { effect, fit: coarse, .. } in racing {
            let indices = state.and(effect);
            let Some(mut runner) = self.runner(&indices, &coarse.point) else { continue };
            let Some(mut fit) = evaluate(&self.setting, &mut runner, whitening, &coarse.point) else { continue };
            fit.columns = coarse.columns;
            let target = refined.iter().map(|r| r.fit.likelihood(&self.setting)).fold(least, f64::max);
            let effort = Effort { target, ..RANKING };
            let fit = maximise(&self.setting, &mut runner, whitening, fit, effort, false);
            let look = Look { effects: &indices, member: indices.len() - 1, others: Others::Detours };
            let fit = self.detour(look, &mut runner, whitening, fit, effort);
            let fit = self.in_turn(effect, &mut runner, whitening, fit, effort);
            let gain = fit.likelihood(&self.setting) - before;
            let freedom = self.freedom(&indices, &fit) - freedom;
            refined.push(Refined { effect, fit, freedom, score: gain - self.penalty(freedom) });
        }
        let scores = self.scores(&refined, &refined, before);
        let covered = refined.iter().zip(&scores).filter(|(_, score)| score.is_none()).map(|(r, _)| r.clone()).collect();
        let mut alone = distinct(refined, scores);
        alone.sort_by(|a, b| b.score.total_cmp(&a.score));
        // Among equals the library's order decides: the more common cause stands first.
        let best = alone.first().map_or(0.0, |r| r.score);
        let equals = alone.iter().take_while(|r| r.score > best - EXCHANGE).count();
        alone[..equals].sort_by_key(|r| r.effect);
        Raced { alone, covered }
    }

    /// The scores of those that are explanations of their own beside others: a law that explains hardly more than one that it contains is none,
    /// unless these data would not show it, or no drive: then it stands behind. `before` is the likelihood of the model that they join.
    pub(crate) fn scores(&self, refined: &[Refined], others: &[Refined], before: f64) -> Vec<Option<f64>> {
        let own = |wide: &Refined| {
            let within = others.iter().filter(|narrow| self.no_more(wide, narrow, before));
            let Some(narrow) = within.max_by(|a, b| a.score.total_cmp(&b.score)) else { return Some(wide.score) };
            let seen = wide.freedom > narrow.freedom + SEEN || self.narrower(wide).is_some();
            let same = always(self.effect(wide.effect), self.effect(narrow.effect)).is_some();
            (same || !seen).then(|| wide.score.min(narrow.score - EXCHANGE))
        };
        refined.iter().map(own).collect()
    }

    /// Whether a law explains hardly more than one that it contains: the form of a law is never exact.
    pub(crate) fn no_more(&self, wide: &Refined, narrow: &Refined, before: f64) -> bool {
        let name = self.effect(narrow.effect).name();
        let [wider, likelihood] = [wide, narrow].map(|r| r.fit.likelihood(&self.setting));
        let contains = self.effect(wide.effect).contains().contains(&name) && wide.effect != narrow.effect;
        self.narrower(wide) == Some(name) || (contains && wider - likelihood < SHARE * (likelihood - before))
    }

    /// The name of the effect that a candidate is where a part of it does nothing.
    fn narrower(&self, candidate: &Refined) -> Option<&'static str> {
        let effect = self.effect(candidate.effect);
        let x = &candidate.fit.point.x;
        let own = x.len() - effect.parameters(self.setting.scene).len();
        effect.narrower(&x[own..], self.setting.scene)
    }

    /// How far from each other, in twice the log-likelihood as it is raced for, two effects may be of which either may come out first: by the
    /// coarse steps, and by as much of what they gain as laws are inexact by.
    fn near(&self, gain: f64) -> f64 {
        OUT_OF_REACH + COARSE_ERROR * COARSE_ERROR * self.setting.layout.values() + SHARE * gain.max(0.0)
    }

    /// Whether what the candidates are closes a loop.
    fn closes(&self, candidates: &[Candidate]) -> bool {
        self.effect(candidates[0].effect).stage() == Stage::Loop
    }

    /// What an effect has to promise.
    fn least_promise(&self, screened: &[Vec<Candidate>], field: &Field<'_>) -> f64 {
        let best = screened.iter().filter(|c| !self.closes(c)).map(|c| c[0].gain).fold(field.gain, f64::max);
        (PROMISING * self.penalty(1.0)).max(BEHIND * best).max(BEHIND * SHARE * field.explained)
    }

    /// The effects that enter: those that promise enough, not too many variants of one name, and what closes a loop, of which no promise says anything.
    fn promising<'c>(
        &'c self,
        screened: &'c [Vec<Candidate>],
        entrants: usize,
        least: f64,
    ) -> impl Iterator<Item = &'c Vec<Candidate>> + use<'c, 'a> {
        let closes = |c: &&Vec<Candidate>| self.closes(c);
        let open = screened.iter().filter(move |c| c[0].gain > least && !closes(c)).filter(self.few()).take(entrants);
        open.chain(screened.iter().filter(closes))
    }

    /// Lets not too many variants of one cause pass, the first of them, and its plain form.
    pub(crate) fn few(&self) -> impl FnMut(&&Vec<Candidate>) -> bool {
        let mut passed: Vec<usize> = Vec::new();
        move |c| {
            let effect = c[0].effect;
            if self.plain(effect) {
                return true;
            }
            passed.push(effect);
            passed.iter().filter(|other| self.kin(**other, effect)).count() <= VARIANTS
        }
    }

    /// The first places, best first: each effect once, and not too many variants of one cause.
    fn thinned<'s>(&self, racing: Vec<Racing<'s, 'a>>, places: usize) -> Vec<Racing<'s, 'a>> {
        let mut kept: Vec<Racing<'s, 'a>> = Vec::with_capacity(places);
        for racer in racing {
            let variants = kept.iter().filter(|k| self.kin(k.effect, racer.effect)).count();
            if kept.len() < places && variants < VARIANTS && kept.iter().all(|k| k.effect != racer.effect) {
                kept.push(racer);
            }
        }
        kept
    }

    /// Whether two effects are variants of one cause: by name, or one mathematics under every drive.
    fn kin(&self, a: usize, b: usize) -> bool {
        let [a, b] = [a, b].map(|i| self.effect(i));
        a.name() == b.name() || always(a, b).is_some()
    }

    /// Whether an effect is the plain form of its cause: the first in the library, of which all others are variants.
    pub(crate) fn plain(&self, effect: usize) -> bool {
        (0..effect).all(|other| !self.kin(other, effect))
    }

    /// The starts of an effect whose likelihood has many maxima that are worth a look, if one is worth something as it is: the best as they are, and those
    /// that promise most with another size.
    fn strolls<'c>(&self, candidates: &'c [Candidate], least: f64) -> Vec<&'c Candidate> {
        let mut all: Vec<&Candidate> = candidates.iter().collect();
        all.sort_by(|a, b| b.as_it_is.total_cmp(&a.as_it_is));
        if !self.effect(candidates[0].effect).rugged() || all[0].as_it_is < least {
            return Vec::new();
        }
        all.truncate(STROLLS.0);
        let seen: Vec<usize> = all.iter().map(|c| c.response).collect();
        all.extend(candidates.iter().take(STROLLS.0).filter(|c| !seen.contains(&c.response)));
        all
    }

    /// An effect at the better of its two best starts, and at the one that changes least: from there the way leads uphill, if slowly.
    fn enter<'s>(
        &'s self,
        state: &State,
        projection: &Projection<'_, '_>,
        whitening: &Whitening,
        (candidates, least): (&[Candidate], f64),
        responses: &[Response],
        field: &Field<'_>,
    ) -> Vec<Racing<'s, 'a>> {
        let indices = state.and(candidates[0].effect);
        let effects = self.effects(&indices);
        // An effect as it starts, beside a model's unknowns.
        let beside = |z: &[f64], c: &Candidate| [z, &responses[c.response].start.values[..]].concat();
        let gentle = candidates.iter().filter(|c| c.information > 0.0).min_by(|a, b| a.information.total_cmp(&b.information));
        let mut substeps = None;
        let mut at = |start: Vec<f64>| {
            let point = Point { x: start, starts: state.fit.point.starts.clone() };
            let mut runner = match substeps {
                Some(substeps) => Runner::with_substeps(&self.setting, &effects, &point, substeps),
                None => Runner::coarse(&self.setting, &effects, &point),
            }
            .ok()?;
            substeps = Some(runner.substeps());
            let fit = evaluate(&self.setting, &mut runner, whitening, &point)?;
            Some(Racing::new(self, candidates[0].effect, runner, fit))
        };
        let bold = candidates.iter().take(2).filter_map(|c| at(projection.start(&responses[c.response], c)));
        let bold = bold.reduce(|a, b| if b.value > a.value { b } else { a });
        let gentle = gentle.and_then(|c| at(beside(&state.fit.point.x, c)));
        if self.closes(candidates) {
            // A loop changes what every parameter does: what is linear about the open one says nothing. It enters closed, all columns new.
            let even = |c: &&Candidate| even(&responses[c.response].start);
            return candidates.iter().filter(even).step_by(2).filter_map(|c| at(beside(&state.fit.point.x, c))).collect();
        }
        // The model bends its parameters to what the effect does; where they are otherwise known they may be nearer to the truth.
        let rough = self.setting.rough.as_deref().filter(|_| state.effects.is_empty() && !responses[candidates[0].response].start.linear);
        let unbent = field.unbent.map(|unbent| &unbent.x[..]).or(rough).and_then(|z| {
            let every = candidates.len().div_ceil(UNBENT);
            let tried = candidates.iter().step_by(every).filter_map(|c| at(beside(z, c)));
            tried.reduce(|a, b| if b.value > a.value { b } else { a })
        });
        let strolled = self.strolls(candidates, least).into_iter().filter_map(|c| {
            let starts = [projection.start(&responses[c.response], c), beside(&state.fit.point.x, c)];
            starts.into_iter().filter_map(&mut at).reduce(|a, b| if b.value > a.value { b } else { a })
        });
        let mut strolled: Vec<Racing<'s, 'a>> = strolled.collect();
        strolled.sort_by(|a, b| b.value.total_cmp(&a.value));
        let walked = strolled.into_iter().take(STROLLS.1).map(|Racing { effect, mut runner, fit, .. }| {
            let fit = self.walked(effect, &mut runner, whitening, fit);
            Racing::new(self, effect, runner, fit)
        });
        // The model's own columns are those it had without the effect, or beside the one whose place this is, until a step disappoints.
        let near = bold.into_iter().chain(gentle).chain(walked).map(|racing| (racing, Some(&state.fit.columns)));
        let far = unbent.map(|racing| (racing, field.unbent.map(|unbent| &unbent.columns)));
        let with_columns = |(mut racing, known): (Racing<'s, 'a>, Option<&Vec<Vec<f64>>>)| {
            if let Some(known) = known {
                join(&mut racing.runner, whitening, &mut racing.fit, known);
            }
            racing
        };
        near.chain(far).map(with_columns).collect()
    }

    /// An effect in the place of a member, from the best of some values and from where the other unknowns are.
    pub(crate) fn placed(
        &self,
        effect: usize,
        starts: Vec<Vec<f64>>,
        unbent: &Unbent,
        selected: &Selected,
        rest: &State,
    ) -> Option<Refined> {
        let whitening = &selected.whitening;
        let indices = rest.and(effect);
        let from = |values: Vec<f64>| {
            let point = Point { x: [&unbent.x[..], &values[..]].concat(), starts: selected.state.fit.point.starts.clone() };
            let mut runner = self.runner(&indices, &point)?;
            Some((evaluate(&self.setting, &mut runner, whitening, &point)?, runner))
        };
        let likelihood = |fit: &Fit| fit.likelihood(&self.setting);
        let (mut fit, mut runner) =
            starts.into_iter().filter_map(from).reduce(|a, b| if likelihood(&b.0) > likelihood(&a.0) { b } else { a })?;
        if self.effect(effect).rugged() {
            let mut coarse = Runner::coarse(&self.setting, &self.effects(&indices), &fit.point).ok()?;
            let from = evaluate(&self.setting, &mut coarse, whitening, &fit.point)?;
            let walked = self.walked(effect, &mut coarse, whitening, from);
            fit = evaluate(&self.setting, &mut runner, whitening, &walked.point)?;
        }
        join(&mut runner, whitening, &mut fit, &unbent.columns);
        let fit = maximise(&self.setting, &mut runner, whitening, fit, RANKING, false);
        let (freedom, score) = self.beyond(&indices, &fit, rest);
        Some(Refined { effect, fit, freedom, score })
    }

    /// Looks at a member's other values and goes on from the best of them as long as that leads anywhere.
    fn detour(&self, look: Look<'_>, runner: &mut Runner<'_, '_>, whitening: &Whitening, mut fit: Fit, effort: Effort) -> Fit {
        for _ in 0..DETOURS {
            let mut best: Option<Fit> = None;
            let (own, elsewhere) = self.elsewhere(look, &fit);
            for values in elsewhere {
                let mut point = fit.point.clone();
                point.x[own.clone()].copy_from_slice(&values);
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

    /// The best of a fit and, where its last member lags in series with the model, of those in which the two change places, on one axis or another: what
    /// couples the outputs tells which is which, but from the wrong way round no small step leads to the right one.
    fn in_turn(&self, last: usize, runner: &mut Runner<'_, '_>, whitening: &Whitening, fit: Fit, effort: Effort) -> Fit {
        let axes = self.setting.layout.outputs();
        if !self.effect(last).in_series() || self.effect(last).parameters(self.setting.scene).len() != axes {
            return fit;
        }
        let exchanged = (1..1_u32 << axes).filter_map(|which| {
            let x = self.setting.exchanged(&fit.point.x, axes, |axis| which >> axis & 1 == 1)?;
            let there = evaluate(&self.setting, runner, whitening, &Point { x, starts: fit.point.starts.clone() })?;
            Some(maximise(&self.setting, runner, whitening, there, effort, false))
        });
        let likelihood = |fit: &Fit| fit.likelihood(&self.setting);
        let best = exchanged.reduce(|a, b| if likelihood(&b) > likelihood(&a) { b } else { a });
        best.filter(|best| likelihood(best) > likelihood(&fit) + EXCHANGE).unwrap_or(fit)
    }

    /// A fit with a look at the other values of the members that were there before the last: what it explains now may have led them astray.
    pub(crate) fn look_round(&self, effects: &[usize], whitening: &Whitening, fit: Fit, effort: Effort) -> Fit {
        let members = effects.len().saturating_sub(1);
        self.looked_at(Look { effects, member: members, others: Others::Detours }, whitening, fit, effort)
    }

    /// A fit with a look at what comes to mind of its members once everything else has been found.
    pub(crate) fn afterthought(&self, effects: &[usize], whitening: &Whitening, fit: Fit, effort: Effort) -> Fit {
        self.looked_at(Look { effects, member: effects.len(), others: Others::Afterthoughts }, whitening, fit, effort)
    }

    /// A fit with a look at other values of all members before one.
    fn looked_at(&self, before: Look<'_>, whitening: &Whitening, mut fit: Fit, effort: Effort) -> Fit {
        let mut runner = None;
        for look in (0..before.member).map(|member| Look { member, ..before }) {
            if self.elsewhere(look, &fit).1.is_empty() {
                continue;
            }
            runner = runner.or_else(|| self.runner(before.effects, &fit.point));
            let Some(runner) = &mut runner else { break };
            fit = self.detour(look, runner, whitening, fit, effort);
        }
        fit
    }

    /// Where a member's values are among a fit's unknowns, and its other values.
    fn elsewhere(&self, look: Look<'_>, fit: &Fit) -> (Range<usize>, Vec<Vec<f64>>) {
        let Look { effects, member, others } = look;
        let first = self.setting.free() + self.parameters(&effects[..member]).len();
        let effect = self.effect(effects[member]);
        let own = first..first + effect.parameters(self.setting.scene).len();
        let values = others.of(effect, &fit.point.x[own.clone()], self.setting.scene);
        (own, values)
    }
}
