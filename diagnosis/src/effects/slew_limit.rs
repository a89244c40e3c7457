//! The command cannot change faster than a rate: |dU'/dt| ≤ a, on each axis, on one axis, or on each wheel.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};

use super::parts::{Axis, Part, Parts, part_by_part};
use super::words::{each, quantity};

/// A ramp in the command path, as drivers and motor controllers have it.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SlewLimit {
    /// One axis only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axis: Option<Axis>,
    /// On each wheel, with one rate for both, in place of the axes.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub wheels: bool,
}

impl SlewLimit {
    fn parts(&self, scene: &Scene) -> Parts {
        if self.wheels { Parts::of(scene.frame, None, None) } else { Parts::axes(scene.frame, self.axis) }
    }
}

fn rate(part: &Part) -> String {
    format!("{}/s", part.unit).replace("/s/s", "/s2")
}

#[typetag::serde(name = "slew_limit")]
impl Effect for SlewLimit {
    fn name(&self) -> &str {
        "slew_limit"
    }

    fn about(&self) -> String {
        "commands are ramped: their rate of change is limited".to_owned()
    }

    fn stage(&self) -> Stage {
        Stage::Ramp
    }

    /// What holds on one axis says nothing about the other.
    fn family(&self) -> &str {
        match self.axis {
            Some(Axis::V) => "slew_limit/v",
            Some(Axis::Omega) => "slew_limit/omega",
            None => "slew_limit",
        }
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        if self.wheels && self.axis.is_some() {
            return Some("it is set to the wheels and to an axis: it acts on one of them".to_owned());
        }
        Parts::refuse(scene.frame, None, self.axis)
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        // Slower than once to its typical size and back over the recording nothing would have been driven.
        let lowest = 2.0 / (scene.scales.time.1 - scene.scales.time.0);
        let of = |p: Part| p.parameter("rate", &rate(&p), (lowest * p.typical, f64::INFINITY), 0.3 * p.typical).neutral(f64::INFINITY);
        self.parts(scene).list(scene).into_iter().map(of).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let sizes: Vec<f64> = self.parts(scene).list(scene).iter().map(|p| p.typical).collect();
        part_by_part(&sizes, &[0.15, 0.25, 0.4, 0.6, 1.0, 1.7, 2.8, 4.6, 8.0, 13.0, 22.0], &[0.2, 0.45, 1.0, 2.2, 5.0, 11.0, 25.0])
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let parts = self.parts(scene).list(scene);
        let said = each(&parts, values, |p, v| format!("{} command changes by at most {}", p.whose, quantity(v, &rate(p))));
        format!("{said}; the model had no ramp")
    }

    fn excitation(&self) -> &'static str {
        "large steps of the command, on each axis alone"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "torque_saturation",
                because: "a limited force bounds the acceleration too; it bounds it at the robot, however the command came, and less when coasting",
            },
            Confusion { with: "actuator_lag", because: "steps of one height only are ramped and filtered alike" },
            Confusion { with: "command_delay", because: "a short ramp delays each step by half its length" },
        ]
    }

    /// Where the command is, and where it was told to go, of each part.
    fn states(&self, scene: &Scene) -> usize {
        2 * Parts::count(scene)
    }

    fn begin(&self, _p: &[f64], at: &Instant<'_>, inputs: &[f64], _outputs: &[f64], state: &mut [f64]) {
        self.parts(at.scene).look(inputs, |(i, command)| state[2 * i..2 * i + 2].fill(command));
    }

    /// A ramp ends where it reaches its goal.
    fn next_switch(&self, p: &[f64], at: &Instant<'_>, state: &[f64]) -> f64 {
        let several = p.len() > 1;
        let ends = state.chunks_exact(2).enumerate().map(|(i, s)| {
            let rate = p[if several { i } else { 0 }];
            let left = (s[1] - s[0]).abs();
            if left > 0.0 { at.time + left / rate } else { f64::INFINITY }
        });
        ends.filter(|t| *t > at.time + 1e-9 * at.scene.scales.period).fold(f64::INFINITY, f64::min)
    }

    fn command(&self, p: &[f64], at: &Instant<'_>, _outputs: &[f64], state: &mut [f64], u: &mut [f64]) {
        self.parts(at.scene).change(u, |part, i, goal| {
            let s = &mut state[2 * part..2 * part + 2];
            let reach = if p[i].is_finite() { p[i] * at.span } else { f64::INFINITY };
            s[0] += (goal - s[0]).clamp(-reach, reach);
            s[1] = goal;
            s[0]
        });
    }
}
