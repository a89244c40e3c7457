//! The track width where none is known: where an effect at the wheels has a kink, only the right track puts it where it is.
//!
//! All effects are screened beside the base model at the widths of a grid. What promises most somewhere is fitted between the neighbours of
//! the width at which it does, by golden section: of one that is no matter of the track, such as an offset, all widths say the same, and
//! that a friction at one wheel does better shows only once it is fitted. A width that explains decisively more than the ordinary one is taken.
//!
//! Where none does there is a second look beside what explains most, at the ordinary width: a late command leaves so much over that no friction
//! of the wheels shows beside the base model, at any width.

use std::f64::consts::SQRT_2;

use wheelwright_core::effect::{Frame, Scene};

use crate::diagnose::{DECISIVE, Surroundings};
use crate::fit::search::Fit;
use crate::fit::setting::Setting;
use crate::fit::whitening::Whitening;
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

/// The track width at which an effect at the wheels explains decisively more than at the ordinary one, if there is such: beside the base model
/// of that one, or else beside what explains most of all.
pub(crate) fn likeliest(question: &Question<'_>, start: &Surroundings<'_>, headings: Option<&[Vec<f64>]>) -> Option<f64> {
    let setting = &start.search.setting;
    if !matches!(setting.scene.frame, Frame::Body { .. }) {
        return None;
    }
    let scene = |width: f64| Scene::new(setting.data, question.model, width, question.wheel_radius, headings);
    let alone = look(start, &Model::plain(start), &scene);
    alone.width.or_else(|| look(start, &Model::with(start, &alone.best.filter(|best| best.score > 0.0)?)?, &scene).width)
}

/// The evidence for the best of some effects in a scene, beside the base model alone.
pub(crate) fn evidence(start: &Surroundings<'_>, scene: &Scene, open: Vec<usize>) -> f64 {
    let plain = Model::plain(start);
    let there = plain.at(start, scene, open);
    there.and_then(|there| there.refined(&there.screened())).map_or(f64::NEG_INFINITY, |best| best.score)
}

/// The same of all effects in the scene where they were looked at first.
pub(crate) fn evidence_at_first(start: &Surroundings<'_>) -> f64 {
    let Surroundings { search, responses, whitening, .. } = start;
    let plain = start.plain();
    let screened = search.screen(&plain, whitening, responses);
    let best = search.refine(&plain, whitening, &screened, responses, &Field::open(0.0)).alone.into_iter().next();
    best.map_or(f64::NEG_INFINITY, |best| best.score)
}

/// What a look at all widths shows.
struct Shown {
    /// The width that explains decisively more than the ordinary one.
    width: Option<f64>,
    /// What explains most at the ordinary one.
    best: Option<Refined>,
}

