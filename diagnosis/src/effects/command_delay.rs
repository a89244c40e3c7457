//! Commands arrive late: u'(t) = u(t − τ), with one τ for all inputs or one for each.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};

use super::late;
use super::words::quantity;

/// A pure delay between what was sent and what acts.
///
/// Forward and turning motion are often done by different actuators or loops, and then each has a delay of its own.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CommandDelay {
    /// Whether each axis (or wheel, or channel) has a delay of its own.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub each_axis: bool,
}

/// Longest delay considered \[s\]: beyond it nobody would steer the robot.
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
        late::FAMILY
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        late::parameters("delay", LONGEST, self.each_axis, scene)
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        late::starts(self.each_axis, scene)
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let said =
            late::each(self.each_axis, values, scene, |whose, v| format!("{whose} take effect {} after they were sent", quantity(v, "s")));
        format!("{said}; the model had no delay")
    }

    fn excitation(&self) -> &'static str {
        late::EXCITATION
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "actuator_lag",
                because: "under slow commands a delay and a lag of the same length are the same; only the sum with the model's own lag shows",
            },
            Confusion {
                with: "sensor_delay",
                because: "always: late commands and late measurements shift the response alike; only a clock that both share tells them apart",
            },
            Confusion { with: "theta1", because: "under slow commands the delay is a longer time constant" },
            Confusion {
                with: "encoder_quantisation",
                because: "speeds differenced from counts are means over a sample: late by half of it",
            },
        ]
    }

    fn next_switch(&self, p: &[f64], at: &Instant<'_>, _state: &[f64]) -> f64 {
        let next = |delay: &f64| at.next_command(at.time - delay).map_or(f64::INFINITY, |next| next + delay);
        p.iter().map(next).fold(f64::INFINITY, f64::min)
    }

    fn holds(&self) -> bool {
        true
    }

    fn command(&self, p: &[f64], at: &Instant<'_>, _outputs: &[f64], _state: &mut [f64], u: &mut [f64]) {
        // The end of a step belongs to the command before the switch.
        let earlier = |delay: f64| at.time - 1e-6 * at.span - delay;
        u.iter_mut().enumerate().for_each(|(i, u)| *u = at.held(earlier(if p.len() > 1 { p[i] } else { p[0] }), i));
    }
}
