//! The drive weakens with time: U' = (1 − k (t − t0)) U, with t0 the recording's first time.
//!
//! With `settles` it weakens quickly first and then slowly, as a supply does that has just been charged: U' = (1 − K (1 − e^{−(t − t0)/τ})) U.
//!
//! With `servo` it is the gain of the speed loops that weakens, and not what they are told alone: the drive loses that share of u − x, x what
//! the robot does.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Motion, Scene, Stage, Start};

use super::force;
use super::words::{digits, quantity, scaled};

/// A supply that runs down, or anything else that changes the gain of all commands in proportion to time.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BatterySag {
    /// The loops weaken, not their commands. Default `false`.
    #[serde(default)]
    pub servo: bool,
    /// Quickly first, then slowly. Default `false`.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub settles: bool,
}

/// Times in which a supply settles that are tried, as shares of the recording, and the shortest and the longest that are told: less is a
/// step, more is steady.
const TIMES: [f64; 3] = [0.1, 0.25, 0.6];
const TOLD: (f64, f64) = (0.02, 2.0);

impl BatterySag {
    /// What is lost at a time. On a recording that ends later than the one it was found on, a drive still does not turn round.
    fn lost(&self, p: &[f64], at: &Instant<'_>) -> f64 {
        let since = at.time - at.scene.scales.time.0;
        if self.settles { -p[0] * (-since / p[1]).exp_m1() } else { (p[0] * since).min(1.0) }
    }
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
        let how = if self.settles { "with time, quickly first" } else { "steadily with time" };
        match self.servo {
            false => format!("all commands lose effect {how}"),
            true => format!("the speed loops weaken {how}"),
        }
    }

    fn stage(&self) -> Stage {
        if self.servo { Stage::Drive } else { Stage::Gain }
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        if self.servo { force::needs_loops(scene) } else { None }
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        // At the end nothing is left of the drive, or it is twice as strong: beyond that it is no sag. A supply that settles falls.
        let per_second = 1.0 / duration(scene);
        if self.settles {
            let (shortest, longest) = (TOLD.0 / per_second, TOLD.1 / per_second);
            return vec![
                EffectParameter::new("lost", "1", (0.0, 1.0), 0.03).neutral(0.0),
                EffectParameter::new("settling_time", "s", (shortest, longest), 0.05 / per_second),
            ];
        }
        vec![EffectParameter::new("sag", "1/s", (-per_second, per_second), 0.03 * per_second).neutral(0.0)]
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let start = |values| Start { values, columns: vec![vec![0]], linear: true };
        if self.settles {
            return TIMES.iter().map(|share| start(vec![0.03, share * duration(scene)])).collect();
        }
        vec![start(vec![0.03 / duration(scene)])]
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let k = values[0];
        let what = if self.servo { "the speed loops" } else { "commands" };
        let size = |unit: f64| quantity(scaled(k, |x| unit * x * k.value.signum()), "%");
        if let (true, Some(time)) = (self.settles, values.get(1)) {
            let time = quantity(*time, "s");
            return format!(
                "{what} lose {} of their effect, quickly first, most of it within {time}; the model's drive stayed the same",
                size(100.0)
            );
        }
        let verb = if k.value < 0.0 { "gain" } else { "lose" };
        let a_minute = size(6000.0);
        let total = digits(100.0 * (k.value * duration(scene)).abs());
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
        let lost = if self.servo { 0.0 } else { self.lost(p, at) };
        u.iter_mut().for_each(|u| *u -= lost * *u);
    }

    fn drive(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, _state: &[f64], drive: &mut [f64]) {
        let lost = if self.servo { self.lost(p, at) } else { 0.0 };
        drive.iter_mut().zip(motion.u.iter().zip(motion.outputs)).for_each(|(drive, (u, x))| *drive -= lost * (u - x));
    }
}
