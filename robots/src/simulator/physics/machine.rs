//! The plant with the parts that are on: what each part gives goes into Newton's and Euler's equations, and those are integrated.
//!
//! The motors' side is one affine loop: the control law acts on the accelerations that its voltages cause. Its two unknowns are the
//! accelerations of the shafts, found as for the rigid plant by evaluating what is left over at trial values. What the shafts push is the
//! wheels (or the gears' teeth, where there is play), and the wheels push the body (or the tyres, where they slip).

use super::super::control::{ControlLaw, Motion};
use super::super::plant::{PlantConstants, Sides, State, balance};
use super::body::Mass;
use super::firmware::Loop;
use super::sensing::Observed;
use super::wheel::Wheels;
use super::{GRAVITY, Physics};

/// Step × fastest rate, for an error of (0.25)⁴/120 of what moves that fast.
const STEP_RATE: f64 = 0.25;
/// No step is longer than this \[s\].
const LONGEST_STEP: f64 = 1e-3;
/// Most voltage where nothing limits it \[V\].
const NO_LIMIT: f64 = f64::INFINITY;
/// Speed up to which the step is chosen to be short enough \[rad/s\].
const FAST_WHEEL: f64 = 20.0;

// Places in the state.
pub(super) const V: usize = 0;
pub(super) const ACROSS: usize = 1;
pub(super) const OMEGA: usize = 2;
pub(super) const X: usize = 3;
pub(super) const Y: usize = 4;
pub(super) const PHI: usize = 5;
/// Angle of each wheel.
pub(super) const ANGLE: usize = 6;
/// Speed of each wheel, where tyres slip.
pub(super) const SPIN: usize = 8;
/// Angle and speed of each motor's shaft, where gears have play.
pub(super) const SHAFT: usize = 10;
pub(super) const SHAFT_SPEED: usize = 12;
/// Bend of each drive's bristles.
pub(super) const BEND: usize = 14;
/// Current of each motor, where it has inductance.
pub(super) const CURRENT: usize = 16;
pub(super) const CASTOR: usize = 18;
pub(super) const BUS: usize = 19;
pub(super) const CHARGE: usize = 20;
const SIZE: usize = 21;

type Vector = [f64; SIZE];

fn sides(s: &Vector, place: usize) -> Sides {
    Sides { left: s[place], right: s[place + 1] }
}

fn set(s: &mut Vector, place: usize, value: Sides) {
    (s[place], s[place + 1]) = (value.left, value.right);
}

/// What drives the motors during a step.
#[derive(Debug, Clone, Copy)]
enum Drive {
    /// The continuous law, under a set point.
    Law([f64; 2]),
    /// Voltages that firmware holds.
    Held(Sides),
}

/// Everything about one instant that does not depend on unknown accelerations.
struct Instant {
    mass: Mass,
    radii: Sides,
    /// Change of the radii with the wheels' angles.
    slopes: Sides,
    half: f64,
    wheel: Sides,
    shaft: Sides,
    /// Force along, across \[N\] and moment about the axle's middle \[N m\] of everything but the driven wheels' drive.
    force: [f64; 2],
    moment: f64,
    /// Forces of slipping tyres on the body, along and across, left and right.
    tyres: Option<[[f64; 2]; 2]>,
    /// Torque of dry friction on each shaft, and the rates of the bristles.
    dry: Sides,
    bending: Sides,
    castor_rate: f64,
    /// Torque of each gear on its wheel, where there is play.
    gears: Option<Sides>,
    /// Factor and bounds of the voltages: what the driver makes of what is asked for.
    driver: f64,
    bounds: [[f64; 2]; 2],
}

/// The robot as a machine.
#[derive(Debug, Clone)]
pub(in super::super) struct Machine {
    c: PlantConstants,
    law: ControlLaw,
    physics: Physics,
    wheels: Wheels,
    state: Vector,
    t: f64,
    step: f64,
    firmware: Loop,
}

