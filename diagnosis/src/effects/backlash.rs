//! Play in the gears: while a motor crosses the gap nothing arrives at its wheel.
//!
//! Of what it takes to hold a speed, θ4 and θ6 for forward and angular motion, a share β is the drag of wheels and ground, `behind` the gap, another
//! in turning than straight on; the rest κ = (1 − β) θ is what loop and motor take. So a motor that moves nothing runs at the speed u/κ, u its command. Where its teeth
//! touch the flank towards which it wants to go, the wheel keeps it back, and what the loop gives for that, u − κ s at the wheel's speed s,
//! goes to the wheel: to its inertia and to whatever brakes the robot. In the gap, |z| < g/2 from flank to flank at the rim, the wheel
//! gets nothing of it, and the motor runs ahead of it by z'. Its own inertia lets it come up in the time σ, `spin_up`:
//!
//! σ (z'' + s') = (u/κ − s) − z'.
//!
//! Where it meets the other flank it gives its momentum away, κ σ z' in terms of the command; a wheel that coasts is without its motor's inertia.
//! With `bouncing` it rebounds, again and again: a flank that is pressed in by y pushes back with ω² y + 2 ζ ω y', and does not pull. A meeting takes the
//! time π/ω, and the restitution e, the share of its speed with which it rebounds, makes ζ = −ln e/√(π² + ln² e).
//!
//! Encoders mostly sit at the motors. Then the recorded speed is the wheel's and z' on top.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Motion, Scene, Stage, Start};
use wheelwright_core::simulation::Readout;

use super::force;
use super::loops::Loops;
use super::root::root;
use super::words::{quantity, scaled};

/// Backlash at both wheels.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Backlash {
    /// Whether the recorded speeds are those of the motors, not of wheels or body. Default `false`.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub at_motor: bool,
    /// Whether motors rebound where their teeth meet a flank.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub bouncing: bool,
}

/// Numbers kept of each wheel.
const EACH: usize = 6;
/// Where among them those at the start of a step stand.
const BEFORE: usize = 2;
/// Where among them the speed stands at which the motor wanted to run ahead in the middle of a step.
const WANTED: usize = 4;
/// Where among them the acceleration of the wheel stands at the start of a step.
const GAINING: usize = 5;
/// Where in the state it says whether the middle of a step has been reached.
const MIDDLE: usize = 2 * EACH;
/// Where in the state the places in the gaps at the last sample stand.
const SAMPLED: usize = MIDDLE + 1;
/// Gaps that are tried, as shares of half the track: 1 to 16 mm for a robot of 0.34 m.
const GAPS: [f64; 6] = [0.006, 0.011, 0.019, 0.034, 0.06, 0.1];

/// Shares of the drag that are tried as those behind the gap.
const BEHIND: [f64; 4] = [0.0, 0.01, 0.04, 0.15];
/// The share in turning is more on many robots: tyres, castors and more than two wheels are dragged sideways.
const MORE: f64 = 0.3;
/// Factors by which a gap, a time to come up to speed and a share of the drag beside those found are looked at as well.
const BESIDE: [f64; 3] = [1.06, 1.5, 1.25];
/// Restitution of teeth that ring for a moment and time \[s\] of a meeting, and the restitutions that are tried.
const RINGS: f64 = 0.4;
const MEETING: f64 = 0.005;
const RESTITUTIONS: [f64; 3] = [0.25, 0.45, 0.65];
/// Places of time and restitution of a meeting, where there are such; the turning ratio stands last.
const MEETS: usize = 4;
const REBOUNDS: usize = 5;
/// Meetings within a step, at most, of teeth that do not rebound.
const MEETINGS: usize = 3;
/// Steps in which a meeting is followed, and the share of what it wants below which a motor is at rest on a flank.
const FINE: f64 = 10.0;
const SETTLED: f64 = 0.02;
/// Motors' times to come up to speed, to begin with \[s\]: light ones, and such as carry much of the inertia.
const SPIN_UPS: [f64; 2] = [0.01, 0.05];

impl Backlash {
    /// What the motors meet the flanks with.
    fn teeth(&self, p: &[f64]) -> Teeth {
        Teeth { gap: p[0], spin_up: p[1], mesh: self.bouncing.then(|| Mesh::new(p[MEETS], p[REBOUNDS])) }
    }

