//! One tracked run: trajectory laid, controller built, dangers weighed, robot driven, error measured.

use serde::Serialize;
use serde_json::{Value, json};
use wheelwright_core::controller::{Concern, Controller, ControllerConfig, Gravity, Plan, Subject};
use wheelwright_core::drive::{DriveError, DriveOptions};
use wheelwright_core::recording::Recording;
use wheelwright_core::robot::Live;
use wheelwright_core::tracking::{TrackLog, Tracked, start_pose, track};
use wheelwright_core::trajectory::{Envelope, Placed, Trajectory, TrajectoryConfig, course, pace_within};

use super::section::{Pace, Start, TrackSection};
use crate::error::Error;

/// Windows of time \[s\] whose errors are told: the thesis adapts from 3 or 30 s on.
const WINDOWS: [(f64, f64); 4] = [(10.0, 30.0), (30.0, 60.0), (60.0, 90.0), (90.0, 120.0)];

/// A run as asked for.
#[derive(Debug, Clone, Copy)]
pub struct TrackRun<'a> {
    /// What the controller knows of the robot; its period is set to the robot's.
    pub subject: &'a Subject,
    /// The controller.
    pub controller: &'a dyn ControllerConfig,
    /// The trajectory.
    pub trajectory: &'a dyn TrajectoryConfig,
    /// How it is laid.
    pub section: &'a TrackSection,
}

/// A run that nothing stands against any more.
#[derive(Debug)]
pub struct Ready {
    controller: Box<dyn Controller>,
    trajectory: Placed,
    start: Start,
    pace: f64,
    duration: f64,
    off_course: f64,
    concerns: Vec<Concern>,
    period: f64,
}

/// What came of a run.
#[derive(Debug)]
pub struct Outcome {
    /// Desired and actual motion, parameters over time.
    pub log: TrackLog,
    /// Names of the controller's parameters.
    pub parameters: Vec<String>,
    /// Everything as one recording; `None` if fewer than two rows came.
    pub recording: Option<Recording>,
    /// Why the drive ended early, if it did.
    pub ended: Option<DriveError>,
    /// What was to be feared.
    pub concerns: Vec<Concern>,
    /// Length asked for \[s\].
    pub duration: f64,
    /// Control period \[s\]; 0 for a continuous simulation.
    pub period: f64,
    /// Pace at which the trajectory was run.
    pub pace: f64,
}

/// Distance error of a run \[m\].
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Distances {
    /// Root mean square of the whole.
    pub rms: f64,
    /// Largest.
    pub max: f64,
    /// Last.
    pub last: f64,
    /// Root mean square by window of time: from \[s\], to \[s\], error.
    pub windows: Vec<(f64, f64, f64)>,
}

impl TrackRun<'_> {
    /// Drives a connected robot and stops it. `options` hold what it keeps within and who may end it.
    ///
    /// # Errors
    /// [`Error`] if the robot was not moved: a setting is wrong, it lacks a channel, or danger was foreseen.
    pub fn drive(&self, robot: &mut Live, options: DriveOptions<'_>) -> Result<Outcome, Error> {
        self.ready(robot)?.drive(robot, options)
    }

    /// Builds the controller, sizes the trajectory and weighs the dangers. Nothing moves yet.
    ///
    /// # Errors
    /// [`Error`] for a setting that is wrong, or danger that is foreseen.
    pub fn ready(&self, robot: &Live) -> Result<Ready, Error> {
        let (trajectory, pace, duration) = self.sized()?;
        let course = course(&trajectory, duration);
        let subject = Subject { period: robot.period(), course, ..self.subject.clone() };
        let controller = self.controller.build(&subject).map_err(Error::Control)?;
        let concerns = controller.assess(&Plan { trajectory: &trajectory, duration, noise: self.section.noise });
        if !self.section.force && concerns.iter().any(|c| c.gravity == Gravity::Danger) {
            return Err(Error::Danger(concerns));
        }
        let off_course = self.section.off_course.unwrap_or(f64::INFINITY);
        Ok(Ready { controller, trajectory, start: self.section.start, pace, duration, off_course, concerns, period: subject.period })
    }

    /// The trajectory as [`sized`], its pace, and the length of the run \[s\].
    ///
    /// # Errors
    /// As [`sized`].
    pub fn sized(&self) -> Result<(Placed, f64, f64), Error> {
        sized(self.trajectory, self.section, &self.subject.envelope)
    }
}

