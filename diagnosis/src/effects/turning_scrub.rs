//! Wheels that cannot steer are dragged sideways in a turn, and the ground resists.
//!
//! `patch`: contact patches ahead of and behind the centre slide sideways at a ω while those of a side roll at its speed s. Their friction acts
//! against the resulting slip as that of a brush (Pacejka, Tyre and Vehicle Dynamics, section 3.2): of the moment M against turning each side has the half, 1 − (1 − y)³ of it where
//! y = l |ω|/|s| is less than one. All of it acts when turning in place, and the less the faster a side rolls, l the patches' lever over the slip
//! angle at which their friction is spent (Wong, Theory of Ground Vehicles, for the moment of skid steering). l large is a moment M sgn ω.
//!
//! `angle`: what cannot steer and rolls freely a lever l ahead of the axle, or behind it, slides across at the angle between where it points and where it goes;
//! friction that is spent resists with its part across, a moment M l ω/√(v² + l² ω²).
//!
//! `skid`: dry friction of two axles. A robot that turns about the point where one axle stands drags the other one sideways: with even loads it is
//! M = a μ m g that resists, a half the wheelbase, and otherwise what the lighter axle holds, M (1 − |d + v |ω|/G − c v'|): d by how much the
//! weight is nearer to one axle, G = μ g, of which holding the curve takes the share v |ω|/G, and c = z/(g a) what accelerating a centre of mass at the
//! height z shifts. What drives is carried by the same friction: of a share n the root of n² − (v'/G)² is left across. As dry friction does,
//! it holds the robot straight where what turns is less.
//!
//! `understeer`: K v² ω against turning, the resistance of side forces that grow with speed.
//!
//! A kinematic loss of turning rate in proportion to ω is θ6's and no effect of its own.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Motion, Scene, Stage, Start};

use super::force;
use super::words::{KINK, digits, length, quantity, scaled};

/// Lever over half the track beyond which the patches' friction is spent in every turn.
const DRY: f64 = 30.0;

/// Most that one axle carries of a weight, beyond the half, as a share of the half.
const UNEVEN: f64 = 0.95;
/// Greatest height of the centre of mass over half the wheelbase, and that from which is tried.
const HIGHEST: f64 = 10.0;
const SHIFTED: f64 = 2.0;
/// Friction coefficient from which is tried.
const SLIPPERY: f64 = 0.3;
/// Difference of their loads, as a share of the half, below which two axles slide together: which one carries less is no matter of a hair.
const EVEN: f64 = 0.05;
/// Least share of the friction that is left across, where all of it drives.
const LEFT: f64 = 0.01;
/// Radius of a turn over the patches' lever in which half of their friction acts: 1 − (1 − y)³ is a half at y = 0.206.
const HALF: f64 = 4.847;
/// The same of friction across a slip angle: its sine is a half where the tangent is 1/√3.
const HALF_ACROSS: f64 = 1.732_050_8;

