//! From a question to an answer, step by step.

use std::cell::{Cell, OnceCell};

use wheelwright_core::Dataset;
use wheelwright_core::effect::{Effect, Frame, Scene, Stage};
use wheelwright_core::simulation::Readout;

use crate::answer::{Means, Story, always, tell};
use crate::beside::{Beside, Dimensions, dimensions};
use crate::clock;
use crate::effects::{LATENESS, digits};
use crate::finding::Diagnosis;
use crate::fit::base::{fit, renew};
use crate::fit::layout::Layout;
use crate::fit::search::{Effort, Fit};
use crate::fit::setting::{Point, Runner, Setting};
use crate::fit::whitening::Whitening;
use crate::gauge::{self, Elsewhere};
use crate::judge::{Bench, judged, widened};
use crate::noise::Noise;
use crate::question::{DiagnosisError, Question};
use crate::radius::{self, Wheels};
use crate::round::{come_round, in_line};
use crate::screen::{Response, saturate};
use crate::select::{EXCHANGE, FINAL, SHARE, Search, Selected, State};
use crate::track;
use crate::unrounded::{step, unrounded};

/// Fewest values a parameter that are needed for a noise model to mean anything.
const FEWEST: usize = 10;
/// Numerical error of a free run as a share of an output's root mean square: below it nothing is physics.
const NUMERICAL: f64 = 5e-5;
/// Error of a free run beside the noise that changes nothing: its square is a ten-thousandth of the noise's.
const ACCURACY: f64 = 0.01;
/// Evidence by which another track must be better than the ordinary one.
pub(crate) const DECISIVE: f64 = 10.0;
/// Rows beyond which a recording only costs time: pieces spread evenly over it are taken.
const MOST_ROWS: usize = 8_000;

/// What is said where the search ended before it had looked at everything.
const STOPPED: &str = "the search ended at its limit of simulation: what further effects would explain, and what could stand in the place of those that \
                       were found, was not looked at to the end; a shorter recording, or an earlier model given as the one to compare with, leaves more room";

/// An effect that channels beside the model's tell, and the evidence for it.
pub(crate) type Known = (Box<dyn Effect>, f64);

/// Diagnoses.
///
/// # Errors
/// [`DiagnosisError`]: what makes an answer impossible, with numbers.
pub fn diagnose(question: &Question<'_>) -> Result<Diagnosis, DiagnosisError> {
    check(question)?;
    let first = answer(question, None)?;
    match unrounded(question.training, &first.training.after) {
        Some(read) => answer(question, Some(&read)),
        None => Ok(first),
    }
}

