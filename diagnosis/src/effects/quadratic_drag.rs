//! Drag that grows with the square of speed: q_v v|v| against forward motion, q_ω ω|ω| against turning; or with another power n that is near 2,
//! q x|x| (|x|/X)^(n−2) with X the typical size of x.
//!
//! Air, water, soft ground, a fan on the shaft. In channels without wheels each output has its own. With `wheels` it acts at each wheel by the wheel's own
//! speed, as gears that churn oil and soft tyres do: q s|s|, which brakes a turn by how fast the robot drives.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Scene, Stage, Start};

use super::force;
use super::words::{digits, percent, quantity};

/// Quadratic drag.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct QuadraticDrag {
    /// Whether it acts at each wheel, by its own speed.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub wheels: bool,
}

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

/// What it grows with, in words.
fn growth(power: f64) -> String {
    if (power - POWER).abs() < 0.05 { "the square of speed".to_owned() } else { format!("speed to the power {}", digits(power)) }
}

#[typetag::serde(name = "quadratic_drag")]
impl Effect for QuadraticDrag {
    fn name(&self) -> &str {
        "quadratic_drag"
    }

    fn about(&self) -> String {
        let what = if self.wheels {
            "drag at each wheel that grows with the square of its speed"
        } else {
            "drag that grows with the square of forward and of angular velocity"
        };
        what.to_owned()
    }

    fn stage(&self) -> Stage {
        if self.wheels { Stage::Bearing } else { Stage::Load }
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        if self.wheels { force::needs_wheels(scene) } else { force::needs_commands(scene) }
    }

    /// It is asked for where a drag was found: driving and turning at once tells which of the two it is.
    fn stands_in(&self) -> bool {
        self.wheels
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let drag = |unit: &str, size: f64, kind: &'static str, which: &str| {
            EffectParameter::new("drag", unit, (0.0, f64::INFINITY), 0.05 * size).neutral(0.0).of(kind, which)
        };
        let s = &scene.scales;
        let power = EffectParameter::new("power", "1", POWERS, 0.1).usually(POWER, SPREAD);
        if self.wheels {
            let unit = if matches!(scene.frame, Frame::Sides { .. }) { "V s2/m2" } else { "s/m" };
            let size = 0.05 * force::command(scene, 0) / s.speed.powi(2);
            let drag = EffectParameter::new("drag", unit, (0.0, f64::INFINITY), size).neutral(0.0);
            return [drag, power].into_iter().chain(force::turning_ratio(scene)).collect();
        }
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
        if self.wheels {
            return force::starts(scene, &values[..2], &[vec![0]]);
        }
        vec![Start { columns: (0..values.len() - 1).map(|i| vec![i]).collect(), values, linear: true }]
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let parameters = self.parameters(scene);
        if self.wheels {
            let share = values[0].value * scene.scales.speed.powi(2) / force::command(scene, 0);
            return format!(
                "a drag at each wheel grows with {}, {}: {} of the command at the typical speed; the model had none",
                growth(values[1].value),
                quantity(values[0], &parameters[0].unit),
                percent(share)
            );
        }
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
        let share = match scene.frame {
            Frame::Channels => values[0].value * scene.scales.outputs[0].powi(2) / scene.scales.inputs[0],
            _ => values[0].value * scene.scales.speed.powi(2) / force::command(scene, 0),
        };
        format!(
            "a drag grows with {}, {}: {} of the command at the typical speed; the model had none",
            growth(power),
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
        if self.wheels {
            let forces = frame.wheels(outputs).map(|speed| p[0] * grown(speed, scene.scales.speed, p[1]));
            return frame.add_at_wheels(forces, p.get(2).copied().unwrap_or(1.0), load);
        }
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
