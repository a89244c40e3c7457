//! From options and configuration to live objects: what `run` and `identify` have in common.

use std::path::{Path, PathBuf};

use clap::Args;
use toml::{Table, Value};
use wheelwright_core::config::{self as core_config, ConfigError};
use wheelwright_core::excitation::Excitation;
use wheelwright_core::profile::RobotProfile;
use wheelwright_core::recording::{ColumnMap, ReadOptions};
use wheelwright_core::robot::Live;
use wheelwright_solvers::Recursive;

use super::Shared;
use crate::config::Config;
use crate::constraints::freedom;
use crate::error::Error;
use crate::output::Folder;
use crate::registry::{ModelFailure, Registry, RobotFailure};
use crate::study::Study;
use crate::toml_file::TomlFile;

/// Columns of a file that are commands, so that any recording can be driven again.
const COMMANDS: [&str; 4] = ["v_ref", "omega_ref", "u_left", "u_right"];
/// Share held out unless asked otherwise.
const HOLDOUT: f64 = 0.3;
const MODEL: &str = "vw-pd";
pub(super) const SOLVER: &str = "output-error";
/// The solver that runs sample by sample.
pub(super) const RECURSIVE: &str = "recursive";

/// How recordings are read.
#[derive(Debug, Clone, Default, Args)]
pub(super) struct ReadArguments {
    /// Columns by another name, as in v=twist_x,omega=gyro_z
    #[arg(long, value_name = "NAME=COLUMN,...", value_delimiter = ',')]
    pub(super) map: Vec<String>,
    /// Topic of a role (cmd or odom), as in cmd=/robot/cmd_vel (may be repeated)
    #[arg(long, value_name = "ROLE=TOPIC")]
    pub(super) topic: Vec<String>,
}

/// What is fitted and how it is judged.
#[derive(Debug, Clone, Default, Args)]
pub(super) struct StudyArguments {
    /// Model to identify [default: the robot profile's, or vw-pd]
    #[arg(long, value_name = "NAME")]
    pub(super) model: Option<String>,
    /// Profile of the robot: its dimensions, and the model its controller calls for
    #[arg(long, value_name = "robot.toml")]
    pub(super) robot: Option<PathBuf>,
    /// Solver to use [default: output-error]
    #[arg(long, value_name = "NAME")]
    pub(super) solver: Option<String>,
    /// Share of the samples that no estimate sees [default: 0.3, or 0 with --validate]
    #[arg(long, value_name = "SHARE")]
    pub(super) holdout: Option<f64>,
    /// Recording to validate on that no estimate sees (may be repeated)
    #[arg(long, value_name = "RECORDING")]
    pub(super) validate: Vec<PathBuf>,
    /// Parameters and fits only: no identifiability, lag, noise ceiling or comparison of recordings
    #[arg(long)]
    pub(super) quick: bool,
    /// Fail with status 4 unless the result reaches a number, as in fit.validate.v=95 (may be repeated)
    #[arg(long, value_name = "KEY=NUMBER")]
    pub(super) require: Vec<String>,
}

/// A configuration with its plugins loaded.
pub(super) struct Setup {
    pub(super) config: Config,
    pub(super) registry: Registry,
}

impl Setup {
    /// Reads the configuration and loads the plugins it names.
    pub(super) fn load(shared: &Shared) -> Result<Self, Error> {
        Self::load_file(shared.config.as_deref(), shared)
    }

    /// The same from a file named otherwise than by `--config`.
    pub(super) fn load_file(file: Option<&Path>, shared: &Shared) -> Result<Self, Error> {
        let config = Config::load(file, &shared.set)?;
        let registry = Registry::load(&config)?;
        Ok(Self { config, registry })
    }

    /// The seed: option, configuration, 0.
    pub(super) fn seed(&self, shared: &Shared) -> u64 {
        shared.seed.or(self.config.sections.seed).unwrap_or(0)
    }

    /// Where results go: option, configuration, nowhere.
    pub(super) fn folder(&self, shared: &Shared) -> Result<Option<Folder>, Error> {
        let configured = || self.config.sections.output.directory.as_ref().map(|d| self.config.resolve(d));
        shared.out.clone().or_else(configured).map(|path| Folder::create(&path)).transpose()
    }