/// The answer to a question; `read` are its training data as they are taken, if that is not as they were recorded.
fn answer(question: &Question<'_>, read: Option<&Dataset>) -> Result<Diagnosis, DiagnosisError> {
    let mut warnings = Vec::new();
    let told = dimensions(question).map(|told| measured(question, &told, &mut warnings));
    let question = told.as_ref().unwrap_or(question);
    let (data, headings) = thinned(question);
    if data.samples() < question.training.samples() {
        warnings.push(format!(
            "{} of {} samples were diagnosed, in pieces spread evenly over the recording",
            data.samples(),
            question.training.samples()
        ));
    }
    let scene = |wheels: Wheels| Scene::new(&data, question.model, wheels.track_width, wheels.radius, headings.as_deref());
    let ordinary = Wheels { radius: question.wheel_radius, track_width: question.track_width.unwrap_or(track::ORDINARY) };
    let (first, fitting, courses) = (scene(ordinary), [const { OnceCell::new() }; 4], [const { OnceCell::new() }; 7]);
    let read = read.map(|training| thinned(&Question { training, ..question.clone() }).0);
    let begin = |scene, course| {
        let mut setting = setting(question, &data, scene, Readout::Instantaneous);
        if let Some(read) = &read {
            setting.measured = setting.layout.flat(read);
        }
        surroundings(setting, question, course)
    };
    let mut start = begin(&first, &courses[0])?;
    let mut shown = wheels_shown(question, &start, headings.as_deref());
    if let Some(wheels) = shown {
        start = begin(fitting[0].get_or_init(|| scene(wheels)), &courses[1])?;
    }
    let mut about = start.search.setting.scene;
    let Beside { radii, track } = Beside::of(question, about);
    let mut story = selected(start, radii.as_ref(), &courses[2])?;
    if let Some(wheels) = radius::left_over(question, &story.search.setting, &story.selected.state.fit) {
        let start = begin(fitting[1].get_or_init(|| scene(wheels)), &courses[3])?;
        let closer = start.search.setting.scene;
        let again = selected(start, radii.as_ref(), &courses[4])?;
        if again.own_evidence() > story.own_evidence() + DECISIVE {
            (story, shown, about) = (again, Some(wheels), closer);
        }
    }
    let mut story = other_readout(story, question, &data, about, radii.as_ref(), [&courses[5], &courses[6]])?;
    story.selected = story.search.unjittered(story.selected, &story.responses);
    let mut likelier = None;
    if shown.is_some() || question.track_width.is_some() {
        likelier = gauge::retold(question, &mut story, headings.as_deref(), &fitting[2], |elsewhere| elsewhere.likelier());
        shown.iter_mut().for_each(|wheels| wheels.track_width = likelier.unwrap_or(wheels.track_width));
    }
    // Where what goes round told another track than the profile's, held-out data have nothing to ask for.
    let tuned = question.track_width.is_some() && likelier.is_some();
    let asked_for = |elsewhere: &Elsewhere<'_, '_>| if tuned { None } else { elsewhere.asked_for() };
    let asked = gauge::retold(question, &mut story, headings.as_deref(), &fitting[3], asked_for);
    warnings.extend(unknown_wheels(question, shown, asked));
    let round = story.search.goes_round(&story.selected.state);
    let given = if told.is_some() { "that which the wheels' rates tell" } else { "the profile's" };
    warnings.extend(another_track(question, likelier, asked, round, given));
    story.selected.state = story.search.modest(story.selected.state, &story.selected.whitening, &story.selected.base);
    story.selected = judged(question, &story.search, story.selected, &story.responses);
    if let Some((prompt, late)) = story.search.prompt(&story.selected) {
        story.selected = prompt;
        warnings.push(format!("the robot is late by {} s beyond the model: no more than any drive is, and not counted", digits(late)));
    }
    let told = clock::named(question, &story.search, &mut story.selected);
    let (selected, mut rests) = story.search.settled(story.selected);
    story.selected = selected;
    if let Some(wider) = widened(question, &story.search, &story.selected) {
        rests = story.search.rests(&wider);
        story.selected = wider;
    }
    story.selected = story.search.told(story.selected);
    story.search.twinned(&mut story.selected, &rests);
    if let Some(told) = told {
        told.exclude(&story.search, &mut story.selected);
        warnings.push(told.remark());
    }
    if story.search.setting.exhausted() {
        warnings.push(STOPPED.to_owned());
    }
    tell(question, story, &rests, track, warnings)
}

/// A question with the dimensions that the wheels' own rates tell.
fn measured<'a>(question: &Question<'a>, told: &Dimensions, warnings: &mut Vec<String>) -> Question<'a> {
    let Dimensions { wheel_radius, track_width } = *told;
    warnings.push(format!(
        "the robot's dimensions are unknown: the wheels' own rates tell a track width of {} m and a wheel radius of {} m, which are taken",
        digits(track_width),
        digits(wheel_radius)
    ));
    Question { track_width: Some(track_width), wheel_radius: Some(wheel_radius), ..question.clone() }
}

/// Radius and track of the wheels where the recording has to tell them and does: by what returns with their way, or else the track alone by
/// the effects at the wheels.
fn wheels_shown(question: &Question<'_>, start: &Surroundings<'_>, headings: Option<&[Vec<f64>]>) -> Option<Wheels> {
    let Question { wheel_radius, track_width, .. } = *question;
    let round = if wheel_radius.is_none() { radius::shown(question, start, headings) } else { None };
    let likeliest = || if track_width.is_none() { track::likeliest(question, start, headings) } else { None };
    round.or_else(|| likeliest().map(|track_width| Wheels { radius: wheel_radius, track_width }))
}

/// What is said where radius or track of the wheels are unknown: which ones are taken, of the track perhaps one that held-out data asked for.
fn unknown_wheels(question: &Question<'_>, shown: Option<Wheels>, asked: Option<f64>) -> Vec<String> {
    let mut all = Vec::new();
    if question.track_width.is_none() {
        let taken = match (asked, shown) {
            (Some(width), _) => format!("{} m, which fits them as well as any other and holds on the held-out data", digits(width)),
            (None, Some(wheels)) => format!("{} m, which fits them best", digits(wheels.track_width)),
            (None, None) => format!("{} m", track::ORDINARY),
        };
        all.push(format!(
            "the track width is unknown: effects at the wheels are computed with {taken}; give `--robot` to have their sizes right"
        ));
    }
    if let (None, Some(radius)) = (question.wheel_radius, shown.and_then(|wheels| wheels.radius)) {
        all.push(format!(
            "the wheels' radius is unknown: something returns with every {} m of a wheel's way, and is taken for its turns, at a radius of {} m; give \
             `--robot` to have that checked",
            digits(std::f64::consts::TAU * radius),
            digits(radius)
        ));
    }
    all
}

