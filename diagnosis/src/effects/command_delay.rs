//! Commands arrive late: u'(t) = u(t − τ), the same τ on every input.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};

use super::words::quantity;

/// A pure delay between what was sent and what acts.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandDelay {}

/// Longest delay considered \[s\].
const LONGEST: f64 = 0.8;

#[typetag::serde(name = "command_delay")]
impl Effect for CommandDelay {
    fn name(&self) -> &str {
        "command_delay"
    }

    fn about(&self) -> String {
        "commands take effect some time after they were sent".to_owned()
    }

    fn stage(&self) -> Stage {
        Stage::Transport
    }

    fn family(&self) -> &str {
        "lateness"
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        vec![EffectParameter::new("delay", "s", (0.0, LONGEST), scene.scales.period).neutral(0.0)]
    }

    fn starts(&self, _scene: &Scene) -> Vec<Start> {
        [0.01, 0.02, 0.04, 0.07, 0.11, 0.16, 0.23, 0.32]
            .map(|delay| Start { values: vec![delay], columns: vec![vec![0]], linear: false })
            .into()
    }

    fn statement(&self, values: &[Estimate], _scene: &Scene) -> String {
        format!("commands take effect {} after they were sent; the model had no delay", quantity(values[0], "s"))
    }

    fn excitation(&self) -> &'static str {
        "steps of the command, or motion faster than a few times per second"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[Confusion {
            with: "actuator_lag",
            because: "under slow commands a delay and a lag of the same length are the same; only the sum with the model's own lag shows",
        }]
    }

    fn next_switch(&self, p: &[f64], at: &Instant<'_>, _state: &[f64]) -> f64 {
        let row = at.row_at(at.time - p[0]);
        at.stretch.time.get(row + 1).map_or(f64::INFINITY, |next| next + p[0])
    }

    fn command(&self, p: &[f64], at: &Instant<'_>, _outputs: &[f64], _state: &mut [f64], u: &mut [f64]) {
        // The end of a step belongs to the command before the switch.
        let row = at.row_at(at.time - 1e-6 * at.span - p[0]);
        u.iter_mut().zip(&at.stretch.inputs).for_each(|(u, column)| *u = column[row]);
    }
}
