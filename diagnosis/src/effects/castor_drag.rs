//! A castor is dragged along: its rolling resistance acts along its own direction, which follows the motion with a delay.
//!
//! `swivel`: the castor is pivoted a distance d behind the axle and trails its pivot by l. With δ its direction seen from the robot, rolling
//! without sliding sideways gives
//!
//! δ' = −(v sin δ + d ω cos δ)/l − ω,   it rolls at v cos δ − d ω sin δ.
//!
//! Its wheel resists rolling with a force F and its pivot swivelling with a moment S sgn δ' + D δ', of dry friction and of grease. By
//! virtual power the body feels F sgn(roll) ∂roll/∂v + (S sgn δ' + D δ') ∂δ'/∂v against forward motion and ρ/h² times the same with ∂/∂ω
//! against turning: the moment at the pivot is held by a force of the ground across the wheel. A stretch begins with the castor as steady
//! motion at the first velocities would have it, and from rest as it was left there. With `soft` F comes up with the speed at which it rolls, as
//! grease in its bearing and a soft floor have it: F r/√(r² + s²).
//!
//! `ball`: a ball or a pad that does not roll slides at (v, −d ω) and feels F against that: F v/√(v² + d² ω²) against forward motion and
//! (ρ d²/h²) F ω/√(v² + d² ω²) against turning. It carries more of the weight while the robot speeds up, or less where it is ahead: F grows by τ v',
//! τ = z/(g b) with the centre of mass at the height z and b from the axle.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Motion, Scene, Stage, Start};

use super::force;
use super::words::{length, quantity, smooth_sign};

/// What kind of castor drags.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CastorKind {
    /// A wheel in a fork that swings round.
    #[default]
    Swivel,
    /// The same ahead of the axle: fitted by itself, since on the way from behind it does less and less.
    Leading,
    /// A ball or a pad that slides.
    Ball,
}

/// Drag of a castor.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CastorDrag {
    /// What kind of castor drags. Default `swivel`.
    #[serde(default)]
    pub kind: CastorKind,
    /// Whether a wheel's resistance to rolling comes up with its speed.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub soft: bool,
}

/// Places of the parameters, of a ball and of a swivelling castor.
const DRAG: usize = 0;
const DISTANCE: usize = 1;
const TRAIL: usize = 2;
const SWIVEL: usize = 3;
const DAMPING: usize = 4;
const LEFT_AT: usize = 5;
const COMES_UP: usize = 6;
/// Place of what speeding up adds to a ball's share of the weight.
const TRANSFER: usize = 2;
/// Greatest height of the centre of mass over its distance from the axle, and what it comes to on most robots.
const HIGHEST: f64 = 10.0;
const HIGH: f64 = 2.0;

/// Turn within a step below which four terms of its tangent, or hyperbolic tangent, are exact to nine digits.
const SMALL: f64 = 0.08;

/// How far from straight a castor usually stands where a robot was left \[rad\], and how far apart others are looked at.
const LEFT: f64 = 1.5;
const TURNS: [f64; 5] = [-2.0, -1.0, 1.0, 2.0, 3.0];

impl CastorDrag {
    /// Number of its parameters but for the turning ratio, which stands last.
    fn own(&self) -> usize {
        match self.kind {
            CastorKind::Swivel | CastorKind::Leading => COMES_UP + usize::from(self.soft),
            CastorKind::Ball => 3,
        }
    }

    /// A castor in a fork, with each of these trails and distances, in half tracks.
    fn pivoted(&self, scene: &Scene, places: &[(f64, f64)]) -> Vec<Start> {
        let (all, h, drag) = (self.parameters(scene), scene.frame.half_track(), 0.05 * force::command(scene, 0));
        let from = |(l, d): &(f64, f64)| Start {
            values: [drag, d * h, l * h, all[SWIVEL].scale, all[DAMPING].scale, 0.0]
                .into_iter()
                .chain(self.soft.then(|| all[COMES_UP].scale))
                .chain(all.get(self.own()).map(|_| 1.0))
                .collect(),
            columns: vec![vec![DRAG], vec![SWIVEL], vec![DAMPING]],
            linear: true,
        };
        places.iter().map(from).collect()
    }
}

#[typetag::serde(name = "castor_drag")]
impl Effect for CastorDrag {
    fn name(&self) -> &str {
        "castor_drag"
    }

