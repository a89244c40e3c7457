//! Forces as the part of the input they use up: their units, their sizes, and where they act.

use std::fmt;

use serde::{Deserialize, Serialize};
use wheelwright_core::effect::{EffectParameter, Estimate, Frame, Instant, Scene, Start};

use super::words::{percent, quantity, smooth_sign};

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

/// In the body frame the two axes have control loops of their own: the same force counts this many times as much in turning as it
/// would if the loops were closed on the wheels.
pub(super) fn turning_ratio(scene: &Scene) -> Option<EffectParameter> {
    matches!(scene.frame, Frame::Body { .. }).then(|| EffectParameter::new("turning_ratio", "1", (0.2, 4.0), 0.3))
}

/// A start for each turning ratio worth trying, which is the last value if there is one; without, the start itself.
pub(super) fn starts(scene: &Scene, values: &[f64], columns: &[Vec<usize>]) -> Vec<Start> {
    let start = |values: Vec<f64>| Start { values, columns: columns.to_vec(), linear: true };
    match turning_ratio(scene) {
        Some(_) => [1.0, 2.0].map(|ratio| start([values, &[ratio]].concat())).into(),
        None => vec![start(values.to_vec())],
    }
}

/// Adds a friction at every contact; `law(contact, speed, sign)` is its size, `contact` the one of [`sizes`], `sign` smooth.
pub(super) fn at_contacts(at: &Instant<'_>, outputs: &[f64], ratio: Option<&f64>, load: &mut [f64], law: impl Fn(usize, f64, f64) -> f64) {
    let scene = at.scene;
    if scene.frame.has_wheels() {
        let typical = scene.scales.speed;
        let forces = scene.frame.wheels(outputs).map(|s| law(0, s, smooth_sign(s, typical)));
        scene.frame.add_at_wheels(forces, ratio.copied().unwrap_or(1.0), load);
    } else {
        for (i, (load, x)) in load.iter_mut().zip(outputs).enumerate() {
            *load += law(i, *x, smooth_sign(*x, scene.scales.outputs[i]));
        }
    }
}

/// A force at a wheel in words: `0.031 m/s (0.029 to 0.033), 8.0 % of a typical command,`.
pub(super) fn in_words(size: Estimate, scene: &Scene) -> String {
    format!("{}, {} of a typical command", quantity(size, unit(scene)), percent(size.value / command(scene, 0)))
}
