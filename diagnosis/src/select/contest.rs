//! Each member's place is contested: another effect may explain more in it, or none may be needed there.

use wheelwright_core::effect::{Effect, Stage};

use super::{COMPARING, EXCHANGE, FINAL, MOST, Rival, SHARE, Search, Selected, State};
use crate::adequacy::{Jitter, OrderLine, Scatter, counted, jittered, lined, whitened};
use crate::answer::always;
use crate::comparison::Comparison;
use crate::effects::LATENESS;
use crate::fit::search::{Fit, left};
use crate::race::{Field, Refined, distinct};
use crate::screen::{Candidate, Response};

/// Whether the rivals of the newest member are to be sought.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Newest {
    /// They are known, as long as nothing else changes.
    Seen,
    Open,
}

/// The rivals of so many members, of which those of the last are known.
pub(super) fn of_the_last(members: usize, rivals: Vec<Rival>) -> Vec<Vec<Rival>> {
    std::iter::repeat_n(Vec::new(), members - 1).chain([rivals]).collect()
}

/// Whether an effect is a pure delay, of commands or of what is recorded.
fn delays(effect: &dyn Effect) -> bool {
    effect.family() == LATENESS && matches!(effect.stage(), Stage::Transport | Stage::Reading)
}

impl<'a> Search<'a> {
    /// The selection with what comes to mind of its members last, if it explains markedly more, and the members contested beside it.
    pub(super) fn think_over(&self, selected: &mut Selected, first: &[Response]) {
        let state = &selected.state;
        let fit = self.afterthought(&state.effects, &selected.whitening, state.fit.clone(), COMPARING);
        let explained = selected.gained(&self.setting, &state.fit);
        if self.gain(&fit, state) <= (SHARE * explained).max(0.0) || self.beyond(&state.effects, &fit, state).1 <= 0.0 {
            return;
        }
        let Some(other) = self.renewed(selected, state.effects.clone(), &fit) else { return };
        *selected = other;
        self.exchange(selected, first, Newest::Open);
    }

