//! The track width once something has been found: the likeliest near the one that it was found at, and, where no profile tells it, the one that held-out
//! driving asks for where the training data leave it open.
//!
//! What goes round with the wheels knows the track better than any grid, and than a person who measured it: over a hundred radians of turning a track
//! that is 1 % off turns a wheel by some radians too much or too little. So it is walked from width to width, each so near to the last that no wheel
//! turns by more than a part of a radian, as long as that makes what was found likelier.
//!
//! A threshold at a wheel knows it as well: where a command stays near, a track that is 1 % off decides whether the wheel moves. So wherever a nudge of
//! a profile's track promises anything decisive, it is walked as far as a person who measured it may be off.
//!
//! A limit that the training data hardly reach, or a friction that no turn has shown, fits at many widths, each with another size of its own, and
//! fails on other driving at all but one. So where an explanation misses held-out data decisively it is fitted again at the widths of a grid, and
//! between the neighbours of the best; what a width costs on the training data counts as it does for any other parameter (`leeway.rs`).

use std::cell::OnceCell;
use std::f64::consts::SQRT_2;

use wheelwright_core::effect::{Frame, Scene, Track};

use crate::answer::Story;
use crate::beside::MEASURED_TRACK;
use crate::diagnose::DECISIVE;
use crate::fit::search::Fit;
use crate::fit::setting::Setting;
use crate::judge::Bench;
use crate::question::Question;
use crate::screen::Response;
use crate::select::{COMPARING, EXCHANGE, FINAL, Newest, Search, Selected, State};
use crate::track::{HALF_OCTAVES, highest};

/// Logarithm of a width by which one that was found by what acts at the wheels may be off: the last sections of `track.rs` differ by so much.
const OFF: f64 = 0.04;
/// Angle \[rad\] by which a wheel stands elsewhere, at the ends of what was turned, from one width to the next.
const NEXT: f64 = 0.5;
/// Logarithm of a width by which it is nudged, to see what that promises: little against what a person measures it to.
const NUDGE: f64 = 0.003;
/// Fewest and most widths to either side.
const STEPS: (f64, f64) = (2.0, 16.0);

/// Has the story told at another width, and returns that, if one is to be had; `kept` keeps its scene.
pub(crate) fn retold<'a>(
    question: &Question<'a>,
    story: &mut Story<'a>,
    headings: Option<&[Vec<f64>]>,
    kept: &'a OnceCell<Scene>,
    place: impl FnOnce(&Elsewhere<'_, 'a>) -> Option<Place>,
) -> Option<f64> {
    let Story { search, selected, responses, .. } = story;
    let elsewhere = Elsewhere::open(question, search, selected, headings)?;
    let place = place(&elsewhere)?;
    let width = place.log.exp();
    let scene = kept.get_or_init(|| elsewhere.scene(width));
    (*search, *selected) = elsewhere.told(scene, &place.fit, responses)?;
    Some(width)
}

/// The selection at another width.
pub(crate) struct Place {
    /// The width's logarithm.
    log: f64,
    fit: Fit,
    likelihood: f64,
}

/// A selection at other widths.
pub(crate) struct Elsewhere<'s, 'a> {
    question: &'s Question<'a>,
    search: &'s Search<'a>,
    selected: &'s Selected,
    headings: Option<&'s [Vec<f64>]>,
}

impl<'s, 'a> Elsewhere<'s, 'a> {
    /// Where something was found that the track may matter to.
    fn open(question: &'s Question<'a>, search: &'s Search<'a>, selected: &'s Selected, headings: Option<&'s [Vec<f64>]>) -> Option<Self> {
        let Frame::Body { .. } = search.setting.scene.frame else { return None };
        let found = selected.state.effects.len() > search.fixed(selected);
        found.then_some(Self { question, search, selected, headings })
    }

    /// The likeliest width near the one that it is told at, if there is a likelier one. That of a profile is near enough, unless something goes round
    /// with the wheels, or another is decisively likelier.
    pub(crate) fn likelier(&self) -> Option<Place> {
        let measured = self.question.track_width.is_some() && !self.round();
        if measured && self.promised() < DECISIVE {
            return None;
        }
        let (step, steps) = self.steps();
        // Wheels are followed anew at every width, at the one that it is told at too.
        let here = self.place(self.now(), &self.selected.state.fit)?;
        let least = here.likelihood + if measured { DECISIVE } else { EXCHANGE };
        let walked = [-step, step].map(|step| self.walked(&here, step, steps));
        let best = walked.into_iter().flatten().reduce(|a, b| if b.likelihood > a.likelihood { b } else { a });
        let mut best = best.unwrap_or(here);
        let (log, from) = (best.log, best.fit.clone());
        let nearer = |log: f64| {
            let Some(place) = self.place(log, &from) else { return f64::NEG_INFINITY };
            let likelihood = place.likelihood;
            if likelihood > best.likelihood {
                best = place;
            }
            likelihood
        };
        highest(nearer, log - step, log + step);
        (best.likelihood > least).then_some(best)
    }

