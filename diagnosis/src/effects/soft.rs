//! Limits that are approached and not met.

use wheelwright_core::effect::EffectParameter;

/// How hard a soft limit may be: below, it is a drag in proportion to speed's square; above, it is a limit.
const HARDNESS: (f64, f64) = (1.5, 12.0);
/// How hard it is at first.
pub(super) const HARD: f64 = 3.0;

/// How hard a soft limit is.
pub(super) fn hardness() -> EffectParameter {
    EffectParameter::new("hardness", "1", HARDNESS, 0.5)
}

/// A value that bends towards a limit.
pub(super) fn bent(value: f64, limit: f64, hardness: f64) -> f64 {
    value * (1.0 + (value / limit).abs().powf(hardness)).powf(-1.0 / hardness)
}
