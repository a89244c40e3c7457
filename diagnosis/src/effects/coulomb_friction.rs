//! Dry friction of constant size at both wheels: f = c sgn s on each, s the wheel's ground speed.
//!
//! In the body frame it uses up (f_R + f_L)/2 of the forward command and ρ (f_R − f_L)/(2h) of the turning command, ρ the
//! turning ratio. In channels without wheels each output has a friction of its own.
//!
//! A `soft` one comes up with speed, as that of a film or of a seal does before it is full: f = c s/√(s² + s_0²). A `presliding` one comes up with the
//! [way](super::bristles) since the last reversal.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Motion, Scene, Stage, Start};

use super::{bristles, force};

/// Coulomb friction.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CoulombFriction {
    /// Whether it comes up with speed. Default `false`: it is whole as soon as a wheel turns.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub soft: bool,
    /// Whether it comes up with the way since the last reversal. Default `false`.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub presliding: bool,
}

impl CoulombFriction {
    /// By what it comes up, if not at once.
    fn rise(&self, scene: &Scene) -> Option<EffectParameter> {
        match (self.soft, self.presliding) {
            (true, _) => Some(force::softness(scene)),
            (_, true) => Some(bristles::length(scene)),
            _ => None,
        }
    }
}

#[typetag::serde(name = "coulomb_friction")]
impl Effect for CoulombFriction {
    fn name(&self) -> &str {
        "coulomb_friction"
    }

    fn about(&self) -> String {
        let how = match (self.soft, self.presliding) {
            (true, _) => "that comes up with speed",
            (_, true) => "that comes up with the way since a reversal",
            _ => "of constant size",
        };
        format!("dry friction {how} at both wheels")
    }

    fn stage(&self) -> Stage {
        Stage::Bearing
    }

    fn family(&self) -> &str {
        "friction"
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        if self.soft || self.presliding { force::needs_wheels(scene) } else { force::needs_commands(scene) }
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        force::sizes(scene, "friction").into_iter().chain(self.rise(scene)).chain(force::turning_ratio(scene)).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let sizes = force::sizes(scene, "friction");
        let rise = self.rise(scene);
        let scales: Vec<f64> = sizes.iter().chain(&rise).map(|p| p.scale).collect();
        force::starts(scene, &scales, &(0..sizes.len()).map(|i| vec![i]).collect::<Vec<_>>())
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let whose = if scene.frame.has_wheels() { "at each wheel".to_owned() } else { format!("on `{}`", scene.outputs[0].name) };
        let comes_up = match (self.soft, self.presliding) {
            (true, _) => force::comes_up(Some(values[1])),
            (_, true) => bristles::comes_up(values[1]),
            _ => String::new(),
        };
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

    fn stands_in(&self) -> bool {
        self.presliding
    }

    fn states(&self, _scene: &Scene) -> usize {
        if self.presliding { bristles::STATES } else { 0 }
    }

    fn begin(&self, _p: &[f64], at: &Instant<'_>, _inputs: &[f64], outputs: &[f64], state: &mut [f64]) {
        if self.presliding {
            bristles::begin(at, outputs, state, |_| 1.0);
        }
    }

    fn advance(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, _drive: &[f64], state: &mut [f64]) {
        if self.presliding {
            bristles::advance(p[1], at, motion, state, |_| 1.0);
        }
    }

    fn load(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], state: &[f64], load: &mut [f64]) {
        if self.presliding {
            bristles::load(p[0], at, state, p.get(2), load);
            return;
        }
        let n = force::contacts(at.scene);
        let (ratio, comes_up_by) = (p.get(n + usize::from(self.soft)), self.soft.then(|| p[n]));
        force::at_contacts(at, outputs, ratio, comes_up_by, load, |contact, _, sign| p[contact] * sign);
    }
}
