//! The track width once something has been found, where no profile tells it: the likeliest near the one that it was found at, and the one that held-out
//! driving asks for where the training data leave it open.
//!
//! What goes round with the wheels knows the track better than any grid: over a hundred radians of turning a track that is 1 % off turns a wheel by
//! some radians too much or too little.
//!
//! A limit that the training data hardly reach, or a friction that no turn has shown, fits at many widths, each with another size of its own, and
//! fails on other driving at all but one. So where an explanation misses held-out data decisively it is fitted again at the widths of a grid, and
//! between the neighbours of the best; what a width costs on the training data counts as it does for any other parameter (`leeway.rs`).

use std::cell::OnceCell;
use std::f64::consts::SQRT_2;

use wheelwright_core::effect::{Frame, Scene};

use crate::answer::Story;
use crate::fit::search::Fit;
use crate::fit::setting::Setting;
use crate::judge::Bench;
use crate::question::Question;
use crate::screen::Response;
use crate::select::{COMPARING, EXCHANGE, FINAL, Search, Selected, State};
use crate::track::{HALF_OCTAVES, highest};

/// Logarithm of a width by which one that was found by what acts at the wheels may be off: the last sections of `track.rs` differ by so much.
const OFF: f64 = 0.04;

/// Has the story told at another width, and returns that, if one is to be had; `kept` keeps its scene.
pub(crate) fn retold<'a>(
    question: &Question<'a>,
    story: &mut Story<'a>,
    headings: Option<&[Vec<f64>]>,
    kept: &'a OnceCell<Scene>,
    width: impl FnOnce(&Elsewhere<'_, 'a>) -> Option<f64>,
) -> Option<f64> {
    let Story { search, selected, responses, .. } = story;
    let elsewhere = Elsewhere::open(question, search, selected, headings)?;
    let width = width(&elsewhere)?;
    let scene = kept.get_or_init(|| elsewhere.scene(width));
    (*search, *selected) = elsewhere.told(scene, responses)?;
    Some(width)
}

/// A selection at other widths.
pub(crate) struct Elsewhere<'s, 'a> {
    question: &'s Question<'a>,
    search: &'s Search<'a>,
    selected: &'s Selected,
    headings: Option<&'s [Vec<f64>]>,
}

impl<'s, 'a> Elsewhere<'s, 'a> {
    /// Where the track is open, and something was found that it may matter to.
    fn open(question: &'s Question<'a>, search: &'s Search<'a>, selected: &'s Selected, headings: Option<&'s [Vec<f64>]>) -> Option<Self> {
        let Frame::Body { .. } = search.setting.scene.frame else { return None };
        let found = selected.state.effects.len() > search.fixed(selected);
        let open = question.track_width.is_none() && found && !search.setting.exhausted();
        open.then_some(Self { question, search, selected, headings })
    }

    /// The likeliest width near the one that it is told at, if there is a likelier one.
    pub(crate) fn likelier(&self) -> Option<f64> {
        let (setting, now) = (&self.search.setting, self.now());
        let likelihood = |log: f64| self.fitted(&self.scene(log.exp())).map_or(f64::NEG_INFINITY, |fit| fit.likelihood(setting));
        let (log, most) = highest(likelihood, now - OFF, now + OFF);
        (most > self.selected.state.fit.likelihood(setting) + EXCHANGE).then(|| log.exp())
    }

    /// The width that the held-out data decisively ask for, if there is such.
    pub(crate) fn asked_for(&self) -> Option<f64> {
        let Self { question, search, selected, .. } = *self;
        let bench = Bench::new(question, search, selected).filter(|bench| bench.missed(search, selected).is_some())?;
        let loss = |log: f64| self.loss(&bench, log.exp()).unwrap_or(f64::INFINITY);
        let (now, step) = (self.now(), SQRT_2.ln());
        let near =
            HALF_OCTAVES.iter().map(|k| now + f64::from(*k) * step).map(|log| (loss(log), log)).min_by(|a, b| a.0.total_cmp(&b.0))?;
        let (log, most) = highest(|log| -loss(log), near.1 - step, near.1 + step);
        bench.decisive(-most, bench.loss(search, &selected.state)).then(|| log.exp())
    }

    /// Logarithm of the width it is told at.
    fn now(&self) -> f64 {
        (2.0 * self.search.setting.scene.frame.half_track()).ln()
    }

    fn scene(&self, width: f64) -> Scene {
        let Setting { model, data, layout, scene, .. } = &self.search.setting;
        let plain = Scene::new(data, *model, width, scene.wheel_radius, self.headings);
        plain.followed(data, &layout.series(&self.selected.state.fit.simulated))
    }

    fn search<'c>(&self, scene: &'c Scene) -> Search<'c>
    where
        'a: 'c,
    {
        let Search { setting, library, open, known } = self.search;
        Search { setting: Setting { scene, ..setting.clone() }, library, open: open.clone(), known: *known }
    }

    /// Loss on the held-out data at a width, with what that costs on the training data.
    fn loss(&self, bench: &Bench<'_>, width: f64) -> Option<f64> {
        let scene = self.scene(width);
        let search = self.search(&scene);
        let State { effects, fit: now } = &self.selected.state;
        let fit = self.fitted(&scene)?;
        let cost = now.likelihood(&search.setting) - fit.likelihood(&search.setting);
        let state = State { effects: effects.clone(), fit };
        Some(bench.with_cost(bench.loss(&search, &state), cost.max(0.0)))
    }

    /// The fit of the selection in another scene.
    fn fitted(&self, scene: &Scene) -> Option<Fit> {
        let Selected { state, whitening, .. } = self.selected;
        self.search(scene).fitted_from(&state.effects, &state.fit.point, whitening, COMPARING, false)
    }

    /// The selection in another scene, fitted to the end, its members contested there.
    fn told(&self, scene: &'a Scene, first: &[Response]) -> Option<(Search<'a>, Selected)> {
        let search = self.search(scene);
        let Selected { state: State { effects, .. }, whitening, base, rivals, ranking } = self.selected;
        let (whitening, fit) = search.under(effects, &self.fitted(scene)?, &whitening.noise, FINAL)?;
        let state = State { effects: effects.clone(), fit };
        let mut selected = Selected { state, whitening, base: base.clone(), rivals: rivals.clone(), ranking: ranking.clone() };
        search.exchange(&mut selected, first, None);
        Some((search, selected))
    }
}
