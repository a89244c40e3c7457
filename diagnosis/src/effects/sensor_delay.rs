//! Measurements are late: what is recorded at t is what was at t − τ.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};
use wheelwright_core::simulation::Readout;

use super::late;
use super::reading::mean;
use super::words::quantity;

/// A pure delay between motion and record: filters in a sensor, transport, stamps set on arrival.
///
/// On commands and velocities alone it is `command_delay`: a model whose coefficients do not depend on time answers late
/// commands by the same response, late by the same. They part only where something else tells the time: a start in motion, and effects
/// that act by place or time.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorDelay {}

/// Longest delay considered \[s\].
const LONGEST: f64 = 0.8;

#[typetag::serde(name = "sensor_delay")]
impl Effect for SensorDelay {
    fn name(&self) -> &str {
        "sensor_delay"
    }

    fn about(&self) -> String {
        "measurements are recorded some time after they were true".to_owned()
    }

    fn stage(&self) -> Stage {
        Stage::Reading
    }

    fn family(&self) -> &str {
        late::FAMILY
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        late::parameters("delay", LONGEST, false, scene)
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        late::starts(false, scene)
    }

    fn statement(&self, values: &[Estimate], _scene: &Scene) -> String {
        format!("what is recorded happened {} earlier; the model had no delay", quantity(values[0], "s"))
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

    /// Room for sums.
    fn states(&self, scene: &Scene) -> usize {
        scene.outputs.len()
    }

    fn measure(&self, p: &[f64], at: &Instant<'_>, past: &dyn Fn(f64, &mut [f64]), state: &mut [f64], outputs: &mut [f64]) {
        let span = at.interval();
        if p[0] <= 0.0 {
            return;
        }
        if at.readout == Readout::IntervalMean && span > 0.0 {
            mean(at.time - p[0] - span, span, past, state, outputs);
        } else {
            past(at.time - p[0], outputs);
        }
    }
}
