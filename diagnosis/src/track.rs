//! The track width where none is known: where an effect at the wheels has a kink, only the right track puts it where it is.
//!
//! All effects are screened beside the base model at the widths of a grid. What promises most somewhere is fitted between the neighbours of
//! the width at which it does, by golden section: of one that is no matter of the track, such as an offset, all widths say the same, and
//! that a friction at one wheel does better shows only once it is fitted. A width that explains decisively more than the ordinary one is taken.

use std::f64::consts::SQRT_2;

use wheelwright_core::effect::{Frame, Scene};

use crate::diagnose::{DECISIVE, Surroundings};
use crate::fit::search::Fit;
use crate::fit::setting::Setting;
use crate::question::Question;
use crate::race::{Field, Refined};
use crate::screen::{Candidate, Response};
use crate::select::{COMPARING, Search, State};

/// Track width that is taken where none is known and none shows \[m\].
pub(crate) const ORDINARY: f64 = 0.35;
/// Half octaves by which it is narrowed and widened: to a robot on a desk, to a car.
pub(crate) const HALF_OCTAVES: [i32; 8] = [-4, -3, -2, -1, 1, 2, 3, 4];
/// The family of dry frictions.
const DRY: &str = "friction";
/// Effects that are screened at other widths than the ordinary one, beside dry frictions.
const CONSIDERED: usize = 12;
/// Names that are fitted at other widths.
const FITTED: usize = 3;
/// Share of the evidence for the best so far below which an effect is left behind where it promises most: of 42 effects of a proving ground none gained
/// more than 7 % between the neighbours of that width.
const NEAR: f64 = 0.8;
/// Fits between the neighbours of the best: in the end they differ by 4 %.
const SECTIONS: usize = 7;
/// The golden section.
const GOLDEN: f64 = 0.618_033_988_749_895;

/// The track width at which an effect at the wheels explains decisively more than at the ordinary one, beside the base model of that
/// one, if there is such.
pub(crate) fn likeliest(question: &Question<'_>, start: &Surroundings<'_>, headings: Option<&[Vec<f64>]>) -> Option<f64> {
    let setting = &start.search.setting;
    if !matches!(setting.scene.frame, Frame::Body { .. }) {
        return None;
    }
    let state = start.plain();
    let scene = |width: f64| Scene::new(setting.data, question.model, width, question.wheel_radius, headings);
    // Where nothing is promised at the ordinary width nothing is missing.
    let screened_ordinary = start.search.screen(&state, &start.whitening, &start.responses);
    let mut promised = promises(&start.search, ORDINARY, &screened_ordinary);
    let open = worth_a_look(&start.search, &promised);
    if promised.is_empty() {
        return None;
    }
    for width in HALF_OCTAVES.map(|k| ORDINARY * SQRT_2.powi(k)) {
        let scene = scene(width);
        let search = search(start, &scene, open.clone());
        promised.extend(promises(&search, width, &screened(start, &search, &state).1));
    }
    promised.sort_by(|a, b| b.value.total_cmp(&a.value));
    let fitted = |effect: usize, width: f64| {
        let scene = scene(width);
        let search = search(start, &scene, vec![effect]);
        let (responses, screened) = screened(start, &search, &state);
        refined(&search, start, &responses, &screened)
    };
    let nearby = |effect: usize, width: f64, fit: &Fit| {
        let scene = scene(width);
        from(&search(start, &scene, vec![effect]), start, effect, fit)
    };
    let mut named = Vec::new();
    promised.retain(|p| {
        let name = start.search.effect(p.effect).name();
        let new = !named.contains(&name);
        named.push(name);
        new
    });
    let (mut ordinary, mut best) = (f64::NEG_INFINITY, (ORDINARY, f64::NEG_INFINITY));
    for Promise { effect, width, .. } in promised.into_iter().take(FITTED) {
        ordinary = fitted(effect, ORDINARY).map_or(f64::NEG_INFINITY, |best| best.score).max(ordinary);
        // From one width to the next no look anew at all starts is needed.
        let Some(mut known) = fitted(effect, width) else { continue };
        if known.score < NEAR * best.1.max(ordinary) {
            continue;
        }
        let evidence = |log: f64| {
            let Some(next) = nearby(effect, log.exp(), &known.fit) else { return f64::NEG_INFINITY };
            let score = next.score;
            if score > known.score {
                known = next;
            }
            score
        };
        let (log, most) = highest(evidence, (width / SQRT_2).ln(), (width * SQRT_2).ln());
        if most > best.1 {
            best = (log.exp(), most);
        }
    }
    (best.1 > ordinary + DECISIVE).then_some(best.0)
}

