//! A castor is dragged along: its rolling resistance F acts along its own direction, which follows the motion with a delay.
//!
//! The castor is pivoted a distance d behind the axle and trails its pivot by l. With δ its direction seen from the robot, rolling
//! without sliding sideways gives
//!
//! δ' = −(v sin δ + d ω cos δ)/l − ω,   it rolls at v cos δ − d ω sin δ,
//!
//! and the body feels F sgn(roll) cos δ against forward motion and (ρ d/h²) F sgn(roll) sin δ with turning. A stretch begins with
//! the castor as steady motion at the first velocities would have it, and straight from rest.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};

use super::force;
use super::words::{quantity, smooth_sign};

/// Drag of a castor.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CastorDrag {}

/// Places of the parameters.
const DRAG: usize = 0;
const TRAIL: usize = 1;
const DISTANCE: usize = 2;
const RATIO: usize = 3;

#[typetag::serde(name = "castor_drag")]
impl Effect for CastorDrag {
    fn name(&self) -> &str {
        "castor_drag"
    }

    fn about(&self) -> String {
        "the drag of a castor that swings round behind its pivot".to_owned()
    }

    fn stage(&self) -> Stage {
        Stage::Load
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        force::needs_wheels(scene)
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let h = scene.frame.half_track();
        let mut all = force::sizes(scene, "drag");
        all.push(EffectParameter::new("trail", "m", (0.05 * h, 2.0 * h), 0.1 * h));
        all.push(EffectParameter::new("distance", "m", (-3.0 * h, 3.0 * h), 0.2 * h));
        all.extend(force::turning_ratio(scene));
        all
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let (h, drag) = (scene.frame.half_track(), 0.05 * force::command(scene, 0));
        let from = |(l, d): (f64, f64)| force::starts(scene, &[drag, l * h, d * h], &[vec![DRAG]]);
        [(0.18, 0.8), (0.18, 1.3), (0.4, 0.8), (0.4, 1.3), (0.28, -1.1)].into_iter().flat_map(from).collect()
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let distance = values[DISTANCE];
        let place = if distance.value < 0.0 { "ahead of" } else { "behind" };
        let away = super::words::scaled(distance, |d| d * distance.value.signum());
        format!(
            "a castor {} {place} the axle, trailing its pivot by {}, drags: rolling it along uses up {}; the model had no castor",
            quantity(away, "m"),
            quantity(values[TRAIL], "m"),
            force::in_words(values[DRAG], scene),
        )
    }

    fn excitation(&self) -> &'static str {
        "reversals and turns in place, after which the castor has to swing round"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion { with: "rolling_resistance", because: "on the straight the castor's drag is a constant force against the motion" },
            Confusion {
                with: "coulomb_friction",
                because: "without reversals the swinging round is not seen, and what is left brakes both motions",
            },
            Confusion { with: "turning_scrub", because: "in gentle curves the castor's sideways pull is a moment against turning" },
            Confusion { with: "theta6", because: "as long as it trails, its moment is nearly proportional to the turning rate" },
        ]
    }

    /// cos δ/2 and sin δ/2, in which the swinging round is linear, and the outputs before.
    fn states(&self, _scene: &Scene) -> usize {
        4
    }

    fn begin(&self, p: &[f64], at: &Instant<'_>, _inputs: &[f64], outputs: &[f64], state: &mut [f64]) {
        let [v, w] = at.scene.frame.body(outputs);
        let across = p[DISTANCE] * w;
        let pivot = v.hypot(across);
        let angle = if pivot > 0.0 { (-p[TRAIL] * w / pivot).clamp(-1.0, 1.0).asin() - across.atan2(v) } else { 0.0 };
        (state[1], state[0]) = (0.5 * angle).sin_cos();
        state[2] = outputs[0];
        state[3] = outputs[1];
    }

    fn load(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], state: &[f64], load: &mut [f64]) {
        let (scene, h) = (at.scene, at.scene.frame.half_track());
        let [v, w] = scene.frame.body(outputs);
        let (cos, sin) = (state[0] * state[0] - state[1] * state[1], 2.0 * state[0] * state[1]);
        let drag = p[DRAG] * smooth_sign(v * cos - p[DISTANCE] * w * sin, scene.scales.speed);
        let lever = p.get(RATIO).copied().unwrap_or(1.0) * p[DISTANCE] / (h * h);
        scene.frame.add_at_body([drag * cos, -lever * drag * sin], load);
    }

    /// δ' = A sin δ + B cos δ + C turns (cos δ/2, sin δ/2) by y' = M y/2 with M = [−A, B − C; B + C, A] and M² = (A² + B² − C²) I, at
    /// velocities in the middle of the span.
    fn advance(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], _drive: &[f64], state: &mut [f64]) {
        let middle = [0.5 * (state[2] + outputs[0]), 0.5 * (state[3] + outputs[1])];
        state[2..4].copy_from_slice(&outputs[..2]);
        let [v, w] = at.scene.frame.body(&middle);
        let (a, b, c) = (-v / p[TRAIL], -p[DISTANCE] * w / p[TRAIL], -w);
        let half = 0.5 * at.span;
        let square = half * half * (a * a + b * b - c * c);
        let size = square.abs().sqrt();
        // Of exp(M half) only the direction counts: divided by the hyperbolic cosine it does not overflow.
        let (kept, turned) = match (size < 1e-9, square > 0.0) {
            (true, _) => (1.0, half),
            (false, true) => (1.0, half * size.tanh() / size),
            (false, false) => (size.cos(), half * size.sin() / size),
        };
        let (x, y) = (state[0], state[1]);
        let (x, y) = (kept * x + turned * (-a * x + (b - c) * y), kept * y + turned * ((b + c) * x + a * y));
        let length = x.hypot(y);
        if length > 0.0 && length.is_finite() {
            state[0] = x / length;
            state[1] = y / length;
        }
    }
}