/// What is said where what acts at the wheels shows another track than the one that was `given`, or what goes `round` with them only keeps its phase on
/// held-out data at another.
fn another_track(question: &Question<'_>, likelier: Option<f64>, asked: Option<f64>, round: bool, given: &str) -> Option<String> {
    let (width, other) = question.track_width.zip(asked.or(likelier))?;
    let off = digits(100.0 * (other / width - 1.0).abs());
    let wider = if other > width { "wider" } else { "narrower" };
    let fits = if round { "what goes round with the wheels keeps its phase" } else { "what acts at the wheels is explained best" };
    let held_out = if asked.is_some() { " on the held-out data too" } else { "" };
    Some(format!("{fits}{held_out} if the track is {} m, {off} % {wider} than {given}, which is taken; measure it again", digits(other)))
}

/// Odometry that differences counts records means over the interval, which looks like a delay of half a sample, or hides in the model's own
/// lag. Unless what was found is later than that, this reading of the data is tried, and kept if it explains more.
fn other_readout<'a>(
    story: Story<'a>,
    question: &Question<'a>,
    data: &'a Dataset,
    scene: &'a Scene,
    known: Option<&'a Known>,
    [course, closer]: [&'a OnceCell<Scene>; 2],
) -> Result<Story<'a>, DiagnosisError> {
    let instead = story.search.effects(&story.selected.state.effects).into_iter().find(|effect| late(*effect));
    if (instead.is_some() && !story.barely_late()) || story.search.setting.exhausted() {
        return Ok(story);
    }
    let mut other = setting(question, data, scene, Readout::IntervalMean);
    other.measured.clone_from(&story.search.setting.measured);
    let Ok(base) = fit(&mut other, question) else { return Ok(story) };
    // Speeds that come in whole counts of the wheels say themselves that counts are differenced.
    let counted = story.search.counted(&story.selected);
    // Under the same white noise as the first base fit.
    if !counted && base.likelihood(&other) <= story.first {
        return Ok(story);
    }
    // Else it is one of the library's names, and was looked for among them. And to those that are known to be differenced a delay of half a sample
    // comes as near as laws are exact.
    let inexact = SHARE * story.selected.gained(&story.search.setting, &story.selected.state.fit);
    let sought = if counted { (-inexact).min(0.0) } else { story.search.penalty(1.0) - story.search.log_values() };
    if plainer(&story, &other, &base).is_none_or(|plainer| plainer - sought <= story.evidence()) {
        return Ok(story);
    }
    let rival = selected(surroundings(other, question, course)?, known, closer)?;
    let better = rival.own_evidence() - story.own_evidence() - sought;
    if better <= EXCHANGE || (!counted && contradicted(question, &rival, &story)) {
        return Ok(story);
    }
    let rival = if counted { on_time(rival, inexact) } else { rival };
    let instead = instead.map_or_else(Vec::new, |effect| with_the_same(effect, &story.search));
    let means = Means { evidence: better, instead, base: story.selected.base.clone() };
    Ok(Story { means: Some(means), ..rival })
}

