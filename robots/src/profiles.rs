//! Profiles of real robots that ship with the program.

use wheelwright_core::config::ConfigError;
use wheelwright_core::profile::RobotProfile;

/// Built-in profiles: name and the text of `robot.toml`, with the sources in its comments.
pub const BUILT_IN: [(&str, &str); 10] = [
    ("pioneer-3dx", include_str!("../profiles/pioneer-3dx.toml")),
    ("khepera-3", include_str!("../profiles/khepera-3.toml")),
    ("khepera-4", include_str!("../profiles/khepera-4.toml")),
    ("turtlebot3-burger", include_str!("../profiles/turtlebot3-burger.toml")),
    ("turtlebot3-waffle-pi", include_str!("../profiles/turtlebot3-waffle-pi.toml")),
    ("turtlebot-4", include_str!("../profiles/turtlebot-4.toml")),
    ("create-2", include_str!("../profiles/create-2.toml")),
    ("create-3", include_str!("../profiles/create-3.toml")),
    ("husky-a200", include_str!("../profiles/husky-a200.toml")),
    ("warthog", include_str!("../profiles/warthog.toml")),
];

/// The built-in profile of that name.
///
/// # Errors
/// [`ConfigError`] listing the names there are.
pub fn built_in(name: &str) -> Result<RobotProfile, ConfigError> {
    let known = || BUILT_IN.iter().map(|(name, _)| (*name).to_owned()).collect::<Vec<_>>();
    let (_, text) = BUILT_IN
        .iter()
        .find(|(n, _)| *n == name)
        .ok_or_else(|| ConfigError::new("", wheelwright_core::config::unknown_name(name, &known())))?;
    RobotProfile::from_table(text.parse().map_err(|e: toml::de::Error| ConfigError::new("", e.message()))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_profile_is_valid_and_bears_its_name() {
        for (name, _) in BUILT_IN {
            assert_eq!(built_in(name).unwrap().name, name);
        }
    }

    #[test]
    fn an_unknown_profile_is_answered_with_the_nearest() {
        let message = built_in("pioneer-3d").unwrap_err().to_string();
        assert!(message.contains("did you mean \"pioneer-3dx\"?") && message.contains("khepera-3"), "{message}");
    }
}
