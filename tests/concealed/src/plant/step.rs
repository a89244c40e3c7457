//! Moves a [`Rig`] on in time: forces at the middle of a step, impulses over the whole of it (second order for smooth forces).

use super::bearing::{Dry, Law};
use super::castor::Push;
use super::solve::{Balance, Moved};
use super::{LEFT, RIGHT, Rig, State};

/// Slip velocity per force \[m/s/N\] of a wheel in the air.
const IN_THE_AIR: f64 = 1e9;

/// Forces at one state.
struct Forces {
    balance: Balance,
    rotor: [f64; 2],
    settled: [f64; 2],
    castor: Option<Push>,
}

impl Rig {
    /// The state `step` seconds on, with the firmware's voltages held.
    pub fn step(&self, s: &State, volts: [f64; 2], step: f64) -> State {
        let mut half = self.moved(s, s, &self.forces(s, volts, 0.5 * step), 0.5 * step);
        // What depends on place (waves, carpet) may lag by half a step, a tenth of a millimetre; what depends on heading may not.
        half.pose.2 += 0.25 * step * (s.twist[1] + half.twist[1]);
        let forces = self.forces(&half, volts, step);
        let mut next = self.moved(s, &half, &forces, step);
        next.pose = travelled(s, &next, step);
        for i in [LEFT, RIGHT] {
            next.bristle[i] = self.wheels[i].bearing.bristle_after(s.bristle[i], half.wheel[i], step);
        }
        next.turning = (next.twist[1] - s.twist[1]) / step;
        next
    }

    /// Everything that acts at state `s`, for a balance over `step`.
    fn forces(&self, s: &State, volts: [f64; 2], step: f64) -> Forces {
        let body = self.body_at(s.t);
        let loads = self.normal_loads(&body);
        let mut settled = [0.0; 2];
        let mut rotor = [0.0; 2];
        let mut torque = [0.0; 2];
        let mut bounds = [(0.0, 0.0); 2];
        for i in [LEFT, RIGHT] {
            let (motor, wheel) = (&self.motors[i], &self.wheels[i]);
            let (speed, angle) = if self.gear.is_some() { (s.rotor[i], s.rotor_angle[i]) } else { (s.wheel[i], s.angle[i]) };
            settled[i] = motor.settled_current(volts[i], speed);
            let current = if motor.electric_time > 0.0 { s.current[i] } else { settled[i] };
            let driven = motor.torque(current, angle);
            let lost = wheel.bearing.viscous_torque(s.wheel[i], s.t) + wheel.bearing.smooth_torque(s.wheel[i], s.bristle[i]);
            let rolling = self.rolling_resistance * loads[i] * wheel.radius;
            bounds[i] = wheel.bearing.bounds(s.wheel[i], rolling);
            torque[i] = match &self.gear {
                Some(gear) => {
                    let passed = gear.torque(s.rotor_angle[i] - s.angle[i], s.rotor[i] - s.wheel[i]);
                    rotor[i] = (driven - passed) / gear.rotor;
                    passed - lost
                }
                None => driven - lost,
            };
        }
        let castor = self.castor.map(|c| c.push((s.twist[0], s.twist[1]), s.swivel, s.turning, step));
        let force = self.outer(s, &body, &loads, castor.as_ref());
        let radius = [self.wheels[LEFT].radius_at(s.angle[LEFT]), self.wheels[RIGHT].radius_at(s.angle[RIGHT])];
        let balance = Balance {
            body,
            half_track: self.half_track,
            inertia: [self.wheels[LEFT].inertia, self.wheels[RIGHT].inertia],
            radius,
            compliance: self.compliance(s, radius),
            torque,
            force,
            bounds,
            step,
        };
        Forces { balance, rotor, settled, castor }
    }

