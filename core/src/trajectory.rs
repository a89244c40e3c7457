//! Trajectories: where a robot should be, how it should move there, and how that changes, as functions of time.
//!
//! A [`Trajectory`] gives at any time a [`Reference`]: position, heading that never jumps, velocities and their exact
//! derivatives, which is what a tracking controller and its σ need. [`Placed`] moves, stretches and slows any of them.

use std::fmt::Debug;

use thiserror::Error;

use crate::profile::Limits;

/// Where a robot should be at an instant, and how it should move.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Reference {
    /// Position \[m\].
    pub x: f64,
    /// Position \[m\].
    pub y: f64,
    /// Heading, not wrapped \[rad\].
    pub phi: f64,
    /// Forward velocity \[m/s\].
    pub v: f64,
    /// Angular velocity, the derivative of `phi` \[rad/s\].
    pub omega: f64,
    /// Derivative of `v` \[m/s²\].
    pub v_dot: f64,
    /// Derivative of `omega` \[rad/s²\].
    pub omega_dot: f64,
}

impl Reference {
    /// Distance of a position from this one \[m\].
    pub fn distance(&self, x: f64, y: f64) -> f64 {
        (self.x - x).hypot(self.y - y)
    }
}

/// A desired motion. Live object, built from a [`TrajectoryConfig`].
pub trait Trajectory: Debug + Send + Sync {
    /// Time of one round of a closed trajectory, or until the end of an open one \[s\].
    fn duration(&self) -> f64;

    /// The desired motion at time `t` ≥ 0 \[s\].
    fn at(&self, t: f64) -> Reference;
}

/// What bounds a robot's motion: its limits and the dimensions that turn them into limits of the body.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Envelope {
    /// Limits.
    pub limits: Limits,
    /// Distance between the wheels' contact points \[m\].
    pub track_width: Option<f64>,
    /// Radius of the wheels \[m\].
    pub wheel_radius: Option<f64>,
}

impl Envelope {
    /// Ground speed of each wheel at most \[m/s\], and half the track \[m\], if the wheels' speed is limited.
    pub fn wheels(&self) -> Option<(f64, f64)> {
        Some((self.limits.wheel_speed? * self.wheel_radius?, 0.5 * self.track_width?))
    }

    /// How much of each limit a motion takes, 1 being all of it: forward speed, angular speed, wheel speed, and the two
    /// accelerations. Zero where there is no limit.
    pub fn shares(&self, motion: &Reference) -> [f64; 5] {
        let share = |value: f64, limit: Option<f64>| limit.map_or(0.0, |limit| value.abs() / limit);
        let wheels = self.wheels().map_or(0.0, |(most, half_track)| (motion.v.abs() + half_track * motion.omega.abs()) / most);
        let Limits { v, omega, v_dot, omega_dot, .. } = self.limits;
        [share(motion.v, v), share(motion.omega, omega), wheels, share(motion.v_dot, v_dot), share(motion.omega_dot, omega_dot)]
    }
}

/// Names of the five shares of [`Envelope::shares`].
pub const SHARES: [&str; 5] = ["forward speed", "angular speed", "wheel speed", "forward acceleration", "angular acceleration"];

/// Intervals between the instants at which a trajectory is looked at.
const LOOKS: usize = 4000;

/// The largest of each share of an envelope that a trajectory takes within `duration` \[s\].
pub fn peaks(trajectory: &dyn Trajectory, duration: f64, envelope: &Envelope) -> [f64; 5] {
    course(trajectory, duration).iter().map(|at| envelope.shares(at)).fold([0.0; 5], |mut most, shares| {
        most.iter_mut().zip(shares).for_each(|(most, share)| *most = share.max(*most));
        most
    })
}

/// The motion that a trajectory asks for within `duration` \[s\], at instants of equal distance.
pub fn course(trajectory: &dyn Trajectory, duration: f64) -> Vec<Reference> {
    (0..=LOOKS).map(|i| trajectory.at(duration * i as f64 / LOOKS as f64)).collect()
}

/// The factor ≤ 1 on time's pace that brings a trajectory within `fill` of every limit: speeds go with it, accelerations
/// with its square. 1 if it is within already.
pub fn pace_within(trajectory: &dyn Trajectory, duration: f64, envelope: &Envelope, fill: f64) -> f64 {
    let [v, omega, wheels, v_dot, omega_dot] = peaks(trajectory, duration, envelope);
    let speeds = v.max(omega).max(wheels) / fill;
    let accelerations = (v_dot.max(omega_dot) / fill).sqrt();
    let worst = speeds.max(accelerations);
    if worst > 1.0 { 1.0 / worst } else { 1.0 }
}

/// A trajectory somewhere else, of another size, at another pace.
#[derive(Debug)]
pub struct Placed {
    inner: Box<dyn Trajectory>,
    size: f64,
    pace: f64,
    turn: f64,
    shift: [f64; 2],
}

impl Placed {
    /// The trajectory itself.
    pub fn new(inner: Box<dyn Trajectory>) -> Self {
        Self { inner, size: 1.0, pace: 1.0, turn: 0.0, shift: [0.0; 2] }
    }

