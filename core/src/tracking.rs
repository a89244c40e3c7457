//! Tracking: a controller at the wheel of the driving loop.
//!
//! Row k of what comes out holds the measurement at t_k, the command held from t_k on, and beside them the desired motion
//! and the controller's parameters at that time.

use std::cell::Cell;
use std::ops::ControlFlow;

use crate::channel::{self, Channel};
use crate::controller::{Controller, Observation};
use crate::drive::{DriveError, DriveFault, DriveOptions, DriveProgress, RowSink, steer};
use crate::recording::{Column, Recording, RecordingError};
use crate::robot::Live;
use crate::trajectory::{Reference, Trajectory};

/// Where the pose comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Pose {
    /// Measured channels x, y, φ by index.
    Measured([usize; 3]),
    /// Dead reckoning from v and ω by index: pose so far and time of the last row.
    Reckoned([usize; 2], [f64; 3], Option<f64>),
}

/// A controller as the law of a drive, with a log of what it did.
#[derive(Debug)]
pub struct Tracker<'a> {
    controller: &'a mut dyn Controller,
    trajectory: &'a dyn Trajectory,
    pose: Pose,
    outputs: Vec<usize>,
    inputs: Vec<usize>,
    measured: Vec<f64>,
    command: Vec<f64>,
    /// Distance error at which the robot is stopped \[m\].
    limit: f64,
    log: TrackLog,
}

/// What a tracked run was, one value a row.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TrackLog {
    /// Time on the trajectory \[s\]: since the start, less the time for which the robot stood because somebody was late.
    pub time: Vec<f64>,
    /// Desired motion.
    pub reference: Vec<Reference>,
    /// Measured (or reckoned) pose.
    pub pose: Vec<[f64; 3]>,
    /// The controller's parameters, one series a parameter.
    pub theta: Vec<Vec<f64>>,
    /// Share of the wanted command that the limits left.
    pub share: Vec<f64>,
    /// Whether parameters were being adapted.
    pub adapting: Vec<bool>,
}

impl TrackLog {
    /// Distance between desired and actual position, row by row \[m\].
    pub fn distances(&self) -> Vec<f64> {
        self.reference.iter().zip(&self.pose).map(|(r, p)| r.distance(p[0], p[1])).collect()
    }

    /// Root mean square of the distance error within a window of time \[m\]; `None` without a row in it.
    pub fn rms(&self, from: f64, to: f64) -> Option<f64> {
        let within = self.time.iter().zip(self.distances()).filter(|(t, _)| (from..=to).contains(*t));
        let (n, sum) = within.fold((0_usize, 0.0), |(n, sum), (_, d)| (n + 1, sum + d * d));
        (n > 0).then(|| (sum / n as f64).sqrt())
    }

    /// Rows.
    pub fn rows(&self) -> usize {
        self.time.len()
    }
}

impl<'a> Tracker<'a> {
    /// A tracker for a robot of these channels, which is stopped when it is `limit` \[m\] off its course.
    ///
    /// # Errors
    /// [`TrackError`] naming the channel that the robot lacks.
    pub fn new(
        controller: &'a mut dyn Controller,
        trajectory: &'a dyn Trajectory,
        robot_inputs: &[Channel],
        robot_outputs: &[Channel],
        limit: f64,
    ) -> Result<Self, TrackError> {
        let inputs = controller.inputs().iter().map(|c| find(robot_inputs, c, "takes no command")).collect::<Result<Vec<_>, _>>()?;
        let outputs = controller.outputs().iter().map(|c| find(robot_outputs, c, "does not measure")).collect::<Result<Vec<_>, _>>()?;
        let pose = match [channel::X, channel::Y, channel::PHI].map(|c| find(robot_outputs, &c, "")) {
            [Ok(x), Ok(y), Ok(phi)] => Pose::Measured([x, y, phi]),
            _ => {
                let velocity = |c: Channel| find(robot_outputs, &c, "measures neither x, y, phi nor");
                Pose::Reckoned([velocity(channel::V)?, velocity(channel::OMEGA)?], [0.0; 3], None)
            }
        };
        let log = TrackLog { theta: vec![Vec::new(); controller.parameters().len()], ..TrackLog::default() };
        let (measured, command) = (vec![0.0; outputs.len()], vec![0.0; inputs.len()]);
        Ok(Self { controller, trajectory, pose, outputs, inputs, measured, command, limit, log })
    }