    /// How recordings are read: the configuration's columns and topics, then the options'.
    pub(super) fn read_options(&self, arguments: &ReadArguments) -> Result<ReadOptions, Error> {
        let mut options = self.config.read_options();
        for pair in &arguments.map {
            let (name, from) = split(pair, "--map", "v=twist_x")?;
            options.columns.retain(|c| c.name != name);
            options.columns.push(ColumnMap { name: name.to_owned(), from: from.to_owned(), scale: 1.0, offset: 0.0 });
        }
        for pair in &arguments.topic {
            let (role, topic) = split(pair, "--topic", "cmd=/robot/cmd_vel")?;
            options.topics.retain(|(r, _)| r != role);
            options.topics.push((role.to_owned(), topic.to_owned()));
        }
        if let Some((role, _)) = options.topics.iter().find(|(role, _)| role != "cmd" && role != "odom") {
            return Err(Error::setting("recording.topics", format!("unknown role `{role}`: the roles are `cmd` and `odom`")));
        }
        Ok(options)
    }

    /// The study: model, solver, hold-out and seed.
    pub(super) fn study(&self, shared: &Shared, arguments: &StudyArguments, read: ReadOptions) -> Result<Study, Error> {
        let robot = arguments.robot.as_deref().map(profile).transpose()?;
        let default_model = robot.as_ref().map_or(MODEL, |r| r.model.as_str());
        let model_table = chosen(self.config.sections.model.as_ref(), arguments.model.as_deref(), default_model);
        let solver_table = chosen(self.config.sections.solver.as_ref(), arguments.solver.as_deref(), SOLVER);
        let model = self.registry.model(model_table.clone()).map_err(|e| match e {
            ModelFailure::Config(error) => self.config.error_in("model", error),
            ModelFailure::Model(error) => Error::Identify(error.into()),
        })?;
        let solver = self.registry.solver(solver_table).map_err(|e| self.config.error_in("solver", e))?;
        let freedom = freedom(&*model, &self.config.sections.parameters).map_err(|e| self.config.error_in("parameters", e))?;
        let validates = !arguments.validate.is_empty() || !self.config.sections.validation.recordings.is_empty();
        let default = if validates { 0.0 } else { HOLDOUT };
        let holdout = arguments.holdout.or(self.config.sections.validation.holdout).unwrap_or(default);
        if !(0.0..=0.9).contains(&holdout) {
            return Err(Error::setting(
                "validation.holdout",
                format!("is {holdout}; it is a share of the samples from 0 to 0.9, such as 0.3"),
            ));
        }
        let model_about = self.registry.list("models").into_iter().find(|m| m.name == model.name()).map(|m| m.about).unwrap_or_default();
        let evidence = !arguments.quick;
        Ok(Study { evidence, model_table, model, model_about, freedom, solver, robot, read, holdout, seed: self.seed(shared) })
    }

    /// Settings of the recursive estimator: the configuration's `[solver]` if it is one, else the defaults.
    pub(super) fn recursive(&self) -> Result<Recursive, Error> {
        let mut table = chosen(self.config.sections.solver.as_ref(), Some(RECURSIVE), RECURSIVE);
        table.remove("type");
        core_config::plain(table).map_err(|e| self.config.error_in("solver", e))
    }

    /// Recordings that only validate: the options', or else the configuration's.
    pub(super) fn validation_paths(&self, arguments: &StudyArguments) -> Vec<PathBuf> {
        self.validation_paths_or(&arguments.validate)
    }

    /// The recordings given, or else those that the configuration validates on.
    pub(super) fn validation_paths_or(&self, given: &[PathBuf]) -> Vec<PathBuf> {
        match given {
            [] => self.config.sections.validation.recordings.iter().map(|p| self.config.resolve(p)).collect(),
            given => given.to_vec(),
        }
    }

    /// Recordings the configuration names, relative to it.
    pub(super) fn recording_paths(&self) -> Vec<PathBuf> {
        self.config.sections.recording.paths.iter().map(|p| self.config.resolve(p)).collect()
    }

