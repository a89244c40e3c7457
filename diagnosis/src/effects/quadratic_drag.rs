//! Drag that grows with the square of speed: q_v v|v| against forward motion, q_ω ω|ω| against turning.
//!
//! Air, water, soft ground, a fan on the shaft. In channels without wheels each output has its own.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Scene, Stage, Start};

use super::force;
use super::words::{percent, quantity};

/// Quadratic drag.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuadraticDrag {}

#[typetag::serde(name = "quadratic_drag")]
impl Effect for QuadraticDrag {
    fn name(&self) -> &str {
        "quadratic_drag"
    }

    fn about(&self) -> String {
        "drag that grows with the square of forward and of angular velocity".to_owned()
    }

    fn stage(&self) -> Stage {
        Stage::Load
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        force::needs_commands(scene)
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let drag = |unit: &str, size: f64, kind: &'static str, which: &str| {
            EffectParameter::new("drag", unit, (0.0, f64::INFINITY), 0.05 * size).neutral(0.0).of(kind, which)
        };
        let s = &scene.scales;
        match scene.frame {
            Frame::Body { .. } => ["v", "omega"]
                .iter()
                .zip(["s/m", "s/rad"])
                .enumerate()
                .map(|(i, (axis, unit))| drag(unit, s.inputs[i] / s.outputs[i].powi(2), "axis", axis))
                .collect(),
            Frame::Sides { half_track: h } => {
                let size = force::command(scene, 0) / s.speed.powi(2);
                vec![drag("V s2/m2", size, "axis", "v"), drag("V s2/m", size * h, "axis", "omega")]
            }
            Frame::Channels => {
                let one = |i: usize| {
                    let unit = format!("{}/({})2", scene.inputs[i].unit, scene.outputs[i].unit);
                    drag(&unit, s.inputs[i] / s.outputs[i].powi(2), "output", &scene.outputs[i].name)
                };
                (0..s.outputs.len()).map(one).collect()
            }
        }
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let values: Vec<f64> = self.parameters(scene).iter().map(|p| p.scale).collect();
        vec![Start { columns: (0..values.len()).map(|i| vec![i]).collect(), values, linear: true }]
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let parameters = self.parameters(scene);
        let part = |(p, value): (&EffectParameter, &Estimate)| {
            let against = match p.label.as_ref().map_or("", |(_, which)| which.as_str()) {
                "v" => "forward motion",
                "omega" => "turning",
                other => other,
            };
            format!("{} against {against}", quantity(*value, &p.unit))
        };
        let all: Vec<String> = parameters.iter().zip(values).map(part).collect();
        let share = match scene.frame {
            Frame::Channels => values[0].value * scene.scales.outputs[0].powi(2) / scene.scales.inputs[0],
            _ => values[0].value * scene.scales.speed.powi(2) / force::command(scene, 0),
        };
        format!(
            "a drag grows with the square of speed, {}: {} of the command at the typical speed; the model had none",
            all.join(" and "),
            percent(share)
        )
    }

    fn excitation(&self) -> &'static str {
        "steady driving and turning at many speeds, slow to fastest"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion { with: "theta4", because: "over a narrow range of speeds it is viscous friction and a constant offset" },
            Confusion { with: "velocity_saturation", because: "both keep the robot below its command at high speed" },
            Confusion { with: "turning_scrub", because: "while forward speed is constant, drag on turning is scrub" },
        ]
    }

    fn load(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], _state: &[f64], load: &mut [f64]) {
        let frame = &at.scene.frame;
        if frame.has_wheels() {
            let [v, w] = frame.body(outputs);
            frame.add_at_body([p[0] * v * v.abs(), p[1] * w * w.abs()], load);
        } else {
            load.iter_mut().zip(p).zip(outputs).for_each(|((load, q), x)| *load += q * x * x.abs());
        }
    }
}
