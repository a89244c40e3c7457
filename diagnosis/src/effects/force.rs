//! Forces as the part of the input they use up: their units, their sizes, and where they act.

use std::fmt;

use serde::{Deserialize, Serialize};
use wheelwright_core::effect::{EffectParameter, Estimate, Frame, Instant, Motion, Scene, Start};

use super::words::{KINK, length, percent, quantity, smooth_sign};

/// One of the two wheels, or all wheels of one side.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Wheel {
    /// The left one.
    #[default]
    Left,
    /// The right one.
    Right,
}

impl Wheel {
    /// Its place in a pair.
    pub(super) fn index(self) -> usize {
        self as usize
    }

    /// Its name in configurations and sentences.
    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
        }
    }
}

impl fmt::Display for Wheel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

/// Why an effect on wheels or on forward and angular motion cannot act, if it cannot.
pub(super) fn needs_wheels(scene: &Scene) -> Option<String> {
    (!scene.frame.has_wheels()).then(|| "the model's channels do not tell the wheels' speeds".to_owned())
}

/// Why an effect on channels cannot act, if it cannot: each output needs a command of its own.
pub(super) fn needs_commands(scene: &Scene) -> Option<String> {
    let (inputs, outputs) = (scene.inputs.len(), scene.outputs.len());
    (inputs != outputs).then(|| format!("{outputs} outputs and {inputs} inputs: which input moves which output is not known"))
}

/// Why an effect on the loops that keep the wheels' rates cannot act, if it cannot.
pub(super) fn needs_loops(scene: &Scene) -> Option<String> {
    (!matches!(scene.frame, Frame::Body { .. }))
        .then(|| "the robot is not commanded by velocities: no loop keeps a wheel's rate".to_owned())
}

/// What each wheel's motor is asked for, in terms of forward speed: what is told less its [feedback](feedback) times what is done. Where the loops are
/// closed on forward and angular velocity, the turning one counts at each wheel by its own strength, 1/ρ of the other's. Back-EMF is the motors' own,
/// so that of a loop that is ρ times as weak it takes ρ times the share that the feedback leaves.
pub(super) fn asked(frame: &Frame, motion: &Motion<'_>, feedback: f64, ratio: f64) -> [f64; 2] {
    let asked = [(0, 1.0), (1, ratio)].map(|(axis, ratio)| motion.u[axis] - (1.0 - ratio * (1.0 - feedback)) * motion.outputs[axis]);
    frame.at_wheels(&asked, ratio)
}

/// Spread of the feedback between robots.
const FED_BACK: f64 = 0.1;

/// What is to be known of loops for what [each wheel's motor is asked for](asked): their feedback and, where forward and angular velocity have loops of
/// their own, the ratio of their strengths.
pub(super) fn loops(scene: &Scene) -> impl Iterator<Item = EffectParameter> + use<> {
    [feedback()].into_iter().chain(turning_ratio(scene))
}

/// How much of a wheel's speed its loop takes off what it is told: all of it, or less where it adds to its answer what a motor needs to hold the
/// commanded speed against its back-EMF. More than all would take what friction withdraws for a part of the loop, and make of a stronger loop what a
/// centre of mass to one side is.
pub(super) fn feedback() -> EffectParameter {
    EffectParameter::new("feedback", "1", (0.0, 1.0), 0.2 * FED_BACK).usually(1.0, FED_BACK)
}

/// How much of what it takes to hold a speed is the drag of bearings and ground on most robots, which are behind motor and gears: little of what a loop
/// does.
const LITTLE: f64 = 0.1;
/// Most of it that may be.
pub(super) const MOST_BEHIND: f64 = 0.95;

/// Share of what it takes to hold a speed that is the drag of wheels and ground; the rest is what loop and motor take.
pub(super) fn behind(name: &str) -> EffectParameter {
    EffectParameter::new(name, "1", (0.0, MOST_BEHIND), 0.2 * LITTLE).usually(0.0, LITTLE)
}

