//! Carrying a controller from the robot it was tuned on to another: learn the other's parameters, re-parameterise, drive, compare.

use serde_json::{Value, json};
use toml::Table;
use wheelwright_controllers::migration::{GainRule, LoopMargin, Tuning, migrate};
use wheelwright_controllers::{AdaptiveConfig, InverseDynamicsConfig};
use wheelwright_core::config::{self as core_config, ConfigError};
use wheelwright_core::controller::{ControllerConfig, Subject};
use wheelwright_core::dataset::Dataset;
use wheelwright_core::drive::{DriveFault, DriveOptions, drive};
use wheelwright_core::excitation::Excitation;
use wheelwright_core::identification::{Identification, identify};
use wheelwright_core::recording::Recording;
use wheelwright_core::robot::Live;
use wheelwright_core::solver::{Problem, Solver};
use wheelwright_core::trajectory::{TrajectoryConfig, course};

use super::run::{Outcome, TrackRun, sized};
use super::section::TrackSection;
use crate::error::Error;

/// Share of an excitation kept from the fit.
const HOLDOUT: f64 = 0.3;
/// Settings of the adaptation where none are given: slow, pulled back, kept within half of each parameter.
const ADAPTATION: &str = "gamma = 0.2\nstart = 5.0\nleak = 0.02\nprojection = { relative = 0.5 }";

/// The gains in a controller's table, `inverse-dynamics` or `adaptive`.
///
/// # Errors
/// [`ConfigError`] relative to the table.
pub fn tuning(mut table: Table) -> Result<Tuning, ConfigError> {
    match core_config::take_type(&mut table)?.as_str() {
        "inverse-dynamics" => core_config::plain::<InverseDynamicsConfig>(table).map(|c| Tuning::from(&c)),
        "adaptive" => core_config::plain::<AdaptiveConfig>(table).map(|c| Tuning::from(&c)),
        other => Err(ConfigError::new("type", format!("\"{other}\" knows no robot; inverse-dynamics and adaptive can be carried over"))),
    }
}

/// Excites a robot and identifies it. The robot is stopped.
///
/// # Errors
/// [`Error`] of the drive, or as [`learned`].
pub fn learn(
    robot: &mut Live,
    excitation: &dyn Excitation,
    subject: &Subject,
    solver: &dyn Solver,
    options: DriveOptions<'_>,
) -> Result<Identification, Error> {
    let recording = drive(robot, excitation, options).map_err(|error| Error::Drive { error: Box::new(error), kept: None })?;
    learned(&recording, subject, solver)
}

/// What an excitation's recording tells of a robot.
///
/// # Errors
/// [`Error`] of the recording, or of the identification.
pub fn learned(recording: &Recording, subject: &Subject, solver: &dyn Solver) -> Result<Identification, Error> {
    let data = Dataset::new(recording, &*subject.model).map_err(|e| Error::content("excitation", e))?;
    let (train, held_out) = data.hold_out(HOLDOUT);
    Ok(identify(&Problem::new(&*subject.model, &train), solver, &held_out)?)
}

/// A subject that knows what an identification found.
pub fn informed(subject: &Subject, found: &Identification) -> Subject {
    let intervals = found.estimates.iter().map(|e| e.ci95).collect();
    Subject { theta: found.solution.theta.clone(), intervals, own: None, ..subject.clone() }
}

/// A controller on its way from one robot to another.
#[derive(Debug)]
pub struct Migration<'a> {
    /// Gains on the source.
    pub tuning: Tuning,
    /// The source, period included.
    pub source: &'a Subject,
    /// The target as identified, period included.
    pub target: &'a Subject,
    /// What becomes of the gains.
    pub rule: GainRule,
    /// How the trajectory is laid on the target.
    pub section: &'a TrackSection,
    /// The trajectory.
    pub trajectory: &'a dyn TrajectoryConfig,
    /// Settings of the adapting run beside the gains.
    pub adaptation: Option<&'a Table>,
}

/// One run of a comparison.
#[derive(Debug)]
pub struct Case {
    /// What it shows.
    pub name: &'static str,
    /// θ the controller began with.
    pub theta: Vec<f64>,
    /// Its gains.
    pub tuning: Tuning,
    /// The run, or why it was not driven.
    pub outcome: Result<Outcome, Error>,
}

/// Names of the runs.
pub const UNMIGRATED: &str = "unmigrated: source's theta and gains";
/// All parameters one, migrated gains.
pub const ALL_ONES: &str = "all ones";
/// The target's parameters, migrated gains.
pub const MIGRATED: &str = "migrated";
/// The same with adaptation.
pub const ADAPTED: &str = "migrated, adapting";
/// A second identification on the target, or parameters given for it.
pub const NATIVE: &str = "native";

