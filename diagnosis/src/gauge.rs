//! The track width that held-out driving asks for, where no profile tells it and the training data leave it open.
//!
//! A limit that the training data hardly reach, or a friction that no turn has shown, fits at many widths, each with another size of its own, and
//! fails on other driving at all but one. So where an explanation misses held-out data decisively it is fitted again at the widths of a grid, and
//! between the neighbours of the best; what a width costs on the training data counts as it does for any other parameter (`leeway.rs`).

use std::cell::OnceCell;
use std::f64::consts::SQRT_2;

use wheelwright_core::effect::{Frame, Scene};

use crate::answer::Story;
use crate::fit::setting::Setting;
use crate::judge::Bench;
use crate::question::Question;
use crate::screen::Response;
use crate::select::{COMPARING, FINAL, Search, Selected, State};
use crate::track::{HALF_OCTAVES, highest};

/// Has the story told at the width that the held-out data decisively ask for, and returns that, if there is such; `kept` keeps its scene.
pub(crate) fn asked_for<'a>(
    question: &Question<'a>,
    story: &mut Story<'a>,
    headings: Option<&[Vec<f64>]>,
    kept: &'a OnceCell<Scene>,
) -> Option<f64> {
    let Story { search, selected, responses, .. } = story;
    let Frame::Body { .. } = search.setting.scene.frame else { return None };
    if question.track_width.is_some() || selected.state.effects.len() == search.fixed(selected) || search.setting.exhausted() {
        return None;
    }
    let bench = Bench::new(question, search, selected).filter(|bench| bench.missed(search, selected).is_some())?;
    let elsewhere = Elsewhere { question, search, selected, headings };
    let loss = |log: f64| elsewhere.loss(&bench, log.exp()).unwrap_or(f64::INFINITY);
    let now = (2.0 * search.setting.scene.frame.half_track()).ln();
    let step = SQRT_2.ln();
    let near = HALF_OCTAVES.iter().map(|k| now + f64::from(*k) * step).map(|log| (loss(log), log)).min_by(|a, b| a.0.total_cmp(&b.0))?;
    let (log, most) = highest(|log| -loss(log), near.1 - step, near.1 + step);
    if !bench.decisive(-most, bench.loss(search, &selected.state)) {
        return None;
    }
    let scene = kept.get_or_init(|| elsewhere.scene(log.exp()));
    (*search, *selected) = elsewhere.told(scene, responses)?;
    Some(log.exp())
}

/// A selection at other widths.
struct Elsewhere<'s, 'a> {
    question: &'s Question<'a>,
    search: &'s Search<'a>,
    selected: &'s Selected,
    headings: Option<&'s [Vec<f64>]>,
}

impl<'a> Elsewhere<'_, 'a> {
    fn scene(&self, width: f64) -> Scene {
        let Setting { data, layout, .. } = &self.search.setting;
        let plain = Scene::new(data, self.question.model, width, self.question.wheel_radius, self.headings);
        plain.followed(data, &layout.series(&self.selected.base.simulated))
    }

    fn search<'s>(&self, scene: &'s Scene) -> Search<'s>
    where
        'a: 's,
    {
        let Search { setting, library, open, known } = self.search;
        Search { setting: Setting { scene, ..setting.clone() }, library, open: open.clone(), known: *known }
    }

    /// Loss on the held-out data at a width, with what that costs on the training data.
    fn loss(&self, bench: &Bench<'_>, width: f64) -> Option<f64> {
        let scene = self.scene(width);
        let search = self.search(&scene);
        let State { effects, fit: now } = &self.selected.state;
        let fit = search.fitted_from(effects, &now.point, &self.selected.whitening, COMPARING, false)?;
        let cost = now.likelihood(&search.setting) - fit.likelihood(&search.setting);
        let state = State { effects: effects.clone(), fit };
        Some(bench.with_cost(bench.loss(&search, &state), cost.max(0.0)))
    }

    /// The selection in another scene, fitted to the end, its members contested there.
    fn told(&self, scene: &'a Scene, first: &[Response]) -> Option<(Search<'a>, Selected)> {
        let search = self.search(scene);
        let Selected { state: State { effects, fit: now }, whitening, base, rivals, ranking } = self.selected;
        let fit = search.fitted_from(effects, &now.point, whitening, COMPARING, false)?;
        let (whitening, fit) = search.under(effects, &fit, &whitening.noise, FINAL)?;
        let state = State { effects: effects.clone(), fit };
        let mut selected = Selected { state, whitening, base: base.clone(), rivals: rivals.clone(), ranking: ranking.clone() };
        search.exchange(&mut selected, first, None);
        Some((search, selected))
    }
}
