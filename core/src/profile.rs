//! A robot's profile: the facts about a robot that no recording tells, read from `robot.toml`.
//!
//! Dimensions are facts of the whole robot, so they stand here and not with a model or a driver; both read them.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use thiserror::Error;
use toml::Table;

use crate::config::{self, ConfigError};

/// Facts about one robot. Everything but the first four keys is optional.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotProfile {
    /// Name of the robot.
    pub name: String,
    /// Name of the model that its low-level controller calls for, such as `vw-pd`.
    pub model: String,
    /// Distance between the wheels' contact points \[m\].
    pub track_width: f64,
    /// Rolling radius of the driven wheels \[m\].
    pub wheel_radius: f64,
    /// Total mass \[kg\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mass: Option<f64>,
    /// What the robot can or may do.
    #[serde(default, skip_serializing_if = "Limits::is_empty")]
    pub limits: Limits,
    /// Parameters of `model` that are known for this robot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub theta: Option<KnownTheta>,
}

/// Limits of a robot; `None` where there is none or none is known. All are magnitudes.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// Forward speed \[m/s\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub v: Option<f64>,
    /// Angular speed \[rad/s\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub omega: Option<f64>,
    /// Change of the forward speed's set point \[m/s²\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub v_dot: Option<f64>,
    /// Change of the angular speed's set point \[rad/s²\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub omega_dot: Option<f64>,
    /// Speed of each wheel about its axle \[rad/s\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wheel_speed: Option<f64>,
}

impl Limits {
    /// True without any limit.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Every limit must be a positive number.
    ///
    /// # Errors
    /// [`ConfigError`] at the key, relative to the table of limits.
    pub fn check(&self) -> Result<(), ConfigError> {
        let named =
            [("v", self.v), ("omega", self.omega), ("v_dot", self.v_dot), ("omega_dot", self.omega_dot), ("wheel_speed", self.wheel_speed)];
        named.into_iter().try_for_each(|(key, value)| value.map_or(Ok(()), |value| positive(key, value)))
    }
}

/// Parameters known beforehand.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KnownTheta {
    /// Values in the order of the model's parameters.
    pub values: Vec<f64>,
    /// Where they come from.
    pub source: String,
}

/// Why a profile cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ProfileError {
    /// The file could not be read.
    #[error("{}: {error}", .path.display())]
    Io {
        /// File.
        path: PathBuf,
        /// What the operating system says.
        error: std::io::Error,
    },
    /// The file is not TOML.
    #[error("{}: {error}", .path.display())]
    Syntax {
        /// File.
        path: PathBuf,
        /// Line, column and what was expected.
        error: toml::de::Error,
    },
    /// A key is missing, unknown or impossible.
    #[error("{}: {error}", .path.display())]
    Key {
        /// File.
        path: PathBuf,
        /// The key and what to do.
        error: ConfigError,
    },
}

impl RobotProfile {
    /// Reads a profile from a table and checks it.
    ///
    /// # Errors
    /// [`ConfigError`] for an unknown, missing or impossible key.
    pub fn from_table(table: Table) -> Result<Self, ConfigError> {
        let profile: Self = config::plain(table)?;
        profile.check()?;
        Ok(profile)
    }

    /// Reads `robot.toml`.
    ///
    /// # Errors
    /// [`ProfileError`] with the path.
    pub fn load(path: &Path) -> Result<Self, ProfileError> {
        let text = std::fs::read_to_string(path).map_err(|error| ProfileError::Io { path: path.to_owned(), error })?;
        let table: Table = text.parse().map_err(|error| ProfileError::Syntax { path: path.to_owned(), error })?;
        Self::from_table(table).map_err(|error| ProfileError::Key { path: path.to_owned(), error })
    }

