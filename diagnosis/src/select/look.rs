//! What every effect would change beside a model, and what of that is worth a look.

use std::borrow::Cow;

use wheelwright_core::effect::{Effect, Stage, Start};

use super::{RESIMULATED, Search, Selected, State, coloured};
use crate::fit::whitening::Whitening;
use crate::race::even;
use crate::screen::{Candidate, Current, Projected, Projection, Response, responses, responses_at};

impl<'a> Search<'a> {
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

    /// Responses about the base model of what is only tried where the noise goes on from sample to sample, as it may be no noise: of each effect the
    /// best starts.
    pub(crate) fn last_resorts(&self, base: &State, whitening: &Whitening) -> Vec<Response> {
        if !coloured(&whitening.noise) {
            return Vec::new();
        }
        let about = self.respond_of(&self.applying(&|i| self.effect(*i).last_resort()), base);
        let best = self.screen(base, whitening, &about).into_iter().flat_map(|starts| starts.into_iter().take(RESIMULATED.1));
        best.map(|candidate| about[candidate.response].clone()).collect()
    }

    /// Whether an effect goes round with something.
    pub(crate) fn turns(&self, effect: usize) -> bool {
        let effect = self.effect(effect);
        let start = effect.starts(self.setting.scene).into_iter().next();
        start.is_some_and(|start| effect.turned(&start.values, 0, 0.0).is_some())
    }

    /// Whether a member goes round with something.
    pub(crate) fn goes_round(&self, state: &State) -> bool {
        state.effects.iter().any(|member| self.turns(*member))
    }

    /// The effects that go round with something.
    pub(crate) fn turning(&self) -> Vec<usize> {
        self.open.iter().copied().filter(|i| self.turns(*i)).collect()
    }

    /// Those of all effects that apply, whether or not they are tried on any recording.
    pub(crate) fn applying(&self, of: &dyn Fn(&usize) -> bool) -> Vec<usize> {
        let applies = |i: &usize| self.effect(*i).inapplicable(self.setting.scene).is_none();
        (0..self.library.len()).filter(of).filter(applies).collect()
    }

    /// The effects that go round as a member does, whether or not they are tried on any recording.
    pub(crate) fn turning_with(&self, members: &[usize]) -> Vec<usize> {
        let lines: Vec<Option<f64>> = members.iter().filter(|i| self.turns(**i)).map(|i| self.effect(*i).line()).collect();
        self.applying(&|i| lines.contains(&self.effect(*i).line()) && self.turns(*i))
    }

    /// Responses about a model, of which `first` are those about the base model.
    pub(super) fn responses_beside<'r>(&self, state: &State, selected: &Selected, first: &'r [Response]) -> Cow<'r, [Response]> {
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
        let of = |candidates: &Vec<Candidate>, places: usize| {
            let starts = apart(candidates.iter().map(|c| &first[c.response].start), places);
            responses_at(&current, candidates[0].effect, self.effect(candidates[0].effect), starts)
        };
        // What a loop promised beside the base model says nothing of what it does beside another: it is always among them. So is a threshold,
        // which lets through what something else makes of a command; of its variants the plain one, that all others begin from.
        let always = |c: &Vec<Candidate>| match self.effect(c[0].effect).stage() {
            Stage::Loop => true,
            Stage::Threshold => self.plain(c[0].effect),
            _ => false,
        };
        let anew = screened.iter().filter(|c| always(c)).flat_map(|c| {
            let even = self.effect(c[0].effect).starts(self.setting.scene).into_iter().filter(even).collect();
            responses_at(&current, c[0].effect, self.effect(c[0].effect), even)
        });
        // Nor does it of what has to do with what was found: what had evidence by itself is among them too.
        let open = |c: &&Vec<Candidate>| !always(c);
        let alone = ranking.iter().filter(|(_, score)| *score > 0.0).filter_map(|(i, _)| screened.iter().find(|c| c[0].effect == *i));
        let alone: Vec<_> = alone.filter(open).filter(self.few()).take(RESIMULATED.0 / 2).collect();
        let others = |c: &&Vec<Candidate>| open(c) && alone.iter().all(|a| a[0].effect != c[0].effect);
        let beside = screened.iter().filter(others).filter(self.few()).take(RESIMULATED.0 - alone.len());
        let looked_at: Vec<_> = alone.iter().copied().chain(beside).collect();
        // Of every other cause at least the plain form gets a look: what hides in what was found may have promised nothing before.
        let left = |c: &&Vec<Candidate>| open(c) && self.plain(c[0].effect) && looked_at.iter().all(|l| l[0].effect != c[0].effect);
        let once = screened.iter().filter(left).flat_map(|c| of(c, 1));
        looked_at.iter().flat_map(|c| of(c, RESIMULATED.1)).chain(once).chain(anew).collect()
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
}

/// So many starts, best first, of which no two have a value in common that the others vary: what was best about another model says little of which
/// size is best about this one, and neighbours say the same. The next best ones fill what is left of the places.
fn apart<'s>(starts: impl Iterator<Item = &'s Start> + Clone, places: usize) -> Vec<Start> {
    let varied = |j: &usize| {
        let mut values = starts.clone().map(|start| start.values[*j]);
        let first = values.next();
        values.any(|v| Some(v) != first)
    };
    let varied: Vec<usize> = (0..starts.clone().next().map_or(0, |start| start.values.len())).filter(varied).collect();
    let (mut chosen, mut others): (Vec<&Start>, Vec<&Start>) = (Vec::new(), Vec::new());
    for start in starts {
        let near = chosen.iter().any(|c| varied.iter().any(|j| c.values[*j] == start.values[*j]));
        if near { others.push(start) } else { chosen.push(start) }
    }
    chosen.into_iter().chain(others).take(places).cloned().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn starts_that_get_a_second_look_differ_in_all_that_is_varied() {
        let start = |a: f64, b: f64| Start { values: vec![a, 7.0, b], columns: vec![vec![0]], linear: false };
        let ranked = [start(1.0, 0.1), start(1.0, 0.2), start(2.0, 0.1), start(2.0, 0.2), start(3.0, 0.3)];
        let chosen = |places| apart(ranked.iter(), places).into_iter().map(|s| (s.values[0], s.values[2])).collect::<Vec<_>>();
        assert_eq!(chosen(3), [(1.0, 0.1), (2.0, 0.2), (3.0, 0.3)]);
        assert_eq!(chosen(4)[3], (1.0, 0.2), "the best of the others fills what is left");
        assert_eq!(apart([start(1.0, 0.1)].iter(), 3).len(), 1);
    }
}
