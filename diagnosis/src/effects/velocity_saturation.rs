//! Commands are clipped: U' = clip(U, ±m) on each wheel, on one wheel, or on an axis.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};

use super::force::Wheel;
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
}

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
        "commands above a limit are clipped".to_owned()
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
        Parts::refuse(scene.frame, self.wheel, self.axis)
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        // Below a twentieth of what was commanded the robot would have been standing.
        let of = |p: super::parts::Part| {
            p.parameter("limit", &p.unit, (0.05 * p.largest, f64::INFINITY), 0.05 * p.largest).neutral(f64::INFINITY)
        };
        self.parts(scene).list(scene).into_iter().map(of).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let sizes: Vec<f64> = self.parts(scene).list(scene).iter().map(|p| p.largest).collect();
        shares(&sizes, &[0.95, 0.88, 0.8, 0.72, 0.64, 0.55, 0.45, 0.35, 0.25])
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let parts = self.parts(scene).list(scene);
        let said = each(&parts, values, |p, v| format!("{} command is cut at {}", p.whose, quantity(v, &p.unit)));
        format!("{said}; the model had no limit")
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
        self.parts(at.scene).change(u, |_, i, command| command.clamp(-p[i].abs(), p[i].abs()));
    }
}