    /// What was logged.
    pub fn into_log(self) -> TrackLog {
        self.log
    }

    /// The last distance error \[m\]; zero before the first row.
    pub fn distance(&self) -> f64 {
        let last = self.log.reference.last().zip(self.log.pose.last());
        last.map_or(0.0, |(r, p)| r.distance(p[0], p[1]))
    }
}

/// The pose that a robot's measurements tell, for placing a trajectory before it moves; the origin if it measures none.
pub fn start_pose(outputs: &[Channel], measured: &[f64]) -> [f64; 3] {
    [channel::X, channel::Y, channel::PHI]
        .map(|wanted| outputs.iter().position(|c| c.name == wanted.name).and_then(|i| measured.get(i)).copied().unwrap_or(0.0))
}

impl Tracker<'_> {
    /// The law for [`steer`].
    ///
    /// # Errors
    /// [`DriveFault::OffCourse`] when the robot is too far from where it should be.
    pub fn law(&mut self, t: f64, measured: &[f64], command: &mut [f64]) -> Result<ControlFlow<()>, DriveFault> {
        for (value, index) in self.measured.iter_mut().zip(&self.outputs) {
            *value = measured[*index];
        }
        let pose = self.pose.read(t, measured);
        let reference = self.trajectory.at(t);
        let now = Observation { t, reference, pose, outputs: &self.measured };
        self.controller.step(&now, &mut self.command);
        command.fill(0.0);
        for (index, value) in self.inputs.iter().zip(&self.command) {
            command[*index] = *value;
        }
        let state = self.controller.state();
        self.log.time.push(t);
        self.log.reference.push(reference);
        self.log.pose.push(pose);
        self.log.theta.iter_mut().zip(self.controller.theta()).for_each(|(series, value)| series.push(*value));
        self.log.share.push(state.share);
        self.log.adapting.push(state.adapting);
        let distance = reference.distance(pose[0], pose[1]);
        if distance > self.limit {
            return Err(DriveFault::OffCourse { distance, limit: self.limit, t });
        }
        Ok(ControlFlow::Continue(()))
    }
}

impl Pose {
    fn read(&mut self, t: f64, measured: &[f64]) -> [f64; 3] {
        match self {
            Self::Measured(index) => index.map(|i| measured[i]),
            Self::Reckoned([v, omega], pose, last) => {
                if let Some(before) = *last {
                    // The measured velocities are taken for those of the interval that ends now.
                    let (path, turn) = (measured[*v] * (t - before), measured[*omega] * (t - before));
                    let (sin, cos) = (pose[2] + 0.5 * turn).sin_cos();
                    *pose = [pose[0] + path * cos, pose[1] + path * sin, pose[2] + turn];
                }
                *last = Some(t);
                *pose
            }
        }
    }
}

fn find(channels: &[Channel], wanted: &Channel, lack: &'static str) -> Result<usize, TrackError> {
    channels.iter().position(|c| c.name == wanted.name).ok_or_else(|| TrackError::MissingChannel {
        lack,
        channel: wanted.name.to_string(),
        available: crate::recording::list(channels.iter().map(|c| c.name.as_ref())),
    })
}

/// A tracked run, however it ended.
#[derive(Debug)]
pub struct Tracked {
    /// Desired and actual motion, and the controller's parameters.
    pub log: TrackLog,
    /// Commands and measurements as recorded, or why the drive ended early, which holds what was recorded until then.
    pub outcome: Result<Recording, DriveError>,
}

