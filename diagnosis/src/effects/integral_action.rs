//! The low-level loops integrate: i' = k (u − c x), u' = u + i, on forward and angular velocity each. c is the speed that the loop goes by over the one that
//! is recorded: it holds what it measures itself, with radii and a track that a person told it, or a reference that was scaled before. Against winding up |i|
//! ends at a clamp, or what has gathered leaks: i' = k (u − c x) − λ i.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Scene, Stage, Start};

use super::parts::{Axis, pairs};
use super::words::quantity;

/// PI in place of P control.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IntegralAction {
    /// Whether what has gathered leaks, in the place of a clamp. Default `false`.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub leaky: bool,
}

/// A clamp this many times the typical command is none.
const UNCLAMPED: f64 = 10.0;
/// Clamps that are looked at, in typical commands.
const CLAMPS: [f64; 6] = [0.6, 0.3, 0.15, 0.08, 0.04, 0.02];
/// Leaks that are looked at \[1/s\].
const LEAKS: [f64; 2] = [0.3, 1.5];
/// By how much a loop usually goes by another speed than the one that is recorded: as well as radii and tracks are known.
const CALIBRATED: f64 = 0.05;

/// What is said of speeds that the loops go by, where one of them is surely not as recorded.
fn goes_by(scales: &[Estimate]) -> String {
    let surely = |scale: &Estimate| scale.ci95.is_some_and(|(from, to)| from > 1.0 || to < 1.0);
    if !scales.iter().any(surely) {
        return String::new();
    }
    let [forward, turn] = [scales[0], scales[1]].map(|scale| quantity(scale, "times"));
    format!("; they go by {forward} the speed that is recorded forwards and {turn} in turning")
}

#[typetag::serde(name = "integral_action")]
impl Effect for IntegralAction {
    fn name(&self) -> &str {
        "integral_action"
    }

    fn about(&self) -> String {
        let leaky = if self.leaky { " that leaks" } else { "" };
        format!("the low-level speed loops have integral action{leaky}")
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
        let scale = |axis: Axis| EffectParameter::new("scale", "1", (0.5, 2.0), 0.02).of("axis", axis.name()).usually(1.0, CALIBRATED);
        if self.leaky {
            let leak = EffectParameter::new("leak", "1/s", (0.0, 20.0), 0.2).neutral(0.0);
            return vec![gain(Axis::V), gain(Axis::Omega), leak, scale(Axis::V), scale(Axis::Omega)];
        }
        let clamp = |axis: Axis| {
            let (typical, unit) = (scene.scales.inputs[axis.index()], &scene.inputs[axis.index()].unit);
            let bounds = (0.002 * typical, UNCLAMPED * typical);
            // Where it is far from anything, nothing but habit keeps it there.
            EffectParameter::new("clamp", unit, bounds, 0.05 * typical)
                .neutral(bounds.1)
                .of("axis", axis.name())
                .usually(bounds.1, bounds.1)
        };
        vec![gain(Axis::V), gain(Axis::Omega), clamp(Axis::V), clamp(Axis::Omega), scale(Axis::V), scale(Axis::Omega)]
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        if self.leaky {
            return LEAKS
                .map(|leak| Start { values: vec![0.2, 0.2, leak, 1.0, 1.0], columns: vec![vec![0], vec![1]], linear: true })
                .into();
        }
        let mut all = pairs([1.0, 1.0], &[0.15, 0.4, 1.0, 2.0, 4.0, 8.0]);
        let open = [0, 1].map(|i| UNCLAMPED * scene.scales.inputs[i]);
        all.iter_mut().for_each(|start| start.values.extend(open.into_iter().chain([1.0, 1.0])));
        all
    }

    /// The same gains with a clamp, on both axes alike or on one: from none no small step leads to one.
    fn afterthoughts(&self, values: &[f64], scene: &Scene) -> Vec<Vec<f64>> {
        if self.leaky {
            return Vec::new();
        }
        let clamped = |share: f64, axes: &[usize]| {
            let mut values = values.to_vec();
            axes.iter().for_each(|i| values[2 + i] = share * scene.scales.inputs[*i]);
            values
        };
        [&[0, 1][..], &[0], &[1]].iter().flat_map(|axes| CLAMPS.map(|share| clamped(share, axes))).collect()
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let [forward, turn] = [values[0], values[1]].map(|k| quantity(k, "1/s"));
        let scales = goes_by(&values[values.len() - 2..]);
        if self.leaky {
            let leak = quantity(values[2], "1/s");
            return format!(
                "the speed loops correct errors for a while, with an integral gain of {forward} in forward and {turn} in turning motion, of which {leak} leaks{scales}; the model's had none"
            );
        }
        let parameters = self.parameters(scene);
        let ends = |i: usize| (!parameters[i].is_neutral(values[i].value)).then(|| quantity(values[i], &parameters[i].unit));
        let ends = match (ends(2), ends(3)) {
            (Some(v), Some(w)) => format!(", which ends at {v} and {w}"),
            (Some(one), None) | (None, Some(one)) => format!(", which ends at {one}"),
            (None, None) => String::new(),
        };
        format!(
            "the speed loops correct lasting errors, with an integral gain of {forward} in forward and {turn} in turning motion{ends}{scales}; the model's had none"
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
        let (clamps, leak, scales) = if self.leaky { ([f64::INFINITY; 2], p[2], &p[3..5]) } else { ([p[2], p[3]], 0.0, &p[4..6]) };
        // What is left of what had gathered, and of what gathers over the span on the average.
        let (kept, gathered) = if leak > 0.0 {
            let lost = -(-leak * at.span).exp_m1();
            (1.0 - lost, lost / leak)
        } else {
            (1.0, at.span)
        };
        for (((((state, k), clamp), scale), u), x) in state.chunks_exact_mut(2).zip(p).zip(clamps).zip(scales).zip(u).zip(outputs) {
            let error = *u - scale * x;
            state[0] = (kept * state[0] + 0.5 * k * gathered * (error + state[1])).max(-clamp.abs()).min(clamp.abs());
            state[1] = error;
            *u += state[0];
        }
    }
}