    /// The loops of what is before the gap.
    fn loops(&self, p: &[f64], frame: &Frame, motion: &Motion<'_>) -> Loops {
        Loops::of(frame, motion, p.get(MEETS + 2 * usize::from(self.bouncing)), [1.0 - p[2], 1.0 - p[3]])
    }
}

#[typetag::serde(name = "backlash")]
impl Effect for Backlash {
    fn name(&self) -> &str {
        "backlash"
    }

    fn about(&self) -> String {
        let recorded = if self.at_motor { ", speeds recorded at the motors" } else { "" };
        let rebound = if self.bouncing { ", which rebound in it" } else { "" };
        format!("play in the gears of both wheels{recorded}{rebound}")
    }

    fn stage(&self) -> Stage {
        Stage::Drive
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        force::needs_wheels(scene)
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let h = scene.frame.half_track();
        let gap = EffectParameter::new("gap", "m", (0.0, 0.5 * h), 0.004 * h).neutral(0.0);
        let behind = [force::behind("behind"), force::behind("behind_turning").usually(0.0, MORE)];
        let rebounds = [
            EffectParameter::new("meeting", "s", (0.1 * MEETING, 10.0 * MEETING), 0.3 * MEETING),
            EffectParameter::new("restitution", "1", (0.001, 0.95), 0.1).usually(RINGS, RINGS),
        ];
        let all = [gap, force::spin_up()].into_iter().chain(behind);
        all.chain(self.bouncing.then_some(rebounds).into_iter().flatten()).chain(force::turning_ratio(scene)).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let h = scene.frame.half_track();
        let start = |gap: f64, spin_up: f64, behind: f64, rebounds: &[f64]| {
            let values = [&[gap * h, spin_up, behind, behind], rebounds].concat();
            Start { values: force::with_ratio(scene, &values), columns: vec![vec![0]], linear: false }
        };
        if self.bouncing {
            return RESTITUTIONS.map(|e| start(GAPS[2], SPIN_UPS[1], BEHIND[1], &[MEETING, e])).into();
        }
        if !self.at_motor {
            // Of wheels little shows of what their motors do in the gap.
            let light = |gap: f64| BEHIND[1..].iter().map(move |behind| start(gap, SPIN_UPS[0], *behind, &[]));
            return GAPS.into_iter().flat_map(light).collect();
        }
        let all = GAPS.into_iter().flat_map(|gap| SPIN_UPS.map(|spin_up| (gap, spin_up)));
        all.flat_map(|(gap, spin_up)| BEHIND.map(|behind| start(gap, spin_up, behind, &[]))).collect()
    }

    fn rugged(&self) -> bool {
        true
    }

    /// How teeth meet shows only where they do.
    fn stands_in(&self) -> bool {
        self.bouncing
    }

    /// When the teeth meet is a matter of chance for what lies a little beside the truth: there the likelihood has many maxima.
    fn detours(&self, values: &[f64], _scene: &Scene) -> Vec<Vec<f64>> {
        let other = |(i, factor): (usize, f64)| {
            let mut other = values.to_vec();
            other[i] *= factor;
            other
        };
        let within = |v: &Vec<f64>| v[2] <= force::MOST_BEHIND;
        BESIDE.into_iter().enumerate().flat_map(|(i, by)| [(i, 1.0 / by), (i, by)]).map(other).filter(within).collect()
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let play = quantity(scaled(values[0], |g| 1000.0 * g), "mm");
        let angle = scene.wheel_radius.map(|r| quantity(scaled(values[0], |g| (g / r).to_degrees()), "degrees"));
        let angle = angle.map_or_else(String::new, |a| format!(", {a} of the wheel"));
        let rebound = if self.bouncing { ", in which the motors rebound" } else { "" };
        format!("the gears have a play of {play} at the rim{angle}{rebound}; the model had none")
    }

    /// As measured (`benches/stepping.rs`).
    fn effort(&self) -> u64 {
        5
    }