    /// The likeliest place on the way in one direction, which ends where it gets decisively worse.
    fn walked(&self, here: &Place, step: f64, steps: usize) -> Option<Place> {
        let (mut from, mut best, mut most) = (here.fit.clone(), None, here.likelihood);
        for k in 1..=steps {
            let place = self.place(here.log + step * k as f64, &from)?;
            if place.likelihood < most - DECISIVE {
                break;
            }
            from = place.fit.clone();
            if place.likelihood > most {
                most = place.likelihood;
                best = Some(place);
            }
        }
        best
    }

    /// What another track promises of twice the log-likelihood, by what a nudge of it changes that nothing else of the selection can do.
    fn promised(&self) -> f64 {
        let Selected { state, whitening, .. } = self.selected;
        let run = |search: &Search<'_>| search.run_of(&state.effects, &state.fit.point);
        let scene = self.scene((self.now() + NUDGE).exp());
        let Some((here, there)) = run(self.search).zip(run(&self.search(&scene))) else { return 0.0 };
        let nudged: Vec<f64> = there.iter().zip(&here).map(|(there, here)| there - here).collect();
        self.search.projection(state, whitening).promised(&nudged)
    }

    /// Whether something was found that goes round with the wheels.
    fn round(&self) -> bool {
        self.search.goes_round(&self.selected.state)
    }

    /// Difference of the logarithms of two widths at which no wheel stands much elsewhere.
    fn step(&self) -> f64 {
        let scene = self.search.setting.scene;
        let Some(radius) = scene.wheel_radius.filter(|_| self.round()) else { return f64::INFINITY };
        let turned = |track: &Track| {
            let apart = track.distance[0].iter().zip(&track.distance[1]).map(|(left, right)| 0.5 * (right - left));
            let (least, most) = apart.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
            most - least
        };
        NEXT * radius / scene.tracks.iter().map(turned).fold(0.0, f64::max)
    }

    /// The selection at a width, from a fit near by.
    fn place(&self, log: f64, from: &Fit) -> Option<Place> {
        let scene = self.scene(log.exp());
        let fit = self.fitted(&scene, from)?;
        Some(Place { log, likelihood: fit.likelihood(&self.search.setting), fit })
    }

    /// How far apart widths near by are tried, and how many to either side.
    fn steps(&self) -> (f64, usize) {
        let within = if self.question.track_width.is_some() { MEASURED_TRACK } else { OFF };
        let steps = (within / self.step()).ceil().clamp(STEPS.0, STEPS.1);
        (within / steps, steps as usize)
    }

    /// The width that the held-out data decisively ask for, if there is such, near a profile's if there is one: the training data may leave open whether the
    /// track is off or the size of what was found.
    pub(crate) fn asked_for(&self) -> Option<Place> {
        let Self { question, search, selected, .. } = *self;
        let bench = Bench::new(question, search, selected).filter(|bench| bench.missed(search, selected).is_some())?;
        let loss = |log: f64| self.loss(&bench, log.exp()).unwrap_or(f64::INFINITY);
        let (step, apart): (f64, Vec<i32>) = if question.track_width.is_some() {
            let (step, steps) = self.steps();
            (step, (-(steps as i32)..=steps as i32).collect())
        } else {
            (SQRT_2.ln(), HALF_OCTAVES.to_vec())
        };
        let widths = apart.iter().map(|k| self.now() + f64::from(*k) * step);
        let near = widths.map(|log| (loss(log), log)).min_by(|a, b| a.0.total_cmp(&b.0))?;
        let (log, most) = highest(|log| -loss(log), near.1 - step, near.1 + step);
        let asked = bench.decisive(-most, bench.loss(search, &selected.state));
        asked.then(|| self.place(log, &selected.state.fit)).flatten()
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
        let fit = self.fitted(&scene, now)?;
        let cost = now.likelihood(&search.setting) - fit.likelihood(&search.setting);
        let state = State { effects: effects.clone(), fit };
        Some(bench.with_cost(bench.loss(&search, &state), cost.max(0.0)))
    }

    /// The fit of the selection in another scene.
    fn fitted(&self, scene: &Scene, from: &Fit) -> Option<Fit> {
        let Selected { state, whitening, .. } = self.selected;
        self.search(scene).fitted_near(&state.effects, from, whitening, COMPARING)
    }

    /// The selection in another scene, fitted to the end, its members contested there; where one goes round with a wheel, the other wheel is
    /// looked at again.
    fn told(&self, scene: &'a Scene, there: &Fit, first: &[Response]) -> Option<(Search<'a>, Selected)> {
        let search = self.search(scene);
        let Selected { state: State { effects, .. }, whitening, base, rivals, ranking } = self.selected;
        let (whitening, fit) = search.under(effects, there, &whitening.noise, FINAL)?;
        let state = State { effects: effects.clone(), fit };
        let mut selected = Selected { state, whitening, base: base.clone(), rivals: rivals.clone(), ranking: ranking.clone() };
        search.exchange(&mut selected, first, Newest::Open);
        if self.round() {
            let about = search.respond_of(&search.turning_with(effects), &self.selected.plain());
            search.other_wheel(&mut selected, &about, first);
        }
        Some((search, selected))
    }
}