    /// The members after another has joined, each contested by what could stand in its place. For the newest that has just been seen; but what
    /// was seen for the first was seen beside a base model that bends to what is missing.
    pub(super) fn contest(&self, selected: &mut Selected, first: &[Response]) {
        let before = selected.state.effects.clone();
        let seen = selected.rivals.last().cloned();
        if before.len() > self.fixed(selected) + 1 {
            return self.exchange(selected, first, Newest::Seen);
        }
        self.exchange(selected, first, Newest::Open);
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

    /// Drops each member in turn and takes the best replacement if it gains; keeps the others as rivals. Those of the newest member need not be
    /// sought if they are known, as long as nothing else changes. Where the search ends at its limit those stay that were known before.
    pub(crate) fn exchange(&self, selected: &mut Selected, first: &[Response], mut newest: Newest) {
        let fixed = self.fixed(selected);
        let mut member = fixed;
        let mut exchanged = 0;
        if selected.rivals.len() != selected.state.effects.len() {
            selected.rivals = vec![Vec::new(); selected.state.effects.len()];
        }
        while member < selected.state.effects.len() && !self.setting.exhausted() {
            if newest == Newest::Seen && member + 1 == selected.state.effects.len() {
                break;
            }
            let (rest, refined) = self.replacements(selected, member, first);
            // A contest that was cut short says less than the one before it.
            if self.setting.exhausted() && !selected.rivals[member].is_empty() {
                break;
            }
            let present = self.present(selected, &rest, member);
            let before = rest.fit.likelihood(&self.setting);
            let scores = self.scores(&refined, std::slice::from_ref(&present), before);
            let refined = distinct(refined, scores);
            let better = refined.first().filter(|b| b.score > present.score + EXCHANGE);
            let simpler = || refined.iter().find(|candidate| self.no_more(&present, candidate, before));
            let better = better.or_else(simpler).filter(|_| exchanged < MOST);
            let replaced = better.and_then(|best| {
                let next = self.renewed(selected, rest.and(best.effect), &best.fit)?;
                let others: Vec<Refined> = refined.iter().chain([&present]).cloned().collect();
                Some(Selected { rivals: of_the_last(next.state.effects.len(), self.beside(&rest, &others, best)), ..next })
            });
            exchanged += usize::from(replaced.is_some());
            if let Some(next) = replaced.or_else(|| self.pruned(selected, &rest, present.score)) {
                *selected = next;
                selected.rivals.resize(selected.state.effects.len(), Vec::new());
                newest = Newest::Open;
                member = fixed;
                continue;
            }
            selected.rivals[member] = self.beside(&rest, &refined, &present);
            member += 1;
        }
    }

    /// The model without a member, and what could take its place.
    fn replacements(&self, selected: &Selected, member: usize, first: &[Response]) -> (State, Vec<Refined>) {
        let base = || selected.plain();
        let Some(rest) = self.without(selected, member) else { return (base(), Vec::new()) };
        let dropped = selected.state.effects[member];
        let responses = self.responses_beside(&rest, selected, first);
        let screened = self.screen(&rest, &selected.whitening, &responses);
        let others: Vec<Vec<Candidate>> = screened.into_iter().filter(|c| c[0].effect != dropped).collect();
        let unbent = self.unbent(&selected.state, member);
        let gain = self.gain(&selected.state.fit, &rest);
        let field = Field::contest(&unbent, gain, selected.gained(&self.setting, &rest.fit));
        let mut refined = self.refine(&rest, &selected.whitening, &others, &responses, &field).alone;
        // Of the forms of one cause no more than a few race.
        let left_behind = |i: usize| self.is_form_of(dropped, i) && !refined.iter().any(|r| r.effect == i);
        let tried = |i: &usize| (self.stands_in(*i, dropped) || left_behind(*i)) && self.joins(*i, &rest.effects);
        let tried: Vec<usize> = (0..self.library.len()).filter(tried).collect();
        // From where the member is: of what only stands in for it nothing is to be seen without it.
        let placed = |i: usize| self.placed(i, self.starts_at(i, &selected.state, &[member]), &unbent, selected, &rest);
        refined.extend(tried.into_iter().filter_map(placed));
        refined.sort_by(|a, b| b.score.total_cmp(&a.score));
        (rest, refined)
    }

    /// Whether an effect may stand in for another and for nothing else.
    fn stands_in(&self, effect: usize, other: usize) -> bool {
        let [effect, other] = [effect, other].map(|i| self.effect(i));
        // What is two effects at once is asked for in the place of both.
        let akin = effect.name() == other.name() || (effect.family() == other.family() && effect.at_once().is_none());
        akin && effect.stands_in() && effect.inapplicable(self.setting.scene).is_none()
    }

    /// A selection in the place of another, under the noise that it leaves.
    pub(super) fn renewed(&self, selected: &Selected, effects: Vec<usize>, fit: &Fit) -> Option<Selected> {
        let (whitening, fit) = self.under_its_own(&effects, fit, &selected.whitening, FINAL)?;
        let (_, base) = self.under(&[], &selected.base, &whitening.noise, COMPARING)?;
        Some(Selected { state: State { effects, fit }, whitening, base, rivals: Vec::new(), ranking: selected.ranking.clone() })
    }

    /// A member as it stands beside the candidates for its place.
    pub(super) fn present(&self, selected: &Selected, rest: &State, member: usize) -> Refined {
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
        if present > 0.0 && self.matters(selected, rest, present) {
            return None;
        }
        self.only(selected, rest)
    }

    /// How the stamps jitter beside a selection, if they do.
    pub(crate) fn jitter(&self, selected: &Selected) -> Option<Jitter> {
        self.jittered(selected, |jitter, _| jitter)
    }

    /// What returns with a wheel's turning beside a selection, if anything does.
    pub(crate) fn line(&self, selected: &Selected) -> Option<OrderLine> {
        self.asked(selected, lined)
    }

    /// Whether the wheels' speeds come in whole counts, beside a selection.
    pub(crate) fn counted(&self, selected: &Selected) -> bool {
        self.asked(selected, counted)
    }

    fn jittered<T>(&self, selected: &Selected, ask: impl FnOnce(Jitter, &Comparison<'_>) -> T) -> Option<T> {
        self.asked(selected, |comparison| jittered(comparison, ask))
    }

    /// By how much a model lets commands come late, or what is recorded, which looks alike.
    pub(crate) fn late(&self, state: &State) -> Vec<f64> {
        let late = self.effects(&state.effects).into_iter().zip(self.values(state)).find(|(effect, _)| delays(*effect));
        late.map_or_else(Vec::new, |(_, values)| values)
    }

    /// Asks a test that looks at the whitened rest of a selection's free run.
    fn asked<T>(&self, selected: &Selected, test: impl FnOnce(&Comparison<'_>) -> T) -> T {
        let (setting, simulated) = (&self.setting, &selected.state.fit.simulated);
        let rest = setting.layout.series(&left(setting, simulated));
        whitened(setting, &setting.layout.series(simulated), rest, &self.late(&selected.state), &selected.whitening.noise, test)
    }

    /// The selection, contested again under noise that is louder where the robot accelerates, if stamps jitter: there scatter makes evidence
    /// for whatever acts while the robot accelerates.
    pub(crate) fn unjittered(&self, selected: Selected, first: &[Response]) -> Selected {
        let Selected { state, whitening, .. } = &selected;
        if state.effects.len() == self.fixed(&selected) {
            return selected;
        }
        let scatter = self.jittered(&selected, |jitter, comparison| (jitter.of, jitter.factors(comparison)));
        let Some((of, factors)) = scatter else { return selected };
        let residual = left(&self.setting, &state.fit.simulated);
        let noise = whitening.noise.evened(&residual, &self.setting.layout, &factors);
        let under = |effects: &[usize], fit: &Fit, effort| self.under(effects, fit, &noise, effort);
        let (Some((whitening, fit)), Some((_, base))) = (under(&state.effects, &state.fit, FINAL), under(&[], &selected.base, COMPARING))
        else {
            return selected;
        };
        let mut evened = Selected { state: State { effects: state.effects.clone(), fit }, whitening, base, ..selected };
        self.exchange(&mut evened, first, Newest::Open);
        if of == Scatter::Messages { self.commanded(evened) } else { evened }
    }

    /// The selection with a late command in the place of a late sensor, which looks alike: where each message is late by a time of its own it is the
    /// messages that are late.
    fn commanded(&self, selected: Selected) -> Selected {
        let Selected { state, whitening, .. } = &selected;
        let instead = self.by_command(&state.effects);
        let fitted = instead.and_then(|effects| Some((self.under(&effects, &state.fit, &whitening.noise, FINAL)?, effects)));
        match fitted {
            Some(((whitening, fit), effects)) => Selected { state: State { effects, fit }, whitening, ..selected },
            None => selected,
        }
    }

    /// Effects with the late command that looks like the late sensor among them.
    fn by_command(&self, effects: &[usize]) -> Option<Vec<usize>> {
        let of = |i: usize| self.effect(i);
        let member = effects.iter().position(|i| of(*i).stage() == Stage::Reading && delays(of(*i)))?;
        let count = |i: usize| self.parameters(&[i]).len();
        let twin = |i: usize| {
            let same = always(of(effects[member]), of(i)).is_some();
            same && of(i).stage() == Stage::Transport && count(i) == count(effects[member])
        };
        let mut effects = effects.to_vec();
        effects[member] = self.open.iter().copied().find(|i| twin(*i))?;
        Some(effects)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{ActuatorLag, CommandDelay, SensorDelay};
    use crate::fixture::{Case, with_selected};
    use wheelwright_core::effect::Effect;

    #[test]
    fn rivals_that_were_known_stay_where_the_search_is_at_its_limit() {
        let mut case = Case::clean(6);
        for stretch in &mut case.data.stretches {
            stretch.outputs.iter_mut().for_each(|y| y.rotate_right(2));
        }
        let library: Vec<Box<dyn Effect>> = vec![
            Box::new(CommandDelay::default()),
            Box::new(SensorDelay::default()),
            Box::new(ActuatorLag::default()),
            Box::new(CommandDelay { each_axis: true }),
        ];
        with_selected(&case, &library, 1, |search, mut selected| {
            let responses = search.respond(&selected.plain());
            search.exchange(&mut selected, &responses, Newest::Open);
            let known = |selected: &Selected| selected.rivals.iter().flatten().map(|rival| rival.effect).collect::<Vec<_>>();
            let before = (selected.state.effects.clone(), known(&selected));
            assert!(before.1.len() > 1, "{before:?}");
            // At the limit already, and there after one more run.
            for beyond in [1, 0] {
                search.setting.work.set(search.setting.most_steps + beyond);
                search.exchange(&mut selected, &responses, Newest::Open);
                assert_eq!((selected.state.effects.clone(), known(&selected)), before);
            }
        });
    }
}