/// Unit of a force at a wheel; of the first channel's where there are none.
pub(super) fn unit(scene: &Scene) -> &str {
    match scene.frame {
        Frame::Body { .. } => "m/s",
        _ => scene.inputs.first().map_or("1", |c| &c.unit),
    }
}

/// Typical size of the command at one contact.
pub(super) fn command(scene: &Scene, contact: usize) -> f64 {
    if scene.frame.has_wheels() { scene.scales.command } else { scene.scales.inputs[contact] }
}

/// Standard gravity \[m/s²\].
pub(super) const GRAVITY: f64 = 9.80665;

/// The most that the ground holds, as an acceleration of the robot's mass: over gravity the friction coefficient if the driven wheels carry all weight.
pub(super) fn grip(scene: &Scene) -> EffectParameter {
    let speed = scene.scales.speed;
    EffectParameter::new("grip", "m/s2", ((0.02 * speed).min(GRAVITY), f64::INFINITY), 0.1 * speed).neutral(f64::INFINITY)
}

/// Time in which a wheel or its motor alone come up to speed on most robots \[s\]: a part of what the whole robot takes.
const SPIN_UP: f64 = 0.05;

/// The time in which what turns comes up to speed where it moves nothing else.
pub(super) fn spin_up() -> EffectParameter {
    EffectParameter::new("spin_up", "s", (0.0, 1.0), 0.4 * SPIN_UP).neutral(0.0).usually(0.0, SPIN_UP)
}

/// Places where friction has a size of its own: one for both wheels, or one a channel where there are none.
pub(super) fn contacts(scene: &Scene) -> usize {
    if scene.frame.has_wheels() { 1 } else { scene.outputs.len() }
}

/// A friction of this name at each contact: not negative, and nothing at zero.
pub(super) fn sizes(scene: &Scene, name: &str) -> Vec<EffectParameter> {
    let size = |i: usize, unit: &str| EffectParameter::new(name, unit, (0.0, f64::INFINITY), 0.05 * command(scene, i)).neutral(0.0);
    if scene.frame.has_wheels() {
        return vec![size(0, unit(scene))];
    }
    scene.inputs.iter().zip(&scene.outputs).enumerate().map(|(i, (u, y))| size(i, &u.unit).of("output", &y.name)).collect()
}

/// The speed by which a friction that comes up with it has come up to 71 % of its size.
pub(super) fn softness(scene: &Scene) -> EffectParameter {
    let speed = scene.scales.speed;
    EffectParameter::new("comes_up_by", "m/s", (KINK * speed, 2.0 * speed), 0.15 * speed)
}

/// How a friction comes up by some speed, in words; nothing where it is whole at once.
pub(super) fn comes_up(by: Option<Estimate>) -> String {
    by.map_or_else(String::new, |by| format!(", not at once but with speed: seven tenths of it at {}", quantity(by, "m/s")))
}

/// In the body frame the two axes have control loops of their own: the same force counts this many times as much in turning as it
/// would if the loops were closed on the wheels.
pub(super) fn turning_ratio(scene: &Scene) -> Option<EffectParameter> {
    matches!(scene.frame, Frame::Body { .. }).then(|| EffectParameter::new("turning_ratio", "1", (0.2, 4.0), 0.3).usually(1.0, 1.0))
}

/// Values with the turning ratio of loops that are closed on the wheels, where there is one.
pub(super) fn with_ratio(scene: &Scene, values: &[f64]) -> Vec<f64> {
    values.iter().copied().chain(turning_ratio(scene).map(|_| 1.0)).collect()
}

