//! Commands are clipped: U' = clip(U, ±m) on each wheel, on one wheel, or on an axis.
//!
//! With `together` both wheels are slowed down alike where one of them is over the limit, U' = U m / max(|U_l|, |U_r|), so that the robot
//! keeps to its path: as FRC robots are desaturated, and as Nav2 scales velocities.
//!
//! With `soft` they are bent: U' = U (1 + |U/m|^p)^(−1/p), the harder the greater p.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};

use super::force::{self, Wheel};
use super::parts::{Axis, Parts, shares};
use super::words::{each, quantity};

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
}

/// How hard a soft limit may be, and is at first: below, it is a drag in proportion to speed's square; above, it is a limit.
const HARDNESS: (f64, f64) = (1.5, 12.0);
const HARD: f64 = 3.0;
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
        let how = match (self.soft, self.together) {
            (true, _) => "commands bend towards a limit",
            (false, true) => "commands above a limit are scaled down, both wheels' alike",
            (false, false) => "commands above a limit are clipped",
        };
        how.to_owned()
    }

    fn stage(&self) -> Stage {
        Stage::Limit
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
        if !self.together {
            return Parts::refuse(scene.frame, self.wheel, self.axis);
        }
        let other = self.soft || self.wheel.is_some() || self.axis.is_some();
        other
            .then(|| "it is set to both wheels together and to something else: it is one of them".to_owned())
            .or_else(|| force::needs_wheels(scene))
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        // Below a twentieth of what was commanded the robot would have been standing.
        let of = |p: super::parts::Part| {
            p.parameter("limit", &p.unit, (0.05 * p.largest, f64::INFINITY), 0.05 * p.largest).neutral(f64::INFINITY)
        };
        let hardness = self.soft.then(|| EffectParameter::new("hardness", "1", HARDNESS, 0.5));
        self.parts(scene).list(scene).into_iter().map(of).chain(hardness).collect()
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
        let verb = if self.soft { "bends towards" } else { "is cut at" };
        let said = each(&parts, values, |p, v| format!("{} command {verb} {}", p.whose, quantity(v, &p.unit)));
        let both = if self.together { ", and the other wheel's in proportion" } else { "" };
        format!("{said}{both}; the model had no limit")
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
        true
    }

    fn command(&self, p: &[f64], at: &Instant<'_>, _outputs: &[f64], _state: &mut [f64], u: &mut [f64]) {
        if self.together {
            let fastest = at.scene.frame.wheels(u).into_iter().fold(0.0, |most: f64, u| most.max(u.abs()));
            let scale = if fastest > p[0] { p[0] / fastest } else { 1.0 };
            u.iter_mut().for_each(|u| *u *= scale);
            return;
        }
        let hardness = p.last().filter(|_| self.soft);
        self.parts(at.scene).change(u, |_, i, command| match hardness {
            Some(hardness) => command * (1.0 + (command / p[i]).abs().powf(*hardness)).powf(-1.0 / hardness),
            None => command.clamp(-p[i].abs(), p[i].abs()),
        });
    }
}
