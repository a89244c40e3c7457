//! `[limits]`: what a drive keeps within, from the robot's profile and the configuration.

use std::path::Path;

use serde::Deserialize;
use wheelwright_core::config::ConfigError;
use wheelwright_core::drive::{Floor, Safety, Wheels};
use wheelwright_core::profile::{Limits, RobotProfile};
use wheelwright_robots::profiles;

/// `[limits]`. Every key is optional; a key stands before the same one of the profile.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LimitsSection {
    /// A robot's profile whose limits hold: the name of a built-in one, or a file relative to the configuration.
    pub profile: Option<String>,
    /// Forward speed \[m/s\].
    pub v: Option<f64>,
    /// Angular speed \[rad/s\].
    pub omega: Option<f64>,
    /// Change of the forward speed \[m/s²\].
    pub v_dot: Option<f64>,
    /// Change of the angular speed \[rad/s²\].
    pub omega_dot: Option<f64>,
    /// Speed of each wheel about its axle \[rad/s\].
    pub wheel_speed: Option<f64>,
    /// Distance between the wheels' contact points \[m\], for `wheel_speed`.
    pub track_width: Option<f64>,
    /// Rolling radius \[m\], for `wheel_speed`.
    pub wheel_radius: Option<f64>,
    /// Longest drive \[s\].
    pub time: Option<f64>,
    /// The floor there is, about the pose at the start.
    pub floor: Option<Floor>,
    /// Time \[s\] that measurements may stay the same although motion is commanded.
    pub frozen: Option<f64>,
    /// Longest time \[s\] from a measurement to the command that answers it.
    pub deadline: Option<f64>,
}

impl LimitsSection {
    /// The limits of a drive; `given` is a profile from the command line, which stands before the section's own.
    /// `folder` is where a profile's file is looked for.
    ///
    /// # Errors
    /// [`ConfigError`] at the key, relative to the section.
    pub fn safety(&self, given: Option<&RobotProfile>, folder: &Path) -> Result<Safety, ConfigError> {
        let named = match (&self.profile, given) {
            (Some(name), None) => Some(profile(name, folder).map_err(|e| ConfigError::new("profile", e.to_string()))?),
            _ => None,
        };
        let profile = given.or(named.as_ref());
        let known = profile.map(|p| p.limits).unwrap_or_default();
        let limits = Limits {
            v: self.v.or(known.v),
            omega: self.omega.or(known.omega),
            v_dot: self.v_dot.or(known.v_dot),
            omega_dot: self.omega_dot.or(known.omega_dot),
            wheel_speed: self.wheel_speed.or(known.wheel_speed),
        };
        limits.check()?;
        let track_width = self.track_width.or(profile.map(|p| p.track_width));
        let radius = self.wheel_radius.or(profile.map(|p| p.wheel_radius));
        let wheels = track_width.zip(radius).map(|(track_width, radius)| Wheels { track_width, radius });
        let named = [
            ("track_width", track_width),
            ("wheel_radius", radius),
            ("time", self.time),
            ("frozen", self.frozen),
            ("deadline", self.deadline),
        ];
        if let Some((key, Some(value))) = named.into_iter().find(|(_, value)| value.is_some_and(|v| v.is_nan() || v <= 0.0)) {
            return Err(ConfigError::new(key, format!("must be a positive number, not {value}")));
        }
        if let Some((key, reason)) = self.floor.and_then(|floor| floor.flaw()) {
            return Err(ConfigError::new(format!("floor.{key}"), reason));
        }
        let standard = Safety::default();
        Ok(Safety {
            limits,
            wheels,
            floor: self.floor,
            time: self.time,
            frozen: self.frozen.unwrap_or(standard.frozen),
            deadline: self.deadline,
        })
    }
}

/// A built-in profile by name, or one from a file.
fn profile(name: &str, folder: &Path) -> Result<RobotProfile, ConfigError> {
    if Path::new(name).extension().is_some_and(|e| e == "toml") {
        return RobotProfile::load(&folder.join(name)).map_err(|e| ConfigError::new("", e.to_string()));
    }
    profiles::built_in(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn section(text: &str) -> LimitsSection {
        wheelwright_core::config::plain(text.parse().unwrap()).unwrap()
    }

    #[test]
    fn a_key_stands_before_the_profile() {
        let safety = section("profile = 'pioneer-3dx'\nv = 0.5\ntime = 20").safety(None, Path::new("")).unwrap();
        assert_eq!((safety.limits.v, safety.limits.v_dot, safety.time), (Some(0.5), Some(0.3), Some(20.0)));
        assert_eq!(safety.wheels, Some(Wheels { track_width: 0.34, radius: 0.0975 }));
    }

    #[test]
    fn impossible_values_name_their_key() {
        for (text, expected) in [
            ("v = -1", "`v`: must be a positive number, not -1"),
            ("deadline = 0", "`deadline`: must be a positive number, not 0"),
            ("profile = 'pioneer-3d'", "did you mean \"pioneer-3dx\"?"),
            ("floor = { x = [1.0, 2.0], y = [-1.0, 1.0] }", "`floor.x`: goes from 1 to 2"),
        ] {
            let message = section(text).safety(None, Path::new("")).unwrap_err().to_string();
            assert!(message.contains(expected), "{text}: {message}");
        }
    }
}
