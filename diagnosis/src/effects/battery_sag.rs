//! The drive weakens with time: U' = (1 − k (t − t0)) U, with t0 the recording's first time.
//!
//! With `servo` it is the gain of the speed loops that weakens, and not what they are told alone: the drive loses k (t − t0) (u − x), x what
//! the robot does.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Motion, Scene, Stage, Start};

use super::words::quantity;

/// A supply that runs down, or anything else that changes the gain of all commands in proportion to time.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BatterySag {
    /// The loops weaken, not their commands. Default `false`.
    #[serde(default)]
    pub servo: bool,
}

/// What is lost at a time. On a recording that ends later than the one it was found on, a drive still does not turn round.
fn lost(sag: f64, at: &Instant<'_>) -> f64 {
    (sag * (at.time - at.scene.scales.time.0)).min(1.0)
}

/// Seconds from the first to the last sample.
fn duration(scene: &Scene) -> f64 {
    scene.scales.time.1 - scene.scales.time.0
}

#[typetag::serde(name = "battery_sag")]
impl Effect for BatterySag {
    fn name(&self) -> &str {
        "battery_sag"
    }

    fn about(&self) -> String {
        match self.servo {
            false => "all commands lose effect steadily with time".to_owned(),
            true => "the speed loops weaken steadily with time".to_owned(),
        }
    }

    fn stage(&self) -> Stage {
        if self.servo { Stage::Drive } else { Stage::Gain }
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        (self.servo && !matches!(scene.frame, Frame::Body { .. }))
            .then(|| "the robot is not commanded by velocities: no loop keeps a wheel's rate".to_owned())
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        // At the end nothing is left of the drive, or it is twice as strong: beyond that it is no sag.
        let per_second = 1.0 / duration(scene);
        vec![EffectParameter::new("sag", "1/s", (-per_second, per_second), 0.03 * per_second).neutral(0.0)]
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        vec![Start { values: vec![0.03 / duration(scene)], columns: vec![vec![0]], linear: true }]
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let k = values[0];
        let percent = |x: f64| 6000.0 * x * if k.value < 0.0 { -1.0 } else { 1.0 };
        let ends = k.ci95.map(|(a, b)| (percent(a).min(percent(b)), percent(a).max(percent(b))));
        let a_minute = quantity(Estimate { value: percent(k.value), ci95: ends }, "%");
        let verb = if k.value < 0.0 { "gain" } else { "lose" };
        let total = super::words::digits(100.0 * (k.value * duration(scene)).abs());
        let what = if self.servo { "the speed loops" } else { "commands" };
        format!("{what} {verb} {a_minute} of their effect a minute, {total} % over the recording; the model's drive stayed the same")
    }

    fn excitation(&self) -> &'static str {
        "the same driving at the beginning and at the end of a long recording"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "payload_change",
                because: "if accelerations are few, a step in the middle and a steady change differ in the shape of their trend only",
            },
            Confusion {
                with: "viscous_asymmetry",
                because: "a recording that drives one way first and the other way later makes a change with time out of one with direction",
            },
        ]
    }

    fn command(&self, p: &[f64], at: &Instant<'_>, _outputs: &[f64], _state: &mut [f64], u: &mut [f64]) {
        let lost = if self.servo { 0.0 } else { lost(p[0], at) };
        u.iter_mut().for_each(|u| *u -= lost * *u);
    }

    fn drive(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, _state: &[f64], drive: &mut [f64]) {
        let lost = if self.servo { lost(p[0], at) } else { 0.0 };
        drive.iter_mut().zip(motion.u.iter().zip(motion.outputs)).for_each(|(drive, (u, x))| *drive -= lost * (u - x));
    }
}