/// How the resistance depends on speed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ScrubLaw {
    /// Friction of contact patches: greatest when turning in place.
    #[default]
    Patch,
    /// Friction across what rolls ahead of the axle or behind it.
    Angle,
    /// Dry friction of the axle that carries less.
    Skid,
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
            ScrubLaw::Patch | ScrubLaw::Angle => "sideways friction of the wheels against turning, greatest in place".to_owned(),
            ScrubLaw::Skid => "sideways friction of the axle that carries less, which changes as the robot speeds up".to_owned(),
            ScrubLaw::Understeer => "a resistance to turning that grows with the square of forward speed".to_owned(),
        }
    }

    fn stage(&self) -> Stage {
        if self.law == ScrubLaw::Skid { Stage::Contact } else { Stage::Load }
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
        let moment = || strength("moment", if sides { "V/m" } else { "rad/s" }, command / h);
        match self.law {
            ScrubLaw::Patch | ScrubLaw::Angle => vec![moment(), EffectParameter::new("length", "m", (0.1 * h, 1000.0 * h), 0.3 * h)],
            ScrubLaw::Skid => vec![
                moment(),
                EffectParameter::new("uneven", "1", (-UNEVEN, UNEVEN), 0.1).neutral(0.0),
                EffectParameter::new("transfer", "s2/m", (0.0, HIGHEST / force::GRAVITY), 0.3 / force::GRAVITY).neutral(0.0),
                force::grip(scene),
            ],
            ScrubLaw::Understeer => vec![strength("understeer", if sides { "V s3/m3" } else { "s2/m2" }, command / speed.powi(3))],
        }
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let strength = self.parameters(scene)[0].scale;
        let start = |values: Vec<f64>| Start { values, columns: vec![vec![0]], linear: true };
        match self.law {
            ScrubLaw::Patch | ScrubLaw::Angle => [0.4, 1.5, 6.0].map(|l| start(vec![strength, l * scene.frame.half_track()])).into(),
            ScrubLaw::Skid => {
                [0.0, -0.2, 0.2].map(|uneven| start(vec![strength, uneven, SHIFTED / force::GRAVITY, SLIPPERY * force::GRAVITY])).into()
            }
            ScrubLaw::Understeer => vec![start(vec![strength])],
        }
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let (h, unit) = (scene.frame.half_track(), force::unit(scene));
        match self.law {
            ScrubLaw::Patch | ScrubLaw::Skid | ScrubLaw::Angle => {
                let how = match self.law {
                    ScrubLaw::Skid => format!(
                        "by the friction of the axle that carries less, {} less for each m/s² by which the robot speeds up or slows down",
                        quantity(scaled(values[2], |c| 100.0 * c), "%")
                    ),
                    _ if values[1].value > DRY * h => "at whatever speed".to_owned(),
                    law => format!(
                        "and half of that is left where the radius of the turn is {}",
                        quantity(scaled(values[1], |l| l * if law == ScrubLaw::Angle { HALF_ACROSS } else { HALF }), "m")
                    ),
                };
                let moment = quantity(scaled(values[0], |m| m * h), unit);
                format!(
                    "the wheels scrub sideways in turns: turning in place uses up {moment} of each wheel's command, {how}; the model had no scrub"
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

    /// Where nothing scrubs nothing skids.
    fn stands_in(&self) -> bool {
        self.law == ScrubLaw::Skid
    }

    fn excitation(&self) -> &'static str {
        "turning in place, and the same turns at several forward speeds"
    }

    fn confusions(&self) -> &'static [Confusion] {
        match self.law {
            ScrubLaw::Patch | ScrubLaw::Skid | ScrubLaw::Angle => &[
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
                let floor = floor(p[1], at.scene);
                let spent = |side: f64| brush(p[1] * w.abs() / side.abs().max(floor));
                0.5 * p[0] * w.signum() * frame.wheels(outputs).map(spent).iter().sum::<f64>()
            }
            ScrubLaw::Angle => p[0] * p[1] * w / length([v, p[1] * w, KINK * at.scene.scales.speed]),
            ScrubLaw::Understeer => p[0] * v * v * w,
            ScrubLaw::Skid => return,
        };
        frame.add_at_body([0.0, against], load);
    }

    fn drive(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, _state: &[f64], drive: &mut [f64]) {
        let (frame, &[moment, uneven, transfer, grip]) = (at.scene.frame, p) else { return };
        let ([forward, turn], [th1, th2], [v, w]) = (frame.body(drive), force::inertia(&frame, motion), frame.body(motion.outputs));
        let faster = forward / th1;
        let carried = (1.0 - length([uneven + v * w.abs() / grip - transfer * faster, EVEN])).max(0.0);
        let across = moment * (carried.powi(2) - (faster / grip).powi(2)).max(LEFT * LEFT).sqrt();
        // What is held comes to rest within a step.
        let against = (turn + th2 * w / at.step).clamp(-across.abs(), across.abs());
        drive.copy_from_slice(&frame.from_body([forward, turn - against]));
    }
}

/// The share of its friction with which a brush acts at a share of the slip at which that is spent.
fn brush(share: f64) -> f64 {
    1.0 - (1.0 - share.min(1.0)).powi(3)
}

/// The least speed at which patches of this lever roll: however long it is, their moment sets in as steeply as friction does over a kink at the wheels.
fn floor(length: f64, scene: &Scene) -> f64 {
    3.0 * length / scene.frame.half_track() * KINK * scene.scales.speed
}
