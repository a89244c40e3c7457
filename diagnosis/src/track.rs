//! The track width where none is known: where an effect at the wheels has a kink, only the right track puts it where it is.
//!
//! All effects are screened beside the base model at the widths of a grid. Between the neighbours of the best width its best effect is
//! fitted at others, by golden section. A width that explains decisively more than the ordinary one is taken.

use std::f64::consts::SQRT_2;

use wheelwright_core::effect::{Frame, Scene};

use crate::diagnose::{Surroundings, surroundings};
use crate::fit::setting::Setting;
use crate::question::{DiagnosisError, Question};
use crate::race::Field;
use crate::select::{Search, State};

/// Track width that is taken where none is known and none shows \[m\].
pub(crate) const ORDINARY: f64 = 0.35;
/// Half octaves by which it is narrowed and widened: to a robot on a desk, to a car.
const HALF_OCTAVES: [i32; 9] = [0, -4, -3, -2, -1, 1, 2, 3, 4];
/// Evidence by which a width must be better than the ordinary one.
const DECISIVE: f64 = 10.0;
/// Fits between the neighbours of the best: in the end they differ by 4 %.
const SECTIONS: usize = 7;
/// The golden section.
const GOLDEN: f64 = 0.618_033_988_749_895;

/// The track width at which an effect at the wheels explains decisively more than at that of the setting, if there is such.
pub(crate) fn likeliest(
    question: &Question<'_>,
    ordinary: Setting<'_>,
    headings: Option<&[Vec<f64>]>,
) -> Result<Option<f64>, DiagnosisError> {
    let data = ordinary.data;
    if !matches!(ordinary.scene.frame, Frame::Body { .. }) {
        return Ok(None);
    }
    let tried = Tried { start: surroundings(ordinary, question, None)? };
    let scene = |width: f64| Scene::new(data, question.model, width, question.wheel_radius, headings);
    let mut promised: Vec<(f64, usize, f64)> = Vec::with_capacity(HALF_OCTAVES.len());
    for width in HALF_OCTAVES.map(|k| ORDINARY * SQRT_2.powi(k)) {
        promised.extend(tried.best(&scene(width)).map(|(effect, value)| (width, effect, value)));
        // Where nothing is promised at the ordinary width nothing is missing.
        if promised.is_empty() {
            return Ok(None);
        }
    }
    let Some((best, effect, _)) = promised.into_iter().reduce(|a, b| if b.2 > a.2 { b } else { a }) else { return Ok(None) };
    let evidence = |width: f64| tried.evidence(effect, &scene(width));
    let (width, most) = highest(&|log: f64| evidence(log.exp()), (best / SQRT_2).ln(), (best * SQRT_2).ln());
    Ok((most > evidence(ORDINARY) + DECISIVE).then_some(width.exp()))
}

/// The base model and its noise, beside which effects are tried.
struct Tried<'a> {
    start: Surroundings<'a>,
}

impl Tried<'_> {
    fn state(&self) -> State {
        State { effects: Vec::new(), fit: self.start.base.clone() }
    }

    fn search<'s>(&'s self, scene: &'s Scene, open: Vec<usize>) -> Search<'s> {
        let Surroundings { search, .. } = &self.start;
        Search { setting: Setting { scene, ..search.setting.clone() }, library: search.library, open, known: None }
    }

    /// The effect that promises most, and what, if it is more than it costs.
    fn best(&self, scene: &Scene) -> Option<(usize, f64)> {
        let search = self.search(scene, self.start.search.open.clone());
        let responses = search.respond(&self.start.rough);
        let screened = search.screen(&self.state(), &self.start.whitening, &responses);
        let candidate = screened.first()?.first()?;
        let value = candidate.gain - search.penalty(candidate.freedom as f64);
        (value > 0.0).then_some((candidate.effect, value))
    }

    /// What an effect explains, fitted.
    fn evidence(&self, effect: usize, scene: &Scene) -> f64 {
        let search = self.search(scene, vec![effect]);
        let responses = search.respond(&self.start.rough);
        let state = self.state();
        let screened = search.screen(&state, &self.start.whitening, &responses);
        let refined = search.refine(&state, &self.start.whitening, &screened, &responses, &Field::open());
        refined.first().map_or(f64::NEG_INFINITY, |best| best.score)
    }
}

/// Where a function of one hump is highest, and how high.
fn highest(of: &dyn Fn(f64) -> f64, mut from: f64, mut to: f64) -> (f64, f64) {
    let at = |x: f64| (x, of(x));
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
        let (x, y) = highest(&|x| 3.0 - (x - 0.3).powi(2), -1.0, 2.0);
        assert!((x - 0.3).abs() < 0.1 && (y - 3.0).abs() < 0.01, "{x} {y}");
    }
}
