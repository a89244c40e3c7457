//! The third wheel: a swivelling castor with trail, or a ball.
//!
//! The castor turns about a pivot on the robot's middle line; its wheel touches the ground a trail behind the pivot. Its tyre resists
//! being dragged sideways, which turns it; its rolling costs force. Both reach the robot through the pivot.

/// A swivelling castor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Castor {
    /// Pivot ahead of the axle \[m\]; negative when behind.
    pub pivot: f64,
    /// Distance from pivot to contact \[m\].
    pub trail: f64,
    /// Inertia about the pivot \[kg m²\].
    pub inertia: f64,
    /// Rolling force against its motion \[N\].
    pub rolling: f64,
    /// Dry friction of the swivel \[N m\].
    pub swivel: f64,
    /// Sideways force per slip angle \[N/rad\].
    pub lateral: f64,
    /// Speed below which slip is taken against this speed \[m/s\].
    pub floor: f64,
}

/// What the castor does to the robot, and how fast it turns afterwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Push {
    /// Generalised forces on `[v, omega]`.
    pub force: [f64; 2],
    /// Swivel rate against the robot after the step \[rad/s\].
    pub rate: f64,
}

impl Castor {
    /// Forces at swivel angle `angle` and rate `rate`, and the rate `step` seconds on; `turning` is the robot's yaw acceleration.
    pub fn push(&self, (v, omega): (f64, f64), (angle, rate): (f64, f64), turning: f64, step: f64) -> Push {
        let (sin, cos) = angle.sin_cos();
        let across_pivot = self.pivot * omega;
        let rolling = v * cos + across_pivot * sin;
        let dragged = -v * sin + across_pivot * cos - self.trail * omega;
        let stiffness = self.lateral / rolling.abs().max(self.floor);
        let held = self.swivel / (rate.abs() + 0.05);
        let gained = self.inertia * rate + step * (self.trail * stiffness * dragged - self.inertia * turning);
        let rate = gained / (self.inertia + step * (self.trail * self.trail * stiffness + held));
        let sideways = -stiffness * (dragged - self.trail * rate);
        let drag = -self.rolling * (rolling / (0.05 * self.floor)).tanh();
        let (along, across) = (drag * cos - sideways * sin, drag * sin + sideways * cos);
        Push { force: [along, self.pivot * across + held * rate], rate }
    }
}

/// A ball that drags wherever its contact moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    /// Contact ahead of the axle \[m\]; negative when behind.
    pub place: f64,
    /// Force against its motion \[N\].
    pub drag: f64,
    /// Speed over which the force builds up \[m/s\].
    pub soft: f64,
}

impl Ball {
    /// Generalised forces on `[v, omega]`.
    pub fn force(&self, v: f64, omega: f64) -> [f64; 2] {
        let across = self.place * omega;
        let scale = self.drag / (v * v + across * across + self.soft * self.soft).sqrt();
        [-scale * v, -scale * across * self.place]
    }
}
