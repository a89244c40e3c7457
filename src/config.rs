//! The configuration of a run: one TOML file, every plugin's table under its own heading.
//!
//! ```toml
//! seed = 1
//! [[plugin]]                            # a shared library, relative to this file
//! path = "libmy_robot.so"
//! [robot]                               # or [recording]
//! type = "simulator"
//! [excitation]
//! type = "thesis-pioneer"
//! [model]
//! type = "vw-pd"
//! [solver]
//! type = "output-error"
//! [validation]
//! holdout = 0.3
//! [output]
//! directory = "out"
//! ```

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use toml::{Table, Value};
use wheelwright_core::config::{self as core_config, ConfigError};
use wheelwright_core::recording::{ColumnMap, ReadOptions};
use wheelwright_plugin::PluginEntry;

use crate::autonomous::WantedSection;
use crate::control::{MigrateSection, SimulationSection, SourceSection, TrackSection};
use crate::design::DesignSection;
use crate::error::Error;
use crate::record::RecordSection;
use crate::safety::LimitsSection;
use crate::toml_file::TomlFile;

/// A configuration as read, with what is needed to point at its lines.
#[derive(Debug, Clone, Default)]
pub struct Config {
    /// The sections.
    pub sections: Sections,
    file: TomlFile,
}

/// Top level of a configuration file. Plugin tables stay tables until their plugin reads them.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sections {
    /// Seed of whatever is random.
    pub seed: Option<u64>,
    /// Shared libraries to load, relative to the file.
    #[serde(default)]
    pub plugin: Vec<PluginEntry>,
    /// The robot to excite.
    pub robot: Option<Table>,
    /// The protocol to serve with the robot behind it.
    pub emulator: Option<Table>,
    /// The command to drive.
    pub excitation: Option<Table>,
    /// Recordings to read instead of driving.
    #[serde(default)]
    pub recording: RecordingSection,
    /// The model.
    pub model: Option<Table>,
    /// The solver.
    pub solver: Option<Table>,
    /// What is known about parameters beforehand, by name.
    #[serde(default)]
    pub parameters: BTreeMap<String, Constraint>,
    /// What is held out.
    #[serde(default)]
    pub validation: ValidationSection,
    /// The trajectory to follow.
    pub trajectory: Option<Table>,
    /// The controller that follows it.
    pub controller: Option<Table>,
    /// How it is followed.
    #[serde(default)]
    pub track: TrackSection,
    /// A simulation in place of a robot.
    pub simulation: Option<SimulationSection>,
    /// The robot that a controller was tuned on.
    pub source: Option<SourceSection>,
    /// How it is carried over.
    #[serde(default)]
    pub migrate: MigrateSection,
    /// Where results go.
    #[serde(default)]
    pub output: OutputSection,
    /// What a drive keeps within.
    #[serde(default)]
    pub limits: LimitsSection,
    /// How a robot is recorded.
    #[serde(default)]
    pub record: RecordSection,
    /// When an unattended identification is good enough.
    pub autonomous: Option<WantedSection>,
    /// What a designed excitation is to reach.
    pub design: Option<DesignSection>,
}

/// `[parameters.NAME]`: fixed, tied to another parameter, or bounded.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Constraint {
    /// Value it has.
    pub fixed: Option<f64>,
    /// Parameter it follows: θ = factor × θ(tied_to) + offset.
    pub tied_to: Option<String>,
    /// Factor of the tie.
    pub factor: Option<f64>,
    /// Offset of the tie.
    pub offset: Option<f64>,
    /// Lower bound.
    pub min: Option<f64>,
    /// Upper bound.
    pub max: Option<f64>,
}

/// `[recording]`
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordingSection {
    /// Files or bag folders, relative to the configuration.
    #[serde(default)]
    pub paths: Vec<PathBuf>,
    /// Columns by another name: `v = "twist_x"` or `v = { from = "speed", scale = 0.001 }`.
    #[serde(default)]
    pub columns: BTreeMap<String, ColumnSpec>,
    /// Topics by role: `cmd = "/robot/cmd_vel"`.
    #[serde(default)]
    pub topics: BTreeMap<String, String>,
}

/// A column's name in the file, with its conversion to SI if it needs one.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
pub enum ColumnSpec {
    /// Name only.
    Name(String),
    /// value = scale × file value + offset.
    Scaled(ScaledColumn),
}

