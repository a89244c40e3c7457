//! Dry friction of constant size at both wheels: f = c sgn s on each, s the wheel's ground speed.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Scene, Stage, Start};

use super::words::{quantity, smooth_sign};

/// Coulomb friction.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CoulombFriction {}

#[typetag::serde(name = "coulomb_friction")]
impl Effect for CoulombFriction {
    fn name(&self) -> &str {
        "coulomb_friction"
    }

    fn about(&self) -> String {
        "dry friction of constant size at both wheels".to_owned()
    }

    fn stage(&self) -> Stage {
        Stage::Load
    }

    fn family(&self) -> &str {
        "friction"
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        (!scene.frame.has_wheels()).then(|| "the model's channels do not tell the wheels' speeds".to_owned())
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let (unit, scale) = match scene.frame {
            Frame::Sides { .. } => ("V", 0.05 * scene.scales.inputs[0]),
            _ => ("m/s", 0.05 * scene.scales.speed),
        };
        let mut all = vec![EffectParameter::new("friction", unit, (0.0, f64::INFINITY), scale).neutral(0.0)];
        if matches!(scene.frame, Frame::Body { .. }) {
            all.push(EffectParameter::new("turning_ratio", "1", (0.2, 4.0), 0.3));
        }
        all
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let scale = self.parameters(scene)[0].scale;
        match scene.frame {
            Frame::Body { .. } => [1.0, 2.0].map(|rho| Start { values: vec![scale, rho], columns: vec![vec![0]], linear: true }).into(),
            _ => vec![Start { values: vec![scale], columns: vec![vec![0]], linear: true }],
        }
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        match scene.frame {
            Frame::Sides { .. } => {
                format!("each side needs {} more to move at all; the model had no dry friction", quantity(values[0], "V"))
            }
            _ => format!("dry friction uses up {} of each wheel's commanded speed; the model had none", quantity(values[0], "m/s")),
        }
    }

    fn excitation(&self) -> &'static str {
        "slow driving in both directions, through standstill"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion { with: "direction_asymmetry", because: "while no wheel reverses, friction is a constant offset of the command" },
            Confusion { with: "dead_zone", because: "a subtracting dead zone differs from friction only in its phase at reversals" },
        ]
    }

    fn load(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], _state: &[f64], load: &mut [f64]) {
        let typical = at.scene.scales.speed;
        let friction = at.scene.frame.wheels(outputs).map(|s| p[0] * smooth_sign(s, typical));
        at.scene.frame.add_at_wheels(friction, p.get(1).copied().unwrap_or(1.0), load);
    }
}
