//! Configurations: TOML tables in which `type = "NAME"` picks a plugin.
//!
//! typetag's own form of a tagged table is `{ NAME = { ... } }`; [`tagged`] rewrites one into the other, so that an error
//! keeps the key it belongs to, and a name nobody registered is answered with the names there are.

use std::fmt;

use serde::de::value::MapDeserializer;
use serde::de::{self, DeserializeOwned};
use thiserror::Error;
use toml::{Table, Value};

/// Why a table is not a configuration.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{}{message}", if .path.is_empty() { String::new() } else { format!("`{}`: ", .path) })]
pub struct ConfigError {
    /// Dotted path of the key, relative to the table given; empty for the table itself.
    pub path: String,
    /// What is wrong and what to do.
    pub message: String,
}

impl ConfigError {
    /// An error at a key.
    pub fn new(path: impl Into<String>, message: impl Into<String>) -> Self {
        Self { path: path.into(), message: message.into() }
    }

    /// The same error seen from a table one level up.
    #[must_use]
    pub fn inside(mut self, key: &str) -> Self {
        self.path = match self.path.as_str() {
            "" => key.to_owned(),
            path => format!("{key}.{path}"),
        };
        self
    }
}

/// Deserializes a plain table, refusing unknown keys with the nearest known one.
///
/// # Errors
/// [`ConfigError`] with the path of the key.
pub fn plain<T: DeserializeOwned>(table: Table) -> Result<T, ConfigError> {
    let mut track = serde_path_to_error::Track::new();
    let value = Value::Table(table);
    T::deserialize(serde_path_to_error::Deserializer::new(value, &mut track)).map_err(|e: toml::de::Error| {
        let path = track.path().to_string();
        ConfigError::new(if path == "." { String::new() } else { path }, with_suggestion(e.message()))
    })
}

/// Deserializes a table with a `type` key into the plugin of that name, as `tagged::<Box<dyn RobotConfig>>(table)`.
///
/// # Errors
/// [`ConfigError`]; for an unknown name it lists the known ones and the nearest.
pub fn tagged<T: DeserializeOwned>(mut table: Table) -> Result<T, ConfigError> {
    let name = take_type(&mut table)?;
    let known = names::<T>();
    if !known.contains(&name) {
        return Err(ConfigError::new("type", unknown_name(&name, &known)));
    }
    let mut outer = Table::new();
    outer.insert(name.clone(), Value::Table(table));
    plain(outer).map_err(|mut e: ConfigError| {
        e.path = e.path.strip_prefix(&name).map_or(e.path.clone(), |p| p.trim_start_matches('.').to_owned());
        e
    })
}

/// Removes and returns a table's `type`.
///
/// # Errors
/// [`ConfigError`] if it is absent or not a text.
pub fn take_type(table: &mut Table) -> Result<String, ConfigError> {
    match table.remove("type") {
        Some(Value::String(name)) => Ok(name),
        Some(other) => Err(ConfigError::new("type", format!("must be a text such as \"vw-pd\", not {other}"))),
        None => Err(ConfigError::new("type", "is missing: it names the plugin, as in type = \"vw-pd\"")),
    }
}

/// The message for a name nobody registered.
pub fn unknown_name(name: &str, known: &[String]) -> String {
    let nearest = nearest(name, known.iter().map(String::as_str)).map(|n| format!("; did you mean \"{n}\"?")).unwrap_or_default();
    format!("nothing is named \"{name}\"{nearest} Known: {}", known.join(", "))
}

/// The known word nearest to a mistyped one, if any is near enough to be meant.
pub fn nearest<'a>(word: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    known
        .map(|k| (strsim::jaro_winkler(word, k), k))
        .filter(|(similarity, _)| *similarity > 0.75)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, k)| k)
}

/// serde lists the fields it expected after an unknown one; the nearest of them is what a user wants to read first.
fn with_suggestion(message: &str) -> String {
    let Some(rest) = message.strip_prefix("unknown field `") else { return message.to_owned() };
    let Some((field, expected)) = rest.split_once('`') else { return message.to_owned() };
    let known = expected.split('`').skip(1).step_by(2);
    match nearest(field, known) {
        Some(meant) => format!("{message}; did you mean `{meant}`?"),
        None => message.to_owned(),
    }
}

/// Names registered for a typetag trait object, sorted: `names::<Box<dyn RobotConfig>>()`.
///
/// typetag keeps its registry to itself, but tells it to whoever asks for a name that does not exist.
pub fn names<T: DeserializeOwned>() -> Vec<String> {
    let probe = MapDeserializer::<_, Probe>::new(std::iter::once(("\u{0}", ())));
    match T::deserialize(probe) {
        Err(Probe(names)) => names,
        Ok(_) => Vec::new(),
    }
}

/// A deserialization error that keeps only the variant names of `unknown_variant`.
#[derive(Debug)]
struct Probe(Vec<String>);

impl fmt::Display for Probe {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0.join(", "))
    }
}

impl std::error::Error for Probe {}

impl de::Error for Probe {
    fn custom<M: fmt::Display>(_: M) -> Self {
        Self(Vec::new())
    }

    fn unknown_variant(_: &str, expected: &'static [&'static str]) -> Self {
        let mut names: Vec<String> = expected.iter().map(|&n| n.to_owned()).collect();
        names.sort_unstable();
        Self(names)
    }
}
