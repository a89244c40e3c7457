//! The wheels slip on the ground while they push.
//!
//! A tyre carries a force by its slip: the speed by which the rim runs ahead of the hub or behind it, over the faster of the two (Pacejka,
//! Tyre and Vehicle Dynamics, section 1.2). The wheel's loop sees the wheel: of its push a, in units of the command, it withdraws what the
//! rim runs ahead, so that a − σ is carried, σ that speed.
//!
//! `creep`: the slip is λ times what is carried. Where the robot is fast, a/(1 + λ|s|) arrives, s the ground speed: the time that the
//! robot takes to follow its wheels grows with speed. From rest not more than 1/λ is carried: a wheel that turns in its place slips wholly.
//!
//! `grip`: the ground holds no more than an acceleration a_max of the robot's mass; a push beyond that spins the wheel. On the way there
//! the tyre creeps as a brush does (the same, section 3.2): where the share y of its contact sticks, a_max (1 − y³) is carried at the slip
//! 3λ a_max (1 − y). a_max/g is the friction coefficient if the driven wheels carry all weight.
//!
//! A wheel has an inertia of its own, and comes up to the speed of its slip in a time: alone it would take `spin_up`, and the ground helps it
//! where it hardly slips. The push that arrives lags by spin_up λ|s|/(1 + λ|s|).

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Motion, Scene, Stage, Start};

use super::force;
use super::words::{digits, quantity, scaled};

/// What slips.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SlipLaw {
    /// Slip in proportion to force and speed.
    #[default]
    Creep,
    /// A greatest force.
    Grip,
}

/// Slip of the wheels.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WheelSlip {
    /// What slips. Default `creep`.
    #[serde(default)]
    pub law: SlipLaw,
}

/// Standard gravity \[m/s²\].
const GRAVITY: f64 = 9.80665;
/// Friction coefficient beyond which a ground holds whatever is asked of it.
const BOUNDLESS: f64 = 100.0;
/// Time in which a wheel and its motor alone come up to speed on most robots \[s\]: a part of what the whole robot takes.
const SPIN_UP: f64 = 0.05;

#[typetag::serde(name = "wheel_slip")]
impl Effect for WheelSlip {
    fn name(&self) -> &str {
        "wheel_slip"
    }

    fn about(&self) -> String {
        match self.law {
            SlipLaw::Creep => "the wheels creep on the ground, the more the faster and the harder they push".to_owned(),
            SlipLaw::Grip => "the wheels spin when they push harder than the ground holds".to_owned(),
        }
    }

    fn stage(&self) -> Stage {
        Stage::Drive
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        force::needs_wheels(scene)
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let speed = scene.scales.speed;
        let spin_up = || EffectParameter::new("spin_up", "s", (0.0, 1.0), 0.4 * SPIN_UP).neutral(0.0).usually(0.0, SPIN_UP);
        let creep = || EffectParameter::new("creep", "s/m", (0.0, 100.0 / speed), 0.05 / speed).neutral(0.0);
        match self.law {
            SlipLaw::Creep => vec![creep(), spin_up()],
            SlipLaw::Grip => {
                let least = (0.02 * speed).min(GRAVITY);
                let grip = EffectParameter::new("grip", "m/s2", (least, f64::INFINITY), 0.1 * speed).neutral(f64::INFINITY);
                vec![grip, creep(), spin_up()]
            }
        }
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let speed = scene.scales.speed;
        match self.law {
            SlipLaw::Creep => vec![Start { values: vec![0.05 / speed, 0.0], columns: vec![vec![0]], linear: true }],
            SlipLaw::Grip => [8.0, 5.6, 4.0, 2.8, 2.0, 1.4, 1.0, 0.7, 0.5, 0.35]
                .into_iter()
                .map(|share| (share * speed).min(2.0 * GRAVITY))
                .map(|grip| Start { values: vec![grip, 0.05 / speed, 0.0], columns: vec![vec![0], vec![1]], linear: false })
                .collect(),
        }
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let speed = scene.scales.speed;
        let creeps = |creep: Estimate| {
            format!(
                "the wheels creep on the ground: at {} m/s the robot follows them {} more slowly than at rest; the model's wheels rolled without slip",
                digits(speed),
                quantity(scaled(creep, |creep| 100.0 * creep * speed), "%"),
            )
        };
        match self.law {
            SlipLaw::Creep => creeps(values[0]),
            SlipLaw::Grip if values[0].value > BOUNDLESS * GRAVITY => creeps(values[1]),
            SlipLaw::Grip => format!(
                "the wheels slip when the robot is to accelerate by more than {}, a friction coefficient of {} if they carry all of its weight; the model's wheels held always",
                quantity(values[0], "m/s²"),
                digits(values[0].value / GRAVITY)
            ),
        }
    }