/// A trajectory in the size and at the pace at which a section has it followed, that pace, and the length of the run \[s\].
///
/// # Errors
/// [`Error::Trajectory`], or [`Error::Config`] for an impossible size, pace or duration.
pub fn sized(trajectory: &dyn TrajectoryConfig, section: &TrackSection, envelope: &Envelope) -> Result<(Placed, f64, f64), Error> {
    positive("track.size", section.size)?;
    positive("track.fill", section.fill)?;
    let scaled = Placed::new(trajectory.build(envelope).map_err(Error::Trajectory)?).scaled(section.size);
    let pace = match section.pace {
        Pace::Factor(factor) => {
            positive("track.pace", factor)?;
            factor
        }
        Pace::Limits(_) => pace_within(&scaled, section.duration.unwrap_or(0.0).max(scaled.duration()), envelope, section.fill),
    };
    let paced = scaled.paced(pace);
    let duration = section.duration.unwrap_or_else(|| paced.duration());
    positive("track.duration", duration)?;
    Ok((paced, pace, duration))
}

impl Start {
    /// A trajectory as it is followed by a robot that stands at a pose.
    pub(super) fn lay(self, trajectory: Placed, pose: [f64; 3]) -> Placed {
        match self {
            Self::Robot => trajectory.starting_at(pose),
            Self::World => trajectory,
        }
    }
}

impl Ready {
    /// Lays the trajectory at the robot, drives, and stops it. `options` hold what it keeps within and who may end it.
    ///
    /// # Errors
    /// [`Error`] if the robot was not moved: it does not answer, or lacks a channel.
    pub fn drive(mut self, robot: &mut Live, options: DriveOptions<'_>) -> Result<Outcome, Error> {
        let mut measured = vec![0.0; robot.outputs().len()];
        robot.measure(&mut measured).map_err(Error::Connect)?;
        let laid = self.start.lay(self.trajectory, start_pose(robot.outputs(), &measured));
        let tracked = track(robot, &mut *self.controller, &laid, self.duration, self.off_course, options).map_err(Error::Track)?;
        Ok(Outcome::new(tracked, self.controller.parameters(), self.concerns, self.duration, self.period, self.pace))
    }
}

fn positive(key: &str, value: f64) -> Result<(), Error> {
    if value.is_finite() && value > 0.0 { Ok(()) } else { Err(Error::setting(key, format!("must be a positive number, not {value}"))) }
}

impl Outcome {
    pub(super) fn new(tracked: Tracked, parameters: &[String], concerns: Vec<Concern>, duration: f64, period: f64, pace: f64) -> Self {
        let recording = tracked.joined(parameters).ok();
        let Tracked { log, outcome } = tracked;
        Self { recording, parameters: parameters.to_vec(), ended: outcome.err(), concerns, duration, period, pace, log }
    }

    /// Distance errors; `None` without a row.
    pub fn distances(&self) -> Option<Distances> {
        let end = *self.log.time.last()?;
        let distances = self.log.distances();
        let window = |(from, to): (f64, f64)| {
            // A window that the run did not finish would not compare.
            let whole = end >= to - 0.5 * self.period.max(1e-9);
            self.log.rms(from, to).filter(|_| whole).map(|rms| (from, to, rms))
        };
        Some(Distances {
            rms: self.log.rms(0.0, end)?,
            max: distances.iter().copied().fold(0.0, f64::max),
            last: *distances.last()?,
            windows: WINDOWS.into_iter().filter_map(window).collect(),
        })
    }

    /// Root mean square of the distance error after the start-up, the first third of the run \[m\]; infinite for a run that
    /// ended early.
    pub fn settled(&self) -> f64 {
        if self.ended.is_some() {
            return f64::INFINITY;
        }
        self.log.rms(self.duration / 3.0, self.duration).unwrap_or(f64::INFINITY)
    }

    /// Share of the rows in which limits took something from the command.
    pub fn saturated(&self) -> f64 {
        let rows = self.log.share.len().max(1);
        self.log.share.iter().filter(|s| **s < 1.0).count() as f64 / rows as f64
    }

    /// The facts of the run as JSON, without the plan it was made by.
    pub fn facts(&self) -> Value {
        let theta = |i: usize, pick: fn(&[f64]) -> Option<&f64>| self.log.theta.get(i).and_then(|s| pick(s)).copied();
        let parameters: Vec<Value> = (0..self.parameters.len())
            .map(|i| json!({"name": self.parameters[i], "start": theta(i, <[f64]>::first), "end": theta(i, <[f64]>::last)}))
            .collect();
        json!({
            "rows": self.log.rows(),
            "duration_s": self.log.time.last(),
            "planned_s": self.duration,
            "period_s": self.period,
            "pace": self.pace,
            "distance": self.distances().map(|d| json!({
                "rms": d.rms, "max": d.max, "last": d.last,
                "windows": d.windows.iter().map(|(from, to, rms)| json!({"from": from, "to": to, "rms": rms})).collect::<Vec<_>>(),
            })),
            "parameters": parameters,
            "saturated_share": self.saturated(),
            "ended_early": self.ended.as_ref().map(ToString::to_string),
            "warnings": self.concerns.iter().map(|c| c.message.clone()).collect::<Vec<_>>(),
        })
    }
}