/// The evidence for the best of some effects in a scene, beside the base model alone.
pub(crate) fn evidence(start: &Surroundings<'_>, scene: &Scene, open: Vec<usize>) -> f64 {
    let search = search(start, scene, open);
    let (responses, screened) = screened(start, &search, &start.plain());
    best(&search, start, &responses, &screened)
}

/// The same of all effects in the scene where they were looked at first.
pub(crate) fn evidence_at_first(start: &Surroundings<'_>) -> f64 {
    let screened = start.search.screen(&start.plain(), &start.whitening, &start.responses);
    best(&start.search, start, &start.responses, &screened)
}

fn best(search: &Search<'_>, start: &Surroundings<'_>, responses: &[Response], screened: &[Vec<Candidate>]) -> f64 {
    refined(search, start, responses, screened).map_or(f64::NEG_INFINITY, |best| best.score)
}

/// The best of some effects beside the base model, fitted.
fn refined(search: &Search<'_>, start: &Surroundings<'_>, responses: &[Response], screened: &[Vec<Candidate>]) -> Option<Refined> {
    search.refine(&start.plain(), &start.whitening, screened, responses, &Field::open(0.0)).into_iter().next()
}

/// An effect beside the base model, fitted from where it was in another scene.
fn from(search: &Search<'_>, start: &Surroundings<'_>, effect: usize, fit: &Fit) -> Option<Refined> {
    let fit = search.fitted_from(&[effect], &fit.point, &start.whitening, COMPARING, false)?;
    let (freedom, score) = search.beyond(&[effect], &fit, &start.plain());
    Some(Refined { effect, fit, freedom, score })
}

/// What an effect promises at a width, less what it costs.
#[derive(Debug, Clone, Copy)]
struct Promise {
    effect: usize,
    width: f64,
    value: f64,
}

/// The effects that promise more than they cost, those that promise most first.
fn promises(search: &Search<'_>, width: f64, screened: &[Vec<Candidate>]) -> Vec<Promise> {
    let value = |c: &Candidate| c.gain - search.penalty(c.freedom as f64);
    let all = screened.iter().map(|c| Promise { effect: c[0].effect, width, value: value(&c[0]) });
    all.filter(|p| p.value > 0.0).collect()
}

/// The same search in another scene, over some of the effects.
fn search<'s>(start: &'s Surroundings<'_>, scene: &'s Scene, open: Vec<usize>) -> Search<'s> {
    Search { setting: Setting { scene, ..start.search.setting.clone() }, library: start.search.library, open, known: None }
}

/// What the effects of a search would change, and promise.
fn screened(start: &Surroundings<'_>, search: &Search<'_>, state: &State) -> (Vec<Response>, Vec<Vec<Candidate>>) {
    let responses = search.respond(&start.rough);
    let screened = search.screen(state, &start.whitening, &responses);
    (responses, screened)
}

/// The effects that promise most, and all dry frictions: of these none may promise anything where their wheels' standstill is
/// put elsewhere than it is.
fn worth_a_look(search: &Search<'_>, promised: &[Promise]) -> Vec<usize> {
    let mut all: Vec<usize> = promised.iter().take(CONSIDERED).map(|p| p.effect).collect();
    let dry = |i: &usize| search.effect(*i).family() == DRY;
    let others: Vec<usize> = search.open.iter().copied().filter(dry).filter(|i| !all.contains(i)).collect();
    all.extend(others);
    all
}

/// Where a function of one hump is highest, and how high.
pub(crate) fn highest(mut of: impl FnMut(f64) -> f64, mut from: f64, mut to: f64) -> (f64, f64) {
    let mut at = |x: f64| (x, of(x));
    let (mut low, mut high) = (at(to - GOLDEN * (to - from)), at(from + GOLDEN * (to - from)));
    for _ in 2..SECTIONS {
        if low.1 > high.1 {
            (to, high) = (high.0, low);
            low = at(to - GOLDEN * (to - from));
        } else {
            (from, low) = (low.0, high);
            high = at(from + GOLDEN * (to - from));
        }
    }
    if low.1 > high.1 { low } else { high }
}

#[cfg(test)]
mod tests {
    use super::highest;

    #[test]
    fn a_hump_is_found_between_its_feet() {
        let (x, y) = highest(|x| 3.0 - (x - 0.3).powi(2), -1.0, 2.0);
        assert!((x - 0.3).abs() < 0.1 && (y - 3.0).abs() < 0.01, "{x} {y}");
    }
}
