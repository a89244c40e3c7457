//! Odometry reckons with a wrong track: the recorded angular velocity is (1 + e) times the true one.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Scene, Stage, Start};

use super::words::{quantity, scaled};

/// A track that is narrower or wider than the odometry holds it to be, by wear, load or a wrong number: ω is recorded as (s_R − s_L)/B with
/// the wrong B, 1 + e being the true track over it.
///
/// On commands and velocities alone it can never be seen where the model's parameters are free: `vw-pd` records exactly the same
/// with θ2, θ6 and θ5 divided by 1 + e and θ3 by its square. It can where they are held fixed, and where a pose was measured beside.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrackWidthError {}

#[typetag::serde(name = "track_width_error")]
impl Effect for TrackWidthError {
    fn name(&self) -> &str {
        "track_width_error"
    }

    fn about(&self) -> String {
        "the odometry reckons with a wrong track width".to_owned()
    }

    fn stage(&self) -> Stage {
        Stage::Sensor
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        match scene.frame {
            Frame::Body { .. } => None,
            Frame::Sides { .. } => Some("the wheels' speeds are recorded, and the track is not in them".to_owned()),
            Frame::Channels => super::force::needs_wheels(scene),
        }
    }

    fn parameters(&self, _scene: &Scene) -> Vec<EffectParameter> {
        vec![EffectParameter::new("error", "1", (-0.5, 1.0), 0.02).neutral(0.0)]
    }

    /// None: the model's parameters take it up wholly. What is recorded beside the model's channels tells it: a heading, the wheels' rates.
    fn starts(&self, _scene: &Scene) -> Vec<Start> {
        Vec::new()
    }

    fn statement(&self, values: &[Estimate], _scene: &Scene) -> String {
        let size = scaled(values[0], |e| 100.0 * e * if values[0].value < 0.0 { -1.0 } else { 1.0 });
        let more = if values[0].value < 0.0 { "less" } else { "more" };
        format!(
            "the recorded angular velocity is {} {more} than the true one, as with a wrong track width; the model's odometry was right",
            quantity(size, "%")
        )
    }

    fn excitation(&self) -> &'static str {
        "full turns on the spot with a measured heading"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "theta6",
                because: "always: theta2, theta3, theta5 and theta6 scale with the angular velocity's unit, and a wrong track is a wrong unit",
            },
            Confusion { with: "turning_scrub", because: "wheels that scrub in a turn act as if the track were wider" },
        ]
    }

    fn measure(&self, p: &[f64], _at: &Instant<'_>, _past: &dyn Fn(f64, &mut [f64]), _state: &mut [f64], outputs: &mut [f64]) {
        if let Some(turn) = outputs.get_mut(1) {
            *turn += p[0] * *turn;
        }
    }
}
