//! The low-level loops integrate: i' = k (u − x), u' = u + i, on forward and angular velocity each. Against winding up |i| ends at a clamp.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Scene, Stage, Start};

use super::parts::{Axis, pairs};
use super::words::quantity;

/// PI in place of P control.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IntegralAction {}

/// A clamp this many times the typical command is none.
const UNCLAMPED: f64 = 10.0;
/// Clamps that are looked at, in typical commands.
const CLAMPS: [f64; 6] = [0.6, 0.3, 0.15, 0.08, 0.04, 0.02];

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

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let gain = |axis: Axis| EffectParameter::new("integral_gain", "1/s", (0.0, 50.0), 0.2).neutral(0.0).of("axis", axis.name());
        let clamp = |axis: Axis| {
            let (typical, unit) = (scene.scales.inputs[axis.index()], &scene.inputs[axis.index()].unit);
            let bounds = (0.002 * typical, UNCLAMPED * typical);
            // Where it is far from anything, nothing but habit keeps it there.
            EffectParameter::new("clamp", unit, bounds, 0.05 * typical)
                .neutral(bounds.1)
                .of("axis", axis.name())
                .usually(bounds.1, bounds.1)
        };
        vec![gain(Axis::V), gain(Axis::Omega), clamp(Axis::V), clamp(Axis::Omega)]
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let mut all = pairs([1.0, 1.0], &[0.15, 0.4, 1.0, 2.0, 4.0, 8.0]);
        all.iter_mut().for_each(|start| start.values.extend([0, 1].map(|i| UNCLAMPED * scene.scales.inputs[i])));
        all
    }

    /// The same gains with a clamp, on both axes alike or on one: from none no small step leads to one.
    fn afterthoughts(&self, values: &[f64], scene: &Scene) -> Vec<Vec<f64>> {
        let clamped = |share: f64, axes: &[usize]| {
            let mut values = values.to_vec();
            axes.iter().for_each(|i| values[2 + i] = share * scene.scales.inputs[*i]);
            values
        };
        [&[0, 1][..], &[0], &[1]].iter().flat_map(|axes| CLAMPS.map(|share| clamped(share, axes))).collect()
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let [forward, turn] = [values[0], values[1]].map(|k| quantity(k, "1/s"));
        let parameters = self.parameters(scene);
        let ends = |i: usize| (!parameters[i].is_neutral(values[i].value)).then(|| quantity(values[i], &parameters[i].unit));
        let ends = match (ends(2), ends(3)) {
            (Some(v), Some(w)) => format!(", which ends at {v} and {w}"),
            (Some(one), None) | (None, Some(one)) => format!(", which ends at {one}"),
            (None, None) => String::new(),
        };
        format!(
            "the speed loops correct lasting errors, with an integral gain of {forward} in forward and {turn} in turning motion{ends}; the model's had none"
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
        let (gains, clamps) = p.split_at(2);
        for ((((state, k), clamp), u), x) in state.chunks_exact_mut(2).zip(gains).zip(clamps).zip(u).zip(outputs) {
            let error = *u - x;
            state[0] = (state[0] + 0.5 * k * at.span * (error + state[1])).max(-clamp.abs()).min(clamp.abs());
            state[1] = error;
            *u += state[0];
        }
    }
}
