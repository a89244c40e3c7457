//! Rolling resistance: every wheel resists in proportion to the load that it carries.
//!
//! The driven wheels' share acts on each against its own rolling, F = d sgn s, and is therefore dry friction at the wheels to the letter
//! (`coulomb_friction`, same equation, same signs). What tells them apart is the share w of the weight that other wheels carry along on the
//! centre line, a distance d from the axle: there the robot moves at (v, d ω), and feels F = c against that, c v/√(v² + d² ω²) against forward
//! motion and (ρ d²/h²) c ω/√(v² + d² ω²) against turning; near the axle it is c sgn v without a lever to brake a turn. Of a resistance r to straight
//! driving the driven wheels have (1 − w) r and the others w r. The share is not known beforehand, but at most a half: a robot's weight is nearer to its
//! driven wheels, or they would not move it. One that drags by more than its weight is `castor_drag`, as is how it swings round; how patches scrub is
//! `turning_scrub`.
//!
//! With `castor` it is told what the others are. A `swivel` or `leading` one rolls along where it has swung round to, as in `castor_drag`. A `ball` goes the way of
//! its place, as above, and carries more while the robot speeds up, w (1 + τ v'), which the driven wheels carry less.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Motion, Scene, Stage, Start};

use super::castor_drag::{self, CastorKind};
use super::force;
use super::swivel::{self, Swivel};
use super::words::{quantity, scaled, smooth_sign};

/// Places of the parameters; the turning ratio stands last, where there is one.
const RESISTANCE: usize = 0;
const CARRIED: usize = 1;
const DISTANCE: usize = 2;
const TRAIL: usize = 3;
const LEFT_AT: usize = 4;
/// Place of what speeding up adds to a ball's share of the weight.
const TRANSFER: usize = 3;
/// Share of the weight that other wheels carry on most robots, and the most that they do.
const SHARE: f64 = 0.25;
const MOST: f64 = 0.5;

/// Rolling resistance.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RollingResistance {
    /// What carries the rest of the weight. Default: nothing is known of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub castor: Option<CastorKind>,
}

/// A castor in a fork.
fn pivot(p: &[f64]) -> Swivel {
    Swivel { distance: p[DISTANCE], trail: p[TRAIL], left_at: p[LEFT_AT] }
}

impl RollingResistance {
    /// Number of its parameters but for the turning ratio.
    fn own(&self) -> usize {
        match self.castor {
            None => TRANSFER,
            Some(CastorKind::Ball) => TRANSFER + 1,
            Some(CastorKind::Swivel | CastorKind::Leading) => LEFT_AT + 1,
        }
    }

    fn swivels(&self) -> bool {
        matches!(self.castor, Some(CastorKind::Swivel | CastorKind::Leading))
    }
}

#[typetag::serde(name = "rolling_resistance")]
impl Effect for RollingResistance {
    fn name(&self) -> &str {
        "rolling_resistance"
    }

    fn about(&self) -> String {
        let what = match self.castor {
            None => "",
            Some(CastorKind::Ball) => ", among them a ball",
            Some(CastorKind::Swivel) => ", among them a castor that swings round",
            Some(CastorKind::Leading) => ", among them a castor ahead of the axle that swings round",
        };
        format!("a constant force of every wheel that carries load, driven or not{what}")
    }

    fn stage(&self) -> Stage {
        if self.castor == Some(CastorKind::Ball) { Stage::Drive } else { Stage::Bearing }
    }

    fn family(&self) -> &str {
        "friction"
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        force::needs_wheels(scene)
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let h = scene.frame.half_track();
        let carried = EffectParameter::new("carried", "1", (0.0, MOST), 0.2 * SHARE).usually(SHARE, SHARE);
        let mut all: Vec<EffectParameter> = force::sizes(scene, "resistance").into_iter().chain([carried]).collect();
        if self.swivels() {
            all.extend(swivel::place(scene, self.castor == Some(CastorKind::Leading)));
            all.push(swivel::left_at());
        } else {
            // Ahead or behind is one. Where nobody knows, near the axle.
            all.push(EffectParameter::new("distance", "m", (0.0, 3.0 * h), 0.2 * h).usually(0.0, h));
            all.extend((self.castor == Some(CastorKind::Ball)).then(castor_drag::transfer));
        }
        all.into_iter().chain(force::turning_ratio(scene)).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let (size, h) = (0.05 * force::command(scene, 0), scene.frame.half_track());
        let at = |places: &[f64]| force::starts(scene, &[&[size, SHARE], places].concat(), &[vec![RESISTANCE]]);
        let straight = |d: f64, l: f64| Start {
            values: force::with_ratio(scene, &[size, SHARE, d * h, l * h, 0.0]),
            columns: vec![vec![RESISTANCE]],
            linear: true,
        };
        match self.castor {
            None => [0.0, h].into_iter().flat_map(|distance| at(&[distance])).collect(),
            Some(CastorKind::Ball) => at(&[h, 0.0]),
            Some(CastorKind::Swivel) => vec![straight(1.2, 0.2)],
            Some(CastorKind::Leading) => vec![straight(-1.2, 0.2)],
        }
    }

