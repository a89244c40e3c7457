//! The force of a drive is limited: what a wheel's loop asks for, |U − (1 + κ) s|, or what is left of the voltage to accelerate, is cut
//! at m; a limit of power cuts it at m s_b/|s| where a wheel is faster than s_b; iron that saturates bends it, e (1 + |e/m|^p)^(−1/p); a supply that feeds
//! both wheels takes of each the share by which |e_l| + |e_r| is beyond m.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Motion, Scene, Stage, Start};

use super::force;
use super::soft::{HARD, bent, hardness};
use super::words::quantity;

/// A limit of current or torque.
///
/// Where speeds are commanded (the body frame) each wheel's loop pulls in proportion to the speed it lacks, U − s, and the limit cuts
/// that. Of a loop that asks for voltage back-EMF takes κ s before the current is limited; a loop that asks for current has κ = 0, and one that feeds
/// more forward than a speed takes to be held has a negative one. Where
/// the loops are closed on forward and angular velocity, both pull at each wheel in the ratio of their gains: the wheel lacks e_v ± h
/// e_ω / ρ with ρ the ratio of the force-to-command gains of forward and angular motion, and what is cut of the angular command is ρ
/// times as much; its back-EMF is the wheel's own. A loop with a derivative part asks for less while the wheel speeds up, which makes the robot as much
/// heavier as long as nothing is cut: of what the wheel is driven by, D, a share δ is asked back, and U − (1 + κ) s − δ D is cut, by 1/(1 − δ) times
/// as much, as the robot is lighter then. In voltages, and for channels of which nothing is known, the limit cuts what is left for
/// acceleration when friction and back-EMF have taken theirs: a current limit but for the share that friction needs.
///
/// A controller of forward and angular velocity may limit what it asks of either axis, whatever that comes to at a wheel: with the law `axes`
/// |v_ref − v| and |ω_ref − ω| are cut, each at a limit of its own.
///
/// The iron of a motor saturates gradually: with the law `soft` what a wheel's loop asks for bends towards the limit, the harder the greater p.
///
/// A supply that has no more than some current for both motors, as one that a battery's electronics guard, gives each the same share of what it asks for:
/// with the law `shared` the limit is of what both wheels pull together.
///
/// A driver or an engine may have no more than some power to give: with the law `power` the limit at a wheel is m up to a base speed s_b and m s_b/|s|
/// above it, constant torque and then constant power.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TorqueSaturation {
    /// What is limited. Default `wheels`.
    #[serde(default)]
    pub law: TorqueLaw,
}

/// What a limit of torque bounds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TorqueLaw {
    /// What each wheel's drive pulls.
    #[default]
    Wheels,
    /// The same, and its power.
    Power,
    /// What is asked of each axis.
    Axes,
    /// What each wheel's drive pulls, gradually.
    Soft,
    /// What both pull together.
    Shared,
}

/// Base speeds that are tried, as shares of a typical speed, and limits up to them, as shares of a typical command.
const BASES: [f64; 2] = [0.25, 0.7];
const UP_TO_THEM: [f64; 2] = [0.3, 1.0];
/// Soft limits that are tried, as shares of a typical command.
const SOFT: [f64; 4] = [0.15, 0.4, 1.0, 2.0];
/// Back-EMF in terms of a loop's gain on most robots: what their speed falls short of the command.
const BACK_EMF: f64 = 0.05;
/// Share of a robot's inertia that is its loops' derivative part on most robots that have one, and the most that may be: a loop in steps whose derivative part
/// weighs more than the robot shakes it ever harder.
const DERIVATIVE: f64 = 0.1;
const MOST_DERIVATIVE: f64 = 0.5;

/// Where a limit of power is tried.
fn powers(scene: &Scene) -> Vec<Start> {
    let at = |limit: f64, base: f64| Start {
        values: vec![limit * scene.scales.command, 1.0, 0.0, 0.0, base * scene.scales.speed],
        columns: vec![vec![0]],
        linear: false,
    };
    BASES.iter().flat_map(|base| UP_TO_THEM.map(|limit| at(limit, *base))).collect()
}

/// Where a soft limit is tried.
fn soft(scene: &Scene) -> Vec<Start> {
    let at = |limit: f64| Start { values: vec![limit * scene.scales.command, 1.0, 0.0, 0.0, HARD], columns: vec![vec![0]], linear: false };
    SOFT.map(at).into()
}

#[typetag::serde(name = "torque_saturation")]
impl Effect for TorqueSaturation {
    fn name(&self) -> &str {
        "torque_saturation"
    }

    fn about(&self) -> String {
        let limited = match self.law {
            TorqueLaw::Wheels => "the drives' force is limited",
            TorqueLaw::Power => "the drives' force and power are limited",
            TorqueLaw::Axes => "what drives forwards and what turns are limited",
            TorqueLaw::Soft => "the drives' force bends towards a limit",
            TorqueLaw::Shared => "what both drives pull together is limited",
        };
        limited.to_owned()
    }

    fn stage(&self) -> Stage {
        Stage::Drive
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        if self.law == TorqueLaw::Wheels { None } else { force::needs_loops(scene) }
    }

