//! The drive follows its command with a second time constant: τ u̇' = u − u', on every input.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};

use super::words::quantity;

/// A first-order lag between the command and the model, which makes the whole of second order.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorLag {}

#[typetag::serde(name = "actuator_lag")]
impl Effect for ActuatorLag {
    fn name(&self) -> &str {
        "actuator_lag"
    }

    fn about(&self) -> String {
        "the drive follows its command with a second time constant".to_owned()
    }

    fn stage(&self) -> Stage {
        Stage::Filter
    }

    fn family(&self) -> &str {
        "lateness"
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        vec![EffectParameter::new("time_constant", "s", (0.0, 1.0), scene.scales.period).neutral(0.0)]
    }

    fn starts(&self, _scene: &Scene) -> Vec<Start> {
        [0.01, 0.02, 0.04, 0.07, 0.11, 0.16, 0.23, 0.32]
            .map(|tau| Start { values: vec![tau], columns: vec![vec![0]], linear: false })
            .into()
    }

    fn statement(&self, values: &[Estimate], _scene: &Scene) -> String {
        format!("the drive follows its command with a further time constant of {}; the model had one lag only", quantity(values[0], "s"))
    }

    fn excitation(&self) -> &'static str {
        "steps of the command, or motion faster than a few times per second"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[Confusion {
            with: "command_delay",
            because: "under slow commands a delay and a lag of the same length are the same; only the sum with the model's own lag shows",
        }]
    }

    /// The filtered command and the command that last arrived, of each input.
    fn states(&self) -> usize {
        4
    }

    fn begin(&self, _p: &[f64], _at: &Instant<'_>, inputs: &[f64], _outputs: &[f64], state: &mut [f64]) {
        let n = inputs.len().min(2);
        state[..n].copy_from_slice(&inputs[..n]);
        state[2..2 + n].copy_from_slice(&inputs[..n]);
    }

    /// Steps are short while the filter runs after a new command.
    fn next_switch(&self, p: &[f64], at: &Instant<'_>, _state: &[f64]) -> f64 {
        let since = |share: f64| at.stretch.time[at.row] + share * p[0];
        [1.0, 3.0, 7.0].into_iter().map(since).find(|t| *t > at.time + 1e-3 * p[0]).unwrap_or(f64::INFINITY)
    }

    fn command(&self, p: &[f64], at: &Instant<'_>, _outputs: &[f64], state: &mut [f64], u: &mut [f64]) {
        let (filtered, arrived) = state.split_at_mut(2);
        // Past the last time constants of rounding the filter is transparent.
        let kept = if p[0] > 0.0 { (-at.span / p[0]).exp() } else { 0.0 };
        for ((filtered, arrived), u) in filtered.iter_mut().zip(arrived).zip(u) {
            if at.span > 0.0 {
                // The arriving command runs straight from its last value to this one.
                let slope = (*u - *arrived) / at.span;
                *filtered = *u - slope * p[0] + (*filtered - *arrived + slope * p[0]) * kept;
            } else if p[0] == 0.0 {
                *filtered = *u;
            }
            *arrived = *u;
            *u = *filtered;
        }
    }
}
