//! What was found, member by member: values with intervals, evidence, and what could stand in its place.

use wheelwright_core::effect::{Confusion, Effect, EffectParameter, Estimate, Stage};

use crate::finding::{Alternative, Finding, FoundParameter, settings};
use crate::fit::algebra::Directions;
use crate::select::{Rival, SHARE, Search, Selected, State, TOLD};

use super::TWO_SIDED_95;
use super::proof::Proven;

/// Rivals this near in penalised evidence cannot be told from what was found.
pub(crate) const AMBIGUOUS: f64 = 6.0;
/// Rivals up to here are mentioned.
pub(crate) const MENTIONED: f64 = 10.0;
/// How an effect says of another that no drive tells them apart.
const ALWAYS: &str = "always";

/// How far the 95 % intervals of effects' parameters go to either side, where the data tell.
fn intervals(search: &Search<'_>, selected: &Selected) -> Vec<Option<[f64; 2]>> {
    let Selected { state, whitening, .. } = selected;
    let told = Directions::of(&state.fit.information(&search.setting)).visibility();
    let known = search.known_of(state, &whitening.noise);
    let interval = |(told, sides): (&f64, [f64; 2])| (*told > TOLD).then(|| sides.map(|deviation| TWO_SIDED_95 * deviation));
    told[search.setting.free()..].iter().zip(known.deviations).map(interval).collect()
}

/// Findings, and the explanations that could take that of the whole's place.
pub(super) fn findings(search: &Search<'_>, selected: &Selected, rests: &[Option<State>], proof: &Proven) -> (Vec<Finding>, Vec<State>) {
    let mut open = Vec::new();
    let setting = &search.setting;
    let state = &selected.state;
    let halves = intervals(search, selected);
    let free = setting.free();
    let mut at = free;
    let mut all = Vec::with_capacity(state.effects.len());
    for (member, index) in state.effects.iter().enumerate() {
        let effect = search.effect(*index);
        let parameters = effect.parameters(setting.scene);
        let range = at..at + parameters.len();
        at = range.end;
        let values = state.fit.point.x[range.clone()].to_vec();
        let estimate = |(i, p): (usize, &EffectParameter)| {
            let value = values[i];
            let inside = |[below, above]: [f64; 2]| {
                let told = below.max(above) < p.scale.abs().max(value.abs()) * 100.0;
                told.then(|| ((value - below).max(p.bounds.0), (value + above).min(p.bounds.1)))
            };
            Estimate { value, ci95: halves[range.start - free + i].and_then(inside) }
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
            alternatives: alternatives(search, effect, delta_bic, rivals).into_iter().chain(parts(search, effect)).collect(),
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

/// Whether one is a friction and the other a threshold that looks like it.
pub(crate) fn like_a_threshold(a: &dyn Effect, b: &dyn Effect) -> bool {
    let stages = [a.stage(), b.stage()];
    stages.contains(&Stage::Threshold) && stages.contains(&Stage::Bearing) && confusion(a, b).is_some()
}

/// How much worse a rival may be in penalised evidence for these data to leave it so open: two frictions turn over near standstill each in its own
/// way, and no model of them is exact there; nor is one of a threshold that looks like friction.
fn reach(least: f64, found: &dyn Effect, rival: &dyn Effect, worth: f64) -> f64 {
    let frictions = found.stage() == Stage::Bearing && found.family() == rival.family();
    let inexact = frictions || like_a_threshold(found, rival);
    if always(found, rival).is_some() || inexact { least.max(SHARE * worth) } else { least }
}

/// Whether a rival is near enough to be mentioned. Of two causes that are known to look alike the one does not take the other's place by
/// having fewer parameters: what explains as much with more of them is mentioned as well, unless it is the same with a part to spare.
pub(crate) fn mentioned(found: &dyn Effect, effect: &dyn Effect, rival: &Rival, worth: f64) -> bool {
    let alike = confusion(found, effect).is_some() && !effect.contains().contains(&found.name());
    rival.gap < reach(MENTIONED, found, effect, worth) || (alike && rival.gap - rival.cost < MENTIONED)
}

/// Rivals near enough to be mentioned, each name once. What is the same under every drive differs by what nobody recorded before the first
/// sample: it is mentioned unless that is more than the imperfect form of an effect is.
fn alternatives(search: &Search<'_>, found: &dyn Effect, worth: f64, rivals: &[Rival]) -> Vec<Alternative> {
    let mut all: Vec<Alternative> = Vec::new();
    for rival in rivals {
        let effect = search.effect(rival.effect);
        if !mentioned(found, effect, rival, worth) {
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

/// What an effect is that is two others at once: the plain ones of their families beside one another.
fn parts(search: &Search<'_>, found: &dyn Effect) -> Vec<Alternative> {
    let plain = |family: &str| search.open.iter().map(|i| search.effect(*i)).find(|effect| effect.family() == family);
    let Some([Some(one), Some(other)]) = found.at_once().map(|families| families.map(plain)) else { return Vec::new() };
    let part = |of: &dyn Effect, beside: &dyn Effect| Alternative {
        name: of.name().to_owned(),
        gap: 0.0,
        because: format!("{ALWAYS}: beside `{}` it is the same motion", beside.name()),
        always: true,
        open: false,
    };
    vec![part(one, other), part(other, one)]
}

#[cfg(test)]
mod tests {
    use wheelwright_core::effect::Effect;

    use super::{MENTIONED, like_a_threshold, parts, reach};
    use crate::effects::{
        ActuatorLag, CastorDrag, CastorKind, CommandOffset, CoulombFriction, DeadZone, FrictionLaw, RollingResistance, SlewLimit,
    };
    use crate::fixture::{Case, with_selected};

    #[test]
    fn what_is_two_at_once_is_said_to_be_either() {
        let rolling = RollingResistance { castor: Some(CastorKind::Swivel) };
        let (plain, soft) = (CoulombFriction::default(), CoulombFriction { law: FrictionLaw::Soft });
        let library: Vec<Box<dyn Effect>> = vec![Box::new(plain), Box::new(soft), Box::new(CastorDrag::default()), Box::new(rolling)];
        with_selected(&Case::clean(3), &library, 0, |search, _| {
            let names = |i: usize| -> Vec<String> { parts(search, search.effect(i)).into_iter().map(|a| a.name).collect() };
            assert_eq!((names(3), names(0)), (vec!["coulomb_friction".to_owned(), "castor_drag".to_owned()], vec![]));
        });
    }

    #[test]
    fn near_standstill_no_law_is_exact() {
        let threshold = DeadZone { subtracting: true, ..DeadZone::default() };
        let friction = CoulombFriction::default();
        assert!(like_a_threshold(&threshold, &friction) && like_a_threshold(&friction, &threshold));
        assert!(!like_a_threshold(&threshold, &CommandOffset {}) && !like_a_threshold(&friction, &friction));
        let within = |worth: f64| reach(MENTIONED, &threshold, &friction, worth);
        assert!((within(3000.0) - 60.0).abs() < 1e-9 && within(100.0) == MENTIONED);
        assert_eq!(reach(MENTIONED, &ActuatorLag::default(), &SlewLimit::default(), 3000.0), MENTIONED);
    }
}