impl Machine {
    /// A machine of checked settings, at rest. `step` is the longest that the rigid plant would take \[s\].
    pub(in super::super) fn new(c: PlantConstants, law: ControlLaw, physics: Physics, step: f64) -> Self {
        let mut state = [0.0; SIZE];
        state[CASTOR] = physics.castor.as_ref().map_or(0.0, |castor| castor.angle);
        state[BUS] = physics.battery.as_ref().map_or(0.0, |battery| battery.open_voltage(0.0));
        let wheels = physics.wheels.clone().unwrap_or_default();
        let mut machine = Self { c, law, physics, wheels, state, t: 0.0, step, firmware: Loop::default() };
        machine.step = machine.longest_step(step);
        machine
    }

    /// Longest integration step \[s\].
    pub(in super::super) fn step(&self) -> f64 {
        self.step
    }

    fn longest_step(&self, step: f64) -> f64 {
        let (p, c) = (&self.physics, &self.c);
        let speed = FAST_WHEEL * c.wheel_radius;
        // The least that a drive's friction and gear may have to move.
        let inertia = c.wheel_inertia.max(1e-3 * c.mass * c.wheel_radius.powi(2));
        let inductance = p.motors.as_ref().map_or(0.0, |m| m.inductance);
        let rates = [
            p.battery.as_ref().map_or(0.0, |b| b.rate()),
            p.friction.as_ref().map_or(0.0, |f| f.rate(inertia, FAST_WHEEL)),
            p.gear.as_ref().map_or(0.0, |g| g.rate(inertia)),
            p.castor.as_ref().map_or(0.0, |k| k.rate(speed)),
            p.contact.as_ref().and_then(|k| k.slip.as_ref()).map_or(0.0, |s| s.rate(c.mass, inertia, c.wheel_radius)),
            if inductance > 0.0 { (c.resistance + self.braking_gain() * c.torque_constant / inertia) / inductance } else { 0.0 },
        ];
        let fastest = rates.into_iter().fold(0.0, f64::max);
        // With play or slip the motor turns alone, and the loop about it is as fast as its own inertia lets it.
        let alone = if p.gear.is_some() || self.slips() { 0.2 * step.max(1e-5) } else { step };
        (STEP_RATE / fastest.max(1e-9)).min(LONGEST_STEP).min(alone.max(2e-6))
    }

    /// Volts on one motor per acceleration of its wheel, at most.
    fn braking_gain(&self) -> f64 {
        let motion = Motion { v: 0.0, omega: 0.0, v_dot: 0.5 * self.c.wheel_radius, omega_dot: self.c.wheel_radius / self.c.track_width };
        let u = self.law.voltages(&self.c, [0.0; 2], &motion);
        if self.physics.firmware.is_some() { 0.0 } else { u.left.abs().max(u.right.abs()) }
    }

    fn slips(&self) -> bool {
        self.physics.contact.as_ref().is_some_and(|c| c.slip.is_some())
    }