impl Migration<'_> {
    /// The gains on the target and the loops they make there.
    ///
    /// # Errors
    /// [`Error::Migration`] where it would be unsafe; [`Error`] of the trajectory.
    pub fn gains(&self) -> Result<(Tuning, [LoopMargin; 2]), Error> {
        let (trajectory, _, duration) = sized(self.trajectory, self.section, &self.target.envelope)?;
        let target = Subject { course: course(&trajectory, duration), ..self.target.clone() };
        Ok(migrate(&self.tuning, self.source, &target, self.rule, self.section.size)?)
    }

    /// The adaptive controller of the migrated gains.
    ///
    /// # Errors
    /// [`ConfigError`] in the settings of the adaptation.
    pub fn adaptive(&self, tuning: &Tuning) -> Result<AdaptiveConfig, ConfigError> {
        let mut table = match self.adaptation {
            Some(table) => table.clone(),
            None => ADAPTATION.parse().map_err(|e: toml::de::Error| ConfigError::new("", e.message()))?,
        };
        let gains = Table::try_from(tuning).map_err(|e| ConfigError::new("", e.to_string()))?;
        if let Some(key) = gains.keys().find(|key| table.contains_key(*key)) {
            return Err(ConfigError::new(key, "is a gain; gains come from the source's controller"));
        }
        table.extend(gains);
        core_config::plain(table)
    }

    /// The migrated controller, with and without adaptation, and, with `compare`, what it is to be measured against: the
    /// source's controller as it is, all ones, and `native` parameters. After a run that a person, the robot or the disk ended no
    /// other is begun.
    ///
    /// # Errors
    /// [`Error`] if the controller cannot be carried over. Why a run was not driven is in its [`Case`].
    pub fn run(&self, native: Option<&[f64]>, compare: bool, drive: &mut DriveCase<'_>) -> Result<Vec<Case>, Error> {
        let (tuning, _) = self.gains()?;
        let adaptive = self.adaptive(&tuning).map_err(|e| Error::setting("migrate.adaptation", e.to_string()))?;
        let (here, there) = (InverseDynamicsConfig::from(tuning), InverseDynamicsConfig::from(self.tuning));
        let ones = vec![1.0; self.target.theta.len()];
        let planned: [(bool, Planned<'_>); 4] = [
            (compare, (UNMIGRATED, &self.source.theta, self.tuning, &there)),
            (compare, (ALL_ONES, &ones, tuning, &here)),
            (true, (MIGRATED, &self.target.theta, tuning, &here)),
            (true, (ADAPTED, &self.target.theta, tuning, &adaptive)),
        ];
        let native = native.filter(|_| compare).map(|theta| -> Planned<'_> { (NATIVE, theta, tuning, &here) });
        let planned = planned.into_iter().filter_map(|(wanted, run)| wanted.then_some(run)).chain(native);
        let mut cases = Vec::new();
        for (name, theta, tuning, controller) in planned {
            let subject = Subject { theta: theta.to_vec(), own: Some(self.target.theta.clone()), ..self.target.clone() };
            let run = TrackRun { subject: &subject, controller, trajectory: self.trajectory, section: self.section };
            let case = Case { name, theta: theta.to_vec(), tuning, outcome: drive(name, &run) };
            let last = case.is_last();
            cases.push(case);
            if last {
                break;
            }
        }
        Ok(cases)
    }
}

/// A run to be driven: its name, the parameters it begins with, its gains, its controller.
type Planned<'a> = (&'static str, &'a [f64], Tuning, &'a dyn ControllerConfig);

impl Case {
    /// True if a person, the robot or the disk ended the run, or a setting is wrong. What a controller brought about itself, off its
    /// course or refused beforehand, is a result like any other.
    pub fn is_last(&self) -> bool {
        use DriveFault::{Command, Floor, NotFinite, OffCourse};
        match &self.outcome {
            Ok(Outcome { ended: Some(error), .. }) => {
                error.stop_failed.is_some() || !matches!(error.fault, Command { .. } | Floor { .. } | NotFinite { .. } | OffCourse { .. })
            }
            Ok(_) | Err(Error::Danger(_)) => false,
            Err(_) => true,
        }
    }
}

/// Drives the run of that name on a freshly connected target.
pub type DriveCase<'a> = dyn FnMut(&str, &TrackRun<'_>) -> Result<Outcome, Error> + 'a;

/// The settled error of a case \[m\], if it was driven.
pub fn error_of(cases: &[Case], name: &str) -> Option<f64> {
    cases.iter().find(|c| c.name == name)?.outcome.as_ref().ok().map(Outcome::settled)
}

/// The comparison in numbers: settled errors \[m\] and their ratios.
pub fn verdict(cases: &[Case]) -> Value {
    let error = |name| error_of(cases, name).filter(|e| e.is_finite());
    let ratio = |a: Option<f64>, b: Option<f64>| a.zip(b).map(|(a, b)| a / b);
    json!({
        "unmigrated": error(UNMIGRATED), "all_ones": error(ALL_ONES), "migrated": error(MIGRATED), "adapted": error(ADAPTED), "native": error(NATIVE),
        "migrated_over_native": ratio(error(MIGRATED), error(NATIVE)),
        "unmigrated_over_migrated": ratio(error(UNMIGRATED), error(MIGRATED)),
    })
}
