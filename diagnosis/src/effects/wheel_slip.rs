//! The wheels slip on the ground while they push.
//!
//! `creep`: of the drive a at a wheel a/(1 + λ|s|) arrives, s its ground speed. A tyre's force is proportional to slip over speed, so
//! that slip's share of the speed, and with it the time the ground speed takes to follow the wheel, grows with speed.
//!
//! `grip`: the ground holds no more than an acceleration a_max of the robot's mass; a drive beyond that spins the wheel. On the way there
//! the tyre creeps as a brush does (Pacejka, Tyre and Vehicle Dynamics, section 3.2): of its drive a(1 − y³) arrives in units of a_max, y the share of its contact
//! that still sticks. The wheel's loop sees the wheel, which runs ahead of the ground by 3 λ|s| (1 − y), so that y³ + 3λ|s| y = 1 + 3λ|s| −
//! |a|/a_max. a_max/g is the friction coefficient if the driven wheels carry all weight.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Motion, Scene, Stage, Start};

use super::force;
use super::words::{digits, quantity, scaled};

/// What slips.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SlipLaw {
    /// Slip in proportion to force and speed.
    #[default]
    Creep,
    /// A greatest force.
    Grip,
}

/// Slip of the wheels.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WheelSlip {
    /// What slips. Default `creep`.
    #[serde(default)]
    pub law: SlipLaw,
}

/// Standard gravity \[m/s²\].
const GRAVITY: f64 = 9.80665;

#[typetag::serde(name = "wheel_slip")]
impl Effect for WheelSlip {
    fn name(&self) -> &str {
        "wheel_slip"
    }

    fn about(&self) -> String {
        match self.law {
            SlipLaw::Creep => "the wheels creep on the ground, the more the faster and the harder they push".to_owned(),
            SlipLaw::Grip => "the wheels spin when they push harder than the ground holds".to_owned(),
        }
    }

    fn stage(&self) -> Stage {
        Stage::Drive
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        force::needs_wheels(scene)
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let speed = scene.scales.speed;
        let creep = || EffectParameter::new("creep", "s/m", (0.0, 100.0 / speed), 0.05 / speed).neutral(0.0);
        match self.law {
            SlipLaw::Creep => vec![creep()],
            SlipLaw::Grip => {
                let least = (0.02 * speed).min(GRAVITY);
                vec![EffectParameter::new("grip", "m/s2", (least, f64::INFINITY), 0.1 * speed).neutral(f64::INFINITY), creep()]
            }
        }
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let speed = scene.scales.speed;
        match self.law {
            SlipLaw::Creep => vec![Start { values: vec![0.05 / speed], columns: vec![vec![0]], linear: true }],
            SlipLaw::Grip => [8.0, 5.6, 4.0, 2.8, 2.0, 1.4, 1.0, 0.7, 0.5, 0.35]
                .into_iter()
                .map(|share| (share * speed).min(2.0 * GRAVITY))
                .map(|grip| Start { values: vec![grip, 0.05 / speed], columns: vec![vec![0], vec![1]], linear: false })
                .collect(),
        }
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let speed = scene.scales.speed;
        match self.law {
            SlipLaw::Creep => format!(
                "the wheels creep on the ground: at {} m/s the robot follows them {} more slowly than at rest; the model's wheels rolled without slip",
                digits(speed),
                quantity(scaled(values[0], |creep| 100.0 * creep * speed), "%"),
            ),
            SlipLaw::Grip => format!(
                "the wheels slip when the robot is to accelerate by more than {}, a friction coefficient of {} if they carry all of its weight; the model's wheels held always",
                quantity(values[0], "m/s²"),
                digits(values[0].value / GRAVITY)
            ),
        }
    }

    fn excitation(&self) -> &'static str {
        match self.law {
            SlipLaw::Creep => "the same steps of the command at low and at high speed",
            SlipLaw::Grip => "the hardest acceleration and braking that the robot is meant for",
        }
    }

    fn confusions(&self) -> &'static [Confusion] {
        match self.law {
            SlipLaw::Creep => &[
                Confusion { with: "theta1", because: "at one speed it is a longer time constant" },
                Confusion { with: "actuator_lag", because: "slip in proportion to force alone is a small lag" },
                Confusion { with: "slew_limit", because: "either makes fast robots follow slowly when steps are large" },
            ],
            SlipLaw::Grip => &[
                Confusion {
                    with: "torque_saturation",
                    because: "the ground or the motor may be what gives way; only the wheels' own speeds tell",
                },
                Confusion {
                    with: "slew_limit",
                    because: "a command that rises slowly and a robot that cannot accelerate look alike in steps",
                },
            ],
        }
    }

    fn drive(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, _state: &[f64], drive: &mut [f64]) {
        let frame = &at.scene.frame;
        let (pushes, speeds) = (frame.wheels(drive), frame.wheels(motion.outputs));
        let arriving = match self.law {
            SlipLaw::Creep => [0, 1].map(|i| pushes[i] / (1.0 + p[0] * speeds[i].abs())),
            SlipLaw::Grip => {
                let i = motion.inertia;
                // What one unit of forward acceleration takes at each wheel.
                let needs = if matches!(frame, Frame::Body { .. }) { [i[0]; 2] } else { [i[0] + i[1], i[2] + i[3]] };
                [0, 1].map(|side| brushed(pushes[side], p[0] * needs[side], p[1] * speeds[side].abs()))
            }
        };
        drive.copy_from_slice(&frame.from_wheels(arriving));
    }
}

/// What a brush tyre passes on of a push, if it holds no more than a limit and creep takes its share.
fn brushed(push: f64, limit: f64, creep: f64) -> f64 {
    if !limit.is_finite() {
        return push / (1.0 + creep);
    }
    let sticking = stuck(creep, 1.0 + 3.0 * creep - (push / limit).abs());
    limit * (1.0 - sticking.powi(3)) * push.signum()
}

/// The root y of y³ + 3 p y = c for p ≥ 0, and 0 where it is negative. Cardano's u − p/u, written so that no digits cancel.
fn stuck(p: f64, c: f64) -> f64 {
    if c <= 0.0 {
        return 0.0;
    }
    let half = 0.5 * c;
    let u = (half + (half * half + p * p * p).sqrt()).cbrt();
    let v = p / u;
    c / (u * u + p + v * v)
}

#[cfg(test)]
mod tests {
    use super::stuck;

    #[test]
    fn what_sticks_is_the_root_of_its_cubic_to_the_last_digits() {
        for p in [0.0, 1e-12, 1e-6, 1e-3, 0.1, 1.0, 30.0, 1e6] {
            for c in [1e-12, 1e-6, 1e-2, 0.3, 1.0, 4.0, 1e3] {
                let y = stuck(p, c);
                let back = y * (y * y + 3.0 * p);
                assert!((back - c).abs() < 1e-14 * c * 8.0, "{p} {c}: {y} gives {back}");
            }
        }
        assert_eq!(stuck(0.3, -1.0), 0.0);
    }
}