    /// Advances by `interval` \[s\] with the set point at each time since its beginning; `seen` is told after every step.
    pub(in super::super) fn advance(&mut self, interval: f64, set_point: impl Fn(f64) -> [f64; 2], mut seen: impl FnMut(f64, Observed)) {
        let start = self.t;
        let end = start + interval;
        while self.t < end {
            let ahead = self.t - start;
            let mut h = self.step.min(end - self.t);
            if let Some(payload) = &self.physics.payload {
                h = payload.next_change(self.t).map_or(h, |change| h.min((change - self.t).max(1e-9)));
            }
            let held = self.firmware_step(set_point(ahead), &mut h);
            // A last step that rounding left over is none.
            if h < 1e-12 {
                self.t = end;
                break;
            }
            let at = |share: f64| held.map_or_else(|| Drive::Law(set_point(ahead + share * h)), Drive::Held);
            let (begin, middle, last) = (at(0.0), at(0.5), at(1.0));
            let s = self.state;
            let k1 = self.rate(&s, begin);
            let k2 = self.rate(&plus(&s, &k1, 0.5 * h), middle);
            let k3 = self.rate(&plus(&s, &k2, 0.5 * h), middle);
            let k4 = self.rate(&plus(&s, &k3, h), last);
            self.state = std::array::from_fn(|i| s[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]));
            self.t += h;
            seen(self.t, self.observed());
        }
    }

    /// Lets the firmware tick if it is due, and shortens the step to its next tick.
    fn firmware_step(&mut self, set_point: [f64; 2], h: &mut f64) -> Option<Sides> {
        let firmware = self.physics.firmware.as_ref()?;
        let due = self.firmware.count as f64 * firmware.period;
        if self.t >= due - 1e-9 {
            self.firmware.tick(firmware, &self.c, self.observed().angles, set_point);
        }
        let next = self.firmware.count as f64 * firmware.period;
        *h = h.min((next - self.t).max(1e-9));
        Some(self.firmware.volts)
    }

    /// The true state as the rigid plant has it; the wheels are those that carry the encoders.
    pub(in super::super) fn state(&self) -> State {
        let s = &self.state;
        State { v: s[V], omega: s[OMEGA], x: s[X], y: s[Y], phi: s[PHI], wheels: self.observed().angles }
    }

    /// What sensors see now.
    pub(in super::super) fn observed(&self) -> Observed {
        let s = &self.state;
        let geared = self.physics.gear.is_some();
        let angles = sides(s, if geared { SHAFT } else { ANGLE });
        let speeds = if geared { sides(s, SHAFT_SPEED) } else { self.wheel_speeds(s) };
        Observed { angles, speeds, pose: [s[X], s[Y], s[PHI]] }
    }

    /// True while every number is finite.
    pub(in super::super) fn is_finite(&self) -> bool {
        self.state.iter().all(|x| x.is_finite())
    }

    fn half(&self) -> f64 {
        0.5 * self.wheels.track * self.c.track_width
    }

    fn wheel_speeds(&self, s: &Vector) -> Sides {
        if self.slips() {
            return sides(s, SPIN);
        }
        let (radii, _) = self.wheels.radii(&self.c, sides(s, ANGLE));
        let turn = self.half() * s[OMEGA];
        Sides { left: (s[V] - turn) / radii.left, right: (s[V] + turn) / radii.right }
    }

    /// Everything known before the accelerations are.
    fn instant(&self, s: &Vector) -> Instant {
        let (p, c) = (&self.physics, &self.c);
        let mass = Mass::of(c, p.body.as_ref(), p.payload.as_ref(), self.t);
        let half = self.half();
        let (radii, slopes) = self.wheels.radii(c, sides(s, ANGLE));
        let wheel = self.wheel_speeds(s);
        let shaft = if p.gear.is_some() { sides(s, SHAFT_SPEED) } else { wheel };
        let ground = Sides { left: s[V] - half * s[OMEGA], right: s[V] + half * s[OMEGA] };
        let (mut force, mut moment) = ([0.0; 2], 0.0);
        let mut push = |along: f64, across: f64, about: f64| {
            force[0] += along;
            force[1] += across;
            moment += about;
        };
        if let Some(terrain) = &p.terrain {
            let [along, across] = terrain.pull(s[X], s[PHI]).map(|a| mass.mass * a);
            push(along, across, mass.ahead * across - mass.left * along);
        }
        if let Some(body) = &p.body {
            push(body.drag(s[V]), 0.0, 0.0);
        }
        let mut castor_rate = 0.0;
        if let Some(castor) = &p.castor {
            let (pull, about, rate) = castor.act(s[CASTOR], s[V], s[ACROSS], s[OMEGA]);
            push(pull[0], pull[1], about);
            castor_rate = rate;
        }
        let mut tyres = None;
        if let Some(contact) = &p.contact {
            let load = 0.5 * contact.load_share * mass.mass * GRAVITY;
            let (left, right) = (contact.rolling(load, ground.left), contact.rolling(load, ground.right));
            push(left + right, 0.0, half * (right - left) + contact.turning(s[OMEGA]));
            tyres = contact.slip.as_ref().map(|slip| {
                [(radii.left * wheel.left, ground.left), (radii.right * wheel.right, ground.right)]
                    .map(|(rim, ground)| slip.force(load, rim - ground, -s[ACROSS]))
            });
        }
        let (dry, bending) = self.dry(s, shaft);
        let gears = p.gear.as_ref().map(|gear| {
            let twist = |i: usize| s[SHAFT + i] - s[ANGLE + i];
            Sides {
                left: gear.torque(twist(0), shaft.left - wheel.left, c.wheel_inertia),
                right: gear.torque(twist(1), shaft.right - wheel.right, c.wheel_inertia),
            }
        });
        let (driver, bounds) = self.driver(s, shaft);
        Instant { mass, radii, slopes, half, wheel, shaft, force, moment, tyres, dry, bending, castor_rate, gears, driver, bounds }
    }

    fn dry(&self, s: &Vector, shaft: Sides) -> (Sides, Sides) {
        let Some(friction) = &self.physics.friction else { return Default::default() };
        let left = friction.torque(friction.left, shaft.left, s[BEND], self.c.wheel_inertia);
        let right = friction.torque(friction.right, shaft.right, s[BEND + 1], self.c.wheel_inertia);
        (Sides { left: left.0, right: right.0 }, Sides { left: left.1, right: right.1 })
    }

    /// What becomes of voltages: the driver's factor, and the bounds of each motor's.
    fn driver(&self, s: &Vector, shaft: Sides) -> (f64, [[f64; 2]; 2]) {
        let supply = self.c.supply_voltage.unwrap_or(NO_LIMIT);
        let (factor, most) = self.physics.battery.as_ref().map_or((1.0, supply), |b| {
            let (factor, bus) = b.driver(s[BUS]);
            (factor, bus.clamp(0.0, supply))
        });
        let limit = self.physics.motors.as_ref().and_then(|m| m.current_limit);
        let strength = self.strength();
        let bounds = |speed: f64, strength: f64| {
            // Where the current is limited, the voltage keeps it between its bounds about the back-EMF.
            let (emf, room) = (strength * self.c.emf_constant * speed, limit.map_or(NO_LIMIT, |i| i * self.c.resistance));
            [(emf - room).clamp(-most, most), (emf + room).clamp(-most, most)]
        };
        (factor, [bounds(shaft.left, strength.left), bounds(shaft.right, strength.right)])
    }

    fn strength(&self) -> Sides {
        self.physics.motors.as_ref().map_or(Sides { left: 1.0, right: 1.0 }, |m| m.strength())
    }

    /// Voltages that the law asks for, at trial accelerations of the shafts, as the driver passes them on.
    fn asked(&self, now: &Instant, drive: Drive, shafts: Sides) -> Sides {
        let asked = match drive {
            Drive::Held(volts) => volts,
            Drive::Law(set_point) => {
                // The controller knows the wheels by its encoders, and the robot by the dimensions it believes in.
                let [v, omega] = now.shaft.to_body(self.c.track_width, self.c.wheel_radius);
                let [v_dot, omega_dot] = shafts.to_body(self.c.track_width, self.c.wheel_radius);
                self.law.voltages(&self.c, set_point, &Motion { v, omega, v_dot, omega_dot })
            }
        };
        asked.map(|u| now.driver * u)
    }

    /// Torque of each motor at voltages \[N m\], and its current \[A\].
    fn motors(&self, s: &Vector, now: &Instant, u: Sides) -> (Sides, Sides) {
        let strength = self.strength();
        let of = |u: f64, speed: f64, strength: f64, own: f64| {
            let flows = (u - strength * self.c.emf_constant * speed) / self.c.resistance;
            let current = if self.inductance() > 0.0 { own } else { flows };
            (strength * self.c.torque_constant * current, current)
        };
        let left = of(u.left, now.shaft.left, strength.left, s[CURRENT]);
        let right = of(u.right, now.shaft.right, strength.right, s[CURRENT + 1]);
        (Sides { left: left.0, right: right.0 }, Sides { left: left.1, right: right.1 })
    }

    fn inductance(&self) -> f64 {
        self.physics.motors.as_ref().map_or(0.0, |m| m.inductance)
    }

    /// Forces of the ground on the wheels \[N\] that accelerate body and load as wheels that roll do.
    fn rolling(&self, s: &Vector, now: &Instant, wheels: Sides) -> Sides {
        let [v_dot, omega_dot] = self.body_rates(now, wheels);
        let (m, omega) = (now.mass, s[OMEGA]);
        let ahead = v_dot - omega_dot * m.left - omega * omega * m.ahead;
        let across = omega * s[V] + omega_dot * m.ahead - omega * omega * m.left;
        let along = m.mass * ahead - now.force[0];
        let about = m.inertia * omega_dot + m.mass * (m.ahead * across - m.left * ahead) - now.moment;
        let turning = about / now.half;
        Sides { left: 0.5 * (along - turning), right: 0.5 * (along + turning) }
    }

    /// Accelerations of a body on rolling wheels, whose radii change as they turn.
    fn body_rates(&self, now: &Instant, wheels: Sides) -> [f64; 2] {
        let rim = |radius: f64, slope: f64, speed: f64, acceleration: f64| radius * acceleration + slope * speed * speed;
        let left = rim(now.radii.left, now.slopes.left, now.wheel.left, wheels.left);
        let right = rim(now.radii.right, now.slopes.right, now.wheel.right, wheels.right);
        [0.5 * (left + right), 0.5 * (right - left) / now.half]
    }

    /// Torque \[N m\] that the ground takes from each wheel.
    fn ground(&self, s: &Vector, now: &Instant, wheels: Sides) -> Sides {
        let lever = self.c.tyre_radius.unwrap_or(self.c.wheel_radius);
        let forces = match now.tyres {
            Some([left, right]) => Sides { left: left[0], right: right[0] },
            None => self.rolling(s, now, wheels),
        };
        forces.map(|f| f * lever)
    }

    /// Accelerations of the shafts and the voltages on the motors.
    fn shafts(&self, s: &Vector, now: &Instant, drive: Drive) -> (Sides, Sides) {
        let added = self.physics.motors.as_ref().map_or(Sides::default(), |m| m.friction());
        let inertia = self.physics.gear.as_ref().map_or(1.0, |g| g.motor_share) * self.c.wheel_inertia;
        let left_over = |u: Sides, shafts: Sides| {
            let (torque, _) = self.motors(s, now, u);
            let load = now.gears.unwrap_or_else(|| self.ground(s, now, shafts));
            let rest = |torque: f64, speed: f64, added: f64, dry: f64, load: f64, acceleration: f64| {
                torque - (self.c.wheel_friction + added) * speed - dry - load - inertia * acceleration
            };
            [
                rest(torque.left, now.shaft.left, added.left, now.dry.left, load.left, shafts.left),
                rest(torque.right, now.shaft.right, added.right, now.dry.right, load.right, shafts.right),
            ]
        };
        let pair = |a: [f64; 2]| Sides { left: a[0], right: a[1] };
        let asked = |a: [f64; 2]| self.asked(now, drive, pair(a));
        let solve = |cases: [Option<f64>; 2]| {
            let applied = |a| {
                let asked = asked(a);
                Sides { left: cases[0].unwrap_or(asked.left), right: cases[1].unwrap_or(asked.right) }
            };
            let a = balance(|a| left_over(applied(a), pair(a)));
            (a, applied(a))
        };
        let agrees = |case: usize, [low, high]: [f64; 2], u: f64| match case {
            0 => u >= low && u <= high,
            1 => u >= high,
            _ => u <= low,
        };
        // Each motor is in turn free, at its upper and at its lower bound; the case that agrees with what is asked for is the true one.
        for left in 0..3 {
            for right in 0..3 {
                let fixed = |case: usize, [low, high]: [f64; 2]| [None, Some(high), Some(low)][case];
                let (a, u) = solve([fixed(left, now.bounds[0]), fixed(right, now.bounds[1])]);
                let wanted = asked(a);
                if agrees(left, now.bounds[0], wanted.left) && agrees(right, now.bounds[1], wanted.right) {
                    return (pair(a), u);
                }
            }
        }
        let (a, u) = solve([None, None]);
        (pair(a), u)
    }

    /// Accelerations of the wheels behind gears with play, from the teeth's torques.
    fn geared_wheels(&self, s: &Vector, now: &Instant, teeth: Sides) -> Sides {
        let inertia = self.physics.gear.as_ref().map_or(0.0, |g| 1.0 - g.motor_share) * self.c.wheel_inertia;
        let left_over = |a: [f64; 2]| {
            let load = self.ground(s, now, Sides { left: a[0], right: a[1] });
            [teeth.left - load.left - inertia * a[0], teeth.right - load.right - inertia * a[1]]
        };
        let [left, right] = balance(left_over);
        Sides { left, right }
    }

    /// Accelerations along, across and about of a body that tyres push.
    fn pushed(&self, s: &Vector, now: &Instant, [left, right]: [[f64; 2]; 2]) -> [f64; 3] {
        let m = now.mass;
        let force = [now.force[0] + left[0] + right[0], now.force[1] + left[1] + right[1]];
        let about = now.moment + now.half * (right[0] - left[0]);
        let centre = about - (m.ahead * force[1] - m.left * force[0]);
        let (omega, omega_dot) = (s[OMEGA], centre / m.inertia);
        [
            force[0] / m.mass + omega * s[ACROSS] + omega_dot * m.left + omega * omega * m.ahead,
            force[1] / m.mass - omega * s[V] - omega_dot * m.ahead + omega * omega * m.left,
            omega_dot,
        ]
    }

    /// Time derivative of the state. Loads change between steps only.
    fn rate(&self, s: &Vector, drive: Drive) -> Vector {
        let now = self.instant(s);
        let (shafts, u) = self.shafts(s, &now, drive);
        let wheels = now.gears.map_or(shafts, |teeth| self.geared_wheels(s, &now, teeth));
        let mut rate = [0.0; SIZE];
        match now.tyres {
            Some(tyres) => {
                [rate[V], rate[ACROSS], rate[OMEGA]] = self.pushed(s, &now, tyres);
                set(&mut rate, SPIN, wheels);
            }
            None => [rate[V], rate[OMEGA]] = self.body_rates(&now, wheels),
        }
        let (sin, cos) = s[PHI].sin_cos();
        rate[X] = s[V] * cos - s[ACROSS] * sin;
        rate[Y] = s[V] * sin + s[ACROSS] * cos;
        rate[PHI] = s[OMEGA];
        set(&mut rate, ANGLE, now.wheel);
        if now.gears.is_some() {
            set(&mut rate, SHAFT, now.shaft);
            set(&mut rate, SHAFT_SPEED, shafts);
        }
        set(&mut rate, BEND, now.bending);
        rate[CASTOR] = now.castor_rate;
        self.electric(s, &now, u, &mut rate);
        rate
    }

    fn electric(&self, s: &Vector, now: &Instant, u: Sides, rate: &mut Vector) {
        let (_, current) = self.motors(s, now, u);
        let inductance = self.inductance();
        if inductance > 0.0 {
            let strength = self.strength();
            let of = |u: f64, speed: f64, strength: f64, i: f64| {
                (u - strength * self.c.emf_constant * speed - self.c.resistance * i) / inductance
            };
            rate[CURRENT] = of(u.left, now.shaft.left, strength.left, s[CURRENT]);
            rate[CURRENT + 1] = of(u.right, now.shaft.right, strength.right, s[CURRENT + 1]);
        }
        if let Some(battery) = &self.physics.battery {
            (rate[BUS], rate[CHARGE]) = battery.rates(s[BUS], s[CHARGE], u.left * current.left + u.right * current.right);
        }
    }

    #[cfg(test)]
    pub(super) fn place(&mut self, index: usize, value: f64) {
        self.state[index] = value;
    }

    #[cfg(test)]
    pub(super) fn at(&self, index: usize) -> f64 {
        self.state[index]
    }
}

fn plus(s: &Vector, rate: &Vector, h: f64) -> Vector {
    std::array::from_fn(|i| s[i] + h * rate[i])
}
