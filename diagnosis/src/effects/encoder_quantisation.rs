//! Speeds are counts of an encoder over an interval: s = q · (counts since the last sample) / Δt; or, as a `readout`, each output is rounded to a step of
//! its own: y' = q round(y/q).

use serde::{Deserialize, Serialize};
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};
use wheelwright_core::simulation::Readout;
use wheelwright_core::{Channel, Effect};

use super::reading::mean;
use super::words::quantity;

/// Odometry that differences whole counts.
///
/// Where the marks of the encoder stand at the start is not known. On the average over that, the recorded speed is the mean over the
/// interval before the sample, whatever the resolution q: late by half an interval, and that is all a simulation can
/// foretell. So by default this effect records interval means. What q adds is scatter, of the size q/(√6 Δt), and values on a
/// lattice of step q/Δt: by that lattice it is found, not by any fit, and it has no starts for one. With `counts` the counts are
/// simulated one by one, from marks at the start of each stretch.
///
/// A `readout` of few digits is found by its lattice as well, and where other noise does not hide it: else it is a noise.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EncoderQuantisation {
    /// Whether counts are simulated one by one.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub counts: bool,
    /// Whether the outputs are rounded as they are, in place of counts.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub readout: bool,
}

#[typetag::serde(name = "encoder_quantisation")]
impl Effect for EncoderQuantisation {
    fn name(&self) -> &str {
        "encoder_quantisation"
    }

    fn about(&self) -> String {
        if self.readout { "values are rounded where they are read" } else { "speeds are whole counts of an encoder over an interval" }
            .to_owned()
    }

    fn stage(&self) -> Stage {
        Stage::Reading
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        if self.readout { None } else { super::force::needs_wheels(scene) }
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        if self.readout {
            let step = |(y, typical): (&Channel, &f64)| {
                EffectParameter::new("step", &y.unit, (0.0, 10.0 * typical), 0.03 * typical).neutral(0.0).of("output", &y.name)
            };
            return scene.outputs.iter().zip(&scene.scales.outputs).map(step).collect();
        }
        let a_sample = scene.scales.speed * scene.scales.period;
        vec![EffectParameter::new("resolution", "m", (0.0, 10.0 * a_sample), 0.1 * a_sample).neutral(0.0)]
    }

    fn starts(&self, _scene: &Scene) -> Vec<Start> {
        Vec::new()
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        if self.readout {
            let rounded = scene.outputs.iter().zip(values).filter(|(_, step)| step.value > 0.0);
            let each: Vec<String> = rounded.map(|(y, step)| format!("`{}` to steps of {}", y.name, quantity(*step, &y.unit))).collect();
            return format!("recorded values are rounded, {}, and little noise blurs that; the model measured exactly", each.join(" and "));
        }
        if values[0].value == 0.0 {
            return "recorded speeds are means over the sampling interval, as differences of encoder counts are, and half a sample late, with counts too fine \
                    to show; the model measured at an instant"
                .to_owned();
        }
        let step = super::words::scaled(values[0], |q| q / scene.scales.period);
        format!(
            "wheel speeds are differences of encoder counts of {} of travel each: they come in steps of {} and half a sample late; the model measured exactly",
            quantity(values[0], "m"),
            quantity(step, "m/s")
        )
    }

    fn excitation(&self) -> &'static str {
        "slow driving, where a sample holds few counts"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion { with: "sensor_delay", because: "means over a sample are late by half of it; the lattice of the values tells" },
            Confusion { with: "command_delay", because: "means over a sample are late by half of it; the lattice of the values tells" },
        ]
    }

    /// Of each wheel, the distance beyond the last count; and room for sums.
    fn states(&self, _scene: &Scene) -> usize {
        4
    }

    fn measure(&self, p: &[f64], at: &Instant<'_>, past: &dyn Fn(f64, &mut [f64]), state: &mut [f64], outputs: &mut [f64]) {
        if self.readout {
            let rounded = |(x, step): (&mut f64, &f64)| *x = (*x / step).round() * step;
            return outputs.iter_mut().zip(p).filter(|(_, step)| **step > 0.0).for_each(rounded);
        }
        let span = at.interval();
        if p[0] <= 0.0 || span <= 0.0 {
            return;
        }
        let (beyond, sum) = state.split_at_mut(2);
        if at.readout == Readout::Instantaneous {
            mean(at.time - span, span, past, sum, outputs);
        }
        if !self.counts {
            return;
        }
        let frame = at.scene.frame;
        let speeds = frame.wheels(outputs);
        let mut counted = [0.0; 2];
        for ((counted, beyond), speed) in counted.iter_mut().zip(beyond).zip(speeds) {
            let travelled = *beyond + speed * span;
            *counted = (travelled / p[0]).floor() * p[0] / span;
            *beyond = travelled - *counted * span;
        }
        outputs.copy_from_slice(&frame.from_wheels(counted));
    }
}
