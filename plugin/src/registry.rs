//! Names to plugins: built-in ones by typetag, loaded ones by their tables. In TOML they look the same.

use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Serialize, Serializer};
use toml::{Table, Value};
use wheelwright_core::Effect;
use wheelwright_core::config::{self, ConfigError};
use wheelwright_core::model::{ModelConfig, ModelError, RegressorModel};
use wheelwright_core::robot::{Robot, RobotConfig, RobotError};

use crate::alone;
use crate::error::PluginError;
use crate::host::library::{Library, ModelTable, PluginEntry, RobotTable};
use crate::host::offer::{Offer, c_config};
use crate::host::{effect, model, robot};

/// What a name stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Kind {
    /// `[robot]`.
    Robot,
    /// `[model]`.
    Model,
    /// `[[effect]]`.
    Effect,
}

impl Kind {
    /// `robot`, `model` or `effect`.
    pub fn word(self) -> &'static str {
        match self {
            Self::Robot => "robot",
            Self::Model => "model",
            Self::Effect => "effect",
        }
    }
}

/// A line of `wheelwright plugins`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Listed {
    /// What it is.
    pub kind: Kind,
    /// What `type = "..."` says.
    pub name: String,
    /// One line; empty for one that says nothing without a configuration.
    pub about: String,
    /// The library it comes from; `None` for a built-in.
    pub library: Option<PathBuf>,
}

/// Everything that a configuration can name: the built-ins that are linked, and the libraries loaded.
#[derive(Debug, Default)]
pub struct Registry {
    libraries: Vec<Library>,
}

impl Registry {
    /// Built-ins only.
    pub fn new() -> Self {
        Self::default()
    }

    /// Built-ins and the libraries of a configuration that lies in folder `base`.
    ///
    /// # Errors
    /// [`PluginError`] of the first library that cannot be had.
    pub fn load(base: &Path, entries: &[PluginEntry]) -> Result<Self, PluginError> {
        let mut registry = Self::new();
        for entry in entries {
            registry.add(Library::load(base, entry)?)?;
        }
        Ok(registry)
    }

    /// Takes a library in.
    ///
    /// # Errors
    /// [`PluginError::Taken`] if a name is that of a built-in or of another library: a configuration must mean one thing.
    pub fn add(&mut self, library: Library) -> Result<(), PluginError> {
        let known = self.list();
        for new in loaded(&library) {
            if let Some(taken) = known.iter().find(|old| old.kind == new.kind && old.name == new.name) {
                let by = taken.library.as_ref().map_or_else(|| "a built-in".to_owned(), |path| path.display().to_string());
                return Err(PluginError::Taken { path: library.path().to_owned(), kind: new.kind.word(), name: new.name, by });
            }
        }
        self.libraries.push(library);
        Ok(())
    }

    /// The libraries loaded.
    pub fn libraries(&self) -> &[Library] {
        &self.libraries
    }

    /// All robots, models and effects: built-in ones by name, then each library's in its own order.
    pub fn list(&self) -> Vec<Listed> {
        let mut list = built_ins::<Box<dyn RobotConfig>>(Kind::Robot, |robot| robot.about());
        list.extend(built_ins::<Box<dyn ModelConfig>>(Kind::Model, |model| model.about()));
        list.extend(built_ins::<Box<dyn Effect>>(Kind::Effect, |effect| effect.about()));
        list.extend(self.libraries.iter().flat_map(loaded));
        list
    }

    /// The robot of a `[robot]` table.
    ///
    /// # Errors
    /// [`ConfigError`] with the key inside the table; for an unknown `type` it lists all names and the nearest.
    pub fn robot(&self, table: Table) -> Result<Box<dyn RobotConfig>, ConfigError> {
        let Some(own) = self.libraries.iter().flat_map(|l| &l.robots).find(|r| is_type(&table, r.offer.name)) else {
            return self.built_in(Kind::Robot, table);
        };
        own.offer.accept(Kind::Robot.word(), &table)?;
        Ok(Box::new(LoadedRobot { own: own.clone(), table }))
    }

