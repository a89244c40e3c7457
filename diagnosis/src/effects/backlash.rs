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
const BEHIND: [f64; 3] = [0.01, 0.04, 0.15];
/// The share in turning is more on many robots: tyres, castors and more than two wheels are dragged sideways.
const MORE: f64 = 0.3;
/// Factors by which a gap, a time to come up to speed and a share of the drag beside those found are looked at as well.
const BESIDE: [f64; 3] = [1.06, 1.5, 1.25];
/// Motor's time to come up to speed, to begin with \[s\].
const SPIN_UP: f64 = 0.01;

#[typetag::serde(name = "backlash")]
impl Effect for Backlash {
    fn name(&self) -> &str {
        "backlash"
    }

    fn about(&self) -> String {
        match self.at_motor {
            false => "play in the gears of both wheels".to_owned(),
            true => "play in the gears of both wheels, speeds recorded at the motors".to_owned(),
        }
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
        [gap, force::spin_up()].into_iter().chain(behind).chain(force::turning_ratio(scene)).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let h = scene.frame.half_track();
        let values = |gap: f64, behind: f64| force::with_ratio(scene, &[gap * h, SPIN_UP, behind, behind]);
        let start = |gap: f64, behind: f64| Start { values: values(gap, behind), columns: vec![vec![0]], linear: false };
        GAPS.into_iter().flat_map(|gap| BEHIND.map(|behind| start(gap, behind))).collect()
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
        format!("the gears have a play of {play} at the rim{angle}; the model had none")
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
            let moment = Moment::new(p, frame, motion, state);
            (moment, moment.at_once(p))
        } else {
            let moment = Moment::middle(p, frame, motion, state);
            (moment, moment.over(p, motion, state, at.step))
        };
        drive.copy_from_slice(&moment.loops.of_wheels(moment.arriving(p, given, motion, drive)));
    }

    fn advance(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, drive: &[f64], state: &mut [f64]) {
        if p[0] <= 0.0 {
            return;
        }
        let first = state[MIDDLE] == 0.0;
        if first {
            let moment = Moment::new(p, &at.scene.frame, motion, state);
            let gaining = moment.loops.accelerations(motion, moment.arriving(p, moment.at_once(p), motion, drive));
            for (side, own) in state[..MIDDLE].chunks_exact_mut(EACH).enumerate() {
                own.copy_within(..BEFORE, BEFORE);
                (own[WANTED], own[GAINING]) = (moment.wants[side], gaining[side]);
            }
        } else {
            // The whole step at what was wanted in its middle: of second order, as the motion is.
            for own in state[..MIDDLE].chunks_exact_mut(EACH) {
                let wheel = Wheel { acceleration: own[GAINING], yields: 0.0 };
                Motor::of(&own[BEFORE..]).on(p, own[WANTED], wheel, at.step).0.keep(own);
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

/// Both motors at some moment of a step.
#[derive(Debug, Clone, Copy)]
struct Moment {
    /// The loops of what is before the gap.
    loops: Loops,
    motors: [Motor; 2],
    /// By how much each would run ahead of its wheel if it moved nothing else; not at all where nothing would hold it back.
    wants: [f64; 2],
}

impl Moment {
    /// As the motion has it.
    fn new(p: &[f64], frame: &Frame, motion: &Motion<'_>, state: &[f64]) -> Self {
        let (loops, motors) = (loops(p, frame, motion), motors(state, 0));
        let (commands, held) = (loops.at_wheels(motion.u), loops.withdrawn(motion.outputs));
        let of = |i: usize| (commands[i] - held[i] - loops.cross[i] * motors[1 - i].ahead) / loops.own[i];
        Self { loops, motors, wants: [0, 1].map(|i| if loops.hold() { of(i) } else { 0.0 }) }
    }

    /// At the start of a step with what is wanted in its middle, which is known by then.
    fn middle(p: &[f64], frame: &Frame, motion: &Motion<'_>, state: &[f64]) -> Self {
        let wants = [0, 1].map(|side| state[EACH * side + WANTED]);
        Self { loops: loops(p, frame, motion), motors: motors(state, BEFORE), wants }
    }

    /// What the wheels get at this moment.
    fn at_once(&self, p: &[f64]) -> [Given; 2] {
        let pressed = |side: usize| if self.motors[side].touches(self.wants[side], p[0]) { 1.0 } else { 0.0 };
        [0, 1].map(|side| Given { thrown: 0.0, pressed: pressed(side) })
    }

    /// What they get over a time from here on.
    fn over(&self, p: &[f64], motion: &Motion<'_>, state: &[f64], span: f64) -> [Given; 2] {
        [0, 1].map(|side| {
            let wheel = Wheel { acceleration: state[EACH * side + GAINING], yields: self.loops.yields(motion, side) };
            self.motors[side].on(p, self.wants[side], wheel, span).1
        })
    }

    /// The drives that the model has to be given at the wheels, by what they get of their motors.
    fn arriving(&self, p: &[f64], given: [Given; 2], motion: &Motion<'_>, drive: &[f64]) -> [f64; 2] {
        let Self { loops, motors, wants } = self;
        let drives = loops.at_wheels(drive);
        let free = [0, 1].map(|side| loops.own[side] * (1.0 - given[side].pressed));
        let left = [0, 1].map(|side| drives[side] - loops.cross[side] * motors[1 - side].ahead - free[side] * wants[side]);
        // A wheel that coasts does not carry its motor along.
        let moved = loops.lighter(motion, free.map(|free| free * p[1]), left);
        [0, 1].map(|side| moved[side] + loops.own[side] * given[side].thrown)
    }
}

/// The loops of what is before the gap.
fn loops(p: &[f64], frame: &Frame, motion: &Motion<'_>) -> Loops {
    Loops::of(frame, motion, p.get(4), [1.0 - p[2], 1.0 - p[3]])
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

    /// Whether its teeth touch the flank towards which it wants to go.
    fn touches(self, wants: f64, gap: f64) -> bool {
        self.place * wants.signum() >= 0.5 * gap
    }

    /// The motor some time later that wants to run ahead at a speed, of a wheel that accelerates, and what the wheel gets in that time.
    fn on(mut self, p: &[f64], wants: f64, wheel: Wheel, span: f64) -> (Self, Given) {
        let (gap, spin_up) = (p[0], p[1]);
        let flying = wants - spin_up * wheel.acceleration;
        let (mut left, mut thrown) = (span, 0.0);
        // It meets a flank and stays there, or is thrown against one and leaves it, perhaps for the other.
        for _ in 0..3 {
            if self.touches(wants, gap) {
                self.ahead = 0.0;
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