impl Tracked {
    /// The rows there are.
    pub fn recording(&self) -> Option<&Recording> {
        match &self.outcome {
            Ok(recording) => Some(recording),
            Err(error) => error.recorded.as_deref(),
        }
    }

    /// The recording with the desired motion (`x_desired`, .., `omega_desired`), the `distance` error and the controller's
    /// parameters as further columns.
    ///
    /// # Errors
    /// [`RecordingError`] if fewer than two rows were recorded.
    pub fn joined(&self, parameters: &[String]) -> Result<Recording, RecordingError> {
        let Some(recorded) = self.recording() else { return Err(RecordingError::TooShort { rows: self.log.rows() }) };
        let rows = recorded.rows().min(self.log.rows());
        let cut = |values: &[f64]| values[..rows].to_vec();
        let mut columns: Vec<Column> =
            recorded.columns().iter().map(|c| Column { name: c.name.clone(), unit: c.unit.clone(), values: cut(&c.values) }).collect();
        let picks: [Pick; 5] = [
            ("x_desired", "m", |r| r.x),
            ("y_desired", "m", |r| r.y),
            ("phi_desired", "rad", |r| r.phi),
            ("v_desired", "m/s", |r| r.v),
            ("omega_desired", "rad/s", |r| r.omega),
        ];
        let unit = |unit: &str| unit.to_owned();
        for (name, of, pick) in picks {
            columns.push(Column { name: name.to_owned(), unit: unit(of), values: self.log.reference[..rows].iter().map(pick).collect() });
        }
        columns.push(Column { name: "distance".to_owned(), unit: unit("m"), values: cut(&self.log.distances()) });
        for (name, series) in parameters.iter().zip(&self.log.theta) {
            columns.push(Column { name: name.clone(), unit: String::new(), values: cut(series) });
        }
        let mut joined = Recording::new(recorded.source.clone(), recorded.time()[..rows].to_vec(), columns, None)?;
        joined.clock = recorded.clock.clone();
        joined.warnings.clone_from(&recorded.warnings);
        Ok(joined)
    }
}

/// A column of the desired motion: name, unit, and where it is.
type Pick = (&'static str, &'static str, fn(&Reference) -> f64);

/// Has a robot follow a trajectory for `duration` \[s\], and stops it. It is stopped early when it is `off_course` \[m\] from
/// where it should be. The observer is told the distance.
///
/// # Errors
/// [`TrackError`] if the robot lacks a channel; whatever happens while it moves is in [`Tracked::outcome`].
pub fn track(
    robot: &mut Live,
    controller: &mut dyn Controller,
    trajectory: &dyn Trajectory,
    duration: f64,
    off_course: f64,
    options: DriveOptions<'_>,
) -> Result<Tracked, TrackError> {
    let mut tracker = Tracker::new(controller, trajectory, robot.inputs(), robot.outputs(), off_course)?;
    let distance = Cell::new(0.0);
    let mut law = |t: f64, measured: &[f64], command: &mut [f64]| {
        let going = tracker.law(t, measured, command);
        distance.set(tracker.distance());
        going
    };
    let DriveOptions { duration: _, safety, stop, dead_man, mut sinks, observer } = options;
    let mut told = observer.map(|tell| |p: &DriveProgress<'_>| tell(&DriveProgress { distance: Some(distance.get()), ..*p }));
    let observer = told.as_mut().map(|tell| tell as &mut dyn FnMut(&DriveProgress<'_>));
    let sinks = sinks.iter_mut().map(|sink| &mut **sink as &mut dyn RowSink).collect();
    let outcome = steer(robot, duration, &mut law, DriveOptions { duration: None, safety, stop, dead_man, sinks, observer });
    Ok(Tracked { log: tracker.into_log(), outcome })
}

/// Why a robot cannot be tracked.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TrackError {
    /// The robot lacks a channel that the controller needs.
    #[error("the robot {lack} `{channel}`; it has {available}")]
    MissingChannel {
        /// What the robot does not do with it.
        lack: &'static str,
        /// Channel.
        channel: String,
        /// What there is.
        available: String,
    },
}
