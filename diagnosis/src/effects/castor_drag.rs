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
use super::swivel::{self, Swivel};
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

/// By what share more a ball carries for every unit of acceleration.
pub(super) fn transfer() -> EffectParameter {
    let (most, usual) = (HIGHEST / force::GRAVITY, HIGH / force::GRAVITY);
    EffectParameter::new("transfer", "s2/m", (-most, most), 0.1 * usual).neutral(0.0).usually(0.0, usual)
}

/// A castor in a fork.
fn pivot(p: &[f64]) -> Swivel {
    Swivel { distance: p[DISTANCE], trail: p[TRAIL], left_at: p[LEFT_AT] }
}

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
                all.extend(swivel::place(scene, self.kind == CastorKind::Leading));
                let units = if force::unit(scene) == "V" { ["V m", "V m s"] } else { ["m2/s", "m2"] };
                let moment = 0.005 * h * force::command(scene, 0);
                let of = |name: &str, unit: &str, size: f64| EffectParameter::new(name, unit, (0.0, f64::INFINITY), size).neutral(0.0);
                all.push(of("swivel_friction", units[0], moment));
                all.push(of("swivel_damping", units[1], moment * h / scene.scales.speed));
                all.push(swivel::left_at());
                all.extend(self.soft.then(|| force::softness(scene)));
            }
            // Ahead or behind is one to a ball.
            CastorKind::Ball => {
                all.push(EffectParameter::new("distance", "m", (0.05 * h, 3.0 * h), 0.2 * h));
                all.push(transfer());
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

    fn detours(&self, values: &[f64], scene: &Scene) -> Vec<Vec<f64>> {
        if self.kind == CastorKind::Ball { Vec::new() } else { swivel::left_otherwise(values, LEFT_AT, scene) }
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

    fn states(&self, _scene: &Scene) -> usize {
        if self.kind == CastorKind::Ball { 0 } else { swivel::STATES }
    }

    fn begin(&self, p: &[f64], at: &Instant<'_>, _inputs: &[f64], outputs: &[f64], state: &mut [f64]) {
        if self.kind != CastorKind::Ball {
            pivot(p).begin(at, outputs, state);
        }
    }

    fn load(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], state: &[f64], load: &mut [f64]) {
        if self.kind == CastorKind::Ball {
            return;
        }
        let (scene, h) = (at.scene, at.scene.frame.half_track());
        let velocity @ [v, w] = scene.frame.body(outputs);
        let (typical, ratio) = (scene.scales.speed, p.get(self.own()));
        let drag = |rolls: f64| p[DRAG] * if self.soft { rolls / length([rolls, p[COMES_UP]]) } else { smooth_sign(rolls, typical) };
        let dragged = pivot(p).dragged(velocity, state, drag);
        // ∂δ'/∂v and ∂δ'/∂ω times the trail: what the trailing wheel sweeps.
        let [cos, sin] = Swivel::direction(state);
        let (by_v, by_w) = (-sin, -(p[DISTANCE] * cos + p[TRAIL]));
        let sweep = by_v * v + by_w * w;
        let across = (p[SWIVEL] * smooth_sign(sweep, typical) + p[DAMPING] * sweep / p[TRAIL]) / p[TRAIL];
        let [forward, turn] = [dragged[0] + across * by_v, dragged[1] + across * by_w];
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

    fn advance(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, _drive: &[f64], state: &mut [f64]) {
        if self.kind != CastorKind::Ball {
            pivot(p).advance(at, motion, state);
        }
    }
}
