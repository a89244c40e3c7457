//! Dry friction of constant size at both wheels: f = c sgn s on each, s the wheel's ground speed.
//!
//! In the body frame it uses up (f_R + f_L)/2 of the forward command and ρ (f_R − f_L)/(2h) of the turning command, ρ the
//! turning ratio. In channels without wheels each output has a friction of its own.
//!
//! A `soft` one comes up with speed, as that of a film or of a seal does before it is full: f = c s/√(s² + s_0²).

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};

use super::force;

/// Coulomb friction.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CoulombFriction {
    /// Whether it comes up with speed. Default `false`: it is whole as soon as a wheel turns.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub soft: bool,
}

#[typetag::serde(name = "coulomb_friction")]
impl Effect for CoulombFriction {
    fn name(&self) -> &str {
        "coulomb_friction"
    }

    fn about(&self) -> String {
        let how = if self.soft { "that comes up with speed" } else { "of constant size" };
        format!("dry friction {how} at both wheels")
    }

    fn stage(&self) -> Stage {
        Stage::Bearing
    }

    fn family(&self) -> &str {
        "friction"
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        if self.soft { force::needs_wheels(scene) } else { force::needs_commands(scene) }
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let soft = self.soft.then(|| force::softness(scene));
        force::sizes(scene, "friction").into_iter().chain(soft).chain(force::turning_ratio(scene)).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let sizes = force::sizes(scene, "friction");
        let soft = self.soft.then(|| force::softness(scene));
        let scales: Vec<f64> = sizes.iter().chain(&soft).map(|p| p.scale).collect();
        force::starts(scene, &scales, &(0..sizes.len()).map(|i| vec![i]).collect::<Vec<_>>())
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let whose = if scene.frame.has_wheels() { "at each wheel".to_owned() } else { format!("on `{}`", scene.outputs[0].name) };
        let comes_up = force::comes_up(self.soft.then(|| values[1]));
        format!("dry friction {whose} uses up {}{comes_up}; the model had none", force::in_words(values[0], scene))
    }

    fn excitation(&self) -> &'static str {
        "slow driving in both directions, through standstill"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "rolling_resistance",
                because: "always, as far as the driven wheels resist: rolling resistance is dry friction there to the letter; what other wheels carry shows in turning in place only",
            },
            Confusion {
                with: "coulomb_friction_one_wheel",
                because: "while no wheel reverses, friction is a constant offset of each command, whichever wheel it comes from",
            },
            Confusion {
                with: "direction_asymmetry",
                because: "friction that differs forwards and backwards is this one as long as the robot does not drive backwards",
            },
            Confusion {
                with: "stribeck_friction",
                because: "above the speed at which friction has fallen to its running value the two are one",
            },
            Confusion {
                with: "dead_zone",
                because: "a subtracting dead zone takes as much off the command, and differs at reversals only",
            },
            Confusion { with: "theta4", because: "over a narrow range of speeds a constant loss looks like one proportional to speed" },
        ]
    }

    fn load(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], _state: &[f64], load: &mut [f64]) {
        let n = force::contacts(at.scene);
        let (ratio, comes_up_by) = (p.get(n + usize::from(self.soft)), self.soft.then(|| p[n]));
        force::at_contacts(at, outputs, ratio, comes_up_by, load, |contact, _, sign| p[contact] * sign);
    }
}