    /// The others bound forward acceleration and turning as limits at the wheels do, but for where both are asked for, or at speed.
    fn stands_in(&self) -> bool {
        self.law != TorqueLaw::Wheels
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let typical = scene.scales.command;
        let limit = |name: &str, unit: &str, typical: f64| {
            // A drive that cannot pull by a hundredth of its command's size does not move the robot.
            EffectParameter::new(name, unit, (0.01 * typical, f64::INFINITY), 0.1 * typical).neutral(f64::INFINITY)
        };
        let each = || scene.inputs.iter().zip(&scene.scales.inputs);
        match scene.frame {
            Frame::Body { .. } if self.law == TorqueLaw::Axes => each()
                .zip(["v", "omega"])
                .map(|((channel, typical), axis)| limit("limit", &channel.unit, *typical).of("axis", axis))
                .collect(),
            Frame::Body { .. } => {
                let back_emf = EffectParameter::new("back_emf", "1", (-1.0, 1.0), 0.4 * BACK_EMF).usually(0.0, BACK_EMF);
                let derivative = EffectParameter::new("derivative", "1", (0.0, MOST_DERIVATIVE), 0.2 * DERIVATIVE).usually(0.0, DERIVATIVE);
                let mut all = vec![limit("limit", "m/s", typical)];
                all.extend(force::turning_ratio(scene));
                all.extend([back_emf, derivative]);
                if self.law == TorqueLaw::Power {
                    let speed = scene.scales.speed;
                    all.push(EffectParameter::new("base_speed", "m/s", (0.01 * speed, f64::INFINITY), 0.1 * speed));
                }
                all.extend((self.law == TorqueLaw::Soft).then(hardness));
                all
            }
            Frame::Sides { .. } => vec![limit("limit", &scene.inputs[0].unit, typical)],
            Frame::Channels => {
                each().map(|(channel, typical)| limit("limit", &channel.unit, *typical).of("input", &channel.name)).collect()
            }
        }
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        match self.law {
            TorqueLaw::Power => return powers(scene),
            TorqueLaw::Soft => return soft(scene),
            TorqueLaw::Wheels | TorqueLaw::Axes | TorqueLaw::Shared => (),
        }
        let by_wheel = self.law != TorqueLaw::Axes;
        let together = if self.law == TorqueLaw::Shared { 2.0 } else { 1.0 };
        let (wheels, n) = (matches!(scene.frame, Frame::Body { .. }) && by_wheel, scene.inputs.len());
        let at = |share: f64, rho: f64| Start {
            values: match scene.frame {
                Frame::Body { .. } if by_wheel => vec![together * share * scene.scales.command, rho, 0.0, 0.0],
                Frame::Sides { .. } => vec![share * scene.scales.command],
                _ => scene.scales.inputs.iter().map(|typical| share * typical).collect(),
            },
            columns: if scene.frame.has_wheels() && by_wheel { vec![vec![0]] } else { (0..n).map(|i| vec![i]).collect() },
            linear: false,
        };
        let ratios: &[f64] = if wheels { &[1.0, 2.0] } else { &[1.0] };
        let limits = [0.05, 0.09, 0.15, 0.24, 0.36, 0.52, 0.75, 1.05, 1.4];
        limits.iter().flat_map(|share| ratios.iter().map(|rho| at(*share, *rho))).collect()
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        match scene.frame {
            Frame::Body { .. } if self.law == TorqueLaw::Axes => format!(
                "the controller asks for no more than for a lack of {} of forward and {} of angular velocity; the model had no limit of torque or current",
                quantity(values[0], "m/s"),
                quantity(values[1], "rad/s")
            ),
            Frame::Body { .. } if self.law == TorqueLaw::Shared => format!(
                "both wheels' drives together pull no harder than for a lack of {} of speed; the model had no limit of torque or current",
                quantity(values[0], "m/s")
            ),
            Frame::Body { .. } => format!(
                "a wheel's drive pulls no harder than for a lack of {} of speed{}; the model had no limit of torque or current",
                quantity(values[0], "m/s"),
                match values.get(4) {
                    Some(_) if self.law == TorqueLaw::Soft => ", towards which it bends".to_owned(),
                    Some(base) => format!(", and above {} as much less as it turns faster: its power is limited", quantity(*base, "m/s")),
                    None => String::new(),
                }
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
        let hardness = p.last().copied().filter(|_| self.law == TorqueLaw::Soft);
        let excess = |value: f64, limit: f64| {
            value - hardness.map_or_else(|| value.clamp(-limit.abs(), limit.abs()), |hardness| bent(value, limit, hardness))
        };
        let frame = at.scene.frame;
        match frame {
            Frame::Body { .. } if self.law == TorqueLaw::Axes => {
                for (axis, (drive, limit)) in drive.iter_mut().zip(p).enumerate() {
                    *drive -= excess(motion.u[axis] - motion.outputs[axis], *limit);
                }
            }
            Frame::Body { .. } => {
                let (rho, back_emf, derivative) = (p[1], p[2], p[3]);
                let lack = [0, 1].map(|axis| motion.u[axis] - motion.outputs[axis]);
                let (asked, driven, speeds) = (frame.at_wheels(&lack, rho), frame.at_wheels(drive, rho), frame.wheels(motion.outputs));
                let base = p.get(4).filter(|_| self.law == TorqueLaw::Power);
                let limit = |side: usize| base.map_or(p[0], |base| p[0] * (base / speeds[side].abs()).min(1.0));
                let pulled = [0, 1].map(|side| asked[side] - back_emf * speeds[side] - derivative * driven[side]);
                let cut = if self.law == TorqueLaw::Shared {
                    let together = pulled[0].abs() + pulled[1].abs();
                    let share = (1.0 - p[0] / together).max(0.0);
                    pulled.map(|pulled| -share * pulled / (1.0 - derivative))
                } else {
                    [0, 1].map(|side| -excess(pulled[side], limit(side)) / (1.0 - derivative))
                };
                frame.add_at_wheels(cut, rho, drive);
            }
            Frame::Sides { .. } => drive.iter_mut().for_each(|d| *d -= excess(*d, p[0])),
            Frame::Channels => drive.iter_mut().zip(p).for_each(|(d, limit)| *d -= excess(*d, *limit)),
        }
    }
}
