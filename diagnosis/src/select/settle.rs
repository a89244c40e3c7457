//! What selection ends with: no member that is worth nothing, each by the name of what it is, and beside it what is the same under every drive.

use wheelwright_core::effect::{Effect, EffectParameter};

use super::contest::of_the_last;
use super::{EXCHANGE, Newest, Rival, SHARE, Search, Selected, State};
use crate::answer::{AMBIGUOUS, always};
use crate::race::Refined;
use crate::screen::Response;

/// A member's rivals, and those of the others.
pub(super) fn others(selected: &Selected, member: usize) -> (Vec<Rival>, Vec<Vec<Rival>>) {
    let mut rivals = selected.rivals.clone();
    rivals.resize(selected.state.effects.len(), Vec::new());
    (rivals.remove(member), rivals)
}

/// A selection with the rivals of one in which another effect had a place: the one that came in stands last, beside the other's rivals but
/// itself.
fn succeeding(before: &Selected, member: usize, by: Selected) -> Selected {
    let (mut own, mut rivals) = others(before, member);
    own.retain(|r| Some(&r.effect) != by.state.effects.last());
    rivals.push(own);
    Selected { rivals, ..by }
}

impl<'a> Search<'a> {
    /// The selection without members that are worth hardly anything once all is fitted to the end: a place was contested under other noise, or with
    /// others beside it, and that nothing is missing there is a rival as any other, which these data have to exclude; nor those that, beside
    /// the others as these are now, are no more than their imperfect form. And what it is without each that stays.
    pub(crate) fn settled(&self, selected: Selected) -> (Selected, Vec<Option<State>>) {
        let mut selected = self.named(selected);
        let (mut member, mut rests) = (self.fixed(&selected), self.rests(&selected));
        while member < selected.state.effects.len() {
            let superfluous = |rest: &&State| {
                let worth = self.worth(&selected, rest);
                worth < AMBIGUOUS || !self.matters(&selected, rest, worth)
            };
            let rest = rests[member].as_ref().filter(superfluous);
            match rest.and_then(|rest| self.only(&selected, rest)) {
                Some(fewer) => {
                    let (_, rivals) = others(&selected, member);
                    selected = Selected { rivals, ..fewer };
                    rests = self.rests(&selected);
                }
                None => member += 1,
            }
        }
        (selected, rests)
    }

    /// The selection with one effect in the place of two, as long as there is such: what was found first may be a part of what, in its place, needs
    /// nothing beside it.
    pub(super) fn simplify(&self, selected: &mut Selected, first: &[Response]) {
        while let Some(simpler) = self.simpler(selected) {
            *selected = simpler;
            self.exchange(selected, first, Newest::Open);
        }
    }

    /// The model with one effect in the place of two members: each form of the cause of one of them, for which what the other one does may have been looked for
    /// by itself, and each that is both at once.
    fn in_place_of_two(&self, selected: &Selected, pair: [usize; 2]) -> Vec<State> {
        let keep = |i: usize| !pair.contains(&i);
        let Some(rest) = self.keeping(selected, &keep).filter(|_| !self.setting.exhausted()) else { return Vec::new() };
        let unbent = self.part(&selected.state, &keep);
        let found = pair.map(|member| selected.state.effects[member]);
        let named = |i: usize| move |k: &usize| found[*k] != i && self.effect(found[*k]).name() == self.effect(i).name();
        let forms = self.open.iter().filter_map(|i| [0, 1].into_iter().find(named(*i)).map(|k| (*i, vec![pair[k]])));
        let both = (0..self.library.len()).filter(|i| self.is_at_once(*i, found)).map(|i| (i, pair.to_vec()));
        let placed = |(i, of): (usize, Vec<usize>)| {
            let placed = self.placed(i, self.starts_at(i, &selected.state, &of), &unbent, selected, &rest)?;
            Some(State { effects: rest.and(i), fit: placed.fit })
        };
        forms.chain(both).filter(|(i, _)| self.joins(*i, &rest.effects)).filter_map(placed).collect()
    }

