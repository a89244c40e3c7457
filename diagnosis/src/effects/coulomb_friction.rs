//! Dry friction of constant size at both wheels: f = c sgn s on each, s the wheel's ground speed.
//!
//! In the body frame it uses up (f_R + f_L)/2 of the forward command and ρ (f_R − f_L)/(2h) of the turning command, ρ the
//! turning ratio. In channels without wheels each output has a friction of its own.
//!
//! A `soft` one comes up with speed, as that of a film or of a seal does before it is full: f = c s/√(s² + s_0²). A `presliding` one comes up with the
//! way since the last reversal, as bristles bend. A `warming` one is that of what rubs more, or less, while it is cold, as grease and seals do:
//! f = c (1 + a e^{−t/τ}) sgn s, t from the recording's first time on.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Motion, Scene, Stage, Start};

use super::words::{quantity, scaled};
use super::{bristles, force, trend};

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
    /// Whether it changes as what rubs gets warm. Default `false`.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub warming: bool,
}

/// How much more there is in the cold at most, and what is tried.
const COLD: (f64, f64) = (10.0, 0.5);

impl CoulombFriction {
    /// By what it comes up, if not at once.
    fn rise(&self, scene: &Scene) -> Option<EffectParameter> {
        match (self.soft, self.presliding) {
            (true, _) => Some(force::softness(scene)),
            (_, true) => Some(bristles::length(scene)),
            _ => None,
        }
    }

    /// How much more of it there is in the cold, and the time in which it warms up.
    fn cold(&self, scene: &Scene) -> Vec<EffectParameter> {
        let more = EffectParameter::new("cold", "1", (-1.0, COLD.0), COLD.1).neutral(0.0);
        if self.warming { vec![more, trend::parameter("warming_time", scene)] } else { Vec::new() }
    }

    /// Its size at a time, in terms of that when it is warm.
    fn by_then(&self, p: &[f64], at: &Instant<'_>) -> f64 {
        if self.warming { 1.0 + p[0] * trend::left(p[1], at) } else { 1.0 }
    }
}

#[typetag::serde(name = "coulomb_friction")]
impl Effect for CoulombFriction {
    fn name(&self) -> &str {
        "coulomb_friction"
    }

    fn about(&self) -> String {
        let how = match self {
            Self { soft: true, .. } => "that comes up with speed",
            Self { presliding: true, .. } => "that comes up with the way since a reversal",
            Self { warming: true, .. } => "that changes as it warms up",
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
        let how = self.rise(scene).into_iter().chain(self.cold(scene));
        force::sizes(scene, "friction").into_iter().chain(how).chain(force::turning_ratio(scene)).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let sizes = force::sizes(scene, "friction");
        let rise = self.rise(scene);
        let scales: Vec<f64> = sizes.iter().chain(&rise).map(|p| p.scale).collect();
        let columns: Vec<Vec<usize>> = (0..sizes.len()).map(|i| vec![i]).collect();
        if !self.warming {
            return force::starts(scene, &scales, &columns);
        }
        let within = |time: f64| force::starts(scene, &[&scales[..], &[COLD.1, time]].concat(), &columns);
        trend::times(scene).into_iter().flat_map(within).collect()
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let whose = if scene.frame.has_wheels() { "at each wheel".to_owned() } else { format!("on `{}`", scene.outputs[0].name) };
        let comes_up = match self {
            Self { soft: true, .. } => force::comes_up(Some(values[1])),
            Self { presliding: true, .. } => bristles::comes_up(values[1]),
            Self { warming: true, .. } => {
                let n = force::contacts(scene);
                let (cold, within) = (values[n], quantity(values[n + 1], "s"));
                let share = quantity(scaled(cold, |x| 100.0 * x * cold.value.signum()), "%");
                let word = if cold.value < 0.0 { "less" } else { "more" };
                format!(" when it is warm, and {share} {word} in the cold, most of which is gone within {within}")
            }
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
        self.presliding || self.warming
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
        let (ratio, comes_up_by) = (p.get(n + usize::from(self.soft) + 2 * usize::from(self.warming)), self.soft.then(|| p[n]));
        let by_then = self.by_then(&p[n..], at);
        force::at_contacts(at, outputs, ratio, comes_up_by, load, |contact, _, sign| by_then * p[contact] * sign);
    }
}
