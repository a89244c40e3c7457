//! What is recorded beside the model's channels and says of the robot's geometry what they cannot: a heading, the wheels' own rates.
//!
//! A model of velocities takes wrong radii and a wrong track up into its parameters, wholly or nearly. Two ways of measuring the same motion
//! do not. With V and W the velocities that one of them tells and h half the track, radii that are e/2 too large on the right and as much too
//! small on the left, and a track that is t too wide, make the other tell
//!
//! v = V + (e/2) h W,   h ω = (e/2) V + (1 − t) h W,
//!
//! over spans of a second, in which noise is small. Of encoders one wheel of which is off by δ alone e and t are both δ/2: a track error is one beyond that.
//! One of them may be late: turning that comes and goes in a few seconds would be less by a
//! part in thirty for a tenth of a second of that, and what is left would hide as much, so they are held against each other on the clock on which they agree.

use nalgebra::{Vector1, Vector2, Vector3};
use wheelwright_core::Stretch;
use wheelwright_core::effect::{Effect, Estimate, Frame, Scene};

use crate::effects::{Speeds, TrackWidthError, WheelRadiusMismatch, digits};
use crate::finding::{Finding, FoundParameter, settings};
use crate::question::Question;
use crate::spans::{Regression, Span, unwrapped};

/// Standard deviations by which a coupling or a scale must differ: beyond what the search over all effects asks of one parameter.
const DISTINCT: f64 = 5.0;
/// Least difference of radii that means anything, as a share: tread and load change a tyre's radius by as much.
const SMALLEST_MISMATCH: f64 = 0.005;
/// Least track error against a measured heading: contact patches have a width.
const SMALLEST_TRACK: f64 = 0.01;
/// Least track error against a profile whose track and radius a person measured to 2 %.
pub(crate) const MEASURED_TRACK: f64 = 0.03;
/// Largest standard error, as a share, of a dimension that recorded rates tell: as well as a person measures it.
const MEASURED: f64 = 0.02;
/// A number with its standard error.
#[derive(Debug, Clone, Copy)]
struct Measured {
    value: f64,
    error: f64,
}

impl Measured {
    fn distinct(self, least: f64) -> bool {
        self.value.abs() > least && self.value.abs() > DISTINCT * self.error
    }

    fn evidence(self) -> f64 {
        (self.value / self.error).powi(2)
    }
}

/// What two ways of measuring say of one another.
#[derive(Debug, Clone, Copy)]
struct Relation {
    /// e/2: what forward motion adds to turning.
    coupling: Measured,
    /// −t: by how much the second way tells of more turning than the first.
    turning: Measured,
}

impl Relation {
    /// Whether the radius of one wheel is all that is wrong: encoders that are off by δ at one of the wheels tell of δ/2 of the way as turning, one way or the
    /// other, and of δ/2 too much turning.
    fn of_one_wheel(&self, least: f64) -> bool {
        let Self { coupling, turning } = *self;
        let beyond = Measured { value: turning.value.abs() - coupling.value.abs(), error: coupling.error.hypot(turning.error) };
        coupling.distinct(0.5 * SMALLEST_MISMATCH) && !beyond.distinct(least)
    }
}

/// A geometry that channels beside the model's tell.
pub(crate) struct Beside {
    /// Unequal radii as an effect whose parameter is bounded by what was measured, and the evidence for it.
    pub(crate) radii: Option<(Box<dyn Effect>, f64)>,
    /// A wrong track: nothing of it is in the model's channels.
    pub(crate) track: Option<Finding>,
}

