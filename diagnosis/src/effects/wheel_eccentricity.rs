//! A wheel that is not round, or not round its axle: its radius is (1 + ε) times r, ε = A cos φ + B sin φ, n = 1 or, if it is oval, 2 times a turn. It
//! turns further on what is smaller: φ + A sin φ − B cos φ = n · distance / r.
//!
//! `reading`: the recorded speed s of the wheel gains s ε, and the robot moves as if nothing was: an encoder or an odometry that is off its
//! centre, outside the loop.
//!
//! `rolling`: the wheel itself is, and the ground's own speed is recorded. A loop that keeps the wheel's rate drives the ground speed by
//! s ε, which the robot's inertia follows as it follows a command: a load −s ε. The wheel and its motor are sped up and slowed down once a turn,
//! and push the robot by that: a load −τ (s ε)', of which the greater part is −τ s²/r ε', ε' the change of ε over the wheel's angle. The axle rises
//! and falls with the radius, and the weight on the wheel pushes it: a load κ ε', κ = c g θ1 with the share c of the robot's weight that it carries (θ1 is what
//! the model needs for a unit of acceleration, and no wheel carries more than all: what pushes harder is no weight). Both count in turning by the turning ratio ρ. Where the radius
//! grows or shrinks the wheel stands on a point r ε' ahead of its axle or behind it, which a turn drags sideways, while the other wheel holds the
//! axle: friction μ of the weight resists, a load ρ μ r/(2h²) κ |ε'| sgn ω on the turning command.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Motion, Scene, Stage, Start};

use super::force::{self, Wheel};
use super::words::{digits, quantity, smooth_sign};

/// Where the ripple comes in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Ripple {
    /// In what is recorded.
    #[default]
    Reading,
    /// In how the wheel rolls.
    Rolling,
}

/// A ripple of the recorded speed once a turn of the wheel, in proportion to speed.
///
/// The angle is that of the distance which the recording says the wheel has rolled, from zero at the start of each segment: a
/// simulated distance would drift out of phase within a few turns. The radius is a parameter, for over fifty turns the phase needs it
/// to half a percent, over more of them to less. Behind a gap the wheel's angle is as far on as both its edges tell, and of another segment it is not
/// known, while one A and B serve them all: an eccentricity is found best in one long stretch.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WheelEccentricity {
    /// One wheel only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wheel: Option<Wheel>,
    /// Where the ripple comes in. Default `reading`.
    pub ripple: Ripple,
    /// An oval wheel, which ripples twice a turn. Default `false`.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub oval: bool,
}

impl WheelEccentricity {
    /// How often it ripples in a turn.
    fn per_turn(&self) -> f64 {
        if self.oval { 2.0 } else { 1.0 }
    }

    /// Sine and cosine of φ where the wheel has come so far, by one of Newton's steps.
    fn angle(&self, pair: &[f64], turned: f64) -> (f64, f64) {
        let place = self.per_turn() * turned;
        let (sin, cos) = place.sin_cos();
        (place - (pair[0] * sin - pair[1] * cos) / (1.0 + pair[0] * cos + pair[1] * sin)).sin_cos()
    }

    /// How often in words.
    fn often(&self) -> &'static str {
        if self.oval { "twice" } else { "once" }
    }

    /// The wheels that ripple.
    fn wheels(&self) -> impl Iterator<Item = Wheel> + use<> {
        let only = self.wheel;
        [Wheel::Left, Wheel::Right].into_iter().filter(move |w| only.is_none_or(|only| only == *w))
    }
}

/// Most that a friction coefficient of a tyre is.
const MOST_FRICTION: f64 = 3.0;
/// Most that a radius can differ from the robot's profile.
const RADIUS: f64 = 0.1;
/// Most that it is off in a start, and the step between starts.
const OFF: f64 = 0.04;
const STEP: f64 = 0.005;
/// Angle by which a start's wheel may be off at the end of the longest stretch where the step alone would take it further \[rad\].
const ASTRAY: f64 = 2.0;
/// Most starts to either side.
const MOST: f64 = 24.0;

