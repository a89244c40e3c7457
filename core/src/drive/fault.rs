//! Why a drive ends before its time.

use std::fmt;

use thiserror::Error;

use super::floor::Leaving;
use super::limits::LimitError;
use super::sink::SinkError;
use crate::excitation::ExcitationError;
use crate::recording::{Recording, RecordingError};
use crate::robot::RobotError;

/// Why a drive ended early.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum DriveFault {
    /// The robot failed.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// The excitation does not fit the robot.
    #[error("excitation: {0}")]
    Excitation(#[from] ExcitationError),
    /// The excitation, or the controller, asks for something that is no number.
    #[error("command `{channel}` is {value} at t = {t:.3} s; nothing was sent")]
    Command {
        /// Command channel.
        channel: String,
        /// Its value.
        value: f64,
        /// Time since the start \[s\].
        t: f64,
    },
    /// The robot measured something that is no number.
    #[error("the robot measured `{channel}` = {value} at t = {t:.3} s")]
    NotFinite {
        /// Measured channel.
        channel: String,
        /// Its value.
        value: f64,
        /// Time since the start \[s\].
        t: f64,
    },
    /// The robot's clock stands or goes back.
    #[error("the robot's clock does not advance: {after:.6} s after {before:.6} s; its data is stale")]
    FrozenClock {
        /// Time of the row before \[s\].
        before: f64,
        /// Time returned \[s\].
        after: f64,
    },
    /// The robot's clock advances far slower than its control period promises.
    #[error("the robot's clock crawls: {elapsed:.3} s passed in {steps} control periods of {period} s")]
    SlowClock {
        /// Time passed \[s\].
        elapsed: f64,
        /// Commands sent.
        steps: usize,
        /// Control period \[s\].
        period: f64,
    },
    /// Length or control period is not a positive number.
    #[error("{what} is {value} s; it must be a positive number")]
    Time {
        /// `the drive's duration` or `the robot's control period`.
        what: &'static str,
        /// Value \[s\].
        value: f64,
    },
    /// The robot's clock leaps ahead.
    #[error(
        "the robot's clock jumped from {before:.3} s to {after:.3} s, its control period is {period} s: packets were lost, or the clock was set"
    )]
    ClockJump {
        /// Time of the row before \[s\].
        before: f64,
        /// Time returned \[s\].
        after: f64,
        /// Control period \[s\].
        period: f64,
    },
    /// Nothing measured changes although the robot is told to move.
    #[error(
        "nothing measured has changed since t = {since:.3} s, though the robot was told to move until t = {t:.3} s: its data are frozen, or it is stuck"
    )]
    FrozenData {
        /// Time of the last change \[s\].
        since: f64,
        /// Time since the start \[s\].
        t: f64,
    },
    /// The robot would leave its floor.
    #[error(
        "the robot would leave its floor: at x = {:.2} m, y = {:.2} m it needs {:.2} m to stop and would come to rest at x = {:.2} m, y = {:.2} m (t = {t:.3} s)",
        .leaving.at[0], .leaving.at[1], .leaving.distance, .leaving.rest[0], .leaving.rest[1]
    )]
    Floor {
        /// Where it is and where it would come to rest.
        leaving: Leaving,
        /// Time since the start \[s\].
        t: f64,
    },
    /// A floor was given for a robot that does not measure where it is.
    #[error("a floor needs `x`, `y` and `phi`, which this robot does not measure: leave it out, or make room and give a time limit")]
    NoPose,
    /// The floor is impossible.
    #[error("floor: `{key}` {reason}")]
    BadFloor {
        /// Key inside the floor's table.
        key: &'static str,
        /// What is wrong.
        reason: String,
    },
    /// A limit cannot be kept.
    #[error("limits: {0}")]
    Limit(#[from] LimitError),
    /// The program was too late for its own command.
    #[error("deadline missed: the next command was ready {late_s:.3} s after the measurement, the limit is {limit_s:.3} s (t = {t:.3} s)")]
    Deadline {
        /// Time from the measurement to the command \[s\].
        late_s: f64,
        /// Limit \[s\].
        limit_s: f64,
        /// Time since the start \[s\].
        t: f64,
    },
    /// The program was late for its own command again and again.
    #[error(
        "the next command was late {times} times in {commands} at t = {t:.3} s: what decides, keeps or shows commands is too slow for a control period of {period} s"
    )]
    TooLate {
        /// Times, the last one with them.
        times: usize,
        /// Commands sent until then.
        commands: usize,
        /// Control period \[s\].
        period: f64,
        /// Time since the start \[s\].
        t: f64,
    },
    /// The robot took too long over a control period.
    #[error("the robot took {took_s:.3} s for a control period of {period} s (t = {t:.3} s)")]
    SlowRobot {
        /// Time by the program's clock \[s\].
        took_s: f64,
        /// Control period \[s\].
        period: f64,
        /// Time since the start \[s\].
        t: f64,
    },
    /// The dead man's switch was let go.
    #[error("the dead man's switch was released at t = {t:.3} s")]
    Released {
        /// Time since the start \[s\].
        t: f64,
    },
    /// A row could not be kept.
    #[error("the recording cannot be written: {0}")]
    Sink(#[from] SinkError),
    /// The robot is too far from where it should be.
    #[error("at t = {t:.3} s the robot is {distance:.3} m from where it should be; the limit is {limit} m")]
    OffCourse {
        /// Distance \[m\].
        distance: f64,
        /// Limit \[m\].
        limit: f64,
        /// Time since the start \[s\].
        t: f64,
    },
    /// The stop flag was raised.
    #[error("stopped by request after {t:.3} s")]
    Interrupted {
        /// Time since the start \[s\].
        t: f64,
    },
    /// Too few rows to be a recording, or columns of one name.
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

/// A drive that ended early, with everything measured before.
#[derive(Debug, Clone, PartialEq)]
pub struct DriveError {
    /// Why.
    pub fault: DriveFault,
    /// The rows so far; `None` if there are fewer than two.
    pub recorded: Option<Box<Recording>>,
    /// Set if the robot could not be told to stop either.
    pub stop_failed: Option<RobotError>,
}

impl fmt::Display for DriveError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rows = self.recorded.as_ref().map_or(0, |r| r.rows());
        write!(f, "{}; {rows} rows were kept", self.fault)?;
        match &self.stop_failed {
            None => write!(f, "; the robot was stopped"),
            Some(error) => write!(f, "; THE ROBOT COULD NOT BE STOPPED: {error}"),
        }
    }
}

impl std::error::Error for DriveError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        Some(&self.fault)
    }
}