/// A column with its conversion to SI.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScaledColumn {
    /// Name in the file.
    pub from: String,
    /// Factor to SI.
    #[serde(default = "one")]
    pub scale: f64,
    /// Offset in SI.
    #[serde(default)]
    pub offset: f64,
}

fn one() -> f64 {
    1.0
}

/// `[validation]`
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValidationSection {
    /// Share of the samples that no estimate sees.
    pub holdout: Option<f64>,
    /// Recordings of their own to validate on, relative to the configuration.
    #[serde(default)]
    pub recordings: Vec<PathBuf>,
}

/// `[output]`
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutputSection {
    /// Folder for the result files, relative to the configuration.
    pub directory: Option<PathBuf>,
}

impl Config {
    /// Reads a file (or nothing) and lays `--set KEY=VALUE` settings over it.
    ///
    /// # Errors
    /// [`Error::Io`], or [`Error::Config`] with line and column.
    pub fn load(file: Option<&Path>, settings: &[String]) -> Result<Self, Error> {
        let file = file.map(TomlFile::read).transpose()?.unwrap_or_default();
        let mut table = file.table()?;
        for setting in settings {
            lay_over(&mut table, parse_setting(setting)?);
        }
        let sections = core_config::plain(table).map_err(|e| file.error(e))?;
        Ok(Self { sections, file })
    }

    /// An error at a key of this file, with its line and column if the key stands in it.
    pub fn error(&self, error: ConfigError) -> Error {
        self.file.error(error)
    }

    /// Error inside a section.
    pub fn error_in(&self, section: &str, error: ConfigError) -> Error {
        self.error(error.inside(section))
    }

    /// A path given in this file, which is relative to it.
    pub fn resolve(&self, path: &Path) -> PathBuf {
        self.folder().join(path)
    }

    /// The folder of this file, empty for the current one.
    pub fn folder(&self) -> &Path {
        self.file.path().parent().unwrap_or(Path::new(""))
    }

    /// How readers are to see the recordings.
    pub fn read_options(&self) -> ReadOptions {
        let columns = self.sections.recording.columns.iter().map(|(name, spec)| match spec {
            ColumnSpec::Name(from) => ColumnMap { name: name.clone(), from: from.clone(), scale: 1.0, offset: 0.0 },
            ColumnSpec::Scaled(c) => ColumnMap { name: name.clone(), from: c.from.clone(), scale: c.scale, offset: c.offset },
        });
        let topics = self.sections.recording.topics.iter().map(|(role, topic)| (role.clone(), topic.clone()));
        ReadOptions { columns: columns.collect(), topics: topics.collect() }
    }
}

/// `solver.cutoff_hz=1` as nested tables. A value that is no TOML value is a text.
fn parse_setting(setting: &str) -> Result<Table, Error> {
    let wrong = || Error::Usage(format!("--set {setting}: expected KEY=VALUE, such as --set model.static_friction=true"));
    let (key, value) = setting.split_once('=').ok_or_else(wrong)?;
    let line = |value: &str| format!("{} = {value}", key.trim()).parse::<Table>();
    line(value).or_else(|_| line(&Value::String(value.trim().to_owned()).to_string())).map_err(|_| wrong())
}

/// Lays one table over another, table by table.
fn lay_over(base: &mut Table, over: Table) {
    for (key, value) in over {
        match (base.get_mut(&key), value) {
            (Some(Value::Table(below)), Value::Table(above)) => lay_over(below, above),
            (_, value) => {
                base.insert(key, value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_toml_values_or_texts() {
        let table = parse_setting("solver.cutoff_hz=1.5").unwrap();
        assert_eq!(table["solver"]["cutoff_hz"].as_float(), Some(1.5));
        assert_eq!(parse_setting("model.type=vw-pd").unwrap()["model"]["type"].as_str(), Some("vw-pd"));
        assert!(matches!(parse_setting("nonsense"), Err(Error::Usage(_))));
    }

    #[test]
    fn a_setting_keeps_its_neighbours() {
        let mut base: Table = "[solver]\ntype = \"ols\"\norder = 2".parse().unwrap();
        lay_over(&mut base, parse_setting("solver.order=4").unwrap());
        assert_eq!(base["solver"]["type"].as_str(), Some("ols"));
        assert_eq!(base["solver"]["order"].as_integer(), Some(4));
    }
}
