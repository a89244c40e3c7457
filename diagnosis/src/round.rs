//! What goes round with the wheels, once something has been found: it is looked for and fitted again where the wheels stand then.

use std::cell::OnceCell;

use wheelwright_core::effect::Scene;

use crate::answer::Story;
use crate::diagnose::DECISIVE;
use crate::fit::setting::Setting;
use crate::screen::Response;
use crate::select::{Newest, Search, Selected};

/// Angle \[rad\] by which a wheel that is thought elsewhere hides what goes round with it.
const ASTRAY: f64 = 0.5;
/// Angle \[rad\] by which it shifts what was found to go round enough to be fitted again: its radius is told by the angle after many turns.
const SHIFTED: f64 = 0.1;
/// How far a line may be off its order: as far as a wheel's radius that a person measured.
const OFF_LINE: f64 = 0.05;

/// A story with the effect whose line stands out of what everything else leaves over, if there is one.
pub(crate) fn in_line(mut story: Story<'_>) -> Story<'_> {
    let Story { search, selected, .. } = &story;
    if search.full(selected) {
        return story;
    }
    let Some(line) = search.line(selected) else { return story };
    let of = |i: &usize| search.effect(*i).line().is_some_and(|order| (line.order / order - 1.0).abs() < OFF_LINE);
    let fitting = search.applying(&of);
    let about = search.respond_of(&fitting, &selected.plain());
    // One wheel, and the other as well.
    for _ in 0..2 {
        let Some(joined) = story.search.joined(&story.selected, &about) else { break };
        story.selected = joined;
        story.search.exchange(&mut story.selected, &story.responses, Newest::Open);
    }
    story
}

/// A story with what goes round with the wheels as it shows once they are followed with what was found: where a misfit took the base model away
/// nobody knew how they stood, and what was found of it has another radius.
pub(crate) fn come_round<'a>(story: Story<'a>, closer: &'a OnceCell<Scene>) -> Story<'a> {
    let Story { search, selected, .. } = &story;
    let Setting { data, layout, .. } = &search.setting;
    let members = &selected.state.effects;
    let turning = search.turning();
    let round = members.iter().any(|i| turning.contains(i));
    let nothing = members.len() == search.fixed(selected);
    if turning.is_empty() || nothing || (!round && search.full(selected)) || search.setting.exhausted() {
        return story;
    }
    let scene = closer.get_or_init(|| search.setting.scene.followed(data, &layout.series(&selected.state.fit.simulated)));
    if !astray(search.setting.scene, scene, if round { SHIFTED } else { ASTRAY }) {
        return story;
    }
    let setting = Setting { scene, ..search.setting.clone() };
    let nearer = Search { setting, library: search.library, open: search.open.clone(), known: search.known };
    let base = selected.plain();
    let about = nearer.respond_of(&turning, &base);
    let rest = search.keeping(selected, &|i| !turning.contains(&members[i])).and_then(|rest| search.only(selected, &rest));
    let Some(mut anew) = rest.and_then(|rest| nearer.joined(&rest, &about)) else { return story };
    let moved = if round { nearer.only(selected, &selected.state) } else { None };
    let Story { responses: others, first, means, .. } = story;
    let others = others.into_iter().filter(|r| !turning.contains(&r.effect));
    let mut responses: Vec<Response> = others.chain(about.iter().cloned()).collect();
    responses.sort_by_key(|r| r.effect);
    nearer.exchange(&mut anew, &responses, Newest::Open);
    nearer.other_wheel(&mut anew, &about, &responses);
    let better = |moved: &Selected| explains_more(&nearer, moved, &anew);
    let selected = match moved.filter(better) {
        Some(mut moved) => {
            nearer.exchange(&mut moved, &responses, Newest::Open);
            moved
        }
        None => anew,
    };
    Story { search: nearer, selected, responses, first, means }
}

/// Whether a selection explains decisively more than another one.
fn explains_more(search: &Search<'_>, a: &Selected, b: &Selected) -> bool {
    search.own_evidence(a) > search.own_evidence(b) + DECISIVE
}

/// Whether wheels stand elsewhere in one scene than in another, by more than an angle.
fn astray(a: &Scene, b: &Scene, angle: f64) -> bool {
    let Some(radius) = a.wheel_radius else { return false };
    let [there, here] = [a, b].map(|scene| scene.tracks.iter().flat_map(|t| &t.distance).flatten());
    there.zip(here).any(|(a, b)| (a - b).abs() > angle * radius)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

    use wheelwright_core::effect::Effect;

    use super::*;
    use crate::effects::{CommandOffset, QuadraticDrag};
    use crate::fit::setting::Point;
    use crate::fixture::{Case, NOISE, normal, with_selected};
    use crate::select::State;

    #[test]
    fn what_explains_is_told_from_what_does_not() {
        let case = Case::new(5, |_, i, y, _, random| y - [0.3, 0.0][i] * y * y.abs() + NOISE[i] * normal(random));
        let library: Vec<Box<dyn Effect>> = vec![Box::new(QuadraticDrag::default()), Box::new(CommandOffset {})];
        with_selected(&case, &library, 1, |search, drag| {
            let start = search.effect(1).starts(search.setting.scene).remove(0).values;
            let x = drag.base.point.x.iter().copied().chain(start).collect();
            let point = Point { x, starts: drag.base.point.starts.clone() };
            let (whitening, fit) = search.at(&[1], point, &drag.whitening.noise).unwrap();
            let offset = Selected { state: State { effects: vec![1], fit }, whitening, ..drag.clone() };
            assert!(explains_more(search, &drag, &offset) && !explains_more(search, &offset, &drag));
        });
    }
}