    fn about(&self) -> String {
        match self.kind {
            CastorKind::Swivel if self.soft => {
                "the drag of a castor that swings round behind its pivot and comes up as it rolls faster".to_owned()
            }
            CastorKind::Swivel => "the drag of a castor that swings round behind its pivot".to_owned(),
            CastorKind::Leading => "the drag of a castor ahead of the axle that swings round behind its pivot".to_owned(),
            CastorKind::Ball => "the drag of a castor that slides, such as a ball".to_owned(),
        }
    }

    fn stage(&self) -> Stage {
        match self.kind {
            CastorKind::Swivel | CastorKind::Leading => Stage::Load,
            CastorKind::Ball => Stage::Drive,
        }
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        let wheel = (self.soft && self.kind == CastorKind::Ball).then(|| "it is set to roll and to slide: it does one of them".to_owned());
        wheel.or_else(|| force::needs_wheels(scene))
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let h = scene.frame.half_track();
        let mut all = force::sizes(scene, "drag");
        match self.kind {
            CastorKind::Swivel | CastorKind::Leading => {
                let farthest = if self.kind == CastorKind::Leading { 0.0 } else { 3.0 * h };
                all.push(EffectParameter::new("distance", "m", (-3.0 * h, farthest), 0.2 * h));
                all.push(EffectParameter::new("trail", "m", (0.02 * h, 2.0 * h), 0.1 * h));
                let units = if force::unit(scene) == "V" { ["V m", "V m s"] } else { ["m2/s", "m2"] };
                let moment = 0.005 * h * force::command(scene, 0);
                let of = |name: &str, unit: &str, size: f64| EffectParameter::new(name, unit, (0.0, f64::INFINITY), size).neutral(0.0);
                all.push(of("swivel_friction", units[0], moment));
                all.push(of("swivel_damping", units[1], moment * h / scene.scales.speed));
                let any = (-std::f64::consts::PI, std::f64::consts::PI);
                all.push(EffectParameter::new("left_at", "rad", any, 0.2).usually(0.0, LEFT).initially());
                all.extend(self.soft.then(|| force::softness(scene)));
            }
            // Ahead or behind is one to a ball.
            CastorKind::Ball => {
                all.push(EffectParameter::new("distance", "m", (0.05 * h, 3.0 * h), 0.2 * h));
                let most = HIGHEST / force::GRAVITY;
                let transfer = EffectParameter::new("transfer", "s2/m", (-most, most), 0.1 * HIGH / force::GRAVITY);
                all.push(transfer.neutral(0.0).usually(0.0, HIGH / force::GRAVITY));
            }
        }
        all.extend(force::turning_ratio(scene));
        all
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let (h, drag) = (scene.frame.half_track(), 0.05 * force::command(scene, 0));
        match self.kind {
            CastorKind::Swivel => self.pivoted(scene, &[(0.08, 1.5), (0.18, 0.9), (0.18, 1.4), (0.4, 0.8), (0.4, 1.3), (0.2, -1.1)]),
            CastorKind::Leading => self.pivoted(scene, &[(0.08, -1.5), (0.18, -1.0), (0.2, -1.6), (0.4, -1.3)]),
            CastorKind::Ball => [0.8, 1.4].into_iter().flat_map(|d| force::starts(scene, &[drag, d * h, 0.0], &[vec![DRAG]])).collect(),
        }
    }

