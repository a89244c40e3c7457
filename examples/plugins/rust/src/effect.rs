//! A bus that carries commands at a slow period of its own: u'(t) = u at the last tick.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};

/// `type = "bus_period"`.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BusPeriod {
    /// Longest period that can be meant \[s\].
    pub longest: f64,
}

impl Default for BusPeriod {
    fn default() -> Self {
        Self { longest: 1.0 }
    }
}

/// A shorter period is none \[s\]: no bus ticks faster than this.
const SHORTEST: f64 = 1e-3;

#[typetag::serde(name = "bus_period")]
impl Effect for BusPeriod {
    fn name(&self) -> &str {
        "bus_period"
    }

    fn about(&self) -> String {
        "commands pass at the ticks of a slow bus, from the example plugin".to_owned()
    }

    fn stage(&self) -> Stage {
        Stage::Transport
    }

    fn family(&self) -> &str {
        "lateness"
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        vec![EffectParameter::new("period", "s", (0.0, self.longest), scene.scales.period).neutral(0.0)]
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let start = |ticks: f64| Start { values: vec![ticks * scene.scales.period], columns: vec![vec![0]], linear: false };
        [2.0, 3.0, 5.0, 8.0].map(start).into_iter().filter(|s| s.values[0] <= self.longest).collect()
    }

    fn statement(&self, values: &[Estimate], _scene: &Scene) -> String {
        let Some(Estimate { value, ci95 }) = values.first() else { return String::new() };
        let interval = ci95.map(|(low, high)| format!(" ({low:.3} to {high:.3})")).unwrap_or_default();
        format!("commands pass only every {value:.3} s{interval}; in the model each passed at once")
    }

    fn excitation(&self) -> &'static str {
        "commands that change more often than the bus ticks"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[Confusion { with: "command_delay", because: "a slow bus delays commands by half its period in the mean" }]
    }

    /// The command that passed last, and the number of its tick.
    fn states(&self, scene: &Scene) -> usize {
        scene.inputs.len() + 1
    }

    fn begin(&self, _p: &[f64], _at: &Instant<'_>, inputs: &[f64], _outputs: &[f64], state: &mut [f64]) {
        state[..inputs.len()].copy_from_slice(inputs);
        state[inputs.len()] = 0.0;
    }

    fn next_switch(&self, p: &[f64], at: &Instant<'_>, _state: &[f64]) -> f64 {
        if p[0] < SHORTEST { f64::INFINITY } else { at.stretch.time[0] + (tick(p[0], at) + 1.0) * p[0] }
    }

    fn command(&self, p: &[f64], at: &Instant<'_>, _outputs: &[f64], state: &mut [f64], u: &mut [f64]) {
        if p[0] < SHORTEST {
            return;
        }
        let Some((last, passed)) = state.split_last_mut() else { return };
        // A tick passes what is there then; the end of a step belongs to what was before it.
        if at.span == 0.0 && tick(p[0], at) != *last {
            *last = tick(p[0], at);
            passed.copy_from_slice(u);
        }
        u.copy_from_slice(passed);
    }
}

/// Ticks since the start of the stretch.
fn tick(period: f64, at: &Instant<'_>) -> f64 {
    ((at.time - at.stretch.time[0]) / period + 1e-6).floor()
}