    /// The model of a `[model]` table.
    ///
    /// # Errors
    /// As [`robot`](Self::robot).
    pub fn model(&self, table: Table) -> Result<Box<dyn ModelConfig>, ConfigError> {
        let Some(own) = self.libraries.iter().flat_map(|l| &l.models).find(|m| is_type(&table, m.offer.name)) else {
            return self.built_in(Kind::Model, table);
        };
        own.offer.accept(Kind::Model.word(), &table)?;
        Ok(Box::new(LoadedModel { own: own.clone(), table }))
    }

    /// The effect of an `[[effect]]` table.
    ///
    /// # Errors
    /// As [`robot`](Self::robot).
    pub fn effect(&self, table: Table) -> Result<Box<dyn Effect>, ConfigError> {
        let Some(own) = self.libraries.iter().flat_map(|l| &l.effects).find(|e| is_type(&table, e.offer.name)) else {
            return self.built_in(Kind::Effect, table);
        };
        own.offer.accept(Kind::Effect.word(), &table)?;
        let who = format!("plugin effect `{}`", own.offer.name);
        Ok(Box::new(effect::open(own, table).map_err(|failure| failure.into_config_error(&who))?))
    }

    /// A built-in, or the error that names everything there is.
    fn built_in<T: DeserializeOwned>(&self, kind: Kind, table: Table) -> Result<T, ConfigError> {
        let mut known = config::names::<T>();
        if let Some(Value::String(name)) = table.get("type")
            && !known.contains(name)
        {
            known.extend(self.libraries.iter().flat_map(loaded).filter(|l| l.kind == kind).map(|l| l.name));
            return Err(ConfigError::new("type", config::unknown_name(name, &known)));
        }
        config::tagged(table)
    }
}

pub(crate) fn is_type(table: &Table, name: &str) -> bool {
    table.get("type").and_then(Value::as_str) == Some(name)
}

fn built_ins<T: DeserializeOwned>(kind: Kind, about: impl Fn(&T) -> String) -> Vec<Listed> {
    let line = |name: String| Listed { kind, about: alone::about(&name, &about), name, library: None };
    config::names::<T>().into_iter().map(line).collect()
}

fn loaded(library: &Library) -> Vec<Listed> {
    let line = |kind, offer: &Offer| Listed {
        kind,
        name: offer.name.to_owned(),
        about: offer.about.clone(),
        library: Some(library.path().to_owned()),
    };
    let robots = library.robots.iter().map(|r| line(Kind::Robot, &r.offer));
    let models = library.models.iter().map(|m| line(Kind::Model, &m.offer));
    robots.chain(models).chain(library.effects.iter().map(|e| line(Kind::Effect, &e.offer))).collect()
}

/// The settings of a table, as typetag would write those of a built-in: its name goes around them.
pub(crate) fn settings<S: Serializer>(table: &Table, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(table.iter().filter(|(key, _)| *key != "type"))
}

/// A table that names a library's robot.
#[derive(Debug)]
struct LoadedRobot {
    own: RobotTable,
    table: Table,
}

impl Serialize for LoadedRobot {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        settings(&self.table, serializer)
    }
}

// Not by `#[typetag::serde]`, which would register one name at compile time; what it adds to an implementation is its two
// hidden methods.
impl RobotConfig for LoadedRobot {
    fn about(&self) -> String {
        self.own.offer.about.clone()
    }

    fn connect(&self, seed: u64) -> Result<Box<dyn Robot>, RobotError> {
        Ok(Box::new(robot::connect(&self.own, c_config(&self.table), seed)?))
    }

    fn typetag_name(&self) -> &'static str {
        self.own.offer.name
    }

    fn typetag_deserialize(&self) {}
}

/// A table that names a library's model.
#[derive(Debug)]
struct LoadedModel {
    own: ModelTable,
    table: Table,
}

impl Serialize for LoadedModel {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        settings(&self.table, serializer)
    }
}

impl ModelConfig for LoadedModel {
    fn about(&self) -> String {
        self.own.offer.about.clone()
    }

    fn build(&self) -> Result<Box<dyn RegressorModel>, ModelError> {
        Ok(Box::new(model::build(&self.own, c_config(&self.table))?))
    }

    fn typetag_name(&self) -> &'static str {
        self.own.offer.name
    }

    fn typetag_deserialize(&self) {}
}