/// A story without what makes it late by so little that it gains less than laws are inexact by.
fn on_time(mut story: Story<'_>, least: f64) -> Story<'_> {
    for member in (0..story.selected.state.effects.len()).rev() {
        let Story { search, selected, .. } = &story;
        if !late(search.effect(selected.state.effects[member])) {
            continue;
        }
        let rest = search.without(selected, member).filter(|rest| search.gain(&selected.state.fit, rest) < least);
        if let Some(fewer) = rest.and_then(|rest| search.only(selected, &rest)) {
            story.selected = fewer;
        }
    }
    story
}

/// The name of an effect, and of those that are one with it under every drive.
fn with_the_same(effect: &dyn Effect, search: &Search<'_>) -> Vec<String> {
    let others = search.effects(&search.open).into_iter().filter(|other| always(effect, *other).is_some());
    let mut names: Vec<String> = std::iter::once(effect).chain(others).map(|effect| effect.name().to_owned()).collect();
    names.dedup();
    names
}

/// Whether the held-out data decisively prefer a story to another one.
fn contradicted(question: &Question<'_>, told: &Story<'_>, other: &Story<'_>) -> bool {
    let (other, its_own) = ((&other.search, &other.selected.state), (&told.search, &told.selected.state));
    Bench::new(question, &told.search, &told.selected).is_some_and(|bench| bench.prefers(other, its_own))
}

/// Evidence for a story without its lateness under another reading: only where that does as well is there more to look for.
fn plainer<'a>(story: &Story<'a>, reading: &Setting<'a>, base: &Fit) -> Option<f64> {
    let Story { search, selected, .. } = story;
    let Setting { tolerance, substeps, .. } = search.setting;
    let setting = Setting { tolerance, substeps, ..reading.clone() };
    let other = Search { setting, library: search.library, open: search.open.clone(), known: search.known };
    let kept = |member: usize| !late(search.effect(selected.state.effects[member]));
    let effects: Vec<usize> = (0..selected.state.effects.len()).filter(|i| kept(*i)).map(|i| selected.state.effects[i]).collect();
    // From the story's own parameters: those of the base model alone have bent to what its effects do.
    let x = search.unknowns(&selected.state, &kept).map(|j| selected.state.fit.point.x[j]).collect();
    let point = Point { x, starts: base.point.starts.clone() };
    let (whitening, fit) = other.at(&effects, point, &selected.whitening.noise)?;
    let state = State { effects, fit };
    Some(other.own_evidence(&Selected { state, whitening, base: base.clone(), rivals: Vec::new(), ranking: Vec::new() }))
}

/// Whether an effect makes what is recorded late.
fn late(effect: &dyn Effect) -> bool {
    matches!(effect.stage(), Stage::Transport | Stage::Filter) || effect.family() == LATENESS
}

pub(crate) fn setting<'a>(question: &Question<'a>, data: &'a Dataset, scene: &'a Scene, readout: Readout) -> Setting<'a> {
    let layout = Layout::of(data, scene);
    let mut map = question.map.clone();
    if let (true, Some(theta)) = (question.fixed, &question.theta) {
        map.free.clear();
        map.matrix.clear();
        map.offset.clone_from(theta);
    }
    Setting {
        model: question.model,
        map,
        bounds: question.bounds.clone(),
        data,
        scene,
        readout,
        measured: layout.flat(data),
        rounded: (0..data.outputs.len()).map(|c| step(data, c).unwrap_or(0.0)).collect(),
        steps: Vec::new(),
        rough: None,
        floor: scene.scales.outputs.iter().map(|s| NUMERICAL * s).collect(),
        substeps: 1,
        tolerance: 0.0,
        work: Cell::new(0),
        most_steps: question.most_steps,
        layout,
    }
}

/// What the search for effects starts from.
pub(crate) struct Surroundings<'a> {
    pub(crate) search: Search<'a>,
    /// The base model under white noise, and twice its log-likelihood.
    pub(crate) rough: State,
    first: f64,
    /// What every effect would change.
    pub(crate) responses: Vec<Response>,
    /// The noise, and the base model under it.
    pub(crate) whitening: Whitening,
    pub(crate) base: Fit,
}

impl Surroundings<'_> {
    /// The base model without effects.
    pub(crate) fn plain(&self) -> State {
        State::plain(self.base.clone())
    }
}

/// Base fit, noise, and what every effect would change; `course` keeps the scene with the wheels' course as that fit and the record tell it.
pub(crate) fn surroundings<'a>(
    mut setting: Setting<'a>,
    question: &Question<'a>,
    course: &'a OnceCell<Scene>,
) -> Result<Surroundings<'a>, DiagnosisError> {
    let rough = fit(&mut setting, question)?;
    setting.scene = course.get_or_init(|| setting.scene.followed(setting.data, &setting.layout.series(&rough.simulated)));
    setting.tolerance = worthwhile_accuracy(&setting, &rough);
    setting.substeps = 1;
    setting.substeps = Runner::new(&setting, &[], &rough.point)?.substeps();
    let first = rough.likelihood(&setting);
    let open: Vec<usize> = (0..question.library.len()).filter(|i| tried(&*question.library[*i], setting.scene)).collect();
    let search = Search { setting, library: question.library, open, known: None };
    let rough = State::plain(rough);
    let responses = search.respond(&rough);
    let (whitening, base) = whitened(&search.setting, &rough.fit, &responses)?;
    Ok(Surroundings { search, rough, first, responses, whitening, base })
}