    fn excitation(&self) -> &'static str {
        "frequent changes between pushing and braking, best about standstill"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "actuator_lag",
                because: "under smooth commands the time in the gap is a lag after each change of direction",
            },
            Confusion {
                with: "command_delay",
                because: "crossing the gap takes time, as a delay does; but only when the drive changes sign",
            },
            Confusion { with: "dead_zone", because: "about standstill either makes small commands without effect" },
        ]
    }

    /// By wheel, the motor's place in its gap and its speed against the wheel, both at the start of a step, and the speed that it wants to have in
    /// its middle; whether that has been reached; the places at the last sample.
    fn states(&self, _scene: &Scene) -> usize {
        SAMPLED + 2
    }

    /// The gap is closed in the direction of the first command.
    fn begin(&self, p: &[f64], at: &Instant<'_>, inputs: &[f64], _outputs: &[f64], state: &mut [f64]) {
        state.fill(0.0);
        let commands = at.scene.frame.wheels(inputs);
        for side in 0..2 {
            let place = if commands[side] == 0.0 { 0.0 } else { (0.5 * p[0]).copysign(commands[side]) };
            (state[EACH * side], state[SAMPLED + side]) = (place, place);
        }
    }

    fn drive(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, state: &[f64], drive: &mut [f64]) {
        if p[0] <= 0.0 {
            return;
        }
        let frame = &at.scene.frame;
        let (moment, given) = if state[MIDDLE] == 0.0 {
            let moment = Moment::new(self.teeth(p), self.loops(p, frame, motion), motion, state);
            (moment, moment.at_once())
        } else {
            let moment = Moment::middle(self.teeth(p), self.loops(p, frame, motion), state);
            (moment, moment.over(motion, state, at.step))
        };
        drive.copy_from_slice(&moment.loops.of_wheels(moment.arriving(given, motion, drive)));
    }

    fn advance(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, drive: &[f64], state: &mut [f64]) {
        if p[0] <= 0.0 {
            return;
        }
        let first = state[MIDDLE] == 0.0;
        if first {
            let moment = Moment::new(self.teeth(p), self.loops(p, &at.scene.frame, motion), motion, state);
            let gaining = moment.loops.accelerations(motion, moment.arriving(moment.at_once(), motion, drive));
            for (side, own) in state[..MIDDLE].chunks_exact_mut(EACH).enumerate() {
                own.copy_within(..BEFORE, BEFORE);
                (own[WANTED], own[GAINING]) = (moment.wants[side], gaining[side]);
            }
        } else {
            // The whole step at what was wanted in its middle: of second order, as the motion is.
            for own in state[..MIDDLE].chunks_exact_mut(EACH) {
                let wheel = Wheel { acceleration: own[GAINING], yields: 0.0 };
                Motor::of(&own[BEFORE..]).on(self.teeth(p), own[WANTED], wheel, at.step).0.keep(own);
            }
        }
        state[MIDDLE] = if first { 1.0 } else { 0.0 };
    }

    fn senses(&self) -> bool {
        self.at_motor
    }

    fn measure(&self, _p: &[f64], at: &Instant<'_>, _past: &dyn Fn(f64, &mut [f64]), state: &mut [f64], outputs: &mut [f64]) {
        let interval = at.interval();
        let ahead = [0, 1].map(|side| {
            let motor = Motor::of(&state[EACH * side..]);
            match at.readout {
                Readout::IntervalMean if interval > 0.0 => (motor.place - state[SAMPLED + side]) / interval,
                _ => motor.ahead,
            }
        });
        (0..2).for_each(|side| state[SAMPLED + side] = state[EACH * side]);
        outputs.iter_mut().zip(at.scene.frame.from_wheels(ahead)).for_each(|(x, d)| *x += d);
    }
}

/// What motors and flanks are like.
#[derive(Debug, Clone, Copy)]
struct Teeth {
    /// From flank to flank \[m\] at the rim.
    gap: f64,
    /// The time \[s\] in which a motor comes up to speed.
    spin_up: f64,
    /// How flanks push back, if motors rebound.
    mesh: Option<Mesh>,
}

/// Flanks that push back.
#[derive(Debug, Clone, Copy)]
struct Mesh {
    /// ω \[1/s\].
    rate: f64,
    /// ζ.
    damping: f64,
}

impl Mesh {
    fn new(meeting: f64, restitution: f64) -> Self {
        let decay = -restitution.ln();
        Self { rate: std::f64::consts::PI / meeting, damping: decay / decay.hypot(std::f64::consts::PI) }
    }

    /// By how much a motor is slowed down per time that is pressed in by a length and at a speed: a flank does not pull.
    fn pushes(&self, into: f64, speed: f64) -> f64 {
        if into > 0.0 { (self.rate * (self.rate * into + 2.0 * self.damping * speed)).max(0.0) } else { 0.0 }
    }
}

