//! Friction that comes up with the way since the last reversal: what rubs bends before it slides.
//!
//! With x what has come up of it, of −1 to 1, d the length of the bend and g(s) what holds at the speed s as a share of what holds at standstill,
//! x' = (s − |s| x/g(s))/d: Dahl's law of 1968 where g is one, and LuGre (Canudas de Wit, Olsson, Åström and Lischinsky, IEEE Transactions on Automatic
//! Control 40, 1995) without damping. Over a way at one speed x nears g sgn s exponentially.

use wheelwright_core::effect::{EffectParameter, Estimate, Instant, Motion, Scene};

use super::words::quantity;

/// Of each wheel what has come up, and its speed before.
pub(super) const STATES: usize = 4;

/// The way in which 63 % of the friction comes up from nothing.
pub(super) fn length(scene: &Scene) -> EffectParameter {
    let h = scene.frame.half_track();
    EffectParameter::new("presliding", "m", (1e-4 * h, 0.5 * h), 0.02 * h)
}

/// How it comes up, in words.
pub(super) fn comes_up(over: Estimate) -> String {
    format!(", not at once but with the way since a reversal: two thirds of it after {}", quantity(over, "m"))
}

/// What moves slides already; what stands bends neither way. `reach` is what holds at a speed, as a share of what holds at standstill.
pub(super) fn begin(at: &Instant<'_>, outputs: &[f64], state: &mut [f64], reach: impl Fn(f64) -> f64) {
    let speeds = at.scene.frame.wheels(outputs);
    for (i, speed) in speeds.into_iter().enumerate() {
        state[i] = if speed == 0.0 { 0.0 } else { speed.signum() * reach(speed) };
        state[2 + i] = speed;
    }
}

/// Lets them bend by the way at the mean speed of a span.
pub(super) fn advance(length: f64, at: &Instant<'_>, motion: &Motion<'_>, state: &mut [f64], reach: impl Fn(f64) -> f64) {
    let speeds = at.scene.frame.wheels(motion.outputs);
    for (i, speed) in speeds.into_iter().enumerate() {
        let mean = 0.5 * (state[2 + i] + speed);
        let (way, reach) = (mean * at.span, reach(mean));
        let full = way.signum() * reach;
        state[i] = full + (state[i] - full) * (-way.abs() / (length * reach)).exp();
        state[2 + i] = speed;
    }
}

/// What a friction of this size, which holds at standstill, takes at each wheel.
pub(super) fn load(size: f64, at: &Instant<'_>, state: &[f64], ratio: Option<&f64>, load: &mut [f64]) {
    at.scene.frame.add_at_wheels([0, 1].map(|wheel: usize| size * state[wheel]), ratio.copied().unwrap_or(1.0), load);
}
