//! What happens to a command inside the robot before the controller sees it: clamps, the firmware's acceleration ramp,
//! the wheels' top speed.

use wheelwright_core::profile::Limits;

use super::plant::{PlantConstants, Sides};

/// The set point's way through the robot's limits. Without limits a command reaches the controller as it is.
#[derive(Debug, Clone)]
pub(super) struct SetPoint {
    limits: Limits,
    track_width: f64,
    wheel_radius: f64,
    /// The ramp's value at the start of the period.
    begin: [f64; 2],
    /// Where the ramp leads.
    target: [f64; 2],
}

impl SetPoint {
    pub(super) fn new(limits: Limits, constants: &PlantConstants) -> Self {
        let (track_width, wheel_radius) = (constants.track_width, constants.wheel_radius);
        Self { limits, track_width, wheel_radius, begin: [0.0; 2], target: [0.0; 2] }
    }

    /// Takes a command (v_ref, ω_ref) at the start of a period.
    pub(super) fn command(&mut self, [v, omega]: [f64; 2]) {
        self.target = [clamp(v, self.limits.v), clamp(omega, self.limits.omega)];
    }

    /// The set point `t` seconds into the period.
    pub(super) fn at(&self, t: f64) -> [f64; 2] {
        let [v, omega] = self.ramp(t);
        let Some(limit) = self.limits.wheel_speed else { return [v, omega] };
        let wheels = Sides::of_body(v, omega, self.track_width, self.wheel_radius);
        if wheels.left.abs() <= limit && wheels.right.abs() <= limit {
            return [v, omega];
        }
        wheels.map(|speed| speed.clamp(-limit, limit)).to_body(self.track_width, self.wheel_radius)
    }

    /// Ends a period of that length.
    pub(super) fn finish(&mut self, interval: f64) {
        self.begin = self.ramp(interval);
    }

    /// Motors off: nothing is left of earlier commands.
    pub(super) fn reset(&mut self) {
        (self.begin, self.target) = ([0.0; 2], [0.0; 2]);
    }

    fn ramp(&self, t: f64) -> [f64; 2] {
        let towards = |begin: f64, target: f64, rate: Option<f64>| match rate {
            Some(rate) => begin + clamp(target - begin, Some(rate * t)),
            None => target,
        };
        [towards(self.begin[0], self.target[0], self.limits.v_dot), towards(self.begin[1], self.target[1], self.limits.omega_dot)]
    }
}

fn clamp(value: f64, limit: Option<f64>) -> f64 {
    limit.map_or(value, |limit| value.clamp(-limit, limit))
}