impl Beside {
    /// Compares what the training data hold beside the model's channels.
    pub(crate) fn of(question: &Question<'_>, scene: &Scene) -> Self {
        let mut made = Self { radii: None, track: None };
        let Frame::Body { half_track } = scene.frame else { return made };
        let pose = question.training_headings.as_ref().and_then(|headings| by_heading(question, headings, half_track));
        let wheels = question.wheel_radius.zip(question.training_wheel_rates.as_ref());
        let wheels = wheels.and_then(|(radius, rates)| by_wheels(question, rates, half_track, radius));
        // The recorded velocities are the encoders' where a heading contradicts them, the robot's own where the wheels do. What is
        // recorded is (1 + e) times what moves in the one case, and what the loops keep in the other.
        let ways = [(pose, Speeds::Encoders, -2.0, SMALLEST_TRACK), (wheels, Speeds::Ground, 2.0, MEASURED_TRACK)];
        for (relation, speeds, sign, least) in ways {
            let Some(relation) = relation else { continue };
            if made.radii.is_none() && relation.coupling.distinct(0.5 * SMALLEST_MISMATCH) && holds(question, "wheel_radius_mismatch") {
                // Three standard deviations, and a tenth for noise in what is taken as the cause, which shrinks coefficients.
                let value = sign * relation.coupling.value;
                let reach = 3.0 * 2.0 * relation.coupling.error + 0.1 * value.abs();
                let effect = WheelRadiusMismatch { speeds, between: Some((value - reach, value + reach)), wheel: None };
                made.radii = Some((Box::new(effect), relation.coupling.evidence()));
            }
            let one_wheel = speeds == Speeds::Encoders && relation.of_one_wheel(least);
            if made.track.is_none() && relation.turning.distinct(least) && !one_wheel && holds(question, "track_width_error") {
                made.track = Some(track(relation.turning, speeds, scene));
            }
        }
        made
    }
}

/// Whether the library holds an effect: what was left out of it is not named.
fn holds(question: &Question<'_>, name: &str) -> bool {
    question.library.iter().any(|e| e.name() == name)
}

/// Turning by the heading against recorded velocities: what it turned over a second by their integrals, and a drift.
fn by_heading(question: &Question<'_>, headings: &[Vec<f64>], h: f64) -> Option<Relation> {
    let stretches = &question.training.stretches;
    if !stretches.iter().map(Stretch::len).eq(headings.iter().map(Vec::len)) {
        return None;
    }
    let turned: Vec<Vec<f64>> = headings.iter().map(|heading| unwrapped(heading)).collect();
    let moved = moved(stretches);
    let row = |span: &Span, by: f64| {
        let (s, stretch) = (span.stretch, &stretches[span.stretch]);
        let [forward, turning] = [0, 1].map(|i| span.covered(stretch, &moved[s][i], 0.0));
        (Vector3::new(forward, h * turning, span.end - span.start), Vector1::new(h * span.covered(stretch, &turned[s], by)))
    };
    let regression = Regression::in_step(question.training, row)?;
    let of = |i: usize, neutral: f64| Measured { value: regression.found[i] - neutral, error: regression.error(i, 0) };
    // Of what the velocities say it turned, the heading tells 1/(1 + t).
    Some(Relation { coupling: of(0, 0.0), turning: of(1, 1.0) })
}

/// What the outputs tell, summed up.
fn moved(stretches: &[Stretch]) -> Vec<[Vec<f64>; 2]> {
    stretches.iter().map(|s| [0, 1].map(|i| s.integral(&s.outputs[i]))).collect()
}

/// Recorded velocities against those of the wheels by the robot's dimensions.
fn by_wheels(question: &Question<'_>, rates: &[[Vec<f64>; 2]], h: f64, radius: f64) -> Option<Relation> {
    let regression = rolled(question, rates, h, radius)?;
    let (found, error) = (regression.found, |i: usize, j: usize| regression.error(i, j));
    // Both equations tell the coupling: by their precision.
    let weights = [error(1, 0).powi(-2), error(0, 1).powi(-2)];
    let coupling = (found[(1, 0)] * weights[0] + found[(0, 1)] * weights[1]) / (weights[0] + weights[1]);
    let forward = found[(0, 0)];
    // A radius that both wheels share scales both alike.
    let turning = Measured {
        value: found[(1, 1)] / forward - 1.0,
        error: (error(1, 1) / forward).hypot(error(0, 0) * found[(1, 1)] / (forward * forward)),
    };
    Some(Relation { coupling: Measured { value: coupling, error: (weights[0] + weights[1]).powf(-0.5) }, turning })
}