    fn detours(&self, values: &[f64], scene: &Scene) -> Vec<Vec<f64>> {
        if self.swivels() { swivel::left_otherwise(values, LEFT_AT, scene) } else { Vec::new() }
    }

    /// What a castor's kind adds is little: it is asked for where that resistance, or friction and a castor beside it, were found.
    fn stands_in(&self) -> bool {
        self.castor.is_some()
    }

    fn at_once(&self) -> Option<[&'static str; 2]> {
        self.castor.map(|_| ["friction", "castor_drag"])
    }

    fn effort(&self) -> u64 {
        if self.swivels() { 4 } else { 1 }
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let (resistance, distance) = (force::in_words(values[RESISTANCE], scene), values[DISTANCE]);
        let place = quantity(scaled(distance, f64::abs), "m");
        let carries = match self.castor {
            None => format!("what rolls along {place} from the axle"),
            Some(CastorKind::Ball) => format!("a ball {place} from the axle"),
            Some(CastorKind::Swivel | CastorKind::Leading) => {
                format!("a castor {place} {} the axle", if distance.value < 0.0 { "ahead of" } else { "behind" })
            }
        };
        let carried = quantity(scaled(values[CARRIED], |w| 100.0 * w), "%");
        format!("rolling resistance uses up {resistance} of which {carries} has {carried}; the model had none")
    }

    fn contains(&self) -> &'static [&'static str] {
        &["coulomb_friction"]
    }

    fn excitation(&self) -> &'static str {
        "driving forwards and backwards, and turning in place"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "coulomb_friction",
                because: "always, as far as the driven wheels resist: that is dry friction there to the letter; what other wheels carry shows in turning in place only",
            },
            Confusion {
                with: "direction_asymmetry",
                because: "while the robot does not drive backwards, what it carries along takes a constant off the forward command, as friction does that is greater forwards",
            },
            Confusion {
                with: "dead_zone",
                because: "a dead zone that subtracts takes as much off, but by the sign of the command and not by that of the motion",
            },
            Confusion { with: "castor_drag", because: "on the straight a castor drags with the same force" },
            Confusion {
                with: "slope",
                because: "while the robot drives one way at one heading, either is a constant offset of the command",
            },
            Confusion { with: "theta4", because: "over a narrow range of speeds a constant loss looks like one proportional to speed" },
        ]
    }

    fn states(&self, _scene: &Scene) -> usize {
        if self.swivels() { swivel::STATES } else { 0 }
    }

    fn begin(&self, p: &[f64], at: &Instant<'_>, _inputs: &[f64], outputs: &[f64], state: &mut [f64]) {
        if self.swivels() {
            pivot(p).begin(at, outputs, state);
        }
    }

    fn load(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], state: &[f64], load: &mut [f64]) {
        if self.castor == Some(CastorKind::Ball) {
            return;
        }
        let (scene, ratio, carried) = (at.scene, p.get(self.own()), p[CARRIED] * p[RESISTANCE]);
        if self.swivels() {
            let drag = |rolls: f64| carried * smooth_sign(rolls, scene.scales.speed);
            let [forward, turn] = pivot(p).dragged(scene.frame.body(outputs), state, drag);
            scene.frame.add_at_body([forward, ratio.copied().unwrap_or(1.0) / scene.frame.half_track().powi(2) * turn], load);
        } else {
            force::slides(scene, outputs, [carried, p[DISTANCE]], ratio, load);
        }
        force::at_contacts(at, outputs, ratio, None, load, |_, _, sign| (p[RESISTANCE] - carried) * sign);
    }

    fn drive(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, _state: &[f64], drive: &mut [f64]) {
        if self.castor != Some(CastorKind::Ball) {
            return;
        }
        let (frame, ratio, outputs) = (at.scene.frame, p.get(self.own()), motion.outputs);
        let [mut ball, mut wheels] = [[0.0; 2]; 2];
        force::slides(at.scene, outputs, [p[RESISTANCE], p[DISTANCE]], ratio, &mut ball);
        force::at_contacts(at, outputs, ratio, None, &mut wheels, |_, _, sign| p[RESISTANCE] * sign);
        let of = |share: f64| [0, 1].map(|i| share * ball[i] + (1.0 - share) * wheels[i]);
        // Straight on, what the one gains the others lose.
        let ([th1, _], steady) = (force::inertia(&frame, motion), frame.body(&of(p[CARRIED]))[0]);
        let faster = (frame.body(drive)[0] - steady) / th1;
        let against = of((p[CARRIED] * (1.0 + p[TRANSFER] * faster)).clamp(0.0, 1.0));
        drive.iter_mut().zip(against).for_each(|(drive, against)| *drive -= against);
    }

    fn advance(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, _drive: &[f64], state: &mut [f64]) {
        if self.swivels() {
            pivot(p).advance(at, motion, state);
        }
    }
}
