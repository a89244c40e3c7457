//! Stamps are off: what is recorded at t is what was at t + σ ε, ε of unit variance and independent from sample to sample.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};

use super::words::quantity;

/// Stamps set by a busy computer.
///
/// On the average nothing changes (a delay that all samples share is `sensor_delay`): what σ adds is scatter in proportion to the
/// acceleration, of variance σ² a². By that it is found, not by any fit, and it has no starts for one. With `seed` the scatter is
/// simulated.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TimestampJitter {
    /// Seed of a simulated scatter; none is simulated without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
}

#[typetag::serde(name = "timestamp_jitter")]
impl Effect for TimestampJitter {
    fn name(&self) -> &str {
        "timestamp_jitter"
    }

    fn about(&self) -> String {
        "the stamps of the samples are off by chance".to_owned()
    }

    fn stage(&self) -> Stage {
        Stage::Reading
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let period = scene.scales.period;
        vec![EffectParameter::new("sigma", "s", (0.0, 3.0 * period), 0.1 * period).neutral(0.0)]
    }

    fn starts(&self, _scene: &Scene) -> Vec<Start> {
        Vec::new()
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let share = super::words::digits(100.0 * values[0].value / scene.scales.period);
        format!(
            "the samples' stamps are off by {} (one standard deviation, {share} % of the sampling interval): the scatter grows with acceleration; the model's clock was exact",
            quantity(values[0], "s")
        )
    }

    fn excitation(&self) -> &'static str {
        "strong accelerations beside steady driving"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[Confusion {
            with: "wheel_eccentricity",
            because: "at a sampling rate near the wheel's turning rate the ripple looks like scatter of the stamps",
        }]
    }

    /// Room for the outputs now.
    fn states(&self, scene: &Scene) -> usize {
        scene.outputs.len()
    }

    fn measure(&self, p: &[f64], at: &Instant<'_>, past: &dyn Fn(f64, &mut [f64]), state: &mut [f64], outputs: &mut [f64]) {
        let Some(seed) = self.seed else { return };
        let off = p[0] * normal(seed, at.row, at.stretch.time[0]);
        // From the slope over as long a past: what is still to come goes on as it came.
        state.copy_from_slice(outputs);
        past(at.time - off.abs(), outputs);
        outputs.iter_mut().zip(state).for_each(|(x, now)| *x = if off < 0.0 { *x } else { 2.0 * *now - *x });
    }
}

/// A standard normal number that belongs to a row: from two uniform ones by Box and Muller.
fn normal(seed: u64, row: usize, start: f64) -> f64 {
    let first = scramble(seed ^ start.to_bits() ^ (row as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let uniform = |bits: u64| ((bits >> 11) as f64 + 0.5) / (1_u64 << 53) as f64;
    (-2.0 * uniform(first).ln()).sqrt() * (std::f64::consts::TAU * uniform(scramble(first))).cos()
}

/// SplitMix64 (Steele, Lea, Flood 2014).
fn scramble(seed: u64) -> u64 {
    let mut z = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