    /// Generalised forces on the body that do not come through the driven wheels.
    fn outer(&self, s: &State, body: &super::body::Body, loads: &[f64; 3], castor: Option<&Push>) -> [f64; 2] {
        let (v, omega) = (s.twist[0], s.twist[1]);
        let mut force = body.inertial(v, omega);
        let mut add = |extra: [f64; 2]| {
            force[0] += extra[0];
            force[1] += extra[1];
        };
        if let Some(push) = castor {
            add(push.force);
        }
        for ball in [self.ball(loads), self.dragging_ball].into_iter().flatten() {
            add(ball.force(v, omega));
        }
        if let Some(scrub) = &self.scrub {
            add([0.0, scrub.torque(omega, [v - self.half_track * omega, v + self.half_track * omega])]);
        }
        let around = &self.surroundings;
        if let Some(slope) = &around.slope {
            let (along, across) = slope.acceleration(s.pose);
            add(body.at_centre(body.mass * along, body.mass * across));
        }
        if let Some(air) = &around.air {
            let (along, yaw) = air.resistance(v, omega);
            add(body.at_centre(along, 0.0));
            add([0.0, yaw]);
        }
        if let Some(carpet) = &around.carpet
            && carpet.covers(s.pose.0)
        {
            add([-carpet.drag * (v / carpet.soft).tanh(), 0.0]);
        }
        for shove in &around.shoves {
            add(shove.at(s.t));
        }
        force
    }

    /// Slip velocity per contact force at this state.
    fn compliance(&self, s: &State, radius: [f64; 2]) -> [f64; 2] {
        let hubs = [s.twist[0] - self.half_track * s.twist[1], s.twist[0] + self.half_track * s.twist[1]];
        let of = |i: usize| {
            let rim = radius[i] * s.wheel[i];
            if self.touches(i, s.t) { self.wheels[i].contact.compliance(rim - hubs[i], rim.abs().max(hubs[i].abs())) } else { IN_THE_AIR }
        };
        [of(LEFT), of(RIGHT)]
    }

    /// State after `step` from `from`, with velocities for the positions taken from `between`.
    fn moved(&self, from: &State, between: &State, forces: &Forces, step: f64) -> State {
        let Moved { twist, wheel, .. } = forces.balance.solve(from.twist, from.wheel);
        let mut next = *from;
        next.t = from.t + step;
        next.twist = twist;
        next.wheel = wheel;
        let mean = |a: f64, b: f64| 0.5 * (a + b);
        for i in [LEFT, RIGHT] {
            next.angle[i] = from.angle[i] + step * mean(from.wheel[i], wheel[i]);
            if self.gear.is_some() {
                next.rotor[i] = from.rotor[i] + step * forces.rotor[i];
                next.rotor_angle[i] = from.rotor_angle[i] + step * mean(from.rotor[i], next.rotor[i]);
            } else {
                next.rotor[i] = wheel[i];
                next.rotor_angle[i] = next.angle[i];
            }
            next.current[i] = self.motors[i].current_after(from.current[i], forces.settled[i], step);
        }
        if let Some(push) = &forces.castor {
            next.swivel = (from.swivel.0 + step * mean(between.swivel.1, push.rate), push.rate);
        }
        next
    }

    /// Longest step \[s\] at which every part of this rig is integrated without harm.
    pub fn longest_step(&self) -> f64 {
        let bristles = |dry: Option<Dry>| matches!(dry, Some(Dry { law: Law::Bristles { .. }, .. }));
        if self.gear.is_some() {
            2e-4
        } else if self.wheels.iter().any(|w| bristles(w.bearing.dry) || w.contact != super::contact::Contact::Rolling) {
            2.5e-4
        } else {
            5e-4
        }
    }
}

/// Pose after a step from `from` to the speeds of `to`.
fn travelled(from: &State, to: &State, step: f64) -> (f64, f64, f64) {
    let (v, omega) = (0.5 * (from.twist[0] + to.twist[0]), 0.5 * (from.twist[1] + to.twist[1]));
    let (sin, cos) = (from.pose.2 + 0.5 * step * omega).sin_cos();
    (from.pose.0 + step * v * cos, from.pose.1 + step * v * sin, from.pose.2 + step * omega)
}
