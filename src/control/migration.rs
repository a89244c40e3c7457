//! Carrying a controller from the robot it was tuned on to another: learn the other's parameters, re-parameterise, drive, compare.

use serde_json::{Value, json};
use toml::Table;
use wheelwright_controllers::migration::{GainRule, LoopMargin, Tuning, migrate};
use wheelwright_controllers::{AdaptiveConfig, InverseDynamicsConfig};
use wheelwright_core::config::{self as core_config, ConfigError};
use wheelwright_core::controller::{ControllerConfig, Subject};
use wheelwright_core::dataset::Dataset;
use wheelwright_core::drive::{DriveOptions, Safety, drive};
use wheelwright_core::excitation::Excitation;
use wheelwright_core::identification::{Identification, identify};
use wheelwright_core::robot::Live;
use wheelwright_core::solver::{Problem, Solver};
use wheelwright_core::trajectory::TrajectoryConfig;

use super::run::{Outcome, TrackRun};
use super::section::TrackSection;
use crate::error::Error;

/// Share of an excitation kept from the fit.
const HOLDOUT: f64 = 0.3;
/// Settings of the adaptation where none are given: slow, pulled back, kept within half of each parameter.
const ADAPTATION: &str = "gamma = 0.2\nstart = 5.0\nleak = 0.02\nprojection = { relative = 0.5 }";
/// What connects the target anew for each run, with a seed for whatever is random in it.
pub type Connect<'a> = dyn FnMut(u64) -> Result<Live, Error> + 'a;

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
/// [`Error`] of the drive, or of the identification.
pub fn learn(
    robot: &mut Live,
    excitation: &dyn Excitation,
    subject: &Subject,
    solver: &dyn Solver,
    options: DriveOptions<'_>,
) -> Result<Identification, Error> {
    let recording = drive(robot, excitation, options).map_err(|error| Error::Drive { error: Box::new(error), kept: None })?;
    let data = Dataset::new(&recording, &*subject.model).map_err(|e| Error::content("excitation", e))?;
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
    /// [`Error::Migration`] where it would be unsafe.
    pub fn gains(&self) -> Result<(Tuning, [LoopMargin; 2]), Error> {
        Ok(migrate(&self.tuning, self.source, self.target, self.rule, self.section.size)?)
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

    /// Drives one case with a controller that starts from `theta`.
    fn case(
        &self,
        name: &'static str,
        theta: &[f64],
        tuning: Tuning,
        controller: &dyn ControllerConfig,
        drive: &mut DriveCase<'_>,
    ) -> Case {
        let own = Some(self.target.theta.clone());
        let subject = Subject { theta: theta.to_vec(), own, ..self.target.clone() };
        let run = TrackRun { subject: &subject, controller, trajectory: self.trajectory, section: self.section };
        Case { name, theta: theta.to_vec(), tuning, outcome: drive(&run) }
    }

    /// The migrated controller, with and without adaptation, and, with `compare`, what it is to be measured against: the
    /// source's controller as it is, all ones, and `native` parameters.
    ///
    /// # Errors
    /// [`Error`] if the controller cannot be carried over. A run that was refused is in its [`Case`].
    pub fn run(&self, native: Option<&[f64]>, compare: bool, drive: &mut DriveCase<'_>) -> Result<Vec<Case>, Error> {
        let (tuning, _) = self.gains()?;
        let adaptive = self.adaptive(&tuning).map_err(|e| Error::setting("migrate.adaptation", e.to_string()))?;
        let fixed = |tuning: Tuning| InverseDynamicsConfig::from(tuning);
        let mut cases = Vec::new();
        if compare {
            cases.push(self.case(UNMIGRATED, &self.source.theta, self.tuning, &fixed(self.tuning), drive));
            let ones = vec![1.0; self.target.theta.len()];
            cases.push(self.case(ALL_ONES, &ones, tuning, &fixed(tuning), drive));
        }
        cases.push(self.case(MIGRATED, &self.target.theta, tuning, &fixed(tuning), drive));
        cases.push(self.case(ADAPTED, &self.target.theta, tuning, &adaptive, drive));
        if let Some(native) = native.filter(|_| compare) {
            cases.push(self.case(NATIVE, native, tuning, &fixed(tuning), drive));
        }
        Ok(cases)
    }
}

/// Drives one run on a freshly connected target.
pub type DriveCase<'a> = dyn FnMut(&TrackRun<'_>) -> Result<Outcome, Error> + 'a;

/// A driver of cases that connects the target for each of them with the same seed, so that they meet the same noise.
pub fn driver<'a>(connect: &'a mut Connect<'_>, seed: u64, safety: Safety) -> impl FnMut(&TrackRun<'_>) -> Result<Outcome, Error> + 'a {
    move |run| run.drive(&mut connect(seed)?, DriveOptions { safety, ..DriveOptions::default() })
}

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