    /// Values must be possible: names not empty, lengths, mass and limits positive, theta finite.
    ///
    /// # Errors
    /// [`ConfigError`] at the first key that is not.
    pub fn check(&self) -> Result<(), ConfigError> {
        for (key, text) in [("name", &self.name), ("model", &self.model)] {
            if text.trim().is_empty() {
                return Err(ConfigError::new(key, "is empty"));
            }
        }
        positive("track_width", self.track_width)?;
        positive("wheel_radius", self.wheel_radius)?;
        self.mass.map_or(Ok(()), |mass| positive("mass", mass))?;
        self.limits.check().map_err(|e| e.inside("limits"))?;
        let Some(theta) = &self.theta else { return Ok(()) };
        match theta.values.iter().position(|value| !value.is_finite()) {
            Some(i) => Err(ConfigError::new("theta.values", format!("value {} is {}, not a finite number", i + 1, theta.values[i]))),
            None if theta.values.is_empty() => Err(ConfigError::new("theta.values", "is empty; leave [theta] out if nothing is known")),
            None => Ok(()),
        }
    }
}

fn positive(key: &str, value: f64) -> Result<(), ConfigError> {
    if value.is_finite() && value > 0.0 { Ok(()) } else { Err(ConfigError::new(key, format!("must be a positive number, not {value}"))) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONTRACT: &str = r#"
        name = "pioneer-3dx"
        model = "vw-pd"
        track_width = 0.34
        wheel_radius = 0.0975
        mass = 9.0
        [limits]
        v = 1.4
        wheel_speed = 15.0
        [theta]
        values = [0.2183, 0.1918, -0.0050, 0.9993, -0.0279, 1.0142]
        source = "Laut 2011, section 4.4.2"
    "#;

    fn parse(text: &str) -> Result<RobotProfile, ConfigError> {
        RobotProfile::from_table(text.parse().unwrap())
    }

    #[test]
    fn a_profile_is_read_and_written_back() {
        let profile = parse(CONTRACT).unwrap();
        assert_eq!(profile.limits.wheel_speed, Some(15.0));
        assert_eq!(profile.limits.omega, None);
        assert_eq!(profile.theta.as_ref().unwrap().values.len(), 6);
        assert_eq!(parse(&toml::to_string(&profile).unwrap()).unwrap(), profile);
    }

    #[test]
    fn four_keys_are_enough() {
        let profile = parse("name = 'a'\nmodel = 'wheel-pd'\ntrack_width = 0.1\nwheel_radius = 0.02").unwrap();
        assert!(profile.limits.is_empty() && profile.mass.is_none() && profile.theta.is_none());
        assert!(!toml::to_string(&profile).unwrap().contains("limits"));
    }

    #[test]
    fn impossible_values_name_their_key() {
        let cases = [
            ("track_width = 0.34", "track_width = -0.34", "`track_width`: must be a positive number, not -0.34"),
            ("wheel_radius = 0.0975", "wheel_radius = 0", "`wheel_radius`: must be a positive number, not 0"),
            ("mass = 9.0", "mass = nan", "`mass`: must be a positive number, not NaN"),
            ("v = 1.4", "v = -1.4", "`limits.v`: must be a positive number, not -1.4"),
            ("v = 1.4", "vmax = 1.4", "`limits"),
            ("0.2183,", "inf,", "`theta.values`: value 1 is inf, not a finite number"),
            ("name = \"pioneer-3dx\"", "name = ''", "`name`: is empty"),
            ("model = \"vw-pd\"", "", "missing field `model`"),
            ("mass = 9.0", "mas = 9.0", "did you mean `mass`?"),
        ];
        for (from, to, expected) in cases {
            let message = parse(&CONTRACT.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(message.contains(expected), "{to}: {message}");
        }
    }

    #[test]
    fn a_missing_file_and_bad_syntax_carry_the_path() {
        let missing = RobotProfile::load(Path::new("no-such/robot.toml")).unwrap_err();
        assert!(matches!(missing, ProfileError::Io { .. }) && missing.to_string().starts_with("no-such/robot.toml"), "{missing}");
    }
}
