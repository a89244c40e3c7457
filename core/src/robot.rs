//! Robots: anything that takes a command for one control period and answers with what it measured.

use std::fmt::Debug;

use thiserror::Error;

use crate::channel::Channel;

/// A connected robot, real or simulated.
///
/// Between [`RobotConfig::connect`] and [`stop`](Self::stop) a robot may move; hold it in a [`Live`].
pub trait Robot: Send {
    /// Command channels, such as `v_ref`, `omega_ref`.
    fn inputs(&self) -> &[Channel];

    /// Measured channels, such as `v`, `omega`, `x`, `y`, `phi`.
    fn outputs(&self) -> &[Channel];

    /// Control period \[s\].
    fn period(&self) -> f64;

    /// True if a control period takes its time by the world's clock, so that a late command is late. A simulated robot that runs as
    /// fast as it can says false.
    fn real_time(&self) -> bool {
        true
    }

    /// Changes a command into the one the robot will hold if asked for it: cut to the driver's limits, rounded to what the
    /// wire carries. A drive records this, so that a recording holds what was sent and not what was wished.
    fn executed(&self, _command: &mut [f64]) {}

    /// What a drive so far should be told besides its measurements, in sentences: late commands, commands beyond what the
    /// robot can follow.
    fn warnings(&self) -> Vec<String> {
        Vec::new()
    }

    /// Reads the channels without commanding, as at the first row of a recording.
    ///
    /// # Errors
    /// [`RobotError`].
    fn measure(&mut self, measured: &mut [f64]) -> Result<f64, RobotError>;

    /// Holds `command` for one control period, then writes one value an output channel; returns the robot's time \[s\].
    ///
    /// # Errors
    /// [`RobotError`]; after it the robot is stopped and only [`stop`](Self::stop) may follow.
    fn step(&mut self, command: &[f64], measured: &mut [f64]) -> Result<f64, RobotError>;

    /// Commands zero velocity and disables the motors. May be called at any time and more than once.
    ///
    /// # Errors
    /// [`RobotError`] if the robot could not be told.
    fn stop(&mut self) -> Result<(), RobotError>;
}

/// A robot that is stopped when this guard goes, on whatever way: return, error or unwinding.
pub struct Live(Box<dyn Robot>);

impl Live {
    /// Takes charge of a connected robot.
    pub fn new(robot: Box<dyn Robot>) -> Self {
        Self(robot)
    }
}

impl std::ops::Deref for Live {
    type Target = dyn Robot;
    fn deref(&self) -> &Self::Target {
        &*self.0
    }
}

impl std::ops::DerefMut for Live {
    fn deref_mut(&mut self) -> &mut Self::Target {
        &mut *self.0
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        // Nothing can be done about a robot that cannot be told: its own watchdog is next in line.
        let _ = self.0.stop();
    }
}

/// Plain data from which a robot is connected; `type = "NAME"` in a configuration picks it.
#[typetag::serde]
pub trait RobotConfig: Debug + Send + Sync {
    /// One line on what the robot is, for `wheelwright plugins`.
    fn about(&self) -> String;

    /// Connects. `seed` drives whatever is random in a simulated robot.
    ///
    /// # Errors
    /// [`RobotError`].
    fn connect(&self, seed: u64) -> Result<Box<dyn Robot>, RobotError>;
}

/// What went wrong with a robot, in classes a user can act on.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum RobotError {
    /// A configuration value is impossible.
    #[error("`{key}`: {reason}")]
    Config {
        /// Key inside the robot's table.
        key: String,
        /// What is wrong and what to do.
        reason: String,
    },
    /// No connection, or it was lost.
    #[error("no connection to the robot: {0}")]
    Connection(String),
    /// The robot did not answer in time.
    #[error("the robot did not answer within {limit_s} s: {what}")]
    Timeout {
        /// Limit \[s\].
        limit_s: f64,
        /// What was waited for.
        what: String,
    },
    /// The robot reported a fault, or sent values that cannot be.
    #[error("the robot reported a fault: {0}")]
    Fault(String),
    /// The driver or plugin itself failed.
    #[error("the robot's driver failed: {0}")]
    Driver(String),
}
