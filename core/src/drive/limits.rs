//! Limits on commands: what a program asks for is brought below what the robot may do, and each time that happens is counted.
//!
//! Speeds are clamped; a pair of speeds that would turn a wheel too fast is scaled, which keeps the curvature; changes are slowed
//! down to the allowed accelerations. The limited pair lies within all limits at once: the target is inside the wheels' limit,
//! and so is everything between it and the command before.

use serde::Serialize;
use thiserror::Error;

use crate::channel::{Channel, OMEGA_REF, V_REF};
use crate::profile::Limits;

/// A limit is said to bite where it takes away more than this share of itself; less is rounding.
const ROUNDING: f64 = 1e-9;

/// Why limits cannot be kept.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum LimitError {
    /// The robot does not take the command that a limit is about.
    #[error("limit `{limit}` is on the command `{channel}`, which this robot does not take")]
    NoCommand {
        /// Key of the limit.
        limit: &'static str,
        /// Command it is on.
        channel: String,
    },
    /// The dimensions that a limit on wheels needs are not known.
    #[error("limit `wheel_speed` needs the robot's `track_width` and `wheel_radius`: give its profile")]
    NoDimensions,
    /// A value is not a positive number.
    #[error("`{key}` is {value}; it must be a positive number")]
    Value {
        /// Key.
        key: &'static str,
        /// Value.
        value: f64,
    },
}

/// Where the wheels stand, for limits on them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wheels {
    /// Distance between the wheels' contact points \[m\].
    pub track_width: f64,
    /// Rolling radius \[m\].
    pub radius: f64,
}

/// How often, and how hard, one limit held a command back.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Bite {
    /// Key of the limit: `v`, `omega`, `v_dot`, `omega_dot`, `wheel_speed`.
    pub limit: &'static str,
    /// Its value, SI.
    pub value: f64,
    /// Most that was asked for, in the same unit.
    pub asked: f64,
    /// Commands held back.
    pub commands: usize,
    /// Time of the first of them \[s\].
    pub first_s: f64,
}

impl Bite {
    /// The bite in one sentence.
    pub fn statement(&self) -> String {
        let (name, unit) = match self.limit {
            "v" => ("forward speed", "m/s"),
            "omega" => ("angular speed", "rad/s"),
            "v_dot" => ("change of the forward speed", "m/s2"),
            "omega_dot" => ("change of the angular speed", "rad/s2"),
            _ => ("wheel speed", "rad/s"),
        };
        format!(
            "{} command(s) were held back by the limit on the {name}: {:.4} {unit} were asked for, {} are allowed (first at t = {:.2} s)",
            self.commands, self.asked, self.value, self.first_s
        )
    }
}

/// Keeps commands within limits.
#[derive(Debug, Clone)]
pub struct Limiter {
    limits: Limits,
    wheels: Option<Wheels>,
    /// Places of v_ref and omega_ref among the robot's commands.
    places: [Option<usize>; 2],
    /// The last limited (v_ref, omega_ref); the robot stands before the first.
    last: [f64; 2],
    bites: Vec<Bite>,
}

impl Limiter {
    /// Limits for a robot that takes `inputs` and stands still.
    ///
    /// # Errors
    /// [`LimitError`] if the robot lacks what a limit is about, so that it could not be kept.
    pub fn new(limits: Limits, wheels: Option<Wheels>, inputs: &[Channel]) -> Result<Self, LimitError> {
        let place = |channel: &Channel| inputs.iter().position(|c| c.name == channel.name);
        let places = [place(&V_REF), place(&OMEGA_REF)];
        let on = [
            ("v", limits.v, &[0][..]),
            ("omega", limits.omega, &[1]),
            ("v_dot", limits.v_dot, &[0]),
            ("omega_dot", limits.omega_dot, &[1]),
            ("wheel_speed", limits.wheel_speed, &[0, 1]),
        ];
        for (limit, value, needs) in on {
            let Some(value) = value else { continue };
            if !(value.is_finite() && value > 0.0) {
                return Err(LimitError::Value { key: limit, value });
            }
            if let Some(missing) = needs.iter().find(|i| places[**i].is_none()) {
                return Err(LimitError::NoCommand { limit, channel: [V_REF, OMEGA_REF][*missing].name.to_string() });
            }
        }
        if limits.wheel_speed.is_some() && wheels.is_none() {
            return Err(LimitError::NoDimensions);
        }
        Ok(Self { limits, wheels, places, last: [0.0; 2], bites: Vec::new() })
    }

