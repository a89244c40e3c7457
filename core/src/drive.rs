//! Driving: the loop that excites a robot and keeps what it measured.
//!
//! Row k of the recording holds the measurement at t_k and the command held from t_k to t_k+1, so the first row is the
//! robot before the first command. Whatever ends the loop, the robot is stopped and the rows so far are kept.

use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};

use thiserror::Error;

use crate::excitation::{Excitation, ExcitationError};
use crate::recording::{Column, Recording, RecordingError, Source};
use crate::robot::{Live, RobotError};

/// A drive that makes fewer than this share of its planned progress per step is given up: a clock that crawls would
/// otherwise never end it.
const SLOWEST_CLOCK: f64 = 0.1;

/// What a drive looks at besides the robot.
#[derive(Default)]
pub struct DriveOptions<'a> {
    /// Length \[s\]; the excitation's own if `None`.
    pub duration: Option<f64>,
    /// Ends the drive when it becomes true; looked at before every command.
    pub stop: Option<&'a AtomicBool>,
    /// Told after every row.
    pub observer: Option<&'a mut dyn FnMut(&DriveProgress<'_>)>,
}

/// One row of a running drive.
#[derive(Debug, Clone, Copy)]
pub struct DriveProgress<'a> {
    /// Time since the first measurement \[s\].
    pub t: f64,
    /// Planned length \[s\].
    pub duration: f64,
    /// Command about to be held.
    pub command: &'a [f64],
    /// Values measured at `t`.
    pub measured: &'a [f64],
}

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
    /// The excitation asks for something that is no number.
    #[error("excitation: command `{channel}` is {value} at t = {t:.3} s; nothing was sent")]
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

/// Drives a robot with an excitation and records `t`, the commands and the measurements, `t` counted from the first
/// measurement. The last row holds the command that would have come next. The robot is stopped at the end.
///
/// # Errors
/// [`DriveError`] with the cause and the rows so far. A panic in the excitation or the observer passes through; the
/// caller's [`Live`] then stops the robot.
pub fn drive(robot: &mut Live, excitation: &dyn Excitation, mut options: DriveOptions<'_>) -> Result<Recording, DriveError> {
    let mut rows = Rows::new(robot);
    let outcome = excite(robot, excitation, &mut options, &mut rows);
    let stopped = robot.stop();
    let recording = rows.into_recording();
    match (outcome, stopped) {
        (Ok(()), Ok(())) => recording.map_err(|e| DriveError { fault: e.into(), recorded: None, stop_failed: None }),
        (Ok(()), Err(error)) => {
            Err(DriveError { fault: error.clone().into(), recorded: recording.ok().map(Box::new), stop_failed: Some(error) })
        }
        (Err(fault), stopped) => Err(DriveError { fault, recorded: recording.ok().map(Box::new), stop_failed: stopped.err() }),
    }
}

/// The loop itself; rows are added as they come.
fn excite(robot: &mut Live, excitation: &dyn Excitation, options: &mut DriveOptions<'_>, rows: &mut Rows) -> Result<(), DriveFault> {
    excitation.check(robot.inputs())?;
    let (duration, period) = (options.duration.unwrap_or_else(|| excitation.duration()), robot.period());
    positive("the drive's duration", duration)?;
    positive("the robot's control period", period)?;
    let mut command = vec![0.0; robot.inputs().len()];
    let mut measured = vec![0.0; robot.outputs().len()];
    let most_steps = (duration / period / SLOWEST_CLOCK).ceil();
    let start = robot.measure(&mut measured)?;
    if !start.is_finite() {
        return Err(DriveFault::FrozenClock { before: 0.0, after: start });
    }
    let (mut t, mut steps) = (0.0, 0_usize);
    loop {
        check_measured(robot, &measured, t)?;
        excitation.command(t, robot.inputs(), &mut command);
        if let Some(i) = command.iter().position(|c| !c.is_finite()) {
            return Err(DriveFault::Command { channel: robot.inputs()[i].name.to_string(), value: command[i], t });
        }
        rows.push(t, &command, &measured);
        if let Some(observer) = options.observer.as_mut() {
            observer(&DriveProgress { t, duration, command: &command, measured: &measured });
        }
        // Half a period of grace: a sum of periods seldom hits the duration to the last bit.
        if t > duration - 0.5 * period {
            return Ok(());
        }
        if options.stop.is_some_and(|stop| stop.load(Ordering::Relaxed)) {
            return Err(DriveFault::Interrupted { t });
        }
        if steps as f64 >= most_steps {
            return Err(DriveFault::SlowClock { elapsed: t, steps, period });
        }
        let after = robot.step(&command, &mut measured)? - start;
        if after.is_nan() || after <= t || after.is_infinite() {
            return Err(DriveFault::FrozenClock { before: t, after });
        }
        t = after;
        steps += 1;
    }
}

fn positive(what: &'static str, value: f64) -> Result<(), DriveFault> {
    if value.is_finite() && value > 0.0 { Ok(()) } else { Err(DriveFault::Time { what, value }) }
}

fn check_measured(robot: &Live, measured: &[f64], t: f64) -> Result<(), DriveFault> {
    match measured.iter().position(|m| !m.is_finite()) {
        Some(i) => Err(DriveFault::NotFinite { channel: robot.outputs()[i].name.to_string(), value: measured[i], t }),
        None => Ok(()),
    }
}

/// Columns as they grow: the commands, then the measurements.
struct Rows {
    time: Vec<f64>,
    columns: Vec<Column>,
}

impl Rows {
    fn new(robot: &Live) -> Self {
        let channels = robot.inputs().iter().chain(robot.outputs());
        let columns = channels.map(|c| Column { name: c.name.to_string(), unit: c.unit.to_string(), values: Vec::new() }).collect();
        Self { time: Vec::new(), columns }
    }

    fn push(&mut self, t: f64, command: &[f64], measured: &[f64]) {
        self.time.push(t);
        for (column, value) in self.columns.iter_mut().zip(command.iter().chain(measured)) {
            column.values.push(*value);
        }
    }

    fn into_recording(self) -> Result<Recording, RecordingError> {
        let mut recording = Recording::new(Source { format: "robot".to_owned(), ..Source::default() }, self.time, self.columns, None)?;
        "robot".clone_into(&mut recording.clock.source);
        Ok(recording)
    }
}