/// A start for each turning ratio worth trying, which is the last value if there is one; without, the start itself.
pub(super) fn starts(scene: &Scene, values: &[f64], columns: &[Vec<usize>]) -> Vec<Start> {
    let start = |values: Vec<f64>| Start { values, columns: columns.to_vec(), linear: true };
    match turning_ratio(scene) {
        Some(_) => [1.0, 0.5, 2.0].map(|ratio| start([values, &[ratio]].concat())).into(),
        None => vec![start(values.to_vec())],
    }
}

/// Adds a drag of one size against the motion of a place on the centre line, a distance from the axle.
pub(super) fn slides(scene: &Scene, outputs: &[f64], [drag, distance]: [f64; 2], ratio: Option<&f64>, load: &mut [f64]) {
    let h = scene.frame.half_track();
    let [v, w] = scene.frame.body(outputs);
    let sideways = distance * w;
    // A smooth direction, as the sign of other frictions.
    let slide = length([v, sideways, KINK * scene.scales.speed]);
    let turn = ratio.copied().unwrap_or(1.0) / (h * h) * drag * distance * sideways / slide;
    scene.frame.add_at_body([drag * v / slide, turn], load);
}

/// Adds a friction at every contact; `law(contact, speed, sign)` is its size, `contact` the one of [`sizes`], `sign` smooth: within the kink, or
/// as a friction that [comes up by](softness) some speed has it.
pub(super) fn at_contacts(
    at: &Instant<'_>,
    outputs: &[f64],
    ratio: Option<&f64>,
    comes_up_by: Option<f64>,
    load: &mut [f64],
    law: impl Fn(usize, f64, f64) -> f64,
) {
    let scene = at.scene;
    let sign = |speed: f64, typical: f64| comes_up_by.map_or_else(|| smooth_sign(speed, typical), |by| speed / length([speed, by]));
    if scene.frame.has_wheels() {
        let typical = scene.scales.speed;
        let forces = scene.frame.wheels(outputs).map(|s| law(0, s, sign(s, typical)));
        scene.frame.add_at_wheels(forces, ratio.copied().unwrap_or(1.0), load);
    } else {
        for (i, (load, x)) in load.iter_mut().zip(outputs).enumerate() {
            *load += law(i, *x, sign(*x, scene.scales.outputs[i]));
        }
    }
}

/// The least that coupling may leave of the determinant of the inertia, as a share: a rigid body's is positive.
pub(super) const LEAST: f64 = 0.05;

/// θ1 and θ2: the forward and turning input that one unit of forward and turning acceleration needs.
pub(super) fn inertia(frame: &Frame, motion: &Motion<'_>) -> [f64; 2] {
    let needs = |of: [f64; 2]| {
        let a = frame.from_body(of);
        frame.body(&[motion.inertia[0] * a[0] + motion.inertia[1] * a[1], motion.inertia[2] * a[0] + motion.inertia[3] * a[1]])
    };
    [needs([1.0, 0.0])[0], needs([0.0, 1.0])[1]]
}

/// Couples forward and turning acceleration: θ1 v' − θ7 ω' and θ2 ω' − θ8 v' take what drives.
pub(super) fn couple(frame: &Frame, motion: &Motion<'_>, th7: f64, th8: f64, drive: &mut [f64]) {
    let [th1, th2] = inertia(frame, motion);
    let share = (1.0 - th7 * th8 / (th1 * th2)).max(LEAST);
    let [forward, turn] = frame.body(drive);
    // [th1, −th7; −th8, th2] a = drive, seen again as what the model alone would need for a.
    let changed = [(forward + th7 / th2 * turn) / share, (turn + th8 / th1 * forward) / share];
    if changed.iter().all(|x| x.is_finite()) {
        drive.copy_from_slice(&frame.from_body(changed));
    }
}

/// A force at a wheel in words: `0.031 m/s (0.029 to 0.033), 8.0 % of a typical command,`.
pub(super) fn in_words(size: Estimate, scene: &Scene) -> String {
    format!("{}, {} of a typical command", quantity(size, unit(scene)), percent(size.value / command(scene, 0)))
}
