//! Wheels that cannot steer are dragged sideways in a turn, and the ground resists.
//!
//! `patch`: contact patches ahead of and behind the centre slide sideways at a ω while they roll at v. Their friction acts against
//! the resulting creep, so that the moment against turning is M ω / √(ω² + (v/l)²): all of it when turning in place, and the less
//! the faster the robot rolls, l the patches' lever over the slip angle at which their friction is spent (a brush or ellipse
//! model's limits; Wong, Theory of Ground Vehicles, for the moment of skid steering). l large is a moment M sgn ω.
//!
//! `understeer`: K v² ω against turning, the resistance of side forces that grow with speed.
//!
//! A kinematic loss of turning rate in proportion to ω is θ6's and no effect of its own.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Scene, Stage, Start};

use super::force;
use super::words::{KINK, digits, quantity, scaled};

/// Lever over half the track beyond which the patches' friction is spent in every turn.
const DRY: f64 = 30.0;

/// How the resistance depends on speed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ScrubLaw {
    /// Friction of contact patches: greatest when turning in place.
    #[default]
    Patch,
    /// Grows with the square of speed.
    Understeer,
}

/// Resistance to turning.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TurningScrub {
    /// How it depends on speed. Default `patch`.
    #[serde(default)]
    pub law: ScrubLaw,
}

#[typetag::serde(name = "turning_scrub")]
impl Effect for TurningScrub {
    fn name(&self) -> &str {
        "turning_scrub"
    }

    fn about(&self) -> String {
        match self.law {
            ScrubLaw::Patch => "sideways friction of the wheels against turning, greatest in place".to_owned(),
            ScrubLaw::Understeer => "a resistance to turning that grows with the square of forward speed".to_owned(),
        }
    }

    fn stage(&self) -> Stage {
        Stage::Load
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        force::needs_wheels(scene)
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let h = scene.frame.half_track();
        let (command, speed) = (force::command(scene, 0), scene.scales.speed);
        let sides = matches!(scene.frame, Frame::Sides { .. });
        let strength = |name: &str, unit: &str, typical: f64| {
            EffectParameter::new(name, unit, (0.0, f64::INFINITY), 0.05 * typical).neutral(0.0).of("axis", "omega")
        };
        match self.law {
            ScrubLaw::Patch => vec![
                strength("moment", if sides { "V/m" } else { "rad/s" }, command / h),
                EffectParameter::new("length", "m", (0.1 * h, 1000.0 * h), 0.3 * h),
            ],
            ScrubLaw::Understeer => vec![strength("understeer", if sides { "V s3/m3" } else { "s2/m2" }, command / speed.powi(3))],
        }
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let strength = self.parameters(scene)[0].scale;
        let start = |values: Vec<f64>| Start { values, columns: vec![vec![0]], linear: true };
        match self.law {
            ScrubLaw::Patch => [0.4, 1.5, 6.0].map(|l| start(vec![strength, l * scene.frame.half_track()])).into(),
            ScrubLaw::Understeer => vec![start(vec![strength])],
        }
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let (h, unit) = (scene.frame.half_track(), force::unit(scene));
        match self.law {
            ScrubLaw::Patch => {
                let fades = match values[1].value > DRY * h {
                    true => "at whatever speed".to_owned(),
                    false => format!(
                        "and half of that is left where the radius of the turn is {}",
                        quantity(scaled(values[1], |l| 3.0_f64.sqrt() * l), "m")
                    ),
                };
                let moment = quantity(scaled(values[0], |m| m * h), unit);
                format!(
                    "the wheels scrub sideways in turns: turning in place uses up {moment} of each wheel's command, {fades}; the model had no scrub"
                )
            }
            ScrubLaw::Understeer => {
                let speed = scene.scales.speed;
                let share = scaled(values[0], |k| 100.0 * k * speed.powi(3) / force::command(scene, 0));
                format!(
                    "turning gets harder with speed: at {} m/s it uses up {} more of the command than slowly; the model's turning did not depend on speed",
                    digits(speed),
                    quantity(share, "%"),
                )
            }
        }
    }

    fn excitation(&self) -> &'static str {
        "turning in place, and the same turns at several forward speeds"
    }

    fn confusions(&self) -> &'static [Confusion] {
        match self.law {
            ScrubLaw::Patch => &[
                Confusion {
                    with: "coulomb_friction",
                    because: "turning in place is braked by both alike; only friction at the wheels also brakes straight driving",
                },
                Confusion { with: "castor_drag", because: "a castor that swings round resists the turn as a patch does" },
                Confusion {
                    with: "theta6",
                    because: "at one forward speed, or fast, the moment is nearly proportional to the turning rate",
                },
                Confusion {
                    with: "track_width_error",
                    because: "a robot that turns less than its wheels say may as well have a wider track",
                },
            ],
            ScrubLaw::Understeer => &[
                Confusion { with: "theta6", because: "at one forward speed it is viscous friction of turning" },
                Confusion { with: "quadratic_drag", because: "while turning rate and speed go together, either grows with their product" },
                Confusion {
                    with: "castor_drag",
                    because: "without stops and reversals a dragging castor also turns with curvature and speed",
                },
            ],
        }
    }

    fn load(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], _state: &[f64], load: &mut [f64]) {
        let frame = &at.scene.frame;
        let [v, w] = frame.body(outputs);
        let against = match self.law {
            ScrubLaw::Patch => {
                let least = KINK * at.scene.scales.speed / frame.half_track();
                p[0] * w / (w * w + (v / p[1]).powi(2) + least * least).sqrt()
            }
            ScrubLaw::Understeer => p[0] * v * v * w,
        };
        frame.add_at_body([0.0, against], load);
    }
}
