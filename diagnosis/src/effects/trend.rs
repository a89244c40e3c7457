//! What changes quickly first and then slowly, as a charged supply falls and grease warms up: what is left of it at a time, and where it is tried.

use wheelwright_core::effect::{EffectParameter, Instant, Scene};

use super::moments::duration;

/// Time constants that are tried, as shares of the recording.
const TIMES: [f64; 3] = [0.1, 0.25, 0.6];
/// The shortest and the longest that are told, as shares of the recording: less is a step, more is steady.
const TOLD: (f64, f64) = (0.02, 2.0);

/// The time constant.
pub(super) fn parameter(name: &str, scene: &Scene) -> EffectParameter {
    let whole = duration(scene);
    EffectParameter::new(name, "s", (TOLD.0 * whole, TOLD.1 * whole), 0.05 * whole)
}

/// Time constants that are tried \[s\].
pub(super) fn times(scene: &Scene) -> [f64; 3] {
    TIMES.map(|share| share * duration(scene))
}

/// What share of the change is still to come, with this time constant.
pub(super) fn left(time: f64, at: &Instant<'_>) -> f64 {
    (-(at.time - at.scene.scales.time.0) / time).exp()
}
