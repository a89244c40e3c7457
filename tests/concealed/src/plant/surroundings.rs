//! What acts on the robot from outside: slope, patches of rough ground, air, pushes.

/// Standard gravity \[m/s²\].
pub const GRAVITY: f64 = 9.806_65;

/// The ground's inclination.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slope {
    /// Part of gravity along the plane \[m/s²\] (gravity times the sine of the inclination).
    pub pull: f64,
    /// Direction downhill, in the frame of the pose \[rad\].
    pub downhill: f64,
    /// Distance over which the inclination goes up and down as one crosses it \[m\]; infinite for a plane.
    pub wave: f64,
}

impl Slope {
    /// Acceleration of gravity along and across the robot \[m/s²\].
    pub fn acceleration(&self, (x, y, psi): (f64, f64, f64)) -> (f64, f64) {
        let along_hill = x * self.downhill.cos() + y * self.downhill.sin();
        let pull = if self.wave.is_finite() { self.pull * (std::f64::consts::TAU * along_hill / self.wave).cos() } else { self.pull };
        let (sin, cos) = (self.downhill - psi).sin_cos();
        (pull * cos, pull * sin)
    }
}

/// Rough ground in part of the room: extra drag where the robot is on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Carpet {
    /// Width of a stripe and of the gap between stripes \[m\], along the room's x.
    pub stripe: f64,
    /// Drag on carpet \[N\].
    pub drag: f64,
    /// Speed over which the drag builds up \[m/s\].
    pub soft: f64,
}

impl Carpet {
    /// Whether a place is on carpet.
    pub fn covers(&self, x: f64) -> bool {
        (x / (2.0 * self.stripe)).rem_euclid(1.0) >= 0.5
    }
}

/// Air and everything that resists with the square of speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Air {
    /// Force per speed to the power `power` at the centre of mass [N/(m/s)^power].
    pub drag: f64,
    /// Yaw torque per turning speed to the power `power` [N m/(rad/s)^power].
    pub yaw: f64,
    /// The power, 2 in free air.
    pub power: f64,
}

impl Air {
    /// Force along the robot \[N\] and yaw torque \[N m\].
    pub fn resistance(&self, v: f64, omega: f64) -> (f64, f64) {
        (-self.drag * v.signum() * v.abs().powf(self.power), -self.yaw * omega.signum() * omega.abs().powf(self.power))
    }
}

/// Something pushes for a while.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shove {
    /// Begin and end \[s\].
    pub during: (f64, f64),
    /// Generalised forces on `[v, omega]` at its height, \[N\] and \[N m\].
    pub force: [f64; 2],
}

impl Shove {
    /// Generalised forces at a time: half a sine, so that it begins and ends softly.
    pub fn at(&self, t: f64) -> [f64; 2] {
        let (from, to) = self.during;
        if t <= from || t >= to {
            return [0.0, 0.0];
        }
        let height = (std::f64::consts::PI * (t - from) / (to - from)).sin();
        [self.force[0] * height, self.force[1] * height]
    }
}

/// Everything around the robot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surroundings {
    /// Inclined ground.
    pub slope: Option<Slope>,
    /// Carpet in stripes.
    pub carpet: Option<Carpet>,
    /// Air.
    pub air: Option<Air>,
    /// Pushes and gusts.
    pub shoves: Vec<Shove>,
}