    /// Lengths times `factor`.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        Self { size: self.size * factor, shift: self.shift.map(|s| s * factor), ..self }
    }

    /// Time runs at `factor` of its pace, so that the trajectory takes longer by 1/`factor`.
    #[must_use]
    pub fn paced(self, factor: f64) -> Self {
        Self { pace: self.pace * factor, ..self }
    }

    /// Turned and moved so that it begins at a pose (x, y, φ).
    #[must_use]
    pub fn starting_at(self, pose: [f64; 3]) -> Self {
        let begin = self.inner.at(0.0);
        let turn = pose[2] - begin.phi;
        let (sin, cos) = turn.sin_cos();
        let (x, y) = (self.size * begin.x, self.size * begin.y);
        Self { turn, shift: [pose[0] - (x * cos - y * sin), pose[1] - (x * sin + y * cos)], ..self }
    }
}

impl Trajectory for Placed {
    fn duration(&self) -> f64 {
        self.inner.duration() / self.pace
    }

    fn at(&self, t: f64) -> Reference {
        let r = self.inner.at(t * self.pace);
        let (sin, cos) = self.turn.sin_cos();
        let (x, y) = (self.size * r.x, self.size * r.y);
        Reference {
            x: self.shift[0] + x * cos - y * sin,
            y: self.shift[1] + x * sin + y * cos,
            phi: r.phi + self.turn,
            v: self.size * self.pace * r.v,
            omega: self.pace * r.omega,
            v_dot: self.size * self.pace * self.pace * r.v_dot,
            omega_dot: self.pace * self.pace * r.omega_dot,
        }
    }
}

/// Plain data from which a trajectory is built; `type = "NAME"` in a configuration picks it.
#[typetag::serde]
pub trait TrajectoryConfig: Debug + Send + Sync {
    /// One line on what the trajectory is, for `wheelwright plugins`.
    fn about(&self) -> String;

    /// Builds it. `envelope` is what bounds the robot; only trajectories that plan their own speed heed it.
    ///
    /// # Errors
    /// [`TrajectoryError`] naming the key that is wrong.
    fn build(&self, envelope: &Envelope) -> Result<Box<dyn Trajectory>, TrajectoryError>;
}

/// Why there is no trajectory.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum TrajectoryError {
    /// A setting is impossible.
    #[error("`{key}`: {reason}")]
    Config {
        /// Key inside the trajectory's table.
        key: String,
        /// What is wrong and what to do.
        reason: String,
    },
    /// The trajectory stands still somewhere on its way, where a heading has no meaning.
    #[error("the trajectory stands still at t = {t:.3} s, where its heading is undefined: {reason}")]
    Standstill {
        /// Time \[s\].
        t: f64,
        /// What to change.
        reason: String,
    },
}

impl TrajectoryError {
    /// An impossible setting.
    pub fn config(key: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Config { key: key.into(), reason: reason.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A spiral start: everything changes with time.
    #[derive(Debug)]
    struct Bend;

    impl Trajectory for Bend {
        fn duration(&self) -> f64 {
            4.0
        }

        fn at(&self, t: f64) -> Reference {
            // x = t + 1, y = t²/2 + 2
            let (v, q) = ((1.0 + t * t).sqrt(), 1.0 + t * t);
            Reference { x: t + 1.0, y: 0.5 * t * t + 2.0, phi: t.atan(), v, omega: 1.0 / q, v_dot: t / v, omega_dot: -2.0 * t / (q * q) }
        }
    }

    #[test]
    fn a_placed_trajectory_begins_where_it_should_and_keeps_its_derivatives() {
        let placed = Placed::new(Box::new(Bend)).scaled(0.5).paced(2.0).starting_at([3.0, -1.0, 0.7]);
        let start = placed.at(0.0);
        assert!((start.x - 3.0).abs() < 1e-14 && (start.y + 1.0).abs() < 1e-14 && (start.phi - 0.7).abs() < 1e-14);
        assert_eq!(placed.duration(), 2.0);
        let h = 1e-5;
        for t in [0.3, 1.1, 1.9] {
            let (a, r, b) = (placed.at(t - h), placed.at(t), placed.at(t + h));
            let rate = |pick: fn(&Reference) -> f64| (pick(&b) - pick(&a)) / (2.0 * h);
            assert!((rate(|r| r.x) - r.v * r.phi.cos()).abs() < 1e-8 && (rate(|r| r.y) - r.v * r.phi.sin()).abs() < 1e-8);
            assert!((rate(|r| r.phi) - r.omega).abs() < 1e-8);
            assert!((rate(|r| r.v) - r.v_dot).abs() < 1e-8 && (rate(|r| r.omega) - r.omega_dot).abs() < 1e-8);
        }
    }

    #[test]
    fn pace_brings_speed_and_acceleration_within_limits() {
        let limits = Limits { v: Some(2.0), wheel_speed: Some(20.0), omega_dot: Some(0.1), ..Limits::default() };
        let envelope = Envelope { limits, track_width: Some(0.4), wheel_radius: Some(0.1) };
        let pace = pace_within(&Bend, 4.0, &envelope, 0.9);
        let slowed = Placed::new(Box::new(Bend)).paced(pace);
        let most = peaks(&slowed, slowed.duration(), &envelope).into_iter().fold(0.0, f64::max);
        assert!((most - 0.9).abs() < 1e-6, "{most}");
        assert_eq!(pace_within(&Bend, 4.0, &Envelope::default(), 0.9), 1.0);
    }
}