    /// Whether an effect is two others at once.
    fn is_at_once(&self, effect: usize, found: [usize; 2]) -> bool {
        let (effect, [one, other]) = (self.effect(effect), found.map(|i| self.effect(i).family()));
        let both = effect.at_once().is_some_and(|of| of == [one, other] || of == [other, one]);
        both && effect.inapplicable(self.setting.scene).is_none()
    }

    /// The selection with the rival of a member that makes another one superfluous, or another form of it, if there is such: the one with which the least is
    /// lost.
    fn simpler(&self, selected: &Selected) -> Option<Selected> {
        let fixed = self.fixed(selected);
        let pairs = (fixed..selected.state.effects.len()).flat_map(|other| (fixed..other).map(move |member| [member, other]));
        let forms = pairs.flat_map(|pair| self.in_place_of_two(selected, pair));
        let near = |rival: &&Rival| rival.gap < AMBIGUOUS + self.penalty(1.0);
        let rests = selected.rivals.iter().skip(fixed).flatten().filter(near).flat_map(|rival| {
            // The rival itself stands last.
            let others = fixed..rival.state.effects.len() - 1;
            others.filter_map(|other| self.reduced(&rival.state, selected, &|i| i != other))
        });
        let lost = |rest: State| {
            let (freedom, worth) = self.beyond(&selected.state.effects, &selected.state.fit, &rest);
            (worth, freedom, rest)
        };
        let mut all: Vec<(f64, f64, State)> = rests.chain(forms).map(lost).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (least, freedom, best) = all.first().filter(|(worth, ..)| *worth < AMBIGUOUS)?;
        // The others that need nothing beside them either are its rivals.
        let (last, beside) = best.effects.split_last()?;
        let others = all.iter().filter(|(.., rest)| rest.effects.split_last().is_some_and(|(other, also)| other != last && also == beside));
        let rival = |(worth, own, rest): &(f64, f64, State)| Rival {
            effect: rest.effects[beside.len()],
            state: rest.clone(),
            gap: worth - least,
            cost: self.log_values() * (freedom - own),
        };
        let rivals = of_the_last(best.effects.len(), others.map(rival).collect());
        self.only(selected, best).map(|simpler| Selected { rivals, ..simpler })
    }

    /// The selection with its members by the names of what they are: of a law that one contains, where that explains as much from where the
    /// member is. A contest may have been left before it saw that, or begun too far away.
    fn named(&self, mut selected: Selected) -> Selected {
        for member in (self.fixed(&selected)..selected.state.effects.len()).rev() {
            let Some(narrow) = self.narrowed(&selected, member) else { continue };
            selected = succeeding(&selected, member, narrow);
        }
        selected
    }

