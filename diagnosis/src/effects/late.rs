//! What delays and lags have in common: one for all inputs or one for each, and the grid on which they are looked for.

use wheelwright_core::effect::{EffectParameter, Estimate, Frame, Scene, Start};

use super::force::Wheel;
use super::parts::{Axis, part_by_part, shares};

/// Ways of being late: never two in one explanation, for only their sum would show.
pub(crate) const FAMILY: &str = "lateness";

/// The motion that shows them.
pub(super) const EXCITATION: &str = "steps of the command, or motion faster than a few times per second";

/// Lengths from which one for all inputs is tried \[s\].
const GRID: [f64; 8] = [0.01, 0.02, 0.04, 0.07, 0.11, 0.16, 0.23, 0.32];
/// Lengths whose pairs are tried where each axis has its own \[s\].
const COARSE: [f64; 5] = [0.02, 0.05, 0.11, 0.2, 0.34];

/// Number of lengths.
pub(super) fn count(each: bool, scene: &Scene) -> usize {
    if each { scene.inputs.len() } else { 1 }
}

/// One length, or one for each input.
pub(super) fn parameters(name: &str, longest: f64, each: bool, scene: &Scene) -> Vec<EffectParameter> {
    let one = || EffectParameter::new(name, "s", (0.0, longest), scene.scales.period).neutral(0.0);
    let of = |i: usize| match scene.frame {
        Frame::Body { .. } => one().of("axis", [Axis::V, Axis::Omega][i].name()),
        Frame::Sides { .. } => one().of("wheel", [Wheel::Left, Wheel::Right][i].word()),
        Frame::Channels => one().of("input", &scene.inputs[i].name),
    };
    if each { (0..scene.inputs.len()).map(of).collect() } else { vec![one()] }
}

/// Points to begin from.
pub(super) fn starts(each: bool, scene: &Scene) -> Vec<Start> {
    let ones = vec![1.0; count(each, scene)];
    if each { part_by_part(&ones, &GRID, &COARSE) } else { shares(&ones, &GRID) }
}

/// What is said of each length, after `commands`, `forward commands`, `` commands on `throttle` ``.
pub(super) fn each(each: bool, values: &[Estimate], scene: &Scene, say: impl Fn(&str, Estimate) -> String) -> String {
    if !each {
        return values.first().map_or(String::new(), |v| say("commands", *v));
    }
    let whose = |i: usize| match scene.frame {
        Frame::Body { .. } => format!("{} commands", [Axis::V, Axis::Omega][i].word()),
        Frame::Sides { .. } => format!("commands of the {} side", [Wheel::Left, Wheel::Right][i].word()),
        Frame::Channels => format!("commands on `{}`", scene.inputs[i].name),
    };
    values.iter().take(scene.inputs.len()).enumerate().map(|(i, v)| say(&whose(i), *v)).collect::<Vec<_>>().join(", ")
}
