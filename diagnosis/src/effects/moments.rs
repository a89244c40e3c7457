//! Times at which something changes for good: where they are tried, and how they are told.

use wheelwright_core::effect::{EffectParameter, Estimate, Instant, Scene};

use super::words::percent;

/// Times that are tried, as shares of the recording; a change nearer to an end has too little on one side of it.
pub(super) const SHARES: [f64; 15] = [0.08, 0.14, 0.20, 0.26, 0.32, 0.38, 0.44, 0.50, 0.56, 0.62, 0.68, 0.74, 0.80, 0.86, 0.92];
/// How far from a fitted time others are looked at, as shares of the recording: out to the next of [`SHARES`], and close.
const NEARBY: [f64; 9] = [0.001, 0.002, 0.004, 0.008, 0.015, 0.022, 0.03, 0.045, 0.06];
/// Share of the recording at either end in which no change is told.
const MARGIN: f64 = 0.02;

/// Seconds from the first to the last sample.
pub(super) fn duration(scene: &Scene) -> f64 {
    scene.scales.time.1 - scene.scales.time.0
}

/// A time some share into the recording.
pub(super) fn at(share: f64, scene: &Scene) -> f64 {
    scene.scales.time.0 + share * duration(scene)
}

/// The share of the recording before a time.
pub(super) fn into(time: Estimate, scene: &Scene) -> String {
    percent((time.value - scene.scales.time.0) / duration(scene))
}

/// The time of a change. A change at either end is none: what it changes has to be seen before and after.
pub(super) fn parameter(scene: &Scene) -> EffectParameter {
    EffectParameter::new("time_s", "s", (at(MARGIN, scene), at(1.0 - MARGIN, scene)), MARGIN * duration(scene))
}

/// How far from a fitted time others are worth a look \[s\].
pub(super) fn nearby(scene: &Scene) -> impl Iterator<Item = f64> + Clone + use<> {
    let whole = duration(scene);
    NEARBY.into_iter().flat_map(move |share| [-share * whole, share * whole])
}

/// Whether a time has passed. One this close to a sample has not cut the interval.
pub(super) fn passed(time: f64, at: &Instant<'_>) -> bool {
    at.time >= time - 2e-9 * at.scene.scales.period
}

/// A time to a hundredth of a second.
pub(super) fn when(time: Estimate) -> String {
    match time.ci95 {
        Some((from, to)) => format!("{:.2} s ({from:.2} to {to:.2})", time.value),
        None => format!("{:.2} s", time.value),
    }
}
