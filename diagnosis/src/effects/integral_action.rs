//! The low-level loops integrate: i' = k (u − x), u' = u + i, on forward and angular velocity each.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Scene, Stage, Start};

use super::parts::{Axis, pairs};
use super::words::quantity;

/// PI in place of P control.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IntegralAction {}

#[typetag::serde(name = "integral_action")]
impl Effect for IntegralAction {
    fn name(&self) -> &str {
        "integral_action"
    }

    fn about(&self) -> String {
        "the low-level speed loops have integral action".to_owned()
    }

    fn stage(&self) -> Stage {
        Stage::Loop
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        (!matches!(scene.frame, Frame::Body { .. }))
            .then(|| "the commands are no speeds, so there is no speed error to integrate".to_owned())
    }

    fn parameters(&self, _scene: &Scene) -> Vec<EffectParameter> {
        let of = |axis: Axis| EffectParameter::new("integral_gain", "1/s", (0.0, 50.0), 0.2).neutral(0.0).of("axis", axis.name());
        vec![of(Axis::V), of(Axis::Omega)]
    }

    fn starts(&self, _scene: &Scene) -> Vec<Start> {
        pairs([1.0, 1.0], &[0.15, 0.4, 1.0, 2.0, 4.0, 8.0])
    }

    fn statement(&self, values: &[Estimate], _scene: &Scene) -> String {
        let [forward, turn] = [values[0], values[1]].map(|k| quantity(k, "1/s"));
        format!(
            "the speed loops correct lasting errors, with an integral gain of {forward} in forward and {turn} in turning motion; the model's had none"
        )
    }

    fn excitation(&self) -> &'static str {
        "steps that are held for several seconds, long enough for the error to be integrated away"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion { with: "theta4", because: "slow driving shows only that the speed is reached, which a gain of one says too" },
            Confusion {
                with: "actuator_lag",
                because: "a slow loop that overshoots and a drive of second order answer a single step alike",
            },
        ]
    }

    /// The integral and the last error, of each axis.
    fn states(&self, _scene: &Scene) -> usize {
        4
    }

    fn command(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], state: &mut [f64], u: &mut [f64]) {
        for (((state, k), u), x) in state.chunks_exact_mut(2).zip(p).zip(u).zip(outputs) {
            let error = *u - x;
            state[0] += 0.5 * k * at.span * (error + state[1]);
            state[1] = error;
            *u += state[0];
        }
    }
}
