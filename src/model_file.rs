//! `model.toml`: an identified model as a file that other commands read.
//!
//! ```toml
//! schema = "wheelwright.model/1"
//! [robot]                 # the profile it was identified with, if one was given
//! [model]
//! type = "vw-pd"
//! [[parameter]]
//! name = "theta1"
//! value = 0.2604
//! std = 0.0003
//! ci95 = [0.2598, 0.2610]
//! unit = "s"
//! ```

use std::path::Path;

use serde::{Deserialize, Serialize};
use toml::Table;
use wheelwright_core::config::{self, ConfigError};
use wheelwright_core::identification::Identification;
use wheelwright_core::model::RegressorModel;
use wheelwright_core::profile::RobotProfile;

use crate::error::Error;
use crate::toml_file::TomlFile;

const SCHEMA: &str = "wheelwright.model/1";

/// The content of a `model.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelFile {
    /// Version of this form.
    pub schema: String,
    /// The robot's profile.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot: Option<RobotProfile>,
    /// The model's configuration.
    pub model: Table,
    /// Its parameters.
    pub parameter: Vec<ParameterValue>,
}

/// A parameter's value with what is known about it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ParameterValue {
    /// Name.
    pub name: String,
    /// Value in SI.
    pub value: f64,
    /// Standard error.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub std: Option<f64>,
    /// 95 % confidence interval.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ci95: Option<(f64, f64)>,
    /// Unit.
    #[serde(default)]
    pub unit: String,
}

impl ModelFile {
    /// The file of an identification.
    pub fn new(model: &Table, robot: Option<RobotProfile>, found: &Identification) -> Self {
        let parameter = found.estimates.iter().map(|e| ParameterValue {
            name: e.parameter.name.clone(),
            value: e.value,
            std: e.std,
            ci95: e.ci95,
            unit: e.parameter.unit.clone(),
        });
        Self { schema: SCHEMA.to_owned(), robot, model: model.clone(), parameter: parameter.collect() }
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`Error::Io`], or [`Error::Config`] naming the key.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let source = TomlFile::read(path)?;
        let file: Self = config::plain(source.table()?).map_err(|e| source.error(e))?;
        if file.schema != SCHEMA {
            return Err(source.error(ConfigError::new("schema", format!("is \"{}\"; this program reads \"{SCHEMA}\"", file.schema))));
        }
        Ok(file)
    }

    /// Parameter values in the order of a model's parameters.
    ///
    /// # Errors
    /// [`ConfigError`] naming a parameter that is missing or unknown.
    pub fn theta(&self, model: &dyn RegressorModel) -> Result<Vec<f64>, ConfigError> {
        let known: Vec<&str> = model.parameters().iter().map(|p| p.name.as_str()).collect();
        if let Some(stray) = self.parameter.iter().find(|p| !known.contains(&p.name.as_str())) {
            return Err(ConfigError::new(
                "parameter",
                format!("model `{}` has no parameter `{}`: it has {}", model.name(), stray.name, known.join(", ")),
            ));
        }
        let value = |name: &&str| {
            let found = self.parameter.iter().find(|p| p.name == **name).map(|p| p.value);
            found.ok_or_else(|| ConfigError::new("parameter", format!("`{name}` of model `{}` has no value", model.name())))
        };
        known.iter().map(value).collect()
    }

    /// The file's text.
    pub fn to_toml(&self) -> String {
        // A struct of plain values and string-keyed tables always has a TOML form.
        toml::to_string(self).unwrap_or_default()
    }
}
