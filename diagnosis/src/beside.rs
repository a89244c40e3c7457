//! What is recorded beside the model's channels and says of the robot's geometry what they cannot: a heading, the wheels' own rates.
//!
//! A model of velocities takes wrong radii and a wrong track up into its parameters, wholly or nearly. Two ways of measuring the same motion
//! do not. With V and W the velocities that one of them tells and h half the track, radii that are e/2 too large on the right and as much too
//! small on the left, and a track that is t too wide, make the other tell
//!
//! v = V + (e/2) h W,   h ω = (e/2) V + (1 − t) h W,
//!
//! in means over a second, in which noise is small and delays do not matter.

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use wheelwright_core::effect::{Effect, Estimate, Frame, Scene};

use crate::comparison::{blocks, wrapped};
use crate::effects::{Speeds, TrackWidthError, WheelRadiusMismatch, digits};
use crate::finding::{Finding, FoundParameter, settings};
use crate::question::Question;

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
/// Fewest seconds that are compared.
const FEWEST: usize = 20;

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
            if made.track.is_none() && relation.turning.distinct(least) && holds(question, "track_width_error") {
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

/// Turning by the heading against recorded velocities: Δφ over a second by their integrals, and a drift.
fn by_heading(question: &Question<'_>, headings: &[Vec<f64>], h: f64) -> Option<Relation> {
    let mut rows: Vec<(Vector3<f64>, f64)> = Vec::new();
    for (s, range) in blocks(question.training, 1.0) {
        let (stretch, heading) = (&question.training.stretches[s], headings.get(s)?);
        if range.end >= stretch.len() || heading.len() != stretch.len() {
            continue;
        }
        let mut sums = Vector3::zeros();
        let mut turned = 0.0;
        for k in range {
            let step = stretch.time[k + 1] - stretch.time[k];
            let mean = |i: usize| 0.5 * (stretch.outputs[i][k] + stretch.outputs[i][k + 1]) * step;
            sums += Vector3::new(mean(0), h * mean(1), step);
            turned += h * wrapped(heading[k + 1] - heading[k]);
        }
        rows.push((sums, turned));
    }
    if rows.len() < FEWEST {
        return None;
    }
    let (square, right) = rows.iter().fold((Matrix3::zeros(), Vector3::zeros()), |(a, b), (x, y)| (a + x * x.transpose(), b + x * *y));
    let inverse = square.try_inverse()?;
    let found = inverse * right;
    let left: f64 = rows.iter().map(|(x, y)| (y - x.dot(&found)).powi(2)).sum();
    let variance = left / (rows.len() - 3) as f64;
    let of = |i: usize, neutral: f64| Measured { value: found[i] - neutral, error: (variance * inverse[(i, i)]).sqrt() };
    // Of what the velocities say it turned, the heading tells 1/(1 + t).
    Some(Relation { coupling: of(0, 0.0), turning: of(1, 1.0) })
}

/// Recorded velocities against those of the wheels by the robot's dimensions.
fn by_wheels(question: &Question<'_>, rates: &[[Vec<f64>; 2]], h: f64, radius: f64) -> Option<Relation> {
    let Rolled { found, error } = rolled(question, rates, h, radius)?;
    // Both equations tell the coupling: by their precision.
    let weights = [error[(1, 0)].powi(-2), error[(0, 1)].powi(-2)];
    let coupling = (found[(1, 0)] * weights[0] + found[(0, 1)] * weights[1]) / (weights[0] + weights[1]);
    let forward = found[(0, 0)];
    // A radius that both wheels share scales both alike.
    let turning = Measured {
        value: found[(1, 1)] / forward - 1.0,
        error: (error[(1, 1)] / forward).hypot(error[(0, 0)] * found[(1, 1)] / (forward * forward)),
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
    let Rolled { found, error } = rolled(question, rates, 1.0, 1.0)?;
    let sure = |i: usize| found[(i, i)] > 0.0 && error[(i, i)] < MEASURED * found[(i, i)];
    let radius = found[(0, 0)];
    (sure(0) && sure(1))
        .then(|| Dimensions { wheel_radius: question.wheel_radius.unwrap_or(radius), track_width: 2.0 * radius / found[(1, 1)] })
}

/// What recorded v and h ω (columns) are of the wheels' means and half differences (rows), and the standard errors.
struct Rolled {
    found: Matrix2<f64>,
    error: Matrix2<f64>,
}

/// Recorded velocities regressed on the wheels' rates, in means over a second.
fn rolled(question: &Question<'_>, rates: &[[Vec<f64>; 2]], h: f64, radius: f64) -> Option<Rolled> {
    let mut rows: Vec<(Vector2<f64>, Vector2<f64>)> = Vec::new();
    for (s, range) in blocks(question.training, 1.0) {
        let (stretch, rates) = (&question.training.stretches[s], rates.get(s)?);
        if rates.iter().any(|r| r.len() != stretch.len()) {
            continue;
        }
        let count = range.len() as f64;
        let mean = |of: &dyn Fn(usize) -> f64| range.clone().map(of).sum::<f64>() / count;
        let [left, right] = [0, 1].map(|side| radius * mean(&|k| rates[side][k]));
        let told = Vector2::new(mean(&|k| stretch.outputs[0][k]), h * mean(&|k| stretch.outputs[1][k]));
        rows.push((Vector2::new(0.5 * (left + right), 0.5 * (right - left)), told));
    }
    if rows.len() < FEWEST {
        return None;
    }
    let square = rows.iter().fold(Matrix2::zeros(), |a, (x, _)| a + x * x.transpose());
    let inverse: Matrix2<f64> = square.try_inverse()?;
    let right = rows.iter().fold(Matrix2::zeros(), |a, (x, y)| a + x * y.transpose());
    let found = inverse * right;
    let left = rows.iter().fold(Vector2::zeros(), |a: Vector2<f64>, (x, y)| a + (y - found.transpose() * x).map(|r| r * r));
    let variance = left / (rows.len() - 2) as f64;
    let error = Matrix2::from_fn(|i, j| (variance[j] * inverse[(i, i)]).sqrt().max(f64::MIN_POSITIVE));
    Some(Rolled { found, error })
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
