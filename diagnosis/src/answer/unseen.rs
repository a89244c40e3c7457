//! The same cause elsewhere: what limits one axis limits the other as well, at a size that the training data need not reach for other driving to do so.

use wheelwright_core::Dataset;
use wheelwright_core::effect::{Estimate, Scene, Start};

use crate::fit::setting::Point;
use crate::holdout::{Loss, fits, mean};
use crate::leeway::Leeway;
use crate::residuals::Series;
use crate::select::{Search, Selected, State};

use super::findings::MENTIONED;
use super::proof::proven;

/// Another axis or side of a cause that was found.
pub(super) struct Unseen {
    /// What held-out data leave with it.
    pub(super) losses: Vec<Loss>,
    /// What it is there, and the fit with it, in a sentence.
    pub(super) statement: String,
}

/// Of the other axes and sides of what was found, at sizes of which the training data know nothing, the one with which the least is left of
/// held-out data.
pub(super) fn unseen(
    search: &Search<'_>,
    selected: &Selected,
    data: &Dataset,
    scene: &Scene,
    losses: impl Fn(&Series) -> Vec<Loss>,
) -> Option<Unseen> {
    let kin: Vec<(usize, Start)> =
        search.open.iter().filter(|i| elsewhere(search, selected, **i)).flat_map(|i| begin(search, *i)).collect();
    if kin.is_empty() {
        return None;
    }
    let left = |state: &State| mean(&losses(&proven(search, state, data, scene).simulated));
    let states = out_of_reach(search, selected, kin)?.map(|state| (left(&state), state));
    let (_, state) = states.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let there = Leeway::new(search, &state, &selected.whitening.noise).moved(data, scene)?;
    let effect = search.effect(*state.effects.last()?);
    let values = &there.x[there.x.len() - effect.parameters(scene).len()..];
    let statement = effect.statement(&Estimate::bare(values), search.setting.scene);
    let fits = data.outputs.iter().zip(fits(data, &there.simulated)).map(|(output, fit)| format!("{} {fit:.1} %", output.name));
    let statement = format!("{statement}; with it the fit there is {}", fits.collect::<Vec<_>>().join(", "));
    Some(Unseen { losses: losses(&there.simulated), statement })
}

/// Whether an effect is another part of a member's cause, which may stand beside it.
fn elsewhere(search: &Search<'_>, selected: &Selected, effect: usize) -> bool {
    let members = &selected.state.effects;
    members.iter().any(|m| search.effect(*m).name() == search.effect(effect).name()) && search.joins(effect, members)
}

/// The starts of an effect that begins at a size: what is proportional shows in any driving.
fn begin(search: &Search<'_>, effect: usize) -> impl Iterator<Item = (usize, Start)> {
    let starts = search.effect(effect).starts(search.setting.scene).into_iter();
    starts.filter(|start| !start.linear).map(move |start| (effect, start))
}

/// The selection with a further part of a cause, from each start at which the training data are as well explained with it as without.
fn out_of_reach<'a>(
    search: &'a Search<'_>,
    selected: &'a Selected,
    kin: Vec<(usize, Start)>,
) -> Option<impl Iterator<Item = State> + use<'a>> {
    let (state, noise) = (&selected.state, &selected.whitening.noise);
    let at = move |effects: &[usize], x: Vec<f64>| {
        let point = Point { x, starts: state.fit.point.starts.clone() };
        search.at(effects, point, noise).map(|(_, fit)| fit)
    };
    let without = at(&state.effects, state.fit.point.x.clone())?.likelihood(&search.setting);
    let tried = kin.into_iter().filter(|_| !search.setting.exhausted());
    Some(tried.filter_map(move |(effect, start)| {
        let effects = state.and(effect);
        let fit = at(&effects, state.fit.point.x.iter().copied().chain(start.values).collect())?;
        (without - fit.likelihood(&search.setting) < MENTIONED).then_some(State { effects, fit })
    }))
}
