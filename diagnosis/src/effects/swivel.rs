//! A castor's wheel swings round behind its pivot. With the pivot a distance d behind the axle, a trail l and δ the wheel's direction seen from the
//! robot, rolling without sliding sideways gives
//!
//! δ' = −(v sin δ + d ω cos δ)/l − ω,   it rolls at v cos δ − d ω sin δ.
//!
//! A stretch begins with the castor as steady motion at the first velocities would have it, and from rest as it was left there.

use wheelwright_core::effect::{EffectParameter, Instant, Motion, Scene};

use super::words::length;

/// Turn within a step below which four terms of its tangent, or hyperbolic tangent, are exact to nine digits.
const SMALL: f64 = 0.08;

/// How far from straight a castor usually stands where a robot was left \[rad\], and how far apart others are looked at.
const LEFT: f64 = 1.5;
const TURNS: [f64; 5] = [-2.0, -1.0, 1.0, 2.0, 3.0];

/// Where its pivot is, and how it was left.
#[derive(Debug, Clone, Copy)]
pub(super) struct Swivel {
    /// From the axle backwards \[m\].
    pub(super) distance: f64,
    /// Of the wheel behind its pivot \[m\].
    pub(super) trail: f64,
    /// Its direction where the robot was at rest \[rad\].
    pub(super) left_at: f64,
}

/// What it keeps: cos δ/2 and sin δ/2, in which the swinging round is linear, and the outputs before.
pub(super) const STATES: usize = 4;

/// Distance and trail of one behind the axle, or ahead of it: fitted by itself, since on the way from the one to the other it does less and less.
pub(super) fn place(scene: &Scene, ahead: bool) -> [EffectParameter; 2] {
    let h = scene.frame.half_track();
    let farthest = if ahead { 0.0 } else { 3.0 * h };
    [EffectParameter::new("distance", "m", (-3.0 * h, farthest), 0.2 * h), EffectParameter::new("trail", "m", (0.02 * h, 2.0 * h), 0.1 * h)]
}

/// How it was left.
pub(super) fn left_at() -> EffectParameter {
    let any = (-std::f64::consts::PI, std::f64::consts::PI);
    EffectParameter::new("left_at", "rad", any, 0.2).usually(0.0, LEFT).initially()
}

/// Values with the castor left otherwise: it swings round within a trail's length, and no small step leads from one side to the other.
pub(super) fn left_otherwise(values: &[f64], left_at: usize, scene: &Scene) -> Vec<Vec<f64>> {
    if !scene.tracks.iter().any(|track| track.from_rest) {
        return Vec::new();
    }
    let turned = |turn: &f64| {
        let mut values = values.to_vec();
        values[left_at] = (values[left_at] + turn + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
        values
    };
    TURNS.iter().map(turned).collect()
}

impl Swivel {
    /// The state where a stretch begins.
    pub(super) fn begin(&self, at: &Instant<'_>, outputs: &[f64], state: &mut [f64]) {
        let [v, w] = at.scene.frame.body(outputs);
        let across = self.distance * w;
        let pivot = v.hypot(across);
        let angle = if at.track.from_rest {
            self.left_at
        } else if pivot > 0.0 {
            (-self.trail * w / pivot).clamp(-1.0, 1.0).asin() - across.atan2(v)
        } else {
            0.0
        };
        (state[1], state[0]) = (0.5 * angle).sin_cos();
        state[2] = outputs[0];
        state[3] = outputs[1];
    }

    /// Cosine and sine of its direction.
    pub(super) fn direction(state: &[f64]) -> [f64; 2] {
        [state[0] * state[0] - state[1] * state[1], 2.0 * state[0] * state[1]]
    }

    /// What a drag against its rolling, of this size at a speed of it, takes from forward motion and as a moment from turning.
    pub(super) fn dragged(&self, [v, w]: [f64; 2], state: &[f64], drag: impl Fn(f64) -> f64) -> [f64; 2] {
        let [cos, sin] = Self::direction(state);
        let drag = drag(v * cos - self.distance * w * sin);
        [drag * cos, -drag * self.distance * sin]
    }

    /// δ' = A sin δ + B cos δ + C turns (cos δ/2, sin δ/2) by y' = M y/2 with M = [−A, B − C; B + C, A] and M² = (A² + B² − C²) I, at
    /// velocities in the middle of the span.
    pub(super) fn advance(&self, at: &Instant<'_>, motion: &Motion<'_>, state: &mut [f64]) {
        let outputs = motion.outputs;
        let middle = [0.5 * (state[2] + outputs[0]), 0.5 * (state[3] + outputs[1])];
        state[2..STATES].copy_from_slice(&outputs[..2]);
        let [v, w] = at.scene.frame.body(&middle);
        let (a, b, c) = (-v / self.trail, -self.distance * w / self.trail, -w);
        let half = 0.5 * at.span;
        let square = half * half * (a * a + b * b - c * c);
        let size = square.abs().sqrt();
        // Of exp(M half) only the direction counts: divided by the hyperbolic cosine it does not overflow.
        let (kept, turned) = match (size < SMALL, square > 0.0) {
            (true, _) => (1.0, half * (1.0 - square * (1.0 / 3.0 - square * (2.0 / 15.0 - square * 17.0 / 315.0)))),
            (false, true) => (1.0, half * size.tanh() / size),
            (false, false) => (size.cos(), half * size.sin() / size),
        };
        let (x, y) = (state[0], state[1]);
        let (x, y) = (kept * x + turned * (-a * x + (b - c) * y), kept * y + turned * ((b + c) * x + a * y));
        let size = length([x, y]);
        if size > 0.0 && size.is_finite() {
            state[0] = x / size;
            state[1] = y / size;
        }
    }
}