/// Both motors at some moment of a step.
#[derive(Debug, Clone, Copy)]
struct Moment {
    teeth: Teeth,
    /// The loops of what is before the gap.
    loops: Loops,
    motors: [Motor; 2],
    /// By how much each would run ahead of its wheel if it moved nothing else; not at all where nothing would hold it back.
    wants: [f64; 2],
}

impl Moment {
    /// As the motion has it.
    fn new(teeth: Teeth, loops: Loops, motion: &Motion<'_>, state: &[f64]) -> Self {
        let motors = motors(state, 0);
        let (commands, held) = (loops.at_wheels(motion.u), loops.withdrawn(motion.outputs));
        let of = |i: usize| (commands[i] - held[i] - loops.cross[i] * motors[1 - i].ahead) / loops.own[i];
        Self { teeth, loops, motors, wants: [0, 1].map(|i| if loops.hold() { of(i) } else { 0.0 }) }
    }

    /// At the start of a step with what is wanted in its middle, which is known by then.
    fn middle(teeth: Teeth, loops: Loops, state: &[f64]) -> Self {
        let wants = [0, 1].map(|side| state[EACH * side + WANTED]);
        Self { teeth, loops, motors: motors(state, BEFORE), wants }
    }

    /// What the wheels get at this moment.
    fn at_once(&self) -> [Given; 2] {
        let pressed = |side: usize| if self.motors[side].pressed(self.teeth, self.wants[side]) { 1.0 } else { 0.0 };
        [0, 1].map(|side| Given { thrown: 0.0, pressed: pressed(side) })
    }

    /// What they get over a time from here on.
    fn over(&self, motion: &Motion<'_>, state: &[f64], span: f64) -> [Given; 2] {
        [0, 1].map(|side| {
            let wheel = Wheel { acceleration: state[EACH * side + GAINING], yields: self.loops.yields(motion, side) };
            self.motors[side].on(self.teeth, self.wants[side], wheel, span).1
        })
    }

    /// The drives that the model has to be given at the wheels, by what they get of their motors.
    fn arriving(&self, given: [Given; 2], motion: &Motion<'_>, drive: &[f64]) -> [f64; 2] {
        let Self { teeth, loops, motors, wants } = self;
        let drives = loops.at_wheels(drive);
        let free = [0, 1].map(|side| loops.own[side] * (1.0 - given[side].pressed));
        let left = [0, 1].map(|side| drives[side] - loops.cross[side] * motors[1 - side].ahead - free[side] * wants[side]);
        // A wheel that coasts does not carry its motor along.
        let moved = loops.lighter(motion, free.map(|free| free * teeth.spin_up), left);
        [0, 1].map(|side| moved[side] + loops.own[side] * given[side].thrown)
    }
}

/// Both motors, now or as they were at the start of the step.
fn motors(state: &[f64], from: usize) -> [Motor; 2] {
    [0, 1].map(|side| Motor::of(&state[EACH * side + from..]))
}

/// What a wheel gets of its motor, in the mean over a time.
#[derive(Debug, Clone, Copy)]
struct Given {
    /// Share of the time in which it is pressed against it, and gives what it can.
    pressed: f64,
    /// Speed \[m/s\] that it would have to want to run ahead at to give as much as by its momentum where they meet.
    thrown: f64,
}

/// A wheel as its motor meets it.
#[derive(Debug, Clone, Copy)]
struct Wheel {
    /// Its acceleration \[m/s²\] while it coasts.
    acceleration: f64,
    /// Its acceleration for a unit of speed at which the motor wants to run ahead \[1/s\].
    yields: f64,
}

/// A motor against its wheel.
#[derive(Debug, Clone, Copy)]
struct Motor {
    /// Place in the gap \[m\] at the rim, 0 in its middle.
    place: f64,
    /// Speed \[m/s\] at the rim.
    ahead: f64,
}

impl Motor {
    fn of(state: &[f64]) -> Self {
        Self { place: state[0], ahead: state[1] }
    }

    fn keep(self, state: &mut [f64]) {
        (state[0], state[1]) = (self.place, self.ahead);
    }

    /// Whether its teeth touch the flank towards which it wants to go, and stay there.
    fn pressed(self, teeth: Teeth, wants: f64) -> bool {
        self.place * wants.signum() >= 0.5 * teeth.gap && (teeth.mesh.is_none() || self.ahead == 0.0)
    }

