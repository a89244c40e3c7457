//! Commands are clipped: U' = clip(U, ±m) on each wheel, on one wheel, or on an axis.
//!
//! With `together` both wheels are slowed down alike where one of them is over the limit, U' = U m / max(|U_l|, |U_r|), so that the robot
//! keeps to its path: as FRC robots are desaturated, and as Nav2 scales velocities.
//!
//! With `soft` they are bent: U' = U (1 + |U/m|^p)^(−1/p), the harder the greater p.
//!
//! With `recorded` it is not the robot that ends but what is recorded of it, y' = clip(y, ±m): a counter that runs over, a filter that takes what
//! is faster for an error. Speeds that end look like a robot that is limited, until the command falls: a limited robot slows down at once, a
//! recorded speed stays at its end until the robot has come down to it. The robot has no such limit, and the answer says so.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};

use super::force::{self, Wheel};
use super::parts::{Axis, Parts, shares};
use super::soft::{HARD, bent, hardness};
use super::words::{digits, each, quantity};

/// A limit of the commanded speed (or voltage). Drives limit wheels; velocity interfaces such as ROS' `diff_drive_controller`
/// limit axes: both are kept apart by the settings.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VelocitySaturation {
    /// One wheel only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wheel: Option<Wheel>,
    /// On the forward or the turning command in place of the wheels'.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axis: Option<Axis>,
    /// Whether the limit is approached and not met.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub soft: bool,
    /// Whether a wheel over the limit slows the other one down as well.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub together: bool,
    /// Whether it is the recorded speed that ends.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub recorded: bool,
}

/// Limits that are tried, as shares of the largest command.
const SHARES: [f64; 9] = [0.95, 0.88, 0.8, 0.72, 0.64, 0.55, 0.45, 0.35, 0.25];
/// The same of soft ones, which take off below and beyond.
const SOFT_SHARES: [f64; 5] = [1.6, 1.1, 0.75, 0.5, 0.3];

impl VelocitySaturation {
    fn parts(&self, scene: &Scene) -> Parts {
        Parts::of(scene.frame, self.wheel, self.axis)
    }
}

#[typetag::serde(name = "velocity_saturation")]
impl Effect for VelocitySaturation {
    fn name(&self) -> &str {
        "velocity_saturation"
    }

    fn about(&self) -> String {
        let how = match (self.recorded, self.soft, self.together) {
            (true, ..) => "speeds above a limit are not recorded",
            (_, true, _) => "commands bend towards a limit",
            (_, _, true) => "commands above a limit are scaled down, both wheels' alike",
            _ => "commands above a limit are clipped",
        };
        how.to_owned()
    }

    fn stage(&self) -> Stage {
        if self.recorded { Stage::Sensor } else { Stage::Limit }
    }

    /// What holds on one axis says nothing about the other.
    fn family(&self) -> &str {
        match self.axis {
            Some(Axis::V) => "velocity_saturation/v",
            Some(Axis::Omega) => "velocity_saturation/omega",
            None => "velocity_saturation",
        }
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        let one_wheel_or_axis = self.wheel.is_some() || self.axis.is_some();
        if (self.together && (self.soft || one_wheel_or_axis)) || (self.recorded && (self.soft || self.together)) {
            return Some("it is set to two kinds of limits: it is one of them".to_owned());
        }
        let needed = match (self.recorded, self.together) {
            (true, _) => force::needs_loops(scene),
            (_, true) => force::needs_wheels(scene),
            _ => None,
        };
        needed.or_else(|| Parts::refuse(scene.frame, self.wheel, self.axis))
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        // Below a twentieth of what was commanded the robot would have been standing.
        let of = |p: super::parts::Part| {
            p.parameter("limit", &p.unit, (0.05 * p.largest, f64::INFINITY), 0.05 * p.largest).neutral(f64::INFINITY)
        };
        self.parts(scene).list(scene).into_iter().map(of).chain(self.soft.then(hardness)).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let sizes: Vec<f64> = self.parts(scene).list(scene).iter().map(|p| p.largest).collect();
        let mut starts = shares(&sizes, if self.soft { &SOFT_SHARES } else { &SHARES });
        if self.soft {
            starts.iter_mut().for_each(|start| start.values.push(HARD));
        }
        starts
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let parts = self.parts(scene).list(scene);
        if self.recorded {
            let said = each(&parts, values, |p, v| format!("{} speed is recorded up to {}", p.whose, quantity(v, &p.unit)));
            return format!("{said} and no further; the model's sensor had no end");
        }
        let verb = if self.soft { "bends towards" } else { "is cut at" };
        let said = each(&parts, values, |p, v| format!("{} command {verb} {}", p.whose, quantity(v, &p.unit)));
        let both = if self.together { ", and the other wheel's in proportion" } else { "" };
        format!("{said}{both}; the model had no limit")
    }

    fn stands_in(&self) -> bool {
        self.recorded
    }

    fn beyond(&self, values: &[Estimate]) -> Option<String> {
        let limit = values.first().filter(|_| self.recorded)?;
        Some(format!("what ends at {} is what is recorded, and not the speed of the robot: its sensor shows no more", digits(limit.value)))
    }

    fn excitation(&self) -> &'static str {
        "commands up to the largest that will be used, straight and turning at once"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "quadratic_drag",
                because: "both take off at high speed only; a limit begins at one speed and is then complete",
            },
            Confusion {
                with: "torque_saturation",
                because: "in short steps to high speed a limit of the force keeps the speed from being reached as well",
            },
        ]
    }

    fn holds(&self) -> bool {
        !self.recorded
    }

    fn measure(&self, p: &[f64], at: &Instant<'_>, _past: &dyn Fn(f64, &mut [f64]), _state: &mut [f64], outputs: &mut [f64]) {
        self.parts(at.scene).change(outputs, |_, i, speed| speed.clamp(-p[i].abs(), p[i].abs()));
    }

    fn command(&self, p: &[f64], at: &Instant<'_>, _outputs: &[f64], _state: &mut [f64], u: &mut [f64]) {
        if self.recorded {
            return;
        }
        if self.together {
            let fastest = at.scene.frame.wheels(u).into_iter().fold(0.0, |most: f64, u| most.max(u.abs()));
            let scale = if fastest > p[0] { p[0] / fastest } else { 1.0 };
            u.iter_mut().for_each(|u| *u *= scale);
            return;
        }
        let hardness = p.last().filter(|_| self.soft);
        self.parts(at.scene).change(u, |_, i, command| match hardness {
            Some(hardness) => bent(command, p[i], *hardness),
            None => command.clamp(-p[i].abs(), p[i].abs()),
        });
    }
}
