//! Odometry counts with wrong radii: the recorded ground speed of a wheel is (1 + e) times the true one.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};

use super::force::Wheel;
use super::words::{digits, quantity, scaled};

/// Wheels whose radii are not those that the odometry reckons with, and unequal.
///
/// By default the right wheel's speed is recorded (1 + e/2) times and the left one's (1 − e/2) times: an error that both wheels
/// share scales all outputs, and the parameters of a model scale with it (θ1, θ2, θ4, θ6 by 1/(1 + e), θ5 and θ3 by its square for
/// `vw-pd`), so that nothing is left to see. For the same reason which wheel is wrong cannot be told: an error of the
/// right wheel alone is, to first order, half of it shared and half of it opposed. With `wheel` the error is that of one wheel, for
/// simulating a known one.
///
/// On a robot whose loops are closed on encoders the same wrong radius is in the loop, and the recorded speeds are right by its own
/// measure: then the error shows in the pose alone. It shows here where the speeds come from another sensor than the one that
/// commands are compared with, or where there is no such loop.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WheelRadiusMismatch {
    /// One wheel only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wheel: Option<Wheel>,
}

#[typetag::serde(name = "wheel_radius_mismatch")]
impl Effect for WheelRadiusMismatch {
    fn name(&self) -> &str {
        "wheel_radius_mismatch"
    }

    fn about(&self) -> String {
        "the wheels' radii differ from those of the odometry".to_owned()
    }

    fn stage(&self) -> Stage {
        Stage::Sensor
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        super::force::needs_wheels(scene)
    }

    fn parameters(&self, _scene: &Scene) -> Vec<EffectParameter> {
        let error = EffectParameter::new("mismatch", "1", (-0.5, 0.5), 0.02).neutral(0.0);
        vec![match self.wheel {
            Some(wheel) => error.of("wheel", wheel.word()),
            None => error,
        }]
    }

    fn starts(&self, _scene: &Scene) -> Vec<Start> {
        vec![Start { values: vec![0.02], columns: vec![vec![0]], linear: true }]
    }

    fn statement(&self, values: &[Estimate], _scene: &Scene) -> String {
        let size = scaled(values[0], |e| 100.0 * e * if values[0].value < 0.0 { -1.0 } else { 1.0 });
        let more = if values[0].value < 0.0 { "less" } else { "more" };
        match self.wheel {
            Some(wheel) => {
                format!(
                    "the {} wheel's speed is recorded {} {more} than it is; the model's odometry was right",
                    wheel.word(),
                    quantity(size, "%")
                )
            }
            None => format!(
                "the recorded speed of the right wheel is {} {more} than it should be beside the left one's, as with wheels whose radii differ by as much: \
                 a radius of 0.1 m is off by {} mm; the model's odometry was right",
                quantity(size, "%"),
                digits(100.0 * values[0].value.abs())
            ),
        }
    }

    fn excitation(&self) -> &'static str {
        "straight driving and turning on the spot with quick changes, and a measured pose"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "gain_asymmetry",
                because: "a gain behind the drive and one before it differ only in what the two axes' different time constants leave of them; with equal time constants they are the same",
            },
            Confusion { with: "command_offset", because: "at one forward speed a veer in proportion to it is a constant turning command" },
            Confusion { with: "theta4", because: "always: the part that both wheels share scales all parameters and leaves no trace" },
        ]
    }

    fn measure(&self, p: &[f64], at: &Instant<'_>, _past: &dyn Fn(f64, &mut [f64]), _state: &mut [f64], outputs: &mut [f64]) {
        let errors = match self.wheel {
            None => [-0.5 * p[0], 0.5 * p[0]],
            Some(wheel) => std::array::from_fn(|side| if side == wheel.index() { p[0] } else { 0.0 }),
        };
        let frame = at.scene.frame;
        let speeds = frame.wheels(outputs);
        let added = frame.from_wheels([errors[0] * speeds[0], errors[1] * speeds[1]]);
        outputs.iter_mut().zip(added).for_each(|(x, d)| *x += d);
    }
}