    /// Brings `command`, to be held from `t` \[s\] on, within the limits; `dt` is the time since the command before \[s\].
    pub fn apply(&mut self, t: f64, dt: f64, command: &mut [f64]) {
        let asked = self.places.map(|place| place.map_or(0.0, |i| command[i]));
        let clamped = self.within_speeds(t, asked);
        let target = self.within_wheels(t, clamped);
        self.last = self.within_changes(t, dt, target);
        for (place, value) in self.places.iter().zip(self.last) {
            if let Some(i) = place {
                command[*i] = value;
            }
        }
    }

    /// Takes note that the robot was told to stand.
    pub fn stand(&mut self) {
        self.last = [0.0; 2];
    }

    /// What was held back so far.
    pub fn bites(&self) -> &[Bite] {
        &self.bites
    }

    /// The limits kept.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    fn within_speeds(&mut self, t: f64, asked: [f64; 2]) -> [f64; 2] {
        let keys = [("v", self.limits.v), ("omega", self.limits.omega)];
        std::array::from_fn(|i| {
            let (key, limit) = keys[i];
            limit.map_or(asked[i], |limit| {
                self.note(key, limit, asked[i].abs(), t);
                asked[i].clamp(-limit, limit)
            })
        })
    }

    fn within_wheels(&mut self, t: f64, [v, omega]: [f64; 2]) -> [f64; 2] {
        let (Some(limit), Some(wheels)) = (self.limits.wheel_speed, self.wheels) else { return [v, omega] };
        let fastest = fastest_wheel(wheels, [v, omega]);
        self.note("wheel_speed", limit, fastest, t);
        let factor = (limit / fastest).min(1.0);
        [v * factor, omega * factor]
    }

    /// From the command before towards the target, no faster than allowed: each axis by itself, or both alike where that would
    /// leave the wheels' limit.
    fn within_changes(&mut self, t: f64, dt: f64, target: [f64; 2]) -> [f64; 2] {
        let keys = [("v_dot", self.limits.v_dot), ("omega_dot", self.limits.omega_dot)];
        let mut share = [1.0_f64; 2];
        for (i, (key, limit)) in keys.into_iter().enumerate() {
            let change = (target[i] - self.last[i]).abs();
            let Some(limit) = limit else { continue };
            if change > 0.0 && dt > 0.0 {
                self.note(key, limit, change / dt, t);
            }
            share[i] = if change > limit * dt { limit * dt / change } else { 1.0 };
        }
        let towards = |share: [f64; 2]| -> [f64; 2] { std::array::from_fn(|i| self.last[i] + share[i] * (target[i] - self.last[i])) };
        let each = towards(share);
        let outside = |c: [f64; 2]| self.limits.wheel_speed.zip(self.wheels).is_some_and(|(limit, w)| fastest_wheel(w, c) > limit);
        if outside(each) { towards([share[0].min(share[1]); 2]) } else { each }
    }

    fn note(&mut self, limit: &'static str, value: f64, asked: f64, t: f64) {
        if asked <= value * (1.0 + ROUNDING) {
            return;
        }
        match self.bites.iter_mut().find(|bite| bite.limit == limit) {
            Some(bite) => {
                bite.commands += 1;
                bite.asked = bite.asked.max(asked);
            }
            None => self.bites.push(Bite { limit, value, asked, commands: 1, first_s: t }),
        }
    }
}

/// Speed of the faster wheel \[rad/s\].
fn fastest_wheel(wheels: Wheels, [v, omega]: [f64; 2]) -> f64 {
    (v.abs() + 0.5 * wheels.track_width * omega.abs()) / wheels.radius
}

#[cfg(test)]
mod tests {
    use super::*;

    const INPUTS: [Channel; 2] = [V_REF, OMEGA_REF];
    const WHEELS: Wheels = Wheels { track_width: 0.4, radius: 0.1 };

    fn limiter(limits: Limits) -> Limiter {
        Limiter::new(limits, Some(WHEELS), &INPUTS).unwrap()
    }