/// What a robot's geometry takes.
pub(crate) struct Dimensions {
    /// Rolling radius of the wheels \[m\].
    pub(crate) wheel_radius: f64,
    /// Distance between them \[m\].
    pub(crate) track_width: f64,
}

/// Radius and track of wheels that nobody measured, as their own rates tell them beside the velocities of the robot.
pub(crate) fn dimensions(question: &Question<'_>) -> Option<Dimensions> {
    let rates = question.training_wheel_rates.as_ref().filter(|_| question.track_width.is_none())?;
    if !matches!(Frame::of(question.model, 1.0), Frame::Body { .. }) {
        return None;
    }
    let regression = rolled(question, rates, 1.0, 1.0)?;
    let found = regression.found;
    let sure = |i: usize| found[(i, i)] > 0.0 && regression.error(i, i) < MEASURED * found[(i, i)];
    let radius = found[(0, 0)];
    (sure(0) && sure(1))
        .then(|| Dimensions { wheel_radius: question.wheel_radius.unwrap_or(radius), track_width: 2.0 * radius / found[(1, 1)] })
}

/// Recorded v and h ω (columns of what is found) regressed on the wheels' means and half differences (rows), over spans of a second.
fn rolled(question: &Question<'_>, rates: &[[Vec<f64>; 2]], h: f64, radius: f64) -> Option<Regression<2, 2>> {
    let stretches = &question.training.stretches;
    let whole = |(stretch, rates): (&Stretch, &[Vec<f64>; 2])| rates.iter().all(|rate| rate.len() == stretch.len());
    if rates.len() != stretches.len() || !stretches.iter().zip(rates).all(whole) {
        return None;
    }
    let rolled: Vec<[Vec<f64>; 2]> = stretches.iter().zip(rates).map(|(s, rates)| [0, 1].map(|side| s.integral(&rates[side]))).collect();
    let moved = moved(stretches);
    let row = |span: &Span, by: f64| {
        let (s, stretch) = (span.stretch, &stretches[span.stretch]);
        let [left, right] = [0, 1].map(|side| radius * span.covered(stretch, &rolled[s][side], by));
        let [forward, turning] = [0, 1].map(|i| span.covered(stretch, &moved[s][i], 0.0));
        (Vector2::new(0.5 * (left + right), 0.5 * (right - left)), Vector2::new(forward, h * turning))
    };
    Regression::in_step(question.training, row)
}

/// A track error as a finding. Where a heading tells it, the recorded angular velocity is (1 + t) times the true one; where the wheels
/// do, the loops reckon with (1 + t) times what the recording tells.
fn track(turning: Measured, speeds: Speeds, scene: &Scene) -> Finding {
    let error = |x: f64| -x / (1.0 + x);
    let value = error(turning.value);
    let half = 1.96 * turning.error / (1.0 + turning.value).powi(2);
    let estimate = Estimate { value, ci95: Some((value - half, value + half)) };
    let effect = TrackWidthError {};
    let statement = match speeds {
        Speeds::Encoders => format!("{} (the measured heading says so)", effect.statement(&[estimate], scene)),
        _ => format!(
            "by the wheels' own rates and the robot's profile it turns {} % {} than it does: another track than the profile's",
            digits(100.0 * value.abs()),
            if value < 0.0 { "less" } else { "more" }
        ),
    };
    Finding {
        name: effect.name().to_owned(),
        place: effect.stage().place(),
        statement,
        parameters: effect
            .parameters(scene)
            .into_iter()
            .map(|p| FoundParameter { name: p.name, value, ci95: estimate.ci95, unit: p.unit, label: p.label })
            .collect(),
        values: vec![value],
        settings: settings(&effect),
        delta_bic: turning.evidence(),
        holdout_gain: None,
        alternatives: Vec::new(),
    }
}

#[cfg(test)]
#[path = "beside_tests.rs"]
mod tests;
