//! Measurements are late: what is recorded at t is what was at t − τ, with one τ for all outputs or one for each, or the mean of what was from
//! t − 2τ to t, which is as old on average.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Scene, Stage, Start};
use wheelwright_core::simulation::Readout;

use super::force;
use super::late;
use super::reading::mean;
use super::words::{quantity, scaled};

/// A pure delay between motion and record: filters in a sensor, transport, stamps set on arrival.
///
/// On commands and velocities alone it is `command_delay`: a model whose coefficients do not depend on time answers late
/// commands by the same response, late by the same. They part only where something else tells the time: a start in motion, and effects
/// that act by place or time.
///
/// Forward and turning motion are often measured by different sensors (encoders and a gyroscope), and then each has a delay of its own.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SensorDelay {
    /// Whether each axis (or wheel, or channel) has a delay of its own.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub each_axis: bool,
    /// Whether the record is a running mean, over twice the delay. Default `false`.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub averaging: bool,
}

/// Longest delay considered \[s\].
const LONGEST: f64 = 0.8;

#[typetag::serde(name = "sensor_delay")]
impl Effect for SensorDelay {
    fn name(&self) -> &str {
        "sensor_delay"
    }

    fn about(&self) -> String {
        match self.averaging {
            true => "measurements are recorded as running means, which are late by half of what they are taken over".to_owned(),
            false => "measurements are recorded some time after they were true".to_owned(),
        }
    }

    fn stage(&self) -> Stage {
        Stage::Reading
    }

    fn family(&self) -> &str {
        late::FAMILY
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        if self.each_axis { force::needs_commands(scene) } else { None }
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        late::parameters("delay", LONGEST, self.each_axis, scene)
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        late::starts(self.each_axis, scene)
    }

    /// A mean is as late as a delay, and differs by what is faster.
    fn stands_in(&self) -> bool {
        self.averaging
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let said = match (self.each_axis, values) {
            (true, [v, omega, ..]) if scene.frame.has_wheels() => {
                let [of, and] = match scene.frame {
                    Frame::Sides { .. } => ["of the left side", "of the right side"],
                    _ => ["of forward motion", "of turning"],
                };
                format!("what is recorded {of} happened {} earlier, {and} {}", quantity(*v, "s"), quantity(*omega, "s"))
            }
            (true, _) => {
                let each = scene.outputs.iter().zip(values).map(|(y, v)| format!("`{}` {}", y.name, quantity(*v, "s")));
                format!("what is recorded happened earlier: {}", each.collect::<Vec<_>>().join(", "))
            }
            (false, _) if self.averaging => {
                let [over, late] = [2.0, 1.0].map(|times| quantity(scaled(values[0], |delay| times * delay), "s"));
                format!("what is recorded is the mean of the last {over}, and {late} old")
            }
            (false, _) => format!("what is recorded happened {} earlier", quantity(values[0], "s")),
        };
        format!("{said}; the model had no delay")
    }

    fn excitation(&self) -> &'static str {
        late::EXCITATION
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "command_delay",
                because: "always: late commands and late measurements shift the response alike; only a clock that both share tells them apart",
            },
            Confusion { with: "actuator_lag", because: "under slow motion a delay and a lag of the same length are the same" },
            Confusion { with: "theta1", because: "under slow motion the delay is a longer time constant" },
        ]
    }

    /// Room for sums, and for what each output was when it is late alone.
    fn states(&self, scene: &Scene) -> usize {
        2 * scene.outputs.len()
    }

    fn measure(&self, p: &[f64], at: &Instant<'_>, past: &dyn Fn(f64, &mut [f64]), state: &mut [f64], outputs: &mut [f64]) {
        let span = at.interval();
        let (sum, seen) = state.split_at_mut(outputs.len());
        seen.copy_from_slice(outputs);
        for (i, delay) in p.iter().enumerate().filter(|(_, delay)| **delay > 0.0) {
            let counted = at.readout == Readout::IntervalMean && span > 0.0;
            if self.averaging {
                let window = (2.0 * delay).max(if counted { span } else { 0.0 });
                mean(at.time - window, window, past, sum, outputs);
            } else if counted {
                mean(at.time - delay - span, span, past, sum, outputs);
            } else {
                past(at.time - delay, outputs);
            }
            let late = if self.each_axis { i..i + 1 } else { 0..outputs.len() };
            seen[late.clone()].copy_from_slice(&outputs[late]);
        }
        outputs.copy_from_slice(seen);
    }
}