    fn contains(&self) -> &'static [&'static str] {
        match self.law {
            SlipLaw::Creep => &[],
            SlipLaw::Grip => &["wheel_slip"],
        }
    }

    fn excitation(&self) -> &'static str {
        match self.law {
            SlipLaw::Creep => "the same steps of the command at low and at high speed",
            SlipLaw::Grip => "the hardest acceleration and braking that the robot is meant for",
        }
    }

    fn confusions(&self) -> &'static [Confusion] {
        match self.law {
            SlipLaw::Creep => &[
                Confusion { with: "theta1", because: "at one speed it is a longer time constant" },
                Confusion { with: "actuator_lag", because: "slip in proportion to force alone is a small lag" },
                Confusion { with: "slew_limit", because: "either makes fast robots follow slowly when steps are large" },
            ],
            SlipLaw::Grip => &[
                Confusion {
                    with: "torque_saturation",
                    because: "the ground or the motor may be what gives way; only the wheels' own speeds tell",
                },
                Confusion {
                    with: "slew_limit",
                    because: "a command that rises slowly and a robot that cannot accelerate look alike in steps",
                },
            ],
        }
    }

    /// By wheel, the push behind the wheel's spinning up: what it was, the wheel's own push then, and the share of a change since then that
    /// arrives at once.
    fn states(&self, _scene: &Scene) -> usize {
        6
    }

    fn begin(&self, _p: &[f64], _at: &Instant<'_>, _inputs: &[f64], _outputs: &[f64], state: &mut [f64]) {
        state.copy_from_slice(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    }

    fn drive(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, state: &[f64], drive: &mut [f64]) {
        let frame = &at.scene.frame;
        let (pushes, speeds, needs) = (frame.wheels(drive), frame.wheels(motion.outputs), needs(frame, motion));
        let unit = per_speed(at.scene);
        let arriving = [0, 1].map(|i| {
            let push = Push::of(spun(&state[3 * i..], pushes[i]), unit * speeds[i]);
            match self.law {
                SlipLaw::Creep => push.crept(p[0] / unit),
                SlipLaw::Grip => push.gripped(p[0] * needs[i], p[1] / unit),
            }
        });
        drive.copy_from_slice(&frame.from_wheels(arriving));
    }

    fn advance(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], drive: &[f64], state: &mut [f64]) {
        let frame = &at.scene.frame;
        let (pushes, speeds) = (frame.wheels(drive), frame.wheels(outputs));
        let (creep, spin_up) = if self.law == SlipLaw::Creep { (p[0], p[1]) } else { (p[1], p[2]) };
        for (i, own) in state.chunks_exact_mut(3).enumerate() {
            let slip = creep * speeds[i].abs();
            let spans = at.span * (1.0 + slip) / (spin_up * slip);
            // Where the lag is nothing, nothing of it is left.
            let (kept, at_once) = match (-spans).exp_m1() {
                gone if spans < AGES => (1.0 + gone, 1.0 + gone / spans),
                _ => (0.0, 1.0),
            };
            own[0] = pushes[i] + kept * (spun(own, pushes[i]) - pushes[i]);
            own[1] = pushes[i];
            own[2] = at_once;
        }
    }
}

/// Spans of a lag after which no digit of it is left.
const AGES: f64 = 40.0;

/// The push behind a wheel's spinning up, if the wheel's own has changed evenly since the state was reckoned.
fn spun(state: &[f64], push: f64) -> f64 {
    state[0] + state[2] * (push - state[1])
}

/// What one unit of forward acceleration takes at each wheel.
fn needs(frame: &Frame, motion: &Motion<'_>) -> [f64; 2] {
    let i = motion.inertia;
    if matches!(frame, Frame::Body { .. }) { [i[0]; 2] } else { [i[0] + i[1], i[2] + i[3]] }
}

/// The command that a loop withdraws for each unit of speed that its wheel runs ahead: what the robot takes to hold a speed.
fn per_speed(scene: &Scene) -> f64 {
    scene.scales.command / scene.scales.speed
}

/// A wheel's push, and its hub's speed along it, both as commands.
#[derive(Debug, Clone, Copy)]
struct Push {
    size: f64,
    along: f64,
    sign: f64,
}

impl Push {
    fn of(push: f64, speed: f64) -> Self {
        let sign = 1.0_f64.copysign(push);
        Self { size: push.abs(), along: speed * sign, sign }
    }

    /// What a tyre carries whose slip is a creep times that.
    fn crept(self, creep: f64) -> f64 {
        let Self { size, along, sign } = self;
        let hub = size / (1.0 + creep * along.abs());
        if along < 0.0 && size - hub <= -2.0 * along {
            return sign * hub;
        }
        // The rim is the faster: creep · carried · (along + size − carried) = size − carried.
        let b = 1.0 + creep * (along + size);
        sign * 2.0 * size / (b + (b * b - 4.0 * creep * size).max(0.0).sqrt())
    }