/// The wheels' radius as the profile has it \[m\].
fn radius(scene: &Scene) -> f64 {
    scene.wheel_radius.unwrap_or(1.0)
}

/// The longest way that a wheel goes from the start of a stretch \[m\].
fn rolled(scene: &Scene) -> f64 {
    let distances = scene.tracks.iter().flat_map(|t| &t.distance).flatten();
    distances.fold(0.0, |most: f64, d| most.max(d.abs()))
}

#[typetag::serde(name = "wheel_eccentricity")]
impl Effect for WheelEccentricity {
    fn name(&self) -> &str {
        "wheel_eccentricity"
    }

    fn about(&self) -> String {
        let often = self.often();
        match self.ripple {
            Ripple::Reading => format!("a wheel's recorded speed ripples {often} a turn"),
            Ripple::Rolling => format!("a wheel that is not round drives unevenly, {often} a turn"),
        }
    }

    fn stage(&self) -> Stage {
        match self.ripple {
            Ripple::Reading => Stage::Sensor,
            Ripple::Rolling => Stage::Drive,
        }
    }

    /// A left wheel that is not round says nothing about the right one.
    fn family(&self) -> &str {
        match self.wheel {
            None => "wheel_eccentricity",
            Some(Wheel::Left) => "wheel_eccentricity/left",
            Some(Wheel::Right) => "wheel_eccentricity/right",
        }
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        force::needs_wheels(scene)
            .or_else(|| {
                scene.wheel_radius.is_none().then(|| "the wheels' radius is not known (`wheel_radius` in the robot's profile)".to_owned())
            })
            .or_else(|| if self.ripple == Ripple::Rolling { force::needs_loops(scene) } else { None })
    }

