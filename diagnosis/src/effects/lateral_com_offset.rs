//! The centre of mass lies beside the middle of the axle, so that speeding up turns the robot and turning pushes it:
//!
//! θ1 v' − θ7 ω' = …,   θ2 ω' − θ8 v' = …,   θ7 = θ1 y,   θ8 = ρ θ1 y/h².
//!
//! y is the offset to the left, for a body of mass m that makes up all of what the drive accelerates (rotors count into θ1 and
//! make y appear smaller); h half the track, ρ the turning ratio. From the rigid body's equations about the axle's middle with the
//! centre at (b, y): m (v' − y ω' − b ω²) = F and (I + m b² + m y²) ω' − m y v' + m b v ω + (m y b − m b y) ω² = M. The products
//! with y cancel: v ω and ω² keep the coefficients the model has.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Motion, Scene, Stage, Start};

use super::force;
use super::words::{quantity, scaled};

/// An offset of the centre of mass to one side.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LateralComOffset {}

#[typetag::serde(name = "lateral_com_offset")]
impl Effect for LateralComOffset {
    fn name(&self) -> &str {
        "lateral_com_offset"
    }

    fn about(&self) -> String {
        "the centre of mass lies to one side, which couples speeding up and turning".to_owned()
    }

    fn stage(&self) -> Stage {
        Stage::Inertia
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        force::needs_wheels(scene)
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        // A centre of mass beyond a wheel would tip the robot over.
        let h = scene.frame.half_track();
        let offset = EffectParameter::new("offset", "m", (-h, h), 0.05 * h).neutral(0.0);
        std::iter::once(offset).chain(force::turning_ratio(scene)).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        force::starts(scene, &[0.05 * scene.frame.half_track()], &[vec![0]])
    }

    fn statement(&self, values: &[Estimate], _scene: &Scene) -> String {
        let side = if values[0].value < 0.0 { "right" } else { "left" };
        let millimetres = scaled(values[0], |y| 1000.0 * y * values[0].value.signum());
        format!(
            "the centre of mass lies {} to the {side} of the middle, so that speeding up turns the robot to the {side}; the model had it in the middle",
            quantity(millimetres, "mm")
        )
    }

    fn excitation(&self) -> &'static str {
        "hard acceleration and braking on the straight, and fast changes of turning rate at constant speed"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "gain_asymmetry",
                because: "unequal wheels also couple forward motion and turning; they do so at constant speed too",
            },
            Confusion {
                with: "wheel_radius_mismatch",
                because: "unequal wheels couple the encoders' velocities as a weight to one side couples the robot's; a measured heading tells",
            },
            Confusion {
                with: "viscous_asymmetry",
                because: "without acceleration a coupling of the axes shows in steady motion only, which is friction's",
            },
        ]
    }

    fn drive(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, _state: &[f64], drive: &mut [f64]) {
        let (frame, h) = (&at.scene.frame, at.scene.frame.half_track());
        let th7 = force::inertia(frame, motion)[0] * p[0];
        let th8 = p.get(1).copied().unwrap_or(1.0) * th7 / (h * h);
        force::couple(frame, motion, th7, th8, drive);
    }
}
