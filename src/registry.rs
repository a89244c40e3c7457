//! The plugins a command can use: the built-in ones and those of the libraries a configuration names.

use serde::de::DeserializeOwned;
use toml::{Table, Value};
use wheelwright_core::config::{self, ConfigError};
use wheelwright_core::excitation::Excitation;
use wheelwright_core::model::{ModelConfig, RegressorModel};
use wheelwright_core::robot::{Robot, RobotConfig, RobotError};
use wheelwright_core::solver::Solver;

use crate::config::Config;
use crate::error::Error;

/// Kinds of plugins, as [`Registry::list`] takes them.
pub const KINDS: [&str; 4] = ["models", "robots", "solvers", "excitations"];

/// A plugin by name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entry {
    /// Name that `type` takes.
    pub name: String,
    /// One line on what it is.
    pub about: String,
    /// `built-in`, or the library's path.
    pub source: String,
}

/// Why there is no robot: its table is wrong, or it does not answer.
#[derive(Debug, Clone, PartialEq)]
pub enum RobotFailure {
    /// Key relative to the table, and reason.
    Config(ConfigError),
    /// What the robot or its driver said.
    Robot(RobotError),
}

/// Finds plugins by the `type` of their table.
#[derive(Debug, Default)]
pub struct Registry {}

impl Registry {
    /// Loads the libraries a configuration names.
    ///
    /// # Errors
    /// [`Error::Plugin`] naming the library and the reason.
    pub fn load(_config: &Config) -> Result<Self, Error> {
        Ok(Self {})
    }

    /// A model.
    ///
    /// # Errors
    /// [`ConfigError`] with the key, relative to the table.
    pub fn model(&self, table: Table) -> Result<Box<dyn RegressorModel>, ConfigError> {
        let model: Box<dyn ModelConfig> = config::tagged(table)?;
        model.build().map_err(|e| match e {
            wheelwright_core::model::ModelError::Config { key, reason } => ConfigError::new(key, reason),
            other => ConfigError::new("", other.to_string()),
        })
    }

    /// A solver.
    ///
    /// # Errors
    /// [`ConfigError`] with the key, relative to the table.
    pub fn solver(&self, table: Table) -> Result<Box<dyn Solver>, ConfigError> {
        config::tagged(table)
    }

    /// A connected robot.
    ///
    /// # Errors
    /// [`RobotFailure`].
    pub fn robot(&self, table: Table, seed: u64) -> Result<Box<dyn Robot>, RobotFailure> {
        let config: Box<dyn RobotConfig> = config::tagged(table).map_err(RobotFailure::Config)?;
        config.connect(seed).map_err(|e| match e {
            RobotError::Config { key, reason } => RobotFailure::Config(ConfigError::new(key, reason)),
            other => RobotFailure::Robot(other),
        })
    }

    /// An excitation.
    ///
    /// # Errors
    /// [`ConfigError`] with the key, relative to the table.
    pub fn excitation(&self, table: Table) -> Result<Box<dyn Excitation>, ConfigError> {
        config::tagged(table)
    }

    /// Plugins of one of [`KINDS`], in order of name.
    pub fn list(&self, kind: &str) -> Vec<Entry> {
        match kind {
            "models" => built_in::<dyn ModelConfig>(|m| m.about()),
            "robots" => built_in::<dyn RobotConfig>(|r| r.about()),
            "solvers" => built_in::<dyn Solver>(|s| s.about()),
            "excitations" => built_in::<dyn Excitation>(|e| e.about()),
            _ => Vec::new(),
        }
    }
}

/// What typetag knows of a trait. A plugin that cannot be made without settings tells what it lacks instead of what it is.
fn built_in<T: ?Sized>(about: impl Fn(&T) -> String) -> Vec<Entry>
where
    Box<T>: DeserializeOwned,
{
    let describe = |name: &String| {
        let table = Table::from_iter([("type".to_owned(), Value::String(name.clone()))]);
        config::tagged::<Box<T>>(table).map_or_else(|e| format!("needs settings: {e}"), |plugin| about(&plugin))
    };
    let entry = |name: String| Entry { about: describe(&name), name, source: "built-in".to_owned() };
    config::names::<Box<T>>().into_iter().map(entry).collect()
}