/// Whether an effect is tried on any recording that it applies to.
pub(crate) fn tried(effect: &dyn Effect, scene: &Scene) -> bool {
    effect.line().is_none() && !effect.stands_in() && !effect.last_resort() && effect.inapplicable(scene).is_none()
}

/// The effects that the evidence asks for; `closer` keeps the scene with the wheels' course as these tell it.
fn selected<'a>(start: Surroundings<'a>, known: Option<&'a Known>, closer: &'a OnceCell<Scene>) -> Result<Story<'a>, DiagnosisError> {
    let Surroundings { search, first, mut responses, whitening, base, .. } = start;
    let search = Search { known, ..search };
    let known = with_known(&search, &base, &whitening);
    let base = State::plain(base);
    responses.extend(search.last_resorts(&base, &whitening));
    responses.sort_by_key(|response| response.effect);
    let selected = search.run(base, known, whitening, &responses)?;
    Ok(in_line(come_round(Story { search, selected, responses, first, means: None }, closer)))
}

/// The base model with the effect that is known from beside, fitted within what is known of it.
fn with_known(search: &Search<'_>, base: &Fit, whitening: &Whitening) -> Option<State> {
    let (effect, _) = search.known?;
    let start = effect.starts(search.setting.scene).into_iter().next()?;
    let point = Point { x: [&base.point.x, &start.values[..]].concat(), starts: base.point.starts.clone() };
    let effects = vec![search.library.len()];
    let fit = search.fitted_from(&effects, &point, whitening, FINAL, true)?;
    Some(State { effects, fit })
}

/// A hundredth of what changes from sample to sample in the residual: errors that small are lost in the noise.
fn worthwhile_accuracy(setting: &Setting<'_>, rough: &Fit) -> f64 {
    let of = |c: usize| {
        let (mut sum, mut count) = (0.0, 0.0_f64);
        for s in 0..setting.layout.stretches() {
            let part = setting.layout.part(c, s);
            let left: Vec<f64> = part.map(|k| setting.measured[k] - rough.simulated[k]).collect();
            sum += left.windows(2).map(|w| (w[1] - w[0]).powi(2)).sum::<f64>();
            count += left.len() as f64;
        }
        (0.5 * sum / count.max(1.0)).sqrt() / setting.scene.scales.outputs[c]
    };
    (0..setting.layout.outputs()).map(|c| ACCURACY * of(c)).fold(f64::INFINITY, f64::min)
}

/// The base fit under the noise of the saturated residual.
fn whitened(setting: &Setting<'_>, rough: &Fit, responses: &[Response]) -> Result<(Whitening, Fit), DiagnosisError> {
    let none: [&dyn Effect; 0] = [];
    let mut runner = Runner::new(setting, &none, &rough.point)?;
    let units = &setting.scene.scales.outputs;
    let white = Noise::white(units, &setting.layout);
    let whitening = Whitening::new(white, &setting.layout, &mut runner, &rough.point);
    let lost = || DiagnosisError::NoStart("the fit cannot be evaluated where it ended".to_owned());
    let mut again = crate::fit::search::evaluate(setting, &mut runner, &whitening, &rough.point).ok_or_else(lost)?;
    let unknowns = again.point.x.len();
    crate::fit::search::linearise(&mut runner, &whitening, &mut again, 0..unknowns);
    let (mut residual, taken) = saturate(setting, &whitening, &again, responses);
    for (c, unit) in units.iter().enumerate() {
        residual[setting.layout.output(c)].iter_mut().for_each(|x| *x *= unit);
    }
    let noise = setting.noise(&residual, taken as f64 + whitening.taken());
    renew(setting, &mut runner, noise, &again, Effort { trials: 12, worthwhile: 0.05, target: f64::NEG_INFINITY }).ok_or_else(lost)
}

