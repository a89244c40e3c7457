//! The wheels slip on the ground while they push.
//!
//! A tyre carries a force by its slip: the speed by which the rim runs ahead of the hub or behind it, over the faster of the two (Pacejka,
//! Tyre and Vehicle Dynamics, section 1.2). The wheel's loop sees the wheel: of its push a, in units of the command, it withdraws what the
//! rim runs ahead, so that a − σ is carried, σ that speed. The push is what loop, motor and bearing leave; what is carried has to hold the
//! robot against what pulls at it (a slope, a drag, what turning does to a centre of mass off the axle) and accelerates it with the rest.
//!
//! `creep`: the slip is λ times what is carried. Where the robot is fast, a/(1 + λ|s|) is carried, s the ground speed: the time that the
//! robot takes to follow its wheels grows with speed. From rest not more than 1/λ is carried: a wheel that turns in its place slips wholly.
//!
//! `grip`: the ground holds no more than an acceleration a_max of the robot's mass; a push beyond that spins the wheel. On the way there
//! the tyre creeps as a brush does (the same, section 3.2): where the share y of its contact sticks, a_max (1 − y³) is carried at the slip
//! 3λ a_max (1 − y). a_max/g is the friction coefficient if the driven wheels carry all weight.
//!
//! A wheel has an inertia of its own: alone it comes up in the time σ, `spin_up`, to what the robot takes θ1 for. With w the speed by which
//! the rim runs ahead, κ what the loop withdraws for it and F what the ground carries,
//!
//! κ σ w' = a − κ w − F(w, s).
//!
//! For σ = 0 the rim is at once where the push and the ground have it.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Motion, Scene, Stage, Start};

use super::force;
use super::loops::Loops;
use super::root::root;
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

/// Acceleration beyond which a ground holds whatever is asked of it \[m/s²\].
const BOUNDLESS: f64 = 100.0 * force::GRAVITY;

