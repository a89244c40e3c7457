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
        let error = nested(&with_suggestion(e.message()));
        if path == "." { error } else { error.inside(&path) }
    })
}

/// A plugin that reads a table of its own tells serde its [`ConfigError`] as text; here it becomes one again.
fn nested(message: &str) -> ConfigError {
    match message.strip_prefix('`').and_then(|rest| rest.split_once("`: ")) {
        Some((path, message)) if !path.contains(char::is_whitespace) => ConfigError::new(path, message),
        _ => ConfigError::new("", message),
    }
}

/// Deserializes a table with a `type` key into the plugin of that name, as `tagged::<Box<dyn RobotConfig>>(table)`.
///
/// # Errors
/// [`ConfigError`]; for an unknown name it lists the known ones and the nearest.
pub fn tagged<T: DeserializeOwned>(mut table: Table) -> Result<T, ConfigError> {
    let known = names::<T>();
    let name = take_type(&mut table).map_err(|e| ConfigError { message: format!("{}. Known: {}", e.message, known.join(", ")), ..e })?;
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
        Some(other) => Err(ConfigError::new("type", format!("must be a text that names a plugin, not {other}"))),
        None => Err(ConfigError::new("type", "is missing: it names the plugin, as in type = \"NAME\"")),
    }
}

/// The message for a name nobody registered.
pub fn unknown_name(name: &str, known: &[String]) -> String {
    let suggestion = match nearest(name, known.iter().map(String::as_str)) {
        Some(nearest) => format!("; did you mean \"{nearest}\"?"),
        None => ".".to_owned(),
    };
    format!("nothing is named \"{name}\"{suggestion} Known: {}", known.join(", "))
}

/// The known word nearest to a mistyped one, if any is near enough to be meant.
pub fn nearest<'a>(word: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    known
        .map(|k| (strsim::jaro_winkler(word, k), k))
        .filter(|(similarity, _)| *similarity > 0.75)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, k)| k)
}

/// serde lists the fields or variants it expected after an unknown one; the nearest of them is what a user wants to read
/// first.
fn with_suggestion(message: &str) -> String {
    // toml appends, line by line, the keys it came through as far as it knows them; the path says that and more.
    let message = message.lines().next().unwrap_or_default();
    let rest = message.strip_prefix("unknown field `").or_else(|| message.strip_prefix("unknown variant `"));
    let Some((unknown, expected)) = rest.and_then(|r| r.split_once('`')) else { return message.to_owned() };
    let known = expected.split('`').skip(1).step_by(2);
    match nearest(unknown, known) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use serde::{Deserialize, Serialize};

    #[typetag::serde]
    trait Gadget {
        fn size(&self) -> f64;
    }

    #[derive(Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Lever {
        length: f64,
        #[serde(default)]
        joints: Vec<Joint>,
    }

    #[derive(Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Joint {
        friction: f64,
    }

    #[derive(Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Wheel {}

    #[typetag::serde(name = "lever")]
    impl Gadget for Lever {
        fn size(&self) -> f64 {
            self.length + self.joints.iter().map(|j| j.friction).sum::<f64>()
        }
    }

    #[typetag::serde(name = "wheel")]
    impl Gadget for Wheel {
        fn size(&self) -> f64 {
            0.0
        }
    }

    fn gadget(text: &str) -> Result<Box<dyn Gadget>, String> {
        tagged(toml::from_str(text).unwrap()).map_err(|e| e.to_string())
    }

    fn refused(text: &str) -> String {
        gadget(text).err().expect("must be refused")
    }

    #[test]
    fn registered_names_are_listed_in_order() {
        assert_eq!(names::<Box<dyn Gadget>>(), ["lever", "wheel"]);
    }

    #[test]
    fn a_tagged_table_becomes_its_plugin() {
        let lever = gadget("type = 'lever'\nlength = 2\njoints = [{ friction = 0.5 }, { friction = 1 }]").unwrap();
        assert_eq!(lever.size(), 3.5);
        assert_eq!(gadget("type = 'wheel'").unwrap().size(), 0.0);
    }

    #[test]
    fn the_type_is_asked_for() {
        assert_eq!(refused("length = 1.0"), "`type`: is missing: it names the plugin, as in type = \"NAME\". Known: lever, wheel");
        assert_eq!(refused("type = 3"), "`type`: must be a text that names a plugin, not 3. Known: lever, wheel");
        assert_eq!(refused("type = 'whel'"), "`type`: nothing is named \"whel\"; did you mean \"wheel\"? Known: lever, wheel");
        assert_eq!(refused("type = 'zzz'"), "`type`: nothing is named \"zzz\". Known: lever, wheel");
        assert_eq!(refused("type = ''"), "`type`: nothing is named \"\". Known: lever, wheel");
    }

    #[test]
    fn errors_keep_the_path_inside_the_table() {
        assert_eq!(
            refused("type = 'lever'\nlength = 1.0\njoints = [{ friction = 1.0 }, { frictin = 2.0 }]"),
            "`joints[1].frictin`: unknown field `frictin`, expected `friction`; did you mean `friction`?"
        );
        assert_eq!(refused("type = 'lever'\nlength = 'long'"), "`length`: invalid type: string \"long\", expected f64");
        assert_eq!(refused("type = 'lever'"), "missing field `length`");
        assert_eq!(refused("type = 'lever'\nlength = 1.0\njoints = [{}]"), "`joints[0]`: missing field `friction`");
        assert_eq!(refused("type = 'wheel'\nradius = 1.0"), "`radius`: unknown field `radius`, there are no fields");
    }

    #[test]
    fn plain_tables_refuse_unknown_keys_with_the_nearest() {
        let table = toml::from_str("length = 1.0\njoint = []").unwrap();
        let error = plain::<Lever>(table).err().unwrap();
        assert_eq!(error.path, "joint");
        assert_eq!(error.message, "unknown field `joint`, expected `length` or `joints`; did you mean `joints`?");
        assert_eq!(error.clone().inside("robot").inside("run").path, "run.robot.joint");
        assert_eq!(ConfigError::new("", "is empty").inside("robot").to_string(), "`robot`: is empty");
    }

    #[test]
    fn only_a_near_word_is_suggested() {
        let known = ["theta1", "theta2", "drag"];
        assert_eq!(nearest("thet1", known.into_iter()), Some("theta1"));
        assert_eq!(nearest("darg", known.into_iter()), Some("drag"));
        assert_eq!(nearest("x", known.into_iter()), None);
        assert_eq!(nearest("x", std::iter::empty()), None);
    }
}
