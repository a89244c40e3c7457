//! The plant: a rigid body on two driven wheels, each with its motor, rolling without slip.
//!
//! Nothing here is solved beforehand. [`Plant::imbalance`] states Newton's and Euler's equations with the forces that the
//! motors put on the ground; the accelerations are those at which nothing is left over. The controllers act on
//! accelerations too, so voltages, forces and accelerations form one algebraic loop, which this closes.

use serde::{Deserialize, Serialize};

use super::control::{ControlLaw, Motion};

/// Physical constants of a differential-drive robot, those of both wheels being equal. Motor quantities are seen from
/// the wheel: the gear is included.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlantConstants {
    /// m, total mass \[kg\].
    pub mass: f64,
    /// Iz, moment of inertia of the whole about the vertical through its centre of mass \[kg m²\].
    pub inertia: f64,
    /// b, how far the centre of mass lies ahead of the axle \[m\].
    pub com_offset: f64,
    /// d, distance between the wheels' contact points \[m\].
    pub track_width: f64,
    /// r, rolling radius: wheel angle to path \[m\].
    pub wheel_radius: f64,
    /// Rt, lever arm of the ground force about the wheel's axle \[m\]; physically equal to r.
    pub tyre_radius: f64,
    /// Ra, resistance of the motor's circuit \[Ω\].
    pub motor_resistance: f64,
    /// ka, torque at the wheel per current \[N m/A\].
    pub torque_constant: f64,
    /// kb, back-EMF per wheel speed \[V s/rad\].
    pub back_emf_constant: f64,
    /// Ie, inertia of one motor, gear and wheel about the axle \[kg m²\].
    pub wheel_inertia: f64,
    /// Be, viscous friction of one motor, gear and wheel \[N m s/rad\].
    pub wheel_friction: f64,
    /// Largest motor voltage either way \[V\]; without it voltages have no bound.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub supply_voltage: Option<f64>,
}

/// One value a side.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sides {
    /// Left.
    pub left: f64,
    /// Right.
    pub right: f64,
}

impl Sides {
    /// The wheels' share in a body motion at `radius`: (forward ± turning·d/2)/radius.
    pub fn of_body(forward: f64, turning: f64, track_width: f64, radius: f64) -> Self {
        let half = 0.5 * track_width * turning;
        Self { left: (forward - half) / radius, right: (forward + half) / radius }
    }

    /// The body's motion, forward and turning, when the wheels roll so.
    pub fn to_body(self, track_width: f64, radius: f64) -> [f64; 2] {
        [0.5 * radius * (self.right + self.left), radius * (self.right - self.left) / track_width]
    }

    /// Each side through a function.
    #[must_use]
    pub fn map(self, f: impl Fn(f64) -> f64) -> Self {
        Self { left: f(self.left), right: f(self.right) }
    }
}

/// Where the robot is and how it moves. Poses are those of the axle's midpoint.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct State {
    /// Forward velocity \[m/s\].
    pub v: f64,
    /// Angular velocity \[rad/s\].
    pub omega: f64,
    /// Position \[m\].
    pub x: f64,
    /// Position \[m\].
    pub y: f64,
    /// Heading, not wrapped \[rad\].
    pub phi: f64,
    /// Angle that each wheel has turned \[rad\].
    pub wheels: Sides,
}

impl State {
    /// `self + h·rate`, every member alike.
    fn plus(&self, rate: &Self, h: f64) -> Self {
        Self {
            v: self.v + h * rate.v,
            omega: self.omega + h * rate.omega,
            x: self.x + h * rate.x,
            y: self.y + h * rate.y,
            phi: self.phi + h * rate.phi,
            wheels: Sides { left: self.wheels.left + h * rate.wheels.left, right: self.wheels.right + h * rate.wheels.right },
        }
    }

    /// True while every member is a finite number.
    pub fn is_finite(&self) -> bool {
        [self.v, self.omega, self.x, self.y, self.phi, self.wheels.left, self.wheels.right].iter().all(|x| x.is_finite())
    }
}

/// Step × fastest rate of the plant. The error of the fourth-order method is (step × rate)⁴/120 of a jump in the
/// command, here 1e-10.
const STEP_RATE: f64 = 0.01;
/// The pose turns with the robot, however slow its dynamics: no step is longer than this \[s\].
const LONGEST_STEP: f64 = 0.002;

/// The body with its motors and its low-level controller, a system of ordinary differential equations.
#[derive(Debug, Clone)]
pub struct Plant {
    constants: PlantConstants,
    law: ControlLaw,
    step: f64,
}

impl Plant {
    /// A plant whose constants were checked.
    pub fn new(constants: PlantConstants, law: ControlLaw) -> Self {
        let mut plant = Self { constants, law, step: LONGEST_STEP };
        let decay = |state: State, pick: usize| -plant.accelerations(&state, [0.0; 2])[pick];
        // Slow enough that no voltage saturates, so that this is the rate of the free plant.
        let small = 1e-9;
        let rates = [decay(State { v: small, ..State::default() }, 0), decay(State { omega: small, ..State::default() }, 1)];
        let fastest = rates[0].max(rates[1]) / small;
        plant.step = (STEP_RATE / fastest).min(LONGEST_STEP);
        plant
    }

    /// The constants.
    pub fn constants(&self) -> &PlantConstants {
        &self.constants
    }

