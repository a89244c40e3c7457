//! The plant: a rigid body on two driven wheels, each with its motor, rolling without slip.
//!
//! Nothing here is solved beforehand. `Plant::imbalance` states Newton's and Euler's equations with the forces that the
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
    pub yaw_inertia: f64,
    /// b, how far the centre of mass lies ahead of the axle \[m\].
    pub com_offset: f64,
    /// d, distance between the wheels' contact points \[m\].
    pub track_width: f64,
    /// r, rolling radius: wheel angle to path \[m\].
    pub wheel_radius: f64,
    /// Rt, lever arm of the ground force about the wheel's axle \[m\]; r without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tyre_radius: Option<f64>,
    /// Ra, resistance of the motor's circuit \[Ω\].
    pub resistance: f64,
    /// ka, torque at the wheel per current \[N m/A\].
    pub torque_constant: f64,
    /// kb, back-EMF per wheel speed \[V s/rad\].
    pub emf_constant: f64,
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

    /// Longest integration step \[s\].
    pub fn step(&self) -> f64 {
        self.step
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
        let lever = c.tyre_radius.unwrap_or(c.wheel_radius);
        let traction = |u: f64, wheel_speed: f64, wheel_acceleration: f64| {
            let current = (u - c.emf_constant * wheel_speed) / c.resistance;
            (c.torque_constant * current - c.wheel_friction * wheel_speed - c.wheel_inertia * wheel_acceleration) / lever
        };
        let speed = Sides::of_body(state.v, state.omega, c.track_width, c.wheel_radius);
        let acceleration = Sides::of_body(v_dot, omega_dot, c.track_width, c.wheel_radius);
        let left = traction(u.left, speed.left, acceleration.left);
        let right = traction(u.right, speed.right, acceleration.right);
        let across = c.mass * (c.com_offset * omega_dot + state.v * state.omega);
        [
            c.mass * (v_dot - c.com_offset * state.omega * state.omega) - (right + left),
            c.yaw_inertia * omega_dot - (0.5 * c.track_width * (right - left) - c.com_offset * across),
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
pub(super) fn balance(f: impl Fn([f64; 2]) -> [f64; 2]) -> [f64; 2] {
    let (origin, along, about) = (f([0.0, 0.0]), f([1.0, 0.0]), f([0.0, 1.0]));
    let (a11, a21) = (along[0] - origin[0], along[1] - origin[1]);
    let (a12, a22) = (about[0] - origin[0], about[1] - origin[1]);
    let determinant = a11 * a22 - a12 * a21;
    [(a12 * origin[1] - a22 * origin[0]) / determinant, (a21 * origin[0] - a11 * origin[1]) / determinant]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulator::control::{VwGains, WheelGains};

    const CONSTANTS: PlantConstants = PlantConstants {
        mass: 9.0,
        yaw_inertia: 0.21,
        com_offset: -0.035,
        track_width: 0.34,
        wheel_radius: 0.0975,
        tyre_radius: None,
        resistance: 1.2,
        torque_constant: 0.9,
        emf_constant: 0.85,
        wheel_inertia: 0.012,
        wheel_friction: 0.03,
        supply_voltage: None,
    };
    const VW: ControlLaw = ControlLaw::VwPd(VwGains { kpt: 30.0, kdt: 4.0, kpr: 7.0, kdr: 1.1 });
    const WHEEL: ControlLaw = ControlLaw::WheelPd(WheelGains { kp: 6.0, kd: 0.9 });

    fn states() -> impl Iterator<Item = (State, [f64; 2])> {
        (0..200).map(|i| {
            let wave = |k: f64| (k * f64::from(i)).sin();
            (State { v: 1.2 * wave(0.7), omega: 3.0 * wave(1.3), ..State::default() }, [1.5 * wave(2.1), 4.0 * wave(0.3)])
        })
    }

    /// Electrical power that becomes mechanical, left and right, and the loss to viscous friction \[W\].
    fn powers(c: &PlantConstants, state: &State, u: Sides) -> (f64, f64) {
        let wheels = Sides::of_body(state.v, state.omega, c.track_width, c.wheel_radius);
        let power = |u: f64, speed: f64| c.torque_constant * (u - c.emf_constant * speed) / c.resistance * speed;
        let drag = c.wheel_friction * (wheels.left.powi(2) + wheels.right.powi(2));
        (power(u.left, wheels.left) + power(u.right, wheels.right), drag)
    }

    /// Change of the kinetic energy of body and wheels \[W\]; the centre of mass moves across the body at b ω.
    fn kinetic(c: &PlantConstants, state: &State, [v_dot, omega_dot]: [f64; 2]) -> f64 {
        let wheels = Sides::of_body(state.v, state.omega, c.track_width, c.wheel_radius);
        let spin = Sides::of_body(v_dot, omega_dot, c.track_width, c.wheel_radius);
        let body = c.mass * (state.v * v_dot + c.com_offset.powi(2) * state.omega * omega_dot) + c.yaw_inertia * state.omega * omega_dot;
        body + c.wheel_inertia * (wheels.left * spin.left + wheels.right * spin.right)
    }

    #[test]
    fn energy_is_neither_made_nor_lost() {
        for law in [VW, WHEEL] {
            for supply_voltage in [None, Some(3.0)] {
                let constants = PlantConstants { supply_voltage, ..CONSTANTS };
                let plant = Plant::new(constants, law);
                for (state, set_point) in states() {
                    let a = plant.accelerations(&state, set_point);
                    let motion = Motion { v: state.v, omega: state.omega, v_dot: a[0], omega_dot: a[1] };
                    let limit = supply_voltage.unwrap_or(f64::INFINITY);
                    let u = law.voltages(&constants, set_point, &motion).map(|u| u.clamp(-limit, limit));
                    let (mechanical, drag) = powers(&constants, &state, u);
                    let kinetic = kinetic(&constants, &state, a);
                    assert!(
                        (mechanical - drag - kinetic).abs() < 1e-9 * (1.0 + mechanical.abs()),
                        "{state:?}: {mechanical} {drag} {kinetic}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_robot_without_command_comes_to_rest() {
        let plant = Plant::new(CONSTANTS, VW);
        let mut state = State { v: 1.0, omega: -2.0, ..State::default() };
        let mut speed = state.v.hypot(state.omega);
        for _ in 0..20 {
            plant.advance(&mut state, 0.1, |_| [0.0; 2]);
            assert!(state.v.hypot(state.omega) < speed);
            speed = state.v.hypot(state.omega);
        }
        assert!(speed < 1e-4, "{speed}");
    }

    #[test]
    fn full_voltage_gives_the_motors_top_speed() {
        let plant = Plant::new(PlantConstants { supply_voltage: Some(12.0), ..CONSTANTS }, WHEEL);
        let mut state = State::default();
        plant.advance(&mut state, 20.0, |_| [5.0, 0.0]);
        let c = CONSTANTS;
        let top = c.torque_constant * 12.0 / (c.resistance * c.wheel_friction + c.torque_constant * c.emf_constant);
        assert!((state.v - c.wheel_radius * top).abs() < 1e-9, "{} {}", state.v, c.wheel_radius * top);
    }

    #[test]
    fn one_saturated_motor_leaves_the_other_under_control() {
        let constants = PlantConstants { supply_voltage: Some(8.0), ..CONSTANTS };
        let plant = Plant::new(constants, WHEEL);
        let mut state = State::default();
        plant.advance(&mut state, 20.0, |_| [0.8, 4.0]);
        // Steady wheels: the right one wants 15.2 rad/s and gets 8 V, the left one is at its proportional error.
        let c = constants;
        let drag = c.resistance * c.wheel_friction / c.torque_constant + c.emf_constant;
        let reference = Sides::of_body(0.8, 4.0, c.track_width, c.wheel_radius);
        let wheels = Sides::of_body(state.v, state.omega, c.track_width, c.wheel_radius);
        // b couples the wheels through m b v ω, so both are shifted by the force that turning takes.
        let turning = c.mass * c.com_offset * state.v * state.omega / c.track_width;
        let forward = 0.5 * c.mass * c.com_offset * state.omega.powi(2);
        let lever = c.wheel_radius * c.resistance / c.torque_constant;
        let right = (8.0 - (turning - forward) * lever) / drag;
        let left = (6.0 * reference.left + (turning + forward) * lever) / (6.0 + drag);
        assert!((wheels.right - right).abs() < 1e-9 && (wheels.left - left).abs() < 1e-9, "{wheels:?} {right} {left}");
    }
}
