//! Dry friction at both wheels: f = c sgn s on each, s the wheel's ground speed.
//!
//! In the body frame it uses up (f_R + f_L)/2 of the forward command and ρ (f_R − f_L)/(2h) of the turning command, ρ the
//! turning ratio. In channels without wheels each output has a friction of its own.
//!
//! A `soft` one comes up with speed, as that of a film or of a seal does before it is full: f = c s/√(s² + s_0²). A `presliding` one comes up with the
//! way since the last reversal, as bristles bend. A `warming` one is that of what rubs more, or less, while it is cold, as grease and seals do:
//! f = c (1 + a e^{−t/τ}) sgn s, t from the recording's first time on. A `geared` one grows with the torque that is passed on, as that of teeth and
//! worms does: f = (c + κ |T|) sgn s, T what the motor gives by the command and what loop and motor withdraw of it. A `sided` one is what
//! `coulomb_friction_one_wheel` finds where both wheels have nearly as much.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Motion, Scene, Stage, Start};

use super::loops::Loops;
use super::words::{quantity, scaled, smooth_sign};
use super::{CoulombFrictionOneWheel, bristles, force, trend};

/// What the size of dry friction hangs on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FrictionLaw {
    /// On nothing.
    #[default]
    Constant,
    /// On speed: it comes up with it.
    Soft,
    /// On the way since the last reversal, with which it comes up.
    Presliding,
    /// On time: it changes as what rubs gets warm.
    Warming,
    /// On the torque that the gears pass on.
    Geared,
    /// On the wheel: each has a size of its own.
    Sided,
}

/// Coulomb friction.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CoulombFriction {
    /// What its size hangs on. Default `constant`.
    #[serde(default)]
    pub law: FrictionLaw,
}

/// How much more there is in the cold at most, and what is tried.
const COLD: (f64, f64) = (10.0, 0.5);
/// Share of the torque that gears lose at most, beyond which no motion of the wheel could turn the motor, and what is tried.
const LOST: (f64, f64) = (0.9, 0.15);
/// What has a size for each wheel.
const EACH: CoulombFrictionOneWheel = CoulombFrictionOneWheel { wheel: None };

impl CoulombFriction {
    /// What its size hangs on, but for the size itself and the turning ratio.
    fn own(&self, scene: &Scene) -> Vec<EffectParameter> {
        let share = |name: &str, bounds: (f64, f64), scale: f64| EffectParameter::new(name, "1", bounds, scale).neutral(0.0);
        match self.law {
            FrictionLaw::Constant | FrictionLaw::Sided => Vec::new(),
            FrictionLaw::Soft => vec![force::softness(scene)],
            FrictionLaw::Presliding => vec![bristles::length(scene)],
            FrictionLaw::Warming => vec![share("cold", (-1.0, COLD.0), COLD.1), trend::parameter("warming_time", scene)],
            FrictionLaw::Geared => vec![share("of_torque", (0.0, LOST.0), LOST.1), force::behind("behind")],
        }
    }
}

#[typetag::serde(name = "coulomb_friction")]
impl Effect for CoulombFriction {
    fn name(&self) -> &str {
        "coulomb_friction"
    }

    fn about(&self) -> String {
        let how = match self.law {
            FrictionLaw::Constant => "of constant size",
            FrictionLaw::Soft => "that comes up with speed",
            FrictionLaw::Presliding => "that comes up with the way since a reversal",
            FrictionLaw::Warming => "that changes as it warms up",
            FrictionLaw::Geared => "that grows with the torque the gears pass on",
            FrictionLaw::Sided => "that differs somewhat between them",
        };
        format!("dry friction {how} at both wheels")
    }

    fn stage(&self) -> Stage {
        if self.law == FrictionLaw::Geared { Stage::Drive } else { Stage::Bearing }
    }