/// What effects explain beside a model, by the width.
fn look(start: &Surroundings<'_>, model: &Model, scene: &impl Fn(f64) -> Scene) -> Shown {
    let fitted = |effect: usize, width: f64| {
        let scene = scene(width);
        let there = model.at(start, &scene, vec![effect])?;
        there.refined(&there.screened())
    };
    let score = |of: &Option<Refined>| of.as_ref().map_or(f64::NEG_INFINITY, |best| best.score);
    let (mut ordinary, mut best) = (None, (ORDINARY, f64::NEG_INFINITY));
    for Promise { effect, width, .. } in promised(start, model, scene) {
        let at_first = fitted(effect, ORDINARY);
        if score(&at_first) > score(&ordinary) {
            ordinary = at_first;
        }
        // From one width to the next no look anew at all starts is needed.
        let Some(mut known) = fitted(effect, width) else { continue };
        if known.score < NEAR * best.1.max(score(&ordinary)) {
            continue;
        }
        let evidence = |log: f64| {
            let scene = scene(log.exp());
            let nearby = model.at(start, &scene, vec![effect]).and_then(|there| there.from(effect, &known.fit));
            let Some(next) = nearby else { return f64::NEG_INFINITY };
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
    Shown { width: (best.1 > score(&ordinary) + DECISIVE).then_some(best.0), best: ordinary }
}

/// The names that promise most beside a model, each where it does.
fn promised(start: &Surroundings<'_>, model: &Model, scene: &impl Fn(f64) -> Scene) -> Vec<Promise> {
    // Where nothing is promised at the ordinary width nothing is missing.
    let screened = start.search.screen(&model.state, &model.whitening, &start.responses);
    let mut promised = promises(&start.search, ORDINARY, 0.0, &screened);
    if promised.is_empty() {
        return promised;
    }
    let open = worth_a_look(&start.search, &promised);
    for width in HALF_OCTAVES.map(|k| ORDINARY * SQRT_2.powi(k)) {
        let scene = scene(width);
        let Some(there) = model.at(start, &scene, open.clone()) else { continue };
        promised.extend(promises(&there.search, width, there.ahead, &there.screened().1));
    }
    promised.sort_by(|a, b| b.value.total_cmp(&a.value));
    let mut named = Vec::new();
    promised.retain(|p| {
        let name = start.search.effect(p.effect).name();
        let new = !named.contains(&name);
        named.push(name);
        new
    });
    promised.truncate(FITTED);
    promised
}

/// A model that effects are looked for beside, as it is at the ordinary width.
struct Model {
    state: State,
    /// The one about which they are simulated, where that is another one.
    about: Option<State>,
    whitening: Whitening,
}

impl Model {
    /// The base model.
    fn plain(start: &Surroundings<'_>) -> Self {
        Self { state: start.plain(), about: Some(start.rough.clone()), whitening: start.whitening.clone() }
    }

    /// The base model with an effect, under the noise that it leaves then.
    fn with(start: &Surroundings<'_>, first: &Refined) -> Option<Self> {
        let (search, effects) = (&start.search, vec![first.effect]);
        let (whitening, fit) = search.under_its_own(&effects, &first.fit, &start.whitening, COMPARING)?;
        Some(Self { state: State { effects, fit }, about: None, whitening })
    }

    /// The model in another scene, and some effects to join it there.
    fn at<'s>(&'s self, start: &'s Surroundings<'_>, scene: &'s Scene, open: Vec<usize>) -> Option<There<'s>> {
        let search =
            Search { setting: Setting { scene, ..start.search.setting.clone() }, library: start.search.library, open, known: None };
        let State { effects, fit } = &self.state;
        let fit = match effects.is_empty() {
            true => fit.clone(),
            false => search.fitted_from(effects, &fit.point, &self.whitening, COMPARING, false)?,
        };
        let ahead = fit.likelihood(&search.setting) - self.state.fit.likelihood(&start.search.setting);
        Some(There { search, state: State { effects: effects.clone(), fit }, model: self, ahead })
    }
}

/// A model at some width, and the effects that may join it.
struct There<'s> {
    search: Search<'s>,
    state: State,
    model: &'s Model,
    /// What it gains there by itself.
    ahead: f64,
}

impl There<'_> {
    /// What the effects would change, and promise.
    fn screened(&self) -> (Vec<Response>, Vec<Vec<Candidate>>) {
        let responses = self.search.respond(self.model.about.as_ref().unwrap_or(&self.state));
        let screened = self.search.screen(&self.state, &self.model.whitening, &responses);
        (responses, screened)
    }

    /// The best of them, fitted.
    fn refined(&self, (responses, screened): &(Vec<Response>, Vec<Vec<Candidate>>)) -> Option<Refined> {
        let all = self.search.refine(&self.state, &self.model.whitening, screened, responses, &Field::open(0.0));
        all.alone.into_iter().next().map(|best| self.with_what_it_gains(best))
    }

    /// One of them, fitted from where it was at another width.
    fn from(&self, effect: usize, fit: &Fit) -> Option<Refined> {
        let effects = self.state.and(effect);
        let fit = self.search.fitted_from(&effects, &fit.point, &self.model.whitening, COMPARING, false)?;
        let (freedom, score) = self.search.beyond(&effects, &fit, &self.state);
        Some(self.with_what_it_gains(Refined { effect, fit, freedom, score }))
    }

    fn with_what_it_gains(&self, refined: Refined) -> Refined {
        Refined { score: refined.score + self.ahead, ..refined }
    }
}

/// What an effect promises at a width, less what it costs.
#[derive(Debug, Clone, Copy)]
struct Promise {
    effect: usize,
    width: f64,
    value: f64,
}

/// The effects that promise more than they cost, those that promise most first; `ahead` is what the model gains there without them.
fn promises(search: &Search<'_>, width: f64, ahead: f64, screened: &[Vec<Candidate>]) -> Vec<Promise> {
    let value = |c: &Candidate| c.gain - search.penalty(c.freedom as f64);
    let worth = screened.iter().map(|c| (c[0].effect, value(&c[0]))).filter(|(_, value)| *value > 0.0);
    worth.map(|(effect, value)| Promise { effect, width, value: value + ahead }).collect()
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