    /// What a brush carries that holds no more than a limit.
    fn gripped(self, limit: f64, creep: f64) -> f64 {
        // So far below the limit all of the contact sticks, to a ten-thousandth.
        if limit > STICKS * self.size {
            return self.crept(creep);
        }
        if self.beyond(limit, creep, 0.0).0 >= 0.0 {
            return self.sign * limit;
        }
        let sticking = root((0.0, 1.0), self.dragged(limit, creep), |y| self.beyond(limit, creep, y));
        self.sign * limit * (1.0 - sticking.powi(3))
    }

    /// The part of the contact that sticks if the hub is the faster.
    fn dragged(self, limit: f64, creep: f64) -> f64 {
        let hub = creep * self.along.abs();
        stuck(hub, 1.0 + 3.0 * hub - self.size / limit)
    }

    /// By how much the rim runs further ahead than it must if the part y of the contact is to stick, and how that grows with y.
    fn beyond(self, limit: f64, creep: f64, y: f64) -> (f64, f64) {
        let ahead = (self.size - limit) + limit * y.powi(3);
        let (grows, slip) = (3.0 * limit * y * y, 3.0 * limit * creep * (1.0 - y));
        let (hub, rim) = (self.along.abs(), self.along + ahead);
        let (faster, gains) = if rim > hub { (rim, grows) } else { (hub, 0.0) };
        (ahead - slip * faster, grows + 3.0 * limit * creep * faster - slip * gains)
    }
}

/// Limit, in terms of the push, beyond which a brush is no other tyre than one without a limit.
const STICKS: f64 = 1e4;
/// Most steps to a root: halving alone needs no more.
const STEPS: usize = 60;
/// A step of Newton's that is this small is the last: what it leaves is its square.
const LAST: f64 = 1e-10;

/// The root of a function that is negative at the lower end of a bracket and positive at the upper, given with its slope: by Newton's steps,
/// and by halving where they leave the bracket.
fn root(bracket: (f64, f64), first: f64, mut function: impl FnMut(f64) -> (f64, f64)) -> f64 {
    let ((mut low, mut high), mut x) = (bracket, first);
    for _ in 0..STEPS {
        let (value, slope) = function(x);
        if value < 0.0 {
            low = x
        } else {
            high = x
        }
        let newton = x - value / slope;
        // Beside the root rounding takes a step out of a bracket that ends there, and halving would begin anew.
        if (newton - x).abs() <= LAST {
            return newton.clamp(low, high);
        }
        x = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
    }
    x
}

/// The root y of y³ + 3 p y = c for p ≥ 0, and 0 where it is negative. Cardano's u − p/u, written so that no digits cancel.
fn stuck(p: f64, c: f64) -> f64 {
    if c <= 0.0 {
        return 0.0;
    }
    let half = 0.5 * c;
    // Several times as fast as a cube root that is right to the last bit.
    let u = (half + (half * half + p * p * p).sqrt()).powf(1.0 / 3.0);
    let v = p / u;
    c / (u * u + p + v * v)
}

#[cfg(test)]
mod tests {
    use super::{Push, root, stuck};

    #[test]
    fn what_a_brush_carries_is_found_in_a_few_steps() {
        for size in [0.3, 0.9, 1.0, 1.1, 2.0, 5.0] {
            for along in [-3.0, -1.0, -1e-3, 0.0, 1e-3, 0.5, 2.0, 30.0] {
                for (limit, creep) in [(0.2, 1e-6), (0.2, 0.05), (1.0, 1e-9), (1.0, 0.02), (1.0, 0.7), (1.0, 20.0), (7.0, 0.1)] {
                    let push = Push { size, along, sign: 1.0 };
                    if push.beyond(limit, creep, 0.0).0 >= 0.0 {
                        continue;
                    }
                    let mut looks = 0;
                    let y = root((0.0, 1.0), push.dragged(limit, creep), |y| {
                        looks += 1;
                        push.beyond(limit, creep, y)
                    });
                    assert!(push.beyond(limit, creep, y).0.abs() < 1e-9, "{push:?} {limit} {creep}: {y}");
                    assert!(looks <= 12, "{push:?} {limit} {creep}: {looks} looks");
                }
            }
        }
    }

    #[test]
    fn what_sticks_is_the_root_of_its_cubic_to_the_last_digits() {
        for p in [0.0, 1e-12, 1e-6, 1e-3, 0.1, 1.0, 30.0, 1e6] {
            for c in [1e-12, 1e-6, 1e-2, 0.3, 1.0, 4.0, 1e3] {
                let y = stuck(p, c);
                let back = y * (y * y + 3.0 * p);
                assert!((back - c).abs() < 1e-14 * c * 8.0, "{p} {c}: {y} gives {back}");
            }
        }
        assert_eq!(stuck(0.3, -1.0), 0.0);
    }
}