    fn family(&self) -> &str {
        "friction"
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        match self.law {
            FrictionLaw::Constant | FrictionLaw::Warming => force::needs_commands(scene),
            FrictionLaw::Soft | FrictionLaw::Presliding | FrictionLaw::Geared | FrictionLaw::Sided => force::needs_wheels(scene),
        }
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        if self.law == FrictionLaw::Sided {
            return EACH.parameters(scene);
        }
        force::sizes(scene, "friction").into_iter().chain(self.own(scene)).chain(force::turning_ratio(scene)).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let scales = |of: &[EffectParameter]| of.iter().map(|p| p.scale).collect::<Vec<f64>>();
        let sizes = scales(&force::sizes(scene, "friction"));
        let mut columns: Vec<Vec<usize>> = (0..sizes.len()).map(|i| vec![i]).collect();
        let tried: Vec<Vec<f64>> = match self.law {
            FrictionLaw::Warming => trend::times(scene).map(|time| vec![COLD.1, time]).into(),
            FrictionLaw::Geared => {
                columns.push(vec![sizes.len()]);
                vec![vec![LOST.1, 0.0]]
            }
            FrictionLaw::Sided => Vec::new(),
            FrictionLaw::Constant | FrictionLaw::Soft | FrictionLaw::Presliding => vec![scales(&self.own(scene))],
        };
        tried.iter().flat_map(|own| force::starts(scene, &[&sizes[..], own].concat(), &columns)).collect()
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        if self.law == FrictionLaw::Sided {
            return EACH.statement(values, scene);
        }
        let whose = if scene.frame.has_wheels() { "at each wheel".to_owned() } else { format!("on `{}`", scene.outputs[0].name) };
        let own = &values[force::contacts(scene)..];
        let comes_up = match self.law {
            FrictionLaw::Constant | FrictionLaw::Sided => String::new(),
            FrictionLaw::Soft => force::comes_up(Some(own[0])),
            FrictionLaw::Presliding => bristles::comes_up(own[0]),
            FrictionLaw::Warming => {
                let (cold, within) = (own[0], quantity(own[1], "s"));
                let share = quantity(scaled(cold, |x| 100.0 * x * cold.value.signum()), "%");
                let word = if cold.value < 0.0 { "less" } else { "more" };
                format!(" when it is warm, and {share} {word} in the cold, most of which is gone within {within}")
            }
            FrictionLaw::Geared => format!(" and {} of what the gears pass on", quantity(scaled(own[0], |x| 100.0 * x), "%")),
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
        !matches!(self.law, FrictionLaw::Constant | FrictionLaw::Soft | FrictionLaw::Sided)
    }

    fn states(&self, _scene: &Scene) -> usize {
        if self.law == FrictionLaw::Presliding { bristles::STATES } else { 0 }
    }

    fn begin(&self, _p: &[f64], at: &Instant<'_>, _inputs: &[f64], outputs: &[f64], state: &mut [f64]) {
        if self.law == FrictionLaw::Presliding {
            bristles::begin(at, outputs, state, |_| 1.0);
        }
    }

    fn advance(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, _drive: &[f64], state: &mut [f64]) {
        if self.law == FrictionLaw::Presliding {
            bristles::advance(p[1], at, motion, state, |_| 1.0);
        }
    }

    fn load(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], state: &[f64], load: &mut [f64]) {
        let own = &p[force::contacts(at.scene)..];
        let (ratio, comes_up_by, times) = match self.law {
            FrictionLaw::Geared => return,
            FrictionLaw::Sided => return EACH.load(p, at, outputs, state, load),
            FrictionLaw::Presliding => return bristles::load(p[0], at, state, own.get(1), load),
            FrictionLaw::Constant => (own.first(), None, 1.0),
            FrictionLaw::Soft => (own.get(1), Some(own[0]), 1.0),
            FrictionLaw::Warming => (own.get(2), None, 1.0 + own[0] * trend::left(own[1], at)),
        };
        force::at_contacts(at, outputs, ratio, comes_up_by, load, |contact, _, sign| times * p[contact] * sign);
    }

    fn drive(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, _state: &[f64], drive: &mut [f64]) {
        if self.law != FrictionLaw::Geared {
            return;
        }
        let (frame, typical, ratio) = (&at.scene.frame, at.scene.scales.speed, p.get(3));
        let loops = Loops::of(frame, motion, ratio, [1.0 - p[2]; 2]);
        let (told, withdrawn, speeds) = (loops.at_wheels(motion.u), loops.withdrawn(motion.outputs), frame.wheels(motion.outputs));
        let rubs = |i: usize| -(p[0] + p[1] * (told[i] - withdrawn[i]).abs()) * smooth_sign(speeds[i], typical);
        frame.add_at_wheels([0, 1].map(rubs), ratio.copied().unwrap_or(1.0), drive);
    }
}