fn check(question: &Question<'_>) -> Result<(), DiagnosisError> {
    let (data, model) = (question.training, question.model);
    for data in std::iter::once(data).chain(question.held_out) {
        let names = |channels: &[wheelwright_core::Channel]| channels.iter().map(|c| c.name.to_string()).collect::<Vec<_>>().join(", ");
        let found = [names(&data.inputs), names(&data.outputs)].join("; ");
        let wanted = [names(model.inputs()), names(model.outputs())].join("; ");
        if found != wanted {
            return Err(DiagnosisError::Channels { found, wanted });
        }
    }
    let needed = FEWEST * (question.map.free.len() + data.outputs.len() * (1 + data.stretches.len())).div_ceil(data.outputs.len().max(1));
    if data.samples() < needed {
        let needed_s = if data.samples() > 1 { needed as f64 * data.period() } else { 0.0 };
        return Err(DiagnosisError::TooFewSamples { samples: data.samples(), needed, needed_s });
    }
    let moves = |s: &wheelwright_core::Stretch| s.outputs.iter().any(|c| c.iter().any(|x| *x != c[0]));
    if !data.stretches.iter().any(moves) {
        return Err(DiagnosisError::NoMotion);
    }
    let wanted = model.parameters().len();
    match (&question.theta, question.fixed) {
        (None, true) => Err(DiagnosisError::NothingToHold { found: 0, wanted }),
        (Some(theta), true) if theta.len() != wanted => Err(DiagnosisError::NothingToHold { found: theta.len(), wanted }),
        _ => Ok(()),
    }
}

/// The training data, or pieces spread evenly over it, with the headings that belong to them: of pieces, those that the whole of the data tells.
fn thinned(question: &Question<'_>) -> (Dataset, Option<Vec<Vec<f64>>>) {
    let data = question.training;
    if data.samples() <= MOST_ROWS {
        return (data.clone(), question.training_headings.clone());
    }
    let turned = || Scene::new(data, question.model, track::ORDINARY, None, None).tracks.into_iter().map(|track| track.heading).collect();
    let told = matches!(Frame::of(question.model, track::ORDINARY), Frame::Body { .. });
    let headings = question.training_headings.clone().or_else(|| told.then(turned));
    let share = MOST_ROWS as f64 / data.samples() as f64;
    // Pieces long against any lag of a robot, many enough to meet all that happened.
    let piece = MOST_ROWS / 8;
    let mut kept = Dataset { stretches: Vec::new(), ..data.clone() };
    let mut kept_headings = headings.as_ref().map(|_| Vec::new());
    for (s, stretch) in data.stretches.iter().enumerate() {
        let count = stretch.len().div_ceil((piece as f64 / share) as usize).max(1);
        let length = ((stretch.len() as f64 * share) as usize / count).max(2);
        for i in 0..count {
            let room = stretch.len() - length;
            let start = if count > 1 { room * i / (count - 1) } else { 0 };
            kept.stretches.push(stretch.slice(start..start + length));
            if let (Some(kept), Some(all)) = (&mut kept_headings, headings.as_ref().and_then(|h| h.get(s))) {
                kept.push(all[start..start + length].to_vec());
            }
        }
    }
    (kept, kept_headings)
}

impl Story<'_> {
    /// Whether a lateness was found that half a sample could be a good part of.
    fn barely_late(&self) -> bool {
        let setting = &self.search.setting;
        let values = &self.selected.state.fit.point.x[setting.free()..];
        let parameters = self.search.parameters(&self.selected.state.effects);
        parameters.iter().zip(values).any(|(p, v)| p.unit == "s" && *v > 0.0 && *v < setting.scene.scales.period)
    }

    fn evidence(&self) -> f64 {
        let Selected { state, whitening, base, .. } = &self.selected;
        self.search.evidence(state, whitening, base)
    }

    fn own_evidence(&self) -> f64 {
        self.search.own_evidence(&self.selected)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

    use wheelwright_core::{ModelConfig, Stretch};
    use wheelwright_models::VwPdConfig;

    use super::*;

    #[test]
    fn pieces_of_a_long_recording_head_where_the_whole_of_it_does() {
        let model = VwPdConfig::default().build().unwrap();
        let time: Vec<f64> = (0..9000).map(|k| 0.01 * f64::from(k)).collect();
        let turning: Vec<f64> = time.iter().map(|t| 1.0 + (0.7 * t).sin()).collect();
        let outputs = vec![vec![0.3; time.len()], turning];
        let stretch = Stretch { label: "0".to_owned(), time, inputs: outputs.clone(), outputs };
        let data = Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![stretch] };
        let (pieces, headings) = thinned(&Question::new(&*model, &data, &[]));
        let whole = Scene::new(&data, &*model, track::ORDINARY, None, None).tracks.remove(0).heading;
        assert!(pieces.stretches.len() > 1 && pieces.samples() <= MOST_ROWS);
        for (piece, heading) in pieces.stretches.iter().zip(headings.unwrap()) {
            let first = (piece.time[0] / 0.01).round() as usize;
            assert_eq!(heading, whole[first..first + piece.len()]);
        }
    }
}