    /// The selection with a narrower law in the place of a member, if it is all that the member is.
    fn narrowed(&self, selected: &Selected, member: usize) -> Option<Selected> {
        let wide = self.effect(selected.state.effects[member]);
        let values = &self.values(&selected.state)[member];
        let name = wide.narrower(values, self.setting.scene);
        let within = |i: &&usize| {
            let narrow = self.effect(**i).name();
            let sought = narrow != wide.name() && !self.starts(**i).is_empty();
            sought && (name == Some(narrow) || wide.contains().contains(&narrow))
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
        self.only(selected, &state).filter(|narrow| self.explains_as_much(narrow, selected, &rest))
    }

    /// Whether a selection explains what another one does beyond the rest of it, but for what laws are inexact by.
    fn explains_as_much(&self, by: &Selected, selected: &Selected, rest: &State) -> bool {
        let gain = self.gain(&by.state.fit, rest);
        self.gain(&selected.state.fit, rest) - gain <= EXCHANGE.max(SHARE * gain)
    }

    /// The selection with a member by the name of another effect whose values are the same, if that explains as much.
    pub(crate) fn renamed(&self, selected: &Selected, member: usize, name: &str) -> Option<Selected> {
        let (rest, z) = (self.without(selected, member)?, self.unbent(&selected.state, member));
        let (found, values) = (self.effect(selected.state.effects[member]), &self.values(&selected.state)[member]);
        let placed = |i: usize| {
            let start = self.as_part_of(i, found, values).filter(|start| start.len() == values.len())?;
            self.placed(i, vec![start], &z, selected, &rest)
        };
        let best = self.open.iter().filter(|i| self.effect(**i).name() == name).find_map(|i| placed(*i))?;
        let by = self.only(selected, &State { effects: rest.and(best.effect), fit: best.fit })?;
        self.explains_as_much(&by, selected, &rest).then(|| succeeding(selected, member, by))
    }

    /// The selection with its members by the names under which a person is told of them, and without rivals of the same name.
    pub(crate) fn told(&self, mut selected: Selected) -> Selected {
        let values = self.values(&selected.state);
        for member in self.fixed(&selected)..selected.state.effects.len() {
            let found = self.told_as(selected.state.effects[member], &values[member]);
            selected.state.effects[member] = found;
            let same = |r: &Rival| self.values(&r.state).last().map(|values| self.effect(self.told_as(r.effect, values)).name());
            if let Some(rivals) = selected.rivals.get_mut(member) {
                rivals.retain(|r| same(r) != Some(self.effect(found).name()));
            }
        }
        selected
    }

    /// The effect as which another one is told with its values: itself, or one with the same parameters.
    fn told_as(&self, effect: usize, values: &[f64]) -> usize {
        let found = self.effect(effect);
        let Some(name) = found.told_as(values) else { return effect };
        let same = |i: &&usize| {
            let other = self.effect(**i);
            other.name() == name && other.parameters(self.setting.scene) == found.parameters(self.setting.scene)
        };
        self.open.iter().find(same).copied().unwrap_or(effect)
    }

    /// What the selection is with each law in a member's place that contains it, of the same name or of another.
    pub(crate) fn wider(&self, selected: &Selected, member: usize) -> Vec<Selected> {
        let own = selected.state.effects[member];
        let contains = |i: &&usize| {
            let (found, other) = (self.effect(own), self.effect(**i));
            if other.name() == found.name() { self.is_form_of(own, **i) } else { other.contains().contains(&found.name()) }
        };
        let wide: Vec<usize> = self.open.iter().filter(contains).copied().collect();
        if wide.is_empty() {
            return Vec::new();
        }
        let Some(rest) = self.without(selected, member) else { return Vec::new() };
        let (z, (freedom, worth)) =
            (self.unbent(&selected.state, member), self.beyond(&selected.state.effects, &selected.state.fit, &rest));
        let placed = |i: usize| {
            let Refined { fit, .. } = self.placed(i, self.starts_at(i, &selected.state, &[member]), &z, selected, &rest)?;
            let by = self.only(selected, &State { effects: rest.and(i), fit })?;
            let (wider_freedom, wider_worth) = self.beyond(&by.state.effects, &by.state.fit, &rest);
            let mut wider = succeeding(selected, member, by);
            for rival in wider.rivals.iter_mut().skip(rest.effects.len()).flatten() {
                rival.gap += wider_worth - worth;
                rival.cost += self.penalty(freedom) - self.penalty(wider_freedom);
            }
            wider.state = self.modest(wider.state, &wider.whitening, &wider.base);
            Some(wider)
        };
        wide.into_iter().filter(|i| self.joins(*i, &rest.effects)).filter_map(placed).collect()
    }

    /// Whether an effect has all that another one of its name has, and more.
    pub(super) fn is_form_of(&self, narrow: usize, wide: usize) -> bool {
        let wide = self.effect(wide);
        if wide.name() != self.effect(narrow).name() || wide.inapplicable(self.setting.scene).is_some() {
            return false;
        }
        let all = wide.parameters(self.setting.scene).len();
        self.as_part_of(narrow, wide, &vec![0.0; all]).is_some_and(|own| own.len() < all)
    }

    /// Values from which an effect may start.
    fn starts(&self, effect: usize) -> Vec<Vec<f64>> {
        self.effect(effect).starts(self.setting.scene).into_iter().map(|start| start.values).collect()
    }

    /// Values from which an effect may start in the place of members: its own, and those with what it has by the same name as one of them has it.
    pub(super) fn starts_at(&self, effect: usize, state: &State, members: &[usize]) -> Vec<Vec<f64>> {
        let values = self.values(state);
        let of = |member: &usize| self.values_in(effect, self.effect(state.effects[*member]), &values[*member]);
        let known: Vec<Vec<Option<f64>>> = members.iter().map(of).collect();
        let known = |i: usize| known.iter().find_map(|of| of[i]);
        let at = |values: &Vec<f64>| values.iter().enumerate().map(|(i, start)| known(i).unwrap_or(*start)).collect();
        let own = self.starts(effect);
        let there: Vec<Vec<f64>> = own.iter().map(at).filter(|values| !own.contains(values)).collect();
        own.into_iter().chain(there).collect()
    }

    /// An effect's values as those of a wider one have them, if it has all of them.
    fn as_part_of(&self, effect: usize, wide: &dyn Effect, values: &[f64]) -> Option<Vec<f64>> {
        self.values_in(effect, wide, values).into_iter().collect()
    }

    /// Of each parameter of an effect the value that another one has for it, if it has it.
    fn values_in(&self, effect: usize, other: &dyn Effect, values: &[f64]) -> Vec<Option<f64>> {
        let whole = other.parameters(self.setting.scene);
        // What has a side in the one has none in the other, which has it for both.
        let same = |p: &EffectParameter, own: &EffectParameter| {
            p.name == own.name && (p.label.is_none() || own.label.is_none() || p.label == own.label)
        };
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
            let present = self.present(selected, rest, member);
            selected.rivals[member].extend(self.beside(rest, &twins, &present));
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

    use super::*;
    use crate::effects::{
        CastorDrag, CastorKind, CommandDelay, CommandOffset, CoulombFriction, DirectionAsymmetry, FrictionLaw, QuadraticDrag,
        RollingResistance, SensorDelay, StribeckFriction,
    };
    use crate::fit::search::evaluate;
    use crate::fixture::{Case, NOISE, hiding, normal, point, with_selected};

    #[test]
    fn members_that_are_worth_nothing_go() {
        let library: Vec<Box<dyn Effect>> = vec![Box::new(CoulombFriction::default()), Box::new(QuadraticDrag::default())];
        with_selected(&Case::clean(5), &library, 2, |search, selected| {
            let (settled, rests) = search.settled(selected);
            assert_eq!((settled.state.effects.len(), settled.rivals.len(), rests.len()), (0, 0, 0));
        });
    }

    #[test]
    fn a_member_that_might_as_well_be_nothing_goes() {
        // A drag whose evidence is positive, and no more than chance gives once in twenty times.
        let with = |drag: f64| Case::new(5, move |_, i, y, _, random| y - [drag, 0.0][i] * y * y.abs() + NOISE[i] * normal(random));
        let library: Vec<Box<dyn Effect>> = vec![Box::new(QuadraticDrag::default())];
        let mut seen = [0, 0];
        for k in 0..24 {
            with_selected(&with(0.002 * f64::from(k)), &library, 1, |search, selected| {
                let rest = search.rests(&selected)[0].clone();
                let worth = rest.map_or(f64::NAN, |rest| search.worth(&selected, &rest));
                let stays = search.settled(selected).0.state.effects.len();
                assert_eq!(stays, usize::from(worth >= AMBIGUOUS), "{k}: {worth}");
                seen[stays] += usize::from(worth > 0.0);
            });
        }
        assert!(seen[0] > 0 && seen[1] > 0, "{seen:?}");
    }

    #[test]
    fn a_member_goes_that_is_no_more_than_the_imperfect_form_of_the_others() {
        let library: Vec<Box<dyn Effect>> = vec![Box::new(CoulombFriction::default()), Box::new(QuadraticDrag::default())];
        // The evidence of the one drag is 32 of 3800, that of the other 240.
        for (drag, stay) in [(0.4, 1), (2.0, 2)] {
            let case = hiding(5, &library, &[0, 1], &[0.1, 1.0, drag, 0.0, 2.0]);
            with_selected(&case, &library, 2, |search, selected| {
                let rest = search.without(&selected, 1).unwrap();
                assert!(search.worth(&selected, &rest) > AMBIGUOUS);
                assert_eq!(search.settled(selected).0.state.effects.len(), stay, "{drag}");
            });
        }
    }

    #[test]
    fn one_effect_takes_the_place_of_two_that_are_its_parts() {
        let library: Vec<Box<dyn Effect>> =
            vec![Box::new(CommandOffset {}), Box::new(CoulombFriction::default()), Box::new(DirectionAsymmetry::default())];
        // Dry friction of another size backwards is plain friction and an offset; beside an offset in turning it is not all.
        let hidden: [(&[usize], &[f64]); 2] = [(&[2], &[0.05, 0.02, 1.0]), (&[0, 2], &[0.0, 0.1, 0.05, 0.02, 1.0])];
        for (truth, values) in hidden {
            let case = hiding(5, &library, truth, values);
            with_selected(&case, &library, 2, |search, mut selected| {
                let first = search.respond(&selected.plain());
                let with = point(&selected.base, search.setting.free(), &[0.0, 0.0, 0.03, 0.03, 1.0]);
                let (_, fit) = search.at(&[0, 2], with, &selected.whitening.noise).unwrap();
                let state = State { effects: vec![0, 2], fit };
                selected.rivals[1] = vec![Rival { effect: 2, state, gap: 0.0, cost: 0.0 }];
                search.simplify(&mut selected, &first);
                assert_eq!(selected.state.effects == [2], truth == [2], "{:?}", selected.state.effects);
            });
        }
    }

    /// Where no rival is known, a form of friction that comes up with speed stands for plain friction and an offset beside it.
    #[test]
    fn another_form_of_a_member_takes_the_place_of_two() {
        let library: Vec<Box<dyn Effect>> =
            vec![Box::new(CommandOffset {}), Box::new(CoulombFriction::default()), Box::new(CoulombFriction { law: FrictionLaw::Soft })];
        let case = hiding(6, &library, &[2], &[0.05, 0.1, 1.0]);
        with_selected(&case, &library, 2, |search, mut selected| {
            let first = search.respond(&selected.plain());
            assert!(selected.rivals.iter().all(Vec::is_empty));
            search.simplify(&mut selected, &first);
            assert_eq!(selected.state.effects, [2]);
        });
    }

    /// Friction at the driven wheels and a castor that drags, beside one another, are what resists wherever a wheel carries.
    #[test]
    fn one_that_is_two_at_once_takes_the_place_of_both() {
        let rolling = RollingResistance { castor: Some(CastorKind::Swivel) };
        let library: Vec<Box<dyn Effect>> = vec![Box::new(CoulombFriction::default()), Box::new(CastorDrag::default()), Box::new(rolling)];
        let case = hiding(7, &library, &[2], &[0.15, 0.4, 0.2, 0.05, 0.0, 1.0]);
        with_selected(&case, &library, 2, |search, mut selected| {
            let first = search.respond(&selected.plain());
            let mut found = selected.state.effects.clone();
            found.sort_unstable();
            assert_eq!(found, [0, 1]);
            search.simplify(&mut selected, &first);
            assert_eq!(selected.state.effects, [2]);
        });
    }

    #[test]
    fn rows_whose_noise_is_louder_count_for_less_of_a_misfit() {
        with_selected(&Case::clean(9), &[], 0, |search, selected| {
            let (fit, mut noise) = (&selected.state.fit, selected.whitening.noise.clone());
            let all = search.misfit(fit, &noise);
            noise.weights.iter_mut().flatten().flatten().for_each(|weight| *weight *= 0.5);
            assert!((search.misfit(fit, &noise) / all - 0.25).abs() < 1e-12);
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
}
