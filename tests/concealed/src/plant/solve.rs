//! One impulse balance: wheels, body, contacts and dry friction, solved together.
//!
//! Unknown are the contact forces `F` (one a wheel) and the friction impulses `p`. Contacts are springless: slip velocity after the step is
//! compliance times force, and zero compliance is ideal rolling, exactly. Eliminating `F` leaves a 2×2 problem for `p`, bounded by what
//! friction can hold: a wheel either stands still, or moves against its full friction (Moreau's time stepping).

use super::body::Body;

/// What enters an impulse balance.
#[derive(Clone, Copy, Debug)]
pub struct Balance {
    /// Body at this time.
    pub body: Body,
    /// Half track \[m\].
    pub half_track: f64,
    /// Wheel inertias \[kg m²\].
    pub inertia: [f64; 2],
    /// Wheel radii at these angles \[m\].
    pub radius: [f64; 2],
    /// Slip velocity per contact force \[m/s/N\].
    pub compliance: [f64; 2],
    /// Torques on the wheels, friction excluded \[N m\].
    pub torque: [f64; 2],
    /// Generalised forces on the body, contacts excluded.
    pub force: [f64; 2],
    /// What friction can hold `(against forward, against backward)` \[N m\].
    pub bounds: [(f64, f64); 2],
    /// Length of the step \[s\].
    pub step: f64,
}

/// Velocities after the step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moved {
    /// `[v, omega]`.
    pub twist: [f64; 2],
    /// Wheel speeds \[rad/s\].
    pub wheel: [f64; 2],
    /// Contact forces on the robot \[N\].
    pub contact: [f64; 2],
}

type Matrix = [[f64; 2]; 2];

fn inverse(m: Matrix) -> Matrix {
    let det = m[0][0] * m[1][1] - m[0][1] * m[1][0];
    [[m[1][1] / det, -m[0][1] / det], [-m[1][0] / det, m[0][0] / det]]
}

fn apply(m: &Matrix, x: [f64; 2]) -> [f64; 2] {
    [m[0][0] * x[0] + m[0][1] * x[1], m[1][0] * x[0] + m[1][1] * x[1]]
}

impl Balance {
    /// Hub speeds along the ground of left and right wheel.
    fn hubs(&self, twist: [f64; 2]) -> [f64; 2] {
        [twist[0] - self.half_track * twist[1], twist[0] + self.half_track * twist[1]]
    }

    /// Generalised forces of contact forces.
    fn levers(&self, contact: [f64; 2]) -> [f64; 2] {
        [contact[0] + contact[1], self.half_track * (contact[1] - contact[0])]
    }

    /// Moves the velocities on by one step.
    pub fn solve(&self, twist: [f64; 2], wheel: [f64; 2]) -> Moved {
        let (h, r, j) = (self.step, self.radius, self.inertia);
        let mobility = inverse(self.body.matrix());
        let gained = apply(&mobility, self.force);
        let free_twist = [twist[0] + h * gained[0], twist[1] + h * gained[1]];
        let free_wheel = [wheel[0] + h * self.torque[0] / j[0], wheel[1] + h * self.torque[1] / j[1]];
        let hubs = self.hubs(free_twist);
        let slip = [r[0] * free_wheel[0] - hubs[0], r[1] * free_wheel[1] - hubs[1]];

        let ground = self.ground_mobility(&mobility);
        let stiffness = inverse([
            [self.compliance[0] + h * (ground[0][0] + r[0] * r[0] / j[0]), h * ground[0][1]],
            [h * ground[1][0], self.compliance[1] + h * (ground[1][1] + r[1] * r[1] / j[1])],
        ]);
        let contact = apply(&stiffness, slip);
        let rolled = [free_wheel[0] - h * r[0] * contact[0] / j[0], free_wheel[1] - h * r[1] * contact[1] / j[1]];

        let impulse = self.friction(&stiffness, rolled);
        let contact = if impulse == [0.0, 0.0] {
            contact
        } else {
            apply(&stiffness, [slip[0] + r[0] * impulse[0] / j[0], slip[1] + r[1] * impulse[1] / j[1]])
        };
        let shed = |i: usize| free_wheel[i] + (impulse[i] - h * r[i] * contact[i]) / j[i];
        let pushed = apply(&mobility, self.levers(contact));
        Moved { twist: [free_twist[0] + h * pushed[0], free_twist[1] + h * pushed[1]], wheel: [shed(0), shed(1)], contact }
    }

    /// Hub acceleration per contact force.
    fn ground_mobility(&self, mobility: &Matrix) -> Matrix {
        let column = |contact: [f64; 2]| self.hubs(apply(mobility, self.levers(contact)));
        let (a, b) = (column([1.0, 0.0]), column([0.0, 1.0]));
        [[a[0], b[0]], [a[1], b[1]]]
    }

    /// Friction impulses that hold the wheels, or resist them with all they have.
    fn friction(&self, stiffness: &Matrix, rolled: [f64; 2]) -> [f64; 2] {
        if self.bounds.iter().all(|b| b.0 == 0.0 && b.1 == 0.0) {
            return [0.0, 0.0];
        }
        let (h, r, j) = (self.step, self.radius, self.inertia);
        let cross = |a: usize, b: usize| -h * r[a] * stiffness[a][b] * r[b] / (j[a] * j[b]);
        let response: Matrix = [[1.0 / j[0] + cross(0, 0), cross(0, 1)], [cross(1, 0), 1.0 / j[1] + cross(1, 1)]];
        let mut impulse = [0.0; 2];
        for _ in 0..60 {
            let before = impulse;
            for i in 0..2 {
                let left = rolled[i] + response[i][0] * impulse[0] + response[i][1] * impulse[1];
                let (forward, backward) = self.bounds[i];
                impulse[i] = (impulse[i] - left / response[i][i]).clamp(-h * forward, h * backward);
            }
            if (impulse[0] - before[0]).abs() + (impulse[1] - before[1]).abs() <= 1e-12 * h * (self.bounds[0].0 + self.bounds[1].0) {
                break;
            }
        }
        impulse
    }
}