    /// A and B of each wheel, where it rolls κ, τ, μ and the turning ratio, and the radius.
    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let amplitude =
            |name: &str, wheel: Wheel| EffectParameter::new(name, "1", (-0.5, 0.5), 0.02).neutral(0.0).of("wheel", wheel.word());
        let mut all: Vec<EffectParameter> = self.wheels().flat_map(|w| [amplitude("cosine", w), amplitude("sine", w)]).collect();
        if self.ripple == Ripple::Rolling {
            all.push(EffectParameter::new("carried", "1", (0.0, 1.0), 0.2).neutral(0.0));
            all.push(force::spin_up());
            all.push(EffectParameter::new("scrub", "1", (0.0, MOST_FRICTION), 0.2).neutral(0.0));
            all.extend(force::turning_ratio(scene));
        }
        let radius = radius(scene);
        all.push(EffectParameter::new("radius", "m", ((1.0 - RADIUS) * radius, (1.0 + RADIUS) * radius), 0.002 * radius));
        all
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let all = self.parameters(scene);
        // The ripple alone: what it does to weights and rotors follows it.
        let free = 0..2 * self.wheels().count();
        let at = |off: f64| {
            let value = |p: &EffectParameter| match p.name.as_str() {
                "radius" => (1.0 + off) * radius(scene),
                "cosine" | "sine" => p.scale,
                _ => p.usual.map(|(value, _)| value).or(p.neutral).unwrap_or(p.scale),
            };
            Start { values: all.iter().map(value).collect(), columns: free.clone().map(|i| vec![i]).collect(), linear: true }
        };
        let step = STEP.min(ASTRAY * radius(scene) / (self.per_turn() * rolled(scene))).max(OFF / MOST);
        let steps = (OFF / step) as i32;
        // Nearest to the known radius first.
        (0..=2 * steps).map(|i| if i % 2 == 0 { i / 2 } else { -(i + 1) / 2 }).map(|i| at(step * f64::from(i))).collect()
    }

    fn line(&self) -> Option<f64> {
        self.oval.then(|| self.per_turn())
    }

    /// By an angle of the ripple.
    fn turned(&self, values: &[f64], part: usize, angle: f64) -> Option<Vec<f64>> {
        if part >= self.wheels().count() {
            return None;
        }
        let (sin, cos) = angle.sin_cos();
        let mut turned = values.to_vec();
        // A cos(φ + angle) + B sin(φ + angle) in terms of cos φ and sin φ.
        let (a, b) = (values.get(2 * part)?, values.get(2 * part + 1)?);
        (turned[2 * part], turned[2 * part + 1]) = (a * cos + b * sin, b * cos - a * sin);
        Some(turned)
    }

    fn statement(&self, values: &[Estimate], _scene: &Scene) -> String {
        let often = self.often();
        let said = self.wheels().zip(values.chunks_exact(2)).map(|(wheel, pair)| {
            let size = pair[0].value.hypot(pair[1].value);
            match self.ripple {
                Ripple::Reading => format!("the {} wheel's speed ripples by {} % {often} a turn", wheel.word(), digits(100.0 * size)),
                Ripple::Rolling => {
                    format!("the {} wheel's radius varies by {} % either way {often} a turn", wheel.word(), digits(100.0 * size))
                }
            }
        });
        let radius = values.last().map_or(String::new(), |r| format!(" at a radius of {}", quantity(*r, "m")));
        format!("{}{radius}; the model's wheels were round", said.collect::<Vec<_>>().join(", "))
    }

    fn excitation(&self) -> &'static str {
        "many turns of the wheels at a steady, not too high speed"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "timestamp_jitter",
                because: "at a sampling rate near the wheel's turning rate the ripple looks like scatter of the stamps",
            },
            Confusion { with: "slope", because: "on a circle whose length is a whole number of the wheel's turns both come once a round" },
        ]
    }

    fn drive(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, _state: &[f64], drive: &mut [f64]) {
        let (frame, Some((radius, rest))) = (at.scene.frame, p.split_last()) else { return };
        if self.ripple == Ripple::Reading {
            return;
        }
        let (outputs, (amplitudes, rest)) = (motion.outputs, rest.split_at(2 * self.wheels().count()));
        let &[carried, spin_up, friction, ..] = rest else { return };
        let (speeds, ratio) = (frame.wheels(outputs), rest.get(3).copied().unwrap_or(1.0));
        let weight = carried * force::GRAVITY * force::inertia(&frame, motion)[0];
        let (mut driven, mut pushed, mut ahead) = ([0.0; 2], [0.0; 2], [0.0; 2]);
        for (wheel, pair) in self.wheels().zip(amplitudes.chunks_exact(2)) {
            let side = wheel.index();
            let (sin, cos) = self.angle(pair, at.distance(side) / radius);
            let growing = self.per_turn() * (pair[1] * cos - pair[0] * sin);
            driven[side] = speeds[side] * (pair[0] * cos + pair[1] * sin);
            pushed[side] = (spin_up * speeds[side].powi(2) / radius - weight) * growing;
            ahead[side] = growing;
        }
        // What the loop is told is no force: it counts alike on both axes.
        frame.add_at_wheels(driven, 1.0, drive);
        frame.add_at_wheels(pushed, ratio, drive);
        let (h, [_, w]) = (frame.half_track(), frame.body(outputs));
        let dragged = friction * weight * radius / (2.0 * h * h) * (ahead[0] - ahead[1]).abs();
        frame.add_at_body([0.0, -ratio * dragged * smooth_sign(h * w, at.scene.scales.speed)], drive);
    }

    fn measure(&self, p: &[f64], at: &Instant<'_>, _past: &dyn Fn(f64, &mut [f64]), _state: &mut [f64], outputs: &mut [f64]) {
        let (frame, Some((radius, amplitudes))) = (at.scene.frame, p.split_last()) else { return };
        if self.ripple == Ripple::Rolling {
            return;
        }
        let speeds = frame.wheels(outputs);
        let mut ripple = [0.0; 2];
        for (wheel, pair) in self.wheels().zip(amplitudes.chunks_exact(2)) {
            let side = wheel.index();
            let (sin, cos) = self.angle(pair, at.distance(side) / radius);
            ripple[side] = speeds[side] * (pair[0] * cos + pair[1] * sin);
        }
        outputs.iter_mut().zip(frame.from_wheels(ripple)).for_each(|(x, d)| *x += d);
    }
}