    /// The motor some time later that wants to run ahead at a speed, of a wheel that accelerates, and what the wheel gets in that time.
    fn on(mut self, teeth: Teeth, wants: f64, wheel: Wheel, span: f64) -> (Self, Given) {
        if self.pressed(teeth, wants) {
            self.ahead = 0.0;
            return (self, Given { thrown: 0.0, pressed: 1.0 });
        }
        match teeth.mesh {
            Some(mesh) => self.rebounding(teeth, mesh, wants, wheel, span),
            None => self.thrown(teeth, wants, wheel, span),
        }
    }

    /// The same of one that stays where it meets a flank.
    fn thrown(mut self, teeth: Teeth, wants: f64, wheel: Wheel, span: f64) -> (Self, Given) {
        let Teeth { gap, spin_up, .. } = teeth;
        let flying = wants - spin_up * wheel.acceleration;
        let (mut left, mut thrown) = (span, 0.0);
        // It meets a flank and stays there, or is thrown against one and leaves it, perhaps for the other.
        for _ in 0..MEETINGS {
            if self.pressed(teeth, wants) {
                return (self, Given { thrown: thrown / span, pressed: left / span });
            }
            let outside = |time: &f64| self.flown(flying, spin_up, *time).place.abs() > 0.5 * gap;
            let Some(until) = [self.turns(flying, spin_up).min(left), left].into_iter().find(outside) else {
                return (self.flown(flying, spin_up, left), Given { thrown: thrown / span, pressed: 0.0 });
            };
            let there = self.flown(flying, spin_up, until);
            let flank = (0.5 * gap).copysign(there.place);
            let missing = |t: f64| {
                let then = self.flown(flying, spin_up, t);
                ((then.place - flank) * flank.signum(), then.ahead * flank.signum())
            };
            let time = root((0.0, until), until * (flank - self.place) / (there.place - self.place), missing);
            left -= time;
            // The wheel is the faster for it, and so wants less from there on.
            thrown += spin_up * self.flown(flying, spin_up, time).ahead * (1.0 - wheel.yields * left);
            self = Self { place: flank, ahead: 0.0 };
        }
        (self, Given { thrown: thrown / span, pressed: 0.0 })
    }

    /// The same of one that rebounds.
    fn rebounding(mut self, teeth: Teeth, mesh: Mesh, wants: f64, wheel: Wheel, span: f64) -> (Self, Given) {
        let steps = (FINE * mesh.rate / std::f64::consts::PI * span).ceil().max(1.0);
        let (step, spin_up) = (span / steps, teeth.spin_up.max(span / steps));
        let flying = wants - spin_up * wheel.acceleration;
        let mut pushed = 0.0;
        for k in 0..steps as usize {
            let side = self.place.signum();
            let into = side * self.place - 0.5 * teeth.gap;
            let rests = (side * flying / spin_up).max(0.0) / (mesh.rate * mesh.rate);
            let swings = (side * self.ahead).hypot(mesh.rate * (into - rests));
            if into >= 0.0 && side * flying > 0.0 && swings < SETTLED * flying.abs() {
                self = Self { place: side * 0.5 * teeth.gap, ahead: 0.0 };
                return (self, Given { thrown: pushed / span, pressed: 1.0 - k as f64 / steps });
            }
            let push = side * mesh.pushes(into, side * self.ahead);
            self.ahead += step * ((flying - self.ahead) / spin_up - push);
            self.place += step * self.ahead;
            // What the wheel alone gets of it, its motor would have to share.
            pushed += step * push * spin_up;
        }
        (self, Given { thrown: pushed / span, pressed: 0.0 })
    }

    /// When it turns round on its way: at once if it does not.
    fn turns(self, wants: f64, spin_up: f64) -> f64 {
        if self.ahead * wants < 0.0 { spin_up * (1.0 - self.ahead / wants).ln() } else { 0.0 }
    }

    /// The motor on its way through the gap.
    fn flown(self, wants: f64, spin_up: f64, time: f64) -> Self {
        let gone = if spin_up > 0.0 { -(-time / spin_up).exp_m1() } else { 1.0 };
        let change = wants - self.ahead;
        Self { place: self.place + wants * time - spin_up * change * gone, ahead: self.ahead + change * gone }
    }
}