    #[test]
    fn without_limits_a_command_passes() {
        let mut free = limiter(Limits::default());
        let mut command = [3.0, -7.0];
        free.apply(0.0, 0.1, &mut command);
        assert_eq!(command, [3.0, -7.0]);
        assert!(free.bites().is_empty());
    }

    #[test]
    fn speeds_are_clamped_and_counted() {
        let mut limited = limiter(Limits { v: Some(0.5), omega: Some(1.0), ..Limits::default() });
        for (t, asked, expected) in [(0.0, [0.4, -0.9], [0.4, -0.9]), (0.1, [0.8, -2.0], [0.5, -1.0]), (0.2, [-0.6, 0.0], [-0.5, 0.0])] {
            let mut command = asked;
            limited.apply(t, 0.1, &mut command);
            assert_eq!(command, expected);
        }
        let v = &limited.bites()[0];
        assert_eq!((v.limit, v.commands, v.asked, v.first_s), ("v", 2, 0.8, 0.1));
        assert_eq!((limited.bites()[1].limit, limited.bites()[1].commands), ("omega", 1));
        assert!(v.statement().contains("2 command(s)") && v.statement().contains("0.5"), "{}", v.statement());
    }

    #[test]
    fn a_wheel_too_fast_slows_both_and_keeps_the_curvature() {
        let mut limited = limiter(Limits { wheel_speed: Some(5.0), ..Limits::default() });
        let mut command = [0.8, 1.0];
        limited.apply(0.0, 0.1, &mut command);
        // The right wheel would turn at (0.8 + 0.2)/0.1 = 10 rad/s: half of it.
        assert!((command[0] - 0.4).abs() < 1e-12 && (command[1] - 0.5).abs() < 1e-12, "{command:?}");
    }

    #[test]
    fn a_step_becomes_a_ramp_and_arrives() {
        let mut limited = limiter(Limits { v_dot: Some(0.5), ..Limits::default() });
        let reached: Vec<f64> = (0..6)
            .map(|k| {
                let mut command = [0.2, 1.0];
                limited.apply(0.1 * f64::from(k), 0.1, &mut command);
                assert_eq!(command[1], 1.0, "the other axis is not held back");
                command[0]
            })
            .collect();
        for (found, expected) in reached.iter().zip([0.05, 0.1, 0.15, 0.2, 0.2, 0.2]) {
            assert!((found - expected).abs() < 1e-12, "{reached:?}");
        }
    }

    #[test]
    fn limits_that_cannot_be_kept_are_refused() {
        let refused = |limits, wheels, inputs: &[Channel]| Limiter::new(limits, wheels, inputs).unwrap_err().to_string();
        assert!(refused(Limits { wheel_speed: Some(1.0), ..Limits::default() }, None, &INPUTS).contains("track_width"));
        assert!(refused(Limits { omega: Some(1.0), ..Limits::default() }, None, &INPUTS[..1]).contains("`omega_ref`"));
        assert!(refused(Limits { v: Some(-1.0), ..Limits::default() }, None, &INPUTS).contains("-1"));
    }

    proptest::proptest! {
        #[test]
        fn every_limited_command_keeps_every_limit(
            asked in proptest::collection::vec((-3.0..3.0, -9.0..9.0), 1..40),
            v in 0.1..1.0, omega in 0.2..3.0, v_dot in 0.1..2.0, omega_dot in 0.3..6.0, wheel in 1.0..12.0
        ) {
            let limits = Limits { v: Some(v), omega: Some(omega), v_dot: Some(v_dot), omega_dot: Some(omega_dot), wheel_speed: Some(wheel) };
            let mut limited = limiter(limits);
            let (mut last, dt) = ([0.0, 0.0], 0.1);
            for (k, (a, b)) in asked.into_iter().enumerate() {
                let mut c = [a, b];
                limited.apply(dt * k as f64, dt, &mut c);
                let room = 1.0 + 1e-9;
                proptest::prop_assert!(c[0].abs() <= v * room && c[1].abs() <= omega * room);
                proptest::prop_assert!(fastest_wheel(WHEELS, c) <= wheel * room);
                proptest::prop_assert!((c[0] - last[0]).abs() <= v_dot * dt * room && (c[1] - last[1]).abs() <= omega_dot * dt * room);
                last = c;
            }
        }
    }
}