/// Limit, in terms of the push, beyond which a brush is no other tyre than one without a limit.
const STICKS: f64 = 1e4;
/// Numbers kept of each wheel.
const EACH: usize = 3;
/// Where among them the speed stands by which its rim runs ahead.
const AHEAD: usize = 0;
/// Where that at the start of a step stands.
const BEFORE: usize = 1;
/// Where the hub's speed in the middle of a step stands.
const HUB: usize = 2;
/// Where in the state it says whether the middle of a step has been reached.
const MIDDLE: usize = 2 * EACH;

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
        Stage::Contact
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        force::needs_wheels(scene)
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let speed = scene.scales.speed;
        let creep = || EffectParameter::new("creep", "s/m", (0.0, 100.0 / speed), 0.05 / speed).neutral(0.0);
        match self.law {
            SlipLaw::Creep => [creep(), force::spin_up()].into_iter().chain(force::turning_ratio(scene)).collect(),
            SlipLaw::Grip => [force::grip(scene), creep(), force::spin_up()].into_iter().chain(force::turning_ratio(scene)).collect(),
        }
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let speed = scene.scales.speed;
        let with_ratio = |values: &[f64]| force::with_ratio(scene, values);
        match self.law {
            SlipLaw::Creep => vec![Start { values: with_ratio(&[0.05 / speed, 0.0]), columns: vec![vec![0]], linear: true }],
            SlipLaw::Grip => [8.0, 5.6, 4.0, 2.8, 2.0, 1.4, 1.0, 0.7, 0.5, 0.35]
                .into_iter()
                .map(|share| (share * speed).min(2.0 * force::GRAVITY))
                .map(|grip| Start { values: with_ratio(&[grip, 0.05 / speed, 0.0]), columns: vec![vec![0], vec![1]], linear: false })
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
            SlipLaw::Grip if values[0].value > BOUNDLESS => creeps(values[1]),
            SlipLaw::Grip => format!(
                "the wheels slip when the robot is to accelerate by more than {}, a friction coefficient of {} if they carry all of its weight; the model's wheels held always",
                quantity(values[0], "m/s²"),
                digits(values[0].value / force::GRAVITY)
            ),
        }
    }

    fn contains(&self) -> &'static [&'static str] {
        match self.law {
            SlipLaw::Creep => &[],
            SlipLaw::Grip => &["wheel_slip"],
        }
    }

    /// As measured (`benches/stepping.rs`).
    fn effort(&self) -> u64 {
        match self.law {
            SlipLaw::Creep => 3,
            SlipLaw::Grip => 7,
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

    /// By wheel, the speed by which its rim runs ahead, the same at the start of a step, and the hub's speed in its middle; whether the middle
    /// has been reached; how long the last step was.
    fn states(&self, _scene: &Scene) -> usize {
        MIDDLE + 1
    }

    fn drive(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, state: &[f64], drive: &mut [f64]) {
        let frame = &at.scene.frame;
        let (loops, speeds, first) = (self.loops(p, frame, motion), frame.wheels(motion.outputs), state[MIDDLE] == 0.0);
        if !loops.hold() {
            return;
        }
        let from = if first { AHEAD } else { BEFORE };
        let held = loops.at_wheels(motion.held);
        let (pushes, grounds) = (pushes(&loops, drive, held, state, from), self.grounds(p, &loops, frame, motion));
        let arriving = [0, 1].map(|i| grounds[i].after(state[EACH * i + from], pushes[i], speeds[i], at.step).1 - held[i]);
        drive.copy_from_slice(&loops.of_wheels(arriving));
    }

    fn advance(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, drive: &[f64], state: &mut [f64]) {
        let (frame, first) = (&at.scene.frame, state[MIDDLE] == 0.0);
        let loops = self.loops(p, frame, motion);
        if !loops.hold() {
            return;
        }
        if first {
            for (own, speed) in state[..MIDDLE].chunks_exact_mut(EACH).zip(frame.wheels(motion.outputs)) {
                (own[BEFORE], own[HUB]) = (own[AHEAD], speed);
            }
        } else {
            // The whole step at the push and at the speed of its middle: of second order, as the motion is.
            let held = loops.at_wheels(motion.held);
            let (pushes, grounds) = (pushes(&loops, drive, held, state, BEFORE), self.grounds(p, &loops, frame, motion));
            for (i, own) in state[..MIDDLE].chunks_exact_mut(EACH).enumerate() {
                own[AHEAD] = grounds[i].after(own[BEFORE], pushes[i], own[HUB], at.step).0;
            }
        }
        state[MIDDLE] = if first { 1.0 } else { 0.0 };
    }
}

impl WheelSlip {
    fn loops(&self, p: &[f64], frame: &Frame, motion: &Motion<'_>) -> Loops {
        Loops::of(frame, motion, p.get(if self.law == SlipLaw::Creep { 2 } else { 3 }), [1.0; 2])
    }

    /// What each wheel stands on.
    fn grounds(&self, p: &[f64], loops: &Loops, frame: &Frame, motion: &Motion<'_>) -> [Ground; 2] {
        let (needs, withdrawn) = (needs(frame, motion), loops.own);
        [0, 1].map(|i| match self.law {
            SlipLaw::Creep => Ground { most: f64::INFINITY, creep: p[0] / withdrawn[i], spin_up: p[1], withdrawn: withdrawn[i] },
            SlipLaw::Grip => Ground { most: p[0] * needs[i], creep: p[1] / withdrawn[i], spin_up: p[2], withdrawn: withdrawn[i] },
        })
    }
}

/// What drives each wheel: what its loop gives less what it withdraws because the other one runs ahead.
fn pushes(loops: &Loops, drive: &[f64], held: [f64; 2], state: &[f64], from: usize) -> [f64; 2] {
    let pushes = loops.at_wheels(drive);
    [0, 1].map(|i| pushes[i] + held[i] - loops.cross[i] * state[EACH * (1 - i) + from])
}

/// What a wheel stands on, and the wheel itself.
#[derive(Debug, Clone, Copy)]
struct Ground {
    /// Most that it carries, in terms of the command.
    most: f64,
    /// Slip for a unit of what is carried, in terms of the command.
    creep: f64,
    /// Time in which the wheel alone comes up to speed \[s\].
    spin_up: f64,
    /// Command that its loop withdraws for a unit of speed.
    withdrawn: f64,
}

impl Ground {
    /// What arrives of a push in the end, at a speed of the hub.
    fn settled(self, push: f64, speed: f64) -> f64 {
        let push = Push::of(push, self.withdrawn * speed);
        if self.most.is_finite() { push.gripped(self.most, self.creep) } else { push.crept(self.creep) }
    }

    /// What is carried where the rim runs ahead by a speed.
    fn carries(self, ahead: f64, speed: f64) -> f64 {
        let faster = speed.abs().max((speed + ahead).abs());
        // What the contact would carry if all of it stuck.
        let whole = ahead / (self.creep * faster);
        let part = whole / (3.0 * self.most);
        match part.abs() {
            _ if ahead == 0.0 => 0.0,
            part if part >= 1.0 => self.most.copysign(ahead),
            part => whole * (1.0 - part + part * part / 3.0),
        }
    }

    /// By how much the rim runs ahead some time later under a push, and what is carried in the mean: on the straight line between what the
    /// ground carries now and in the end.
    fn after(self, ahead: f64, push: f64, speed: f64, span: f64) -> (f64, f64) {
        let carried = self.settled(push, speed);
        if span <= 0.0 {
            return (ahead, carried);
        }
        let end = (push - carried) / self.withdrawn;
        // A wheel that weighs nothing is there at once.
        if self.spin_up == 0.0 {
            return (end, carried);
        }
        let gone = end - ahead;
        // Where the two are one but for rounding, their difference says nothing.
        let stiffness = ((carried - self.carries(ahead, speed)) / gone).max(0.0) / self.withdrawn;
        let left = (-span * (1.0 + stiffness) / self.spin_up).exp();
        let less = self.withdrawn * gone * (1.0 - left) * self.spin_up / span * (1.0 - 1.0 / (1.0 + stiffness));
        (end - gone * left, carried - less)
    }
}

/// What one unit of forward acceleration takes at each wheel.
fn needs(frame: &Frame, motion: &Motion<'_>) -> [f64; 2] {
    let i = motion.inertia;
    if matches!(frame, Frame::Body { .. }) { [i[0]; 2] } else { [i[0] + i[1], i[2] + i[3]] }
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