    /// Connects the robot of a configuration's table.
    pub(super) fn connect(&self, table: Table, seed: u64) -> Result<Live, Error> {
        match self.registry.robot(table, seed) {
            Ok(robot) => Ok(Live::new(robot)),
            Err(RobotFailure::Config(error)) => Err(self.config.error_in("robot", error)),
            Err(RobotFailure::Robot(error)) => Err(Error::Connect(error)),
        }
    }

    /// The excitation of the configuration.
    pub(super) fn excitation(&self) -> Result<Box<dyn Excitation>, Error> {
        let missing =
            || Error::setting("excitation", "is missing: [excitation] says what the robot is to drive, as in type = \"thesis-pioneer\"");
        let mut table = self.config.sections.excitation.clone().ok_or_else(missing)?;
        if table.get("type").and_then(Value::as_str) == Some("table")
            && let Some(file) = table.remove("file")
        {
            self.fill_table(&mut table, &file)?;
        }
        self.registry.excitation(table).map_err(|e| self.config.error_in("excitation", e))
    }

    /// Writes the rows of a file of commands into a `table` excitation; the file is relative to the configuration.
    fn fill_table(&self, table: &mut Table, file: &Value) -> Result<(), Error> {
        let wrong = |message: String| self.config.error_in("excitation", ConfigError::new("file", message));
        let Some(name) = file.as_str() else { return Err(wrong(format!("must be a path, not {file}"))) };
        if table.contains_key("time") || table.contains_key("commands") {
            return Err(wrong("stands beside `time` or `commands`: give the one or the other".to_owned()));
        }
        let path = self.config.resolve(Path::new(name));
        std::fs::metadata(&path).map_err(|error| Error::Io { path: path.clone(), error })?;
        let recording =
            wheelwright_recordings::open(&path, &ReadOptions::default()).map_err(|error| Error::Recording { path: path.clone(), error })?;
        let numbers = |values: &[f64]| Value::Array(values.iter().map(|v| Value::Float(*v)).collect());
        let start = recording.time().first().copied().unwrap_or_default();
        let time: Vec<f64> = recording.time().iter().map(|t| t - start).collect();
        let commands = recording.columns().iter().filter(|c| COMMANDS.contains(&c.name.as_str()));
        table.insert("time".to_owned(), numbers(&time));
        table.insert("commands".to_owned(), Value::Table(commands.map(|c| (c.name.clone(), numbers(&c.values))).collect()));
        Ok(())
    }
}

/// Reads a robot's profile.
pub(super) fn profile(path: &Path) -> Result<RobotProfile, Error> {
    let file = TomlFile::read(path)?;
    RobotProfile::from_table(file.table()?).map_err(|e| file.error(e))
}

/// A plugin's table: the configuration's, unless an option names another plugin.
pub(super) fn chosen(configured: Option<&Table>, option: Option<&str>, default: &str) -> Table {
    let named = |name: &str| Table::from_iter([("type".to_owned(), Value::String(name.to_owned()))]);
    match (configured, option) {
        (Some(table), Some(name)) if table.get("type").and_then(Value::as_str) == Some(name) => table.clone(),
        (Some(table), Some(name)) if !table.contains_key("type") => with_type(table, name),
        (_, Some(name)) => named(name),
        (Some(table), None) if !table.contains_key("type") => with_type(table, default),
        (Some(table), None) => table.clone(),
        (None, None) => named(default),
    }
}

/// `--set model.static_friction=true` makes a table without a type: it takes the one chosen.
fn with_type(table: &Table, name: &str) -> Table {
    let mut table = table.clone();
    table.insert("type".to_owned(), Value::String(name.to_owned()));
    table
}

/// `left=right` of an option.
pub(super) fn split<'a>(pair: &'a str, option: &str, example: &str) -> Result<(&'a str, &'a str), Error> {
    let halves = pair.split_once('=').map(|(l, r)| (l.trim(), r.trim())).filter(|(l, r)| !l.is_empty() && !r.is_empty());
    halves.ok_or_else(|| Error::Usage(format!("{option} {pair}: expected two names with = between, as in {option} {example}")))
}
