//! The force of a drive is limited: what a wheel's loop asks for, |U − (1 + κ) s|, or what is left of the voltage to accelerate, is cut
//! at m.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Motion, Scene, Stage, Start};

use super::force;
use super::words::quantity;

/// A limit of current or torque.
///
/// Where speeds are commanded (the body frame) each wheel's loop pulls in proportion to the speed it lacks, U − s, and the limit cuts
/// that. Of a loop that asks for voltage back-EMF takes κ s before the current is limited; a loop that asks for current has κ = 0, and one that feeds
/// more forward than a speed takes to be held has a negative one. Where
/// the loops are closed on forward and angular velocity, both pull at each wheel in the ratio of their gains: the wheel lacks e_v ± h
/// e_ω / ρ with ρ the ratio of the force-to-command gains of forward and angular motion, and what is cut of the angular command is ρ
/// times as much; its back-EMF is the wheel's own. In voltages, and for channels of which nothing is known, the limit cuts what is left for
/// acceleration when friction and back-EMF have taken theirs: a current limit but for the share that friction needs.
///
/// A controller of forward and angular velocity may limit what it asks of either axis, whatever that comes to at a wheel: with `axes` |v_ref − v| and
/// |ω_ref − ω| are cut, each at a limit of its own.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TorqueSaturation {
    /// Whether each axis is limited by itself. Default `false`: each wheel is.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub axes: bool,
}

/// Back-EMF in terms of a loop's gain on most robots: what their speed falls short of the command.
const BACK_EMF: f64 = 0.05;

#[typetag::serde(name = "torque_saturation")]
impl Effect for TorqueSaturation {
    fn name(&self) -> &str {
        "torque_saturation"
    }

    fn about(&self) -> String {
        if self.axes { "what drives forwards and what turns are limited".to_owned() } else { "the drives' force is limited".to_owned() }
    }

    fn stage(&self) -> Stage {
        Stage::Drive
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        if self.axes { force::needs_loops(scene) } else { None }
    }

    /// It bounds forward acceleration and turning as limits at the wheels do, but for where both are asked for.
    fn stands_in(&self) -> bool {
        self.axes
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let typical = scene.scales.command;
        let limit = |name: &str, unit: &str, typical: f64| {
            // A drive that cannot pull by a hundredth of its command's size does not move the robot.
            EffectParameter::new(name, unit, (0.01 * typical, f64::INFINITY), 0.1 * typical).neutral(f64::INFINITY)
        };
        let each = || scene.inputs.iter().zip(&scene.scales.inputs);
        match scene.frame {
            Frame::Body { .. } if self.axes => each()
                .zip(["v", "omega"])
                .map(|((channel, typical), axis)| limit("limit", &channel.unit, *typical).of("axis", axis))
                .collect(),
            Frame::Body { .. } => {
                let ratio = EffectParameter::new("turning_ratio", "1", (0.2, 4.0), 0.3);
                let back_emf = EffectParameter::new("back_emf", "1", (-1.0, 1.0), 0.4 * BACK_EMF).usually(0.0, BACK_EMF);
                vec![limit("limit", "m/s", typical), ratio, back_emf]
            }
            Frame::Sides { .. } => vec![limit("limit", &scene.inputs[0].unit, typical)],
            Frame::Channels => {
                each().map(|(channel, typical)| limit("limit", &channel.unit, *typical).of("input", &channel.name)).collect()
            }
        }
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let (wheels, n) = (matches!(scene.frame, Frame::Body { .. }) && !self.axes, scene.inputs.len());
        let at = |share: f64, rho: f64| Start {
            values: match scene.frame {
                Frame::Body { .. } if !self.axes => vec![share * scene.scales.command, rho, 0.0],
                Frame::Sides { .. } => vec![share * scene.scales.command],
                _ => scene.scales.inputs.iter().map(|typical| share * typical).collect(),
            },
            columns: if scene.frame.has_wheels() && !self.axes { vec![vec![0]] } else { (0..n).map(|i| vec![i]).collect() },
            linear: false,
        };
        let ratios: &[f64] = if wheels { &[1.0, 2.0] } else { &[1.0] };
        let limits = [0.05, 0.09, 0.15, 0.24, 0.36, 0.52, 0.75, 1.05, 1.4];
        limits.iter().flat_map(|share| ratios.iter().map(|rho| at(*share, *rho))).collect()
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        match scene.frame {
            Frame::Body { .. } if self.axes => format!(
                "the controller asks for no more than for a lack of {} of forward and {} of angular velocity; the model had no limit of torque or current",
                quantity(values[0], "m/s"),
                quantity(values[1], "rad/s")
            ),
            Frame::Body { .. } => format!(
                "a wheel's drive pulls no harder than for a lack of {} of speed; the model had no limit of torque or current",
                quantity(values[0], "m/s")
            ),
            Frame::Sides { .. } => format!(
                "no more than {} of a side's voltage goes into acceleration; the model had no limit of torque or current",
                quantity(values[0], &scene.inputs[0].unit)
            ),
            Frame::Channels => {
                let said = scene
                    .inputs
                    .iter()
                    .zip(values)
                    .map(|(c, v)| format!("`{}` accelerates by no more than {}", c.name, quantity(*v, &c.unit)));
                format!("{}; the model had no limit of force", said.collect::<Vec<_>>().join(", "))
            }
        }
    }

    fn excitation(&self) -> &'static str {
        "full steps from standstill and through zero, as large as will be used"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "slew_limit",
                because: "both bound the acceleration; a ramp does so for the command alone, a limited force leaves less acceleration against friction and drag",
            },
            Confusion { with: "velocity_saturation", because: "in short steps to high speed the speed is not reached either way" },
            Confusion {
                with: "wheel_slip",
                because: "a wheel that slips passes on a limited force as well; it depends on speed and ground, not on the drive",
            },
        ]
    }

    fn drive(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, _state: &[f64], drive: &mut [f64]) {
        let excess = |value: f64, limit: f64| value - value.clamp(-limit.abs(), limit.abs());
        let frame = at.scene.frame;
        match frame {
            Frame::Body { .. } if self.axes => {
                for (axis, (drive, limit)) in drive.iter_mut().zip(p).enumerate() {
                    *drive -= excess(motion.u[axis] - motion.outputs[axis], *limit);
                }
            }
            Frame::Body { .. } => {
                let rho = p[1];
                let lack = [0, 1].map(|axis| motion.u[axis] - motion.outputs[axis]);
                let (asked, speeds) = (frame.at_wheels(&lack, rho), frame.wheels(motion.outputs));
                let cut = [0, 1].map(|side| -excess(asked[side] - p[2] * speeds[side], p[0]));
                frame.add_at_wheels(cut, rho, drive);
            }
            Frame::Sides { .. } => drive.iter_mut().for_each(|d| *d -= excess(*d, p[0])),
            Frame::Channels => drive.iter_mut().zip(p).for_each(|(d, limit)| *d -= excess(*d, *limit)),
        }
    }
}