    /// What is left over of the equations of motion, force \[N\] and moment about the centre of mass \[N m\], for trial
    /// accelerations `a` = (v', ω') under motor voltages `u`:
    ///
    /// - wheel and motor: Ie α + Be ω_w = ka (u − kb ω_w)/Ra − F Rt,
    /// - along the body: m (v' − b ω²) = F_right + F_left,
    /// - across it: m (b ω' + v ω) = F_across, as neither wheel slides sideways,
    /// - about the centre of mass: Iz ω' = (F_right − F_left) d/2 − b F_across.
    fn imbalance(&self, state: &State, u: Sides, a: [f64; 2]) -> [f64; 2] {
        let c = &self.constants;
        let [v_dot, omega_dot] = a;
        let traction = |u: f64, wheel_speed: f64, wheel_acceleration: f64| {
            let current = (u - c.back_emf_constant * wheel_speed) / c.motor_resistance;
            (c.torque_constant * current - c.wheel_friction * wheel_speed - c.wheel_inertia * wheel_acceleration) / c.tyre_radius
        };
        let speed = Sides::of_body(state.v, state.omega, c.track_width, c.wheel_radius);
        let acceleration = Sides::of_body(v_dot, omega_dot, c.track_width, c.wheel_radius);
        let left = traction(u.left, speed.left, acceleration.left);
        let right = traction(u.right, speed.right, acceleration.right);
        let across = c.mass * (c.com_offset * omega_dot + state.v * state.omega);
        [
            c.mass * (v_dot - c.com_offset * state.omega * state.omega) - (right + left),
            c.inertia * omega_dot - (0.5 * c.track_width * (right - left) - c.com_offset * across),
        ]
    }

    /// Accelerations (v', ω') under a set point (v_ref, ω_ref).
    pub fn accelerations(&self, state: &State, set_point: [f64; 2]) -> [f64; 2] {
        let wanted = |a: [f64; 2]| {
            let motion = Motion { v: state.v, omega: state.omega, v_dot: a[0], omega_dot: a[1] };
            self.law.voltages(&self.constants, set_point, &motion)
        };
        let free = balance(|a| self.imbalance(state, wanted(a), a));
        match self.constants.supply_voltage {
            Some(limit) if out_of(wanted(free), limit) => self.saturated(state, wanted, limit).unwrap_or(free),
            _ => free,
        }
    }

    /// Accelerations with at least one motor at full voltage: each motor is in turn taken to be free, at the upper and
    /// at the lower end, and the case that agrees with what the controller then asks for is the true one.
    fn saturated(&self, state: &State, wanted: impl Fn([f64; 2]) -> Sides, limit: f64) -> Option<[f64; 2]> {
        const CASES: [Option<f64>; 3] = [Some(1.0), Some(-1.0), None];
        let held = |case: Option<f64>, wanted: f64| case.map_or(wanted, |sign| sign * limit);
        let agrees = |case: Option<f64>, wanted: f64| case.map_or(wanted.abs() <= limit, |sign| sign * wanted >= limit);
        CASES.iter().flat_map(|left| CASES.iter().map(move |right| (*left, *right))).find_map(|(left, right)| {
            let applied = |a| {
                let wanted = wanted(a);
                Sides { left: held(left, wanted.left), right: held(right, wanted.right) }
            };
            let a = balance(|a| self.imbalance(state, applied(a), a));
            let asked = wanted(a);
            (agrees(left, asked.left) && agrees(right, asked.right)).then_some(a)
        })
    }

    /// Advances the state by `interval` \[s\] with the set point that `set_point` gives at each time since its beginning:
    /// classical Runge-Kutta, equal steps.
    pub fn advance(&self, state: &mut State, interval: f64, set_point: impl Fn(f64) -> [f64; 2]) {
        let steps = (interval / self.step).ceil().max(1.0);
        let h = interval / steps;
        for k in 0..steps as usize {
            let t = h * k as f64;
            let (begin, middle, end) = (set_point(t), set_point(t + 0.5 * h), set_point(t + h));
            let k1 = self.rate(state, begin);
            let k2 = self.rate(&state.plus(&k1, 0.5 * h), middle);
            let k3 = self.rate(&state.plus(&k2, 0.5 * h), middle);
            let k4 = self.rate(&state.plus(&k3, h), end);
            *state = state.plus(&k1, h / 6.0).plus(&k2, h / 3.0).plus(&k3, h / 3.0).plus(&k4, h / 6.0);
        }
    }

    /// Time derivative of the state.
    fn rate(&self, state: &State, set_point: [f64; 2]) -> State {
        let [v, omega] = self.accelerations(state, set_point);
        let (sin, cos) = state.phi.sin_cos();
        let wheels = Sides::of_body(state.v, state.omega, self.constants.track_width, self.constants.wheel_radius);
        State { v, omega, x: state.v * cos, y: state.v * sin, phi: state.omega, wheels }
    }
}

fn out_of(u: Sides, limit: f64) -> bool {
    u.left.abs() > limit || u.right.abs() > limit
}

/// The zero of an affine function of two unknowns, from its values at the origin and at the two units.
fn balance(f: impl Fn([f64; 2]) -> [f64; 2]) -> [f64; 2] {
    let (origin, along, about) = (f([0.0, 0.0]), f([1.0, 0.0]), f([0.0, 1.0]));
    let (a11, a21) = (along[0] - origin[0], along[1] - origin[1]);
    let (a12, a22) = (about[0] - origin[0], about[1] - origin[1]);
    let determinant = a11 * a22 - a12 * a21;
    [(a12 * origin[1] - a22 * origin[0]) / determinant, (a21 * origin[0] - a11 * origin[1]) / determinant]
}
