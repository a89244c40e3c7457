//! The plugins a command can use: the built-in ones and those of the libraries a configuration names.

use serde::de::DeserializeOwned;
use toml::{Table, Value};
use wheelwright_core::config::{self, ConfigError};
use wheelwright_core::controller::ControllerConfig;
use wheelwright_core::effect::{Effect, Place};
use wheelwright_core::excitation::Excitation;
use wheelwright_core::model::{ModelConfig, ModelError, RegressorModel};
use wheelwright_core::robot::{Robot, RobotConfig, RobotError};
use wheelwright_core::solver::Solver;
use wheelwright_core::trajectory::TrajectoryConfig;
use wheelwright_plugin::{Kind, Listed};

use crate::config::Config;
use crate::error::Error;

/// Kinds of plugins, as [`Registry::list`] takes them.
pub const KINDS: [&str; 7] = ["models", "robots", "solvers", "excitations", "effects", "controllers", "trajectories"];

/// A plugin by name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entry {
    /// Name that `type` takes.
    pub name: String,
    /// One line on what it is.
    pub about: String,
    /// `built-in`, or the library's path.
    pub source: String,
    /// Where an effect acts; `None` for everything else.
    pub place: Option<Place>,
}

/// Why there is no model: its table is wrong, or the model or its plugin failed.
#[derive(Debug, Clone, PartialEq)]
pub enum ModelFailure {
    /// Key relative to the table, and reason.
    Config(ConfigError),
    /// What the model said.
    Model(ModelError),
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
pub struct Registry {
    /// Robots and models, which come from libraries too.
    loadable: wheelwright_plugin::Registry,
}

impl Registry {
    /// Loads the libraries a configuration names.
    ///
    /// # Errors
    /// [`Error::Plugin`] naming the library and the reason.
    pub fn load(config: &Config) -> Result<Self, Error> {
        let loadable = wheelwright_plugin::Registry::load(config.folder(), &config.sections.plugin)?;
        Ok(Self { loadable })
    }

    /// A model.
    ///
    /// # Errors
    /// [`ModelFailure`].
    pub fn model(&self, table: Table) -> Result<Box<dyn RegressorModel>, ModelFailure> {
        let config = self.loadable.model(table).map_err(ModelFailure::Config)?;
        config.build().map_err(|e| match e {
            ModelError::Config { key, reason } => ModelFailure::Config(ConfigError::new(key, reason)),
            other => ModelFailure::Model(other),
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
        let config = self.loadable.robot(table).map_err(RobotFailure::Config)?;
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

    /// A controller.
    ///
    /// # Errors
    /// [`ConfigError`] with the key, relative to the table.
    pub fn controller(&self, table: Table) -> Result<Box<dyn ControllerConfig>, ConfigError> {
        config::tagged(table)
    }

    /// A trajectory.
    ///
    /// # Errors
    /// [`ConfigError`] with the key, relative to the table.
    pub fn trajectory(&self, table: Table) -> Result<Box<dyn TrajectoryConfig>, ConfigError> {
        config::tagged(table)
    }

    /// An effect.
    ///
    /// # Errors
    /// [`ConfigError`] with the key, relative to the table.
    pub fn effect(&self, table: Table) -> Result<Box<dyn Effect>, ConfigError> {
        self.loadable.effect(table)
    }

    /// The effects that libraries bring, each with its settings left out; one that cannot be made without is not among them.
    pub fn loaded_effects(&self) -> Vec<Box<dyn Effect>> {
        let loaded = self.loadable.list().into_iter().filter(|l| l.kind == Kind::Effect && l.library.is_some());
        let named = |name: String| Table::from_iter([("type".to_owned(), Value::String(name))]);
        loaded.filter_map(|l| self.effect(named(l.name)).ok()).collect()
    }

    /// Plugins of one of [`KINDS`], in order of name.
    pub fn list(&self, kind: &str) -> Vec<Entry> {
        match kind {
            "models" => self.loadable(Kind::Model),
            "robots" => self.loadable(Kind::Robot),
            "solvers" => built_in::<dyn Solver>(|s| s.about()),
            "excitations" => built_in::<dyn Excitation>(|e| e.about()),
            "controllers" => built_in::<dyn ControllerConfig>(|c| c.about()),
            "trajectories" => built_in::<dyn TrajectoryConfig>(|t| t.about()),
            "effects" => self.loadable(Kind::Effect).into_iter().map(|entry| self.placed(entry)).collect(),
            _ => Vec::new(),
        }
    }

    /// An effect's entry with its place, if it can be asked without settings.
    fn placed(&self, entry: Entry) -> Entry {
        let named = Table::from_iter([("type".to_owned(), Value::String(entry.name.clone()))]);
        Entry { place: self.effect(named).ok().map(|effect| effect.stage().place()), ..entry }
    }

    fn loadable(&self, kind: Kind) -> Vec<Entry> {
        let entry = |l: Listed| Entry {
            about: match kind {
                _ if !l.about.is_empty() || l.library.is_some() => l.about,
                Kind::Robot => describe::<dyn RobotConfig>(&l.name, |r| r.about()),
                Kind::Effect => describe::<dyn Effect>(&l.name, |e| e.about()),
                _ => describe::<dyn ModelConfig>(&l.name, |m| m.about()),
            },
            source: l.library.map_or_else(|| BUILT_IN.to_owned(), |path| path.display().to_string()),
            name: l.name,
            place: None,
        };
        self.loadable.list().into_iter().filter(|l| l.kind == kind).map(entry).collect()
    }
}

/// The source of what no library brought.
const BUILT_IN: &str = "built-in";

/// What built-ins that cannot be made from their name alone need besides, to be asked what they are.
const LEAST_SETTINGS: [(&str, &str); 8] = [
    ("simulator", "robot = \"pioneer-3dx\""),
    ("kinematic", "k = [1, 1, 1]"),
    ("inverse-dynamics", "k = [1, 1, 1]\nkv = 1\nkw = 1"),
    ("adaptive", "k = [1, 1, 1]\nkv = 1\nkw = 1\ngamma = 1"),
    ("figure-eight", "ax = 1\nay = 1\nfrequency = 1"),
    ("circle", "radius = 1\nspeed = 1"),
    ("line", "length = 1\nspeed = 1"),
    ("waypoints", "points = [[0, 0], [1, 0]]\nspeed = 1\nacceleration = 1"),
];

/// What a built-in says of itself; what it lacks, if it is not made of what is known here.
fn describe<T: ?Sized>(name: &str, about: impl Fn(&T) -> String) -> String
where
    Box<T>: DeserializeOwned,
{
    let settings = LEAST_SETTINGS.iter().find(|(known, _)| *known == name).and_then(|(_, text)| text.parse::<Table>().ok());
    let mut table = settings.unwrap_or_default();
    table.insert("type".to_owned(), Value::String(name.to_owned()));
    config::tagged::<Box<T>>(table).map_or_else(|e| format!("needs settings: {e}"), |plugin| about(&plugin))
}

/// What typetag knows of a trait.
fn built_in<T: ?Sized>(about: impl Fn(&T) -> String) -> Vec<Entry>
where
    Box<T>: DeserializeOwned,
{
    let entry = |name: String| Entry { about: describe::<T>(&name, &about), name, source: BUILT_IN.to_owned(), place: None };
    config::names::<Box<T>>().into_iter().map(entry).collect()
}