    /// The castor left otherwise: it swings round within a trail's length, and no small step leads from one side to the other.
    fn detours(&self, values: &[f64], scene: &Scene) -> Vec<Vec<f64>> {
        if self.kind == CastorKind::Ball || !scene.tracks.iter().any(|track| track.from_rest) {
            return Vec::new();
        }
        let left_at = |turn: &f64| {
            let mut values = values.to_vec();
            values[LEFT_AT] = (values[LEFT_AT] + turn + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
            values
        };
        TURNS.iter().map(left_at).collect()
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let distance = values[DISTANCE];
        let place = if distance.value < 0.0 { "ahead of" } else { "behind" };
        let away = super::words::scaled(distance, |d| d * distance.value.signum());
        match self.kind {
            CastorKind::Swivel | CastorKind::Leading => format!(
                "a castor {} {place} the axle, trailing its pivot by {}, drags: rolling it along uses up {}{}, and its pivot {}; the model had no castor",
                quantity(away, "m"),
                quantity(values[TRAIL], "m"),
                force::in_words(values[DRAG], scene),
                force::comes_up(self.soft.then(|| values[COMES_UP])),
                if values[SWIVEL].value + values[DAMPING].value > 0.0 { "resists swivelling" } else { "swivels freely" },
            ),
            CastorKind::Ball => format!(
                "a castor that slides {} away from the axle drags: it uses up {}; the model had no castor",
                quantity(distance, "m"),
                force::in_words(values[DRAG], scene),
            ),
        }
    }

    /// Straight on what comes up with speed is the model's own: only a castor that was found is asked for it.
    fn stands_in(&self) -> bool {
        self.soft
    }

    /// As measured (`benches/stepping.rs`).
    fn effort(&self) -> u64 {
        if self.kind == CastorKind::Ball { 1 } else { 4 }
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
        match self.kind {
            CastorKind::Swivel | CastorKind::Leading => 4,
            CastorKind::Ball => 0,
        }
    }

    fn begin(&self, p: &[f64], at: &Instant<'_>, _inputs: &[f64], outputs: &[f64], state: &mut [f64]) {
        if self.kind == CastorKind::Ball {
            return;
        }
        let [v, w] = at.scene.frame.body(outputs);
        let across = p[DISTANCE] * w;
        let pivot = v.hypot(across);
        let angle = if at.track.from_rest {
            p[LEFT_AT]
        } else if pivot > 0.0 {
            (-p[TRAIL] * w / pivot).clamp(-1.0, 1.0).asin() - across.atan2(v)
        } else {
            0.0
        };
        (state[1], state[0]) = (0.5 * angle).sin_cos();
        state[2] = outputs[0];
        state[3] = outputs[1];
    }

    fn load(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], state: &[f64], load: &mut [f64]) {
        let (scene, h) = (at.scene, at.scene.frame.half_track());
        let [v, w] = scene.frame.body(outputs);
        let (typical, distance) = (scene.scales.speed, p[DISTANCE]);
        let ratio = p.get(self.own());
        if self.kind == CastorKind::Ball {
            return;
        }
        let (cos, sin) = (state[0] * state[0] - state[1] * state[1], 2.0 * state[0] * state[1]);
        let rolls = v * cos - distance * w * sin;
        let drag = p[DRAG] * if self.soft { rolls / length([rolls, p[COMES_UP]]) } else { smooth_sign(rolls, typical) };
        // ∂δ'/∂v and ∂δ'/∂ω times the trail: what the trailing wheel sweeps.
        let (by_v, by_w) = (-sin, -(distance * cos + p[TRAIL]));
        let sweep = by_v * v + by_w * w;
        let across = (p[SWIVEL] * smooth_sign(sweep, typical) + p[DAMPING] * sweep / p[TRAIL]) / p[TRAIL];
        let [forward, turn] = [drag * cos + across * by_v, -drag * distance * sin + across * by_w];
        scene.frame.add_at_body([forward, ratio.copied().unwrap_or(1.0) / (h * h) * turn], load);
    }

    fn drive(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, _state: &[f64], drive: &mut [f64]) {
        if self.kind != CastorKind::Ball {
            return;
        }
        let (frame, [th1, _]) = (at.scene.frame, force::inertia(&at.scene.frame, motion));
        let mut against = [0.0; 2];
        force::slides(at.scene, motion.outputs, [p[DRAG], p[DISTANCE]], p.get(self.own()), &mut against);
        let ([forward, _], [drag, turn]) = (frame.body(drive), frame.body(&against));
        // θ1 v' = forward − drag (1 + τ v').
        let faster = (forward - drag) / (th1 + p[TRANSFER] * drag).max(force::LEAST * th1);
        let load = (1.0 + p[TRANSFER] * faster).max(0.0);
        frame.add_at_body([-load * drag, -load * turn], drive);
    }

    /// δ' = A sin δ + B cos δ + C turns (cos δ/2, sin δ/2) by y' = M y/2 with M = [−A, B − C; B + C, A] and M² = (A² + B² − C²) I, at
    /// velocities in the middle of the span.
    fn advance(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, _drive: &[f64], state: &mut [f64]) {
        if self.kind == CastorKind::Ball {
            return;
        }
        let outputs = motion.outputs;
        let middle = [0.5 * (state[2] + outputs[0]), 0.5 * (state[3] + outputs[1])];
        state[2..4].copy_from_slice(&outputs[..2]);
        let [v, w] = at.scene.frame.body(&middle);
        let (a, b, c) = (-v / p[TRAIL], -p[DISTANCE] * w / p[TRAIL], -w);
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
