//! Drag that grows with the square of speed: q_v v|v| against forward motion, q_ω ω|ω| against turning; or with another power n that is near 2,
//! q x|x| (|x|/X)^(n−2) with X the typical size of x.
//!
//! Air, water, soft ground, a fan on the shaft. In channels without wheels each output has its own.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Scene, Stage, Start};

use super::force;
use super::words::{digits, percent, quantity};

/// Quadratic drag.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuadraticDrag {}

/// The power of most drags, how far others are from it, and bounds: below lies friction.
const POWER: f64 = 2.0;
const SPREAD: f64 = 0.2;
const POWERS: (f64, f64) = (1.2, 4.0);

/// Typical size of forward and angular velocity, where there are wheels.
fn typical(scene: &Scene) -> [f64; 2] {
    match scene.frame {
        Frame::Sides { half_track } => [scene.scales.speed, scene.scales.speed / half_track],
        _ => [scene.scales.outputs[0], scene.scales.outputs[1]],
    }
}

/// x|x| (|x|/X)^(n−2).
fn grown(x: f64, size: f64, power: f64) -> f64 {
    if power == POWER { x * x.abs() } else { x * x.abs().powf(power - 1.0) * size.powf(POWER - power) }
}

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
        let power = EffectParameter::new("power", "1", POWERS, 0.1).usually(POWER, SPREAD);
        let mut all: Vec<EffectParameter> = match scene.frame {
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
        };
        all.push(power);
        all
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let values: Vec<f64> = self.parameters(scene).iter().map(|p| p.usual.map_or(p.scale, |(usual, _)| usual)).collect();
        vec![Start { columns: (0..values.len() - 1).map(|i| vec![i]).collect(), values, linear: true }]
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
        let (power, sizes) = values.split_last().map_or((POWER, values), |(power, sizes)| (power.value, sizes));
        let all: Vec<String> = parameters.iter().zip(sizes).map(part).collect();
        let grows =
            if (power - POWER).abs() < 0.05 { "the square of speed".to_owned() } else { format!("speed to the power {}", digits(power)) };
        let share = match scene.frame {
            Frame::Channels => values[0].value * scene.scales.outputs[0].powi(2) / scene.scales.inputs[0],
            _ => values[0].value * scene.scales.speed.powi(2) / force::command(scene, 0),
        };
        format!(
            "a drag grows with {grows}, {}: {} of the command at the typical speed; the model had none",
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
        let (frame, scene) = (&at.scene.frame, at.scene);
        let Some((power, sizes)) = p.split_last() else { return };
        if frame.has_wheels() {
            let (motion, typical) = (frame.body(outputs), typical(scene));
            frame.add_at_body([0, 1].map(|i| sizes[i] * grown(motion[i], typical[i], *power)), load);
        } else {
            let each = sizes.iter().zip(outputs).zip(&scene.scales.outputs);
            load.iter_mut().zip(each).for_each(|(load, ((q, x), typical))| *load += q * grown(*x, *typical, *power));
        }
    }
}
