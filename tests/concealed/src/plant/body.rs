//! The robot's body: a rigid mass that can move forward and turn about the middle of its driven axle, and cannot move sideways there.
//!
//! Generalised velocities are `[v, omega]` of the axle's middle. The centre of mass sits `forward` and `left` of it, so it moves with
//! `(v - left·omega, forward·omega)`; projecting its acceleration on the two free motions (Jourdain) gives the mass matrix and the
//! velocity-dependent terms used here.

/// Mass, yaw inertia and centre of mass of everything that does not turn with the wheels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Mass \[kg\].
    pub mass: f64,
    /// Yaw inertia about the centre of mass \[kg m²\].
    pub inertia: f64,
    /// Centre of mass ahead of the axle \[m\].
    pub forward: f64,
    /// Centre of mass left of the middle \[m\].
    pub left: f64,
}

impl Body {
    /// Mass matrix of `[v, omega]` about the middle of the axle.
    pub fn matrix(&self) -> [[f64; 2]; 2] {
        let coupling = -self.mass * self.left;
        let arm2 = self.forward * self.forward + self.left * self.left;
        [[self.mass, coupling], [coupling, self.inertia + self.mass * arm2]]
    }

    /// Generalised forces of the body's own motion (centrifugal), to be added to the outer ones.
    pub fn inertial(&self, v: f64, omega: f64) -> [f64; 2] {
        let moment = self.mass * self.forward;
        [moment * omega * omega, -moment * v * omega]
    }

    /// Generalised forces of a force `(along, across)` \[N\] acting at the centre of mass.
    pub fn at_centre(&self, along: f64, across: f64) -> [f64; 2] {
        [along, self.forward * across - self.left * along]
    }

    /// The body with a load of `mass` at `(forward, left)` whose own yaw inertia is `inertia`.
    pub fn with(&self, load: Body) -> Body {
        let mass = self.mass + load.mass;
        if mass <= 0.0 {
            return *self;
        }
        let forward = (self.mass * self.forward + load.mass * load.forward) / mass;
        let left = (self.mass * self.left + load.mass * load.left) / mass;
        let about = |b: &Body| b.inertia + b.mass * ((b.forward - forward).powi(2) + (b.left - left).powi(2));
        Body { mass, inertia: about(self) + about(&load), forward, left }
    }

    /// Kinetic energy at `(v, omega)` \[J\].
    pub fn energy(&self, v: f64, omega: f64) -> f64 {
        let m = self.matrix();
        0.5 * (m[0][0] * v * v + 2.0 * m[0][1] * v * omega + m[1][1] * omega * omega)
    }
}

/// A load put on (or taken off) during a recording; it comes on at the robot's own speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load {
    /// The load's mass, own inertia and place.
    pub body: Body,
    /// Begin and end of its coming on \[s\]; equal for a load that is there at once.
    pub on: (f64, f64),
    /// Begin and end of its going off \[s\]; infinite when it stays.
    pub off: (f64, f64),
}

impl Load {
    /// How much of the load is on at time `t`, 0 to 1.
    pub fn share(&self, t: f64) -> f64 {
        let ramp = |(from, to): (f64, f64)| {
            if t >= to {
                1.0
            } else if t <= from {
                0.0
            } else {
                (t - from) / (to - from)
            }
        };
        ramp(self.on) - ramp(self.off)
    }

    /// The robot's body with the share of the load that is on at time `t`.
    pub fn carried(&self, robot: &Body, t: f64) -> Body {
        let share = self.share(t);
        if share <= 0.0 {
            return *robot;
        }
        robot.with(Body { mass: self.body.mass * share, inertia: self.body.inertia * share, ..self.body })
    }
}
