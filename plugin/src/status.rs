//! Errors as status and message, and back: what a robot or a model says on one side is said on the other.

use wheelwright_core::config::ConfigError;
use wheelwright_core::model::ModelError;
use wheelwright_core::robot::RobotError;

use crate::abi::{self, Status};

/// A status that is not [`abi::OK`], with its message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Failure {
    pub(crate) status: Status,
    pub(crate) text: String,
}

impl Failure {
    pub(crate) fn new(status: Status, text: impl Into<String>) -> Self {
        Self { status, text: text.into() }
    }

    /// The message, or what stands for an empty one.
    fn said(&self) -> String {
        match (self.status, self.text.is_empty()) {
            (abi::CONFIG..=abi::SINGULAR, false) => self.text.clone(),
            (abi::CONFIG..=abi::SINGULAR, true) => format!("status {} without a message", self.status),
            _ => format!("unknown status {} ({})", self.status, self.text),
        }
    }

    /// Key and reason of a configuration message: `` `key`: reason ``.
    fn key_and_reason(&self) -> (String, String) {
        let said = self.said();
        let split = said.strip_prefix('`').and_then(|rest| rest.split_once("`: "));
        split.map(|(key, reason)| (key.to_owned(), reason.to_owned())).unwrap_or((String::new(), said))
    }

    /// As a robot's error. `who` names robot and library, `limit_s` is the limit of the call.
    pub(crate) fn into_robot_error(self, who: &str, limit_s: f64) -> RobotError {
        let said = format!("{who}: {}", self.said());
        match self.status {
            abi::CONFIG => {
                let (key, reason) = self.key_and_reason();
                let key = if key.is_empty() { "type".to_owned() } else { key };
                RobotError::Config { key, reason: format!("{reason} ({who})") }
            }
            abi::CONNECTION => RobotError::Connection(said),
            abi::TIMEOUT => {
                let own = self.text.split_once(" s: ").and_then(|(limit, what)| Some((limit.parse().ok()?, what)));
                match own {
                    Some((limit_s, what)) => RobotError::Timeout { limit_s, what: format!("{who}: {what}") },
                    None => RobotError::Timeout { limit_s, what: said },
                }
            }
            abi::FAULT => RobotError::Fault(said),
            _ => RobotError::Driver(said),
        }
    }

    /// As a model's error.
    pub(crate) fn into_model_error(self, model: &str) -> ModelError {
        match self.status {
            abi::CONFIG => {
                let (key, reason) = self.key_and_reason();
                ModelError::Config { key: if key.is_empty() { "type".to_owned() } else { key }, reason }
            }
            abi::SINGULAR => ModelError::Singular { model: model.to_owned() },
            _ => ModelError::Plugin { model: model.to_owned(), reason: self.said() },
        }
    }

    /// As what a check of a configuration found.
    pub(crate) fn into_config_error(self, who: &str) -> ConfigError {
        match self.status {
            abi::CONFIG => {
                let (key, reason) = self.key_and_reason();
                ConfigError::new(key, reason)
            }
            _ => ConfigError::new("type", format!("{who} failed while it checked this table: {}", self.said())),
        }
    }
}

impl From<RobotError> for Failure {
    fn from(error: RobotError) -> Self {
        match error {
            RobotError::Config { key, reason } => Self::new(abi::CONFIG, format!("`{key}`: {reason}")),
            RobotError::Connection(what) => Self::new(abi::CONNECTION, what),
            RobotError::Timeout { limit_s, what } => Self::new(abi::TIMEOUT, format!("{limit_s} s: {what}")),
            RobotError::Fault(what) => Self::new(abi::FAULT, what),
            RobotError::Driver(what) => Self::new(abi::DRIVER, what),
            other => Self::new(abi::DRIVER, other.to_string()),
        }
    }
}

impl From<ModelError> for Failure {
    fn from(error: ModelError) -> Self {
        match error {
            ModelError::Config { key, reason } => Self::new(abi::CONFIG, format!("`{key}`: {reason}")),
            ModelError::Singular { .. } | ModelError::Overflow { .. } => Self::new(abi::SINGULAR, error.to_string()),
            ModelError::Plugin { reason, .. } => Self::new(abi::DRIVER, reason),
            other => Self::new(abi::DRIVER, other.to_string()),
        }
    }
}

impl From<ConfigError> for Failure {
    fn from(error: ConfigError) -> Self {
        Self::new(abi::CONFIG, error.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn back(error: RobotError) -> RobotError {
        Failure::from(error).into_robot_error("robot `r`", 9.0)
    }

    #[test]
    fn robot_errors_keep_class_key_and_limit_across_the_boundary() {
        let config = RobotError::Config { key: "tau".into(), reason: "must be positive, not -1".into() };
        assert_eq!(back(config).to_string(), "`tau`: must be positive, not -1 (robot `r`)");
        assert_eq!(back(RobotError::Connection("no port".into())), RobotError::Connection("robot `r`: no port".into()));
        let timeout = RobotError::Timeout { limit_s: 0.5, what: "odometry".into() };
        assert_eq!(back(timeout), RobotError::Timeout { limit_s: 0.5, what: "robot `r`: odometry".into() });
        assert_eq!(back(RobotError::Fault("bumper".into())), RobotError::Fault("robot `r`: bumper".into()));
        assert_eq!(back(RobotError::Driver("bug".into())), RobotError::Driver("robot `r`: bug".into()));
    }

    #[test]
    fn statuses_without_a_message_and_unknown_ones_are_said() {
        let silent = Failure::new(abi::FAULT, "").into_robot_error("robot `r`", 1.0);
        assert_eq!(silent, RobotError::Fault("robot `r`: status 4 without a message".into()));
        let unknown = Failure::new(77, "x").into_robot_error("robot `r`", 1.0);
        assert_eq!(unknown, RobotError::Driver("robot `r`: unknown status 77 (x)".into()));
        let late = Failure::new(abi::TIMEOUT, "no answer").into_robot_error("robot `r`", 2.0);
        assert_eq!(late, RobotError::Timeout { limit_s: 2.0, what: "robot `r`: no answer".into() });
    }

    #[test]
    fn model_and_config_errors_keep_their_key() {
        let model = ModelError::Config { key: "order".into(), reason: "must be 1 or 2".into() };
        assert_eq!(Failure::from(model.clone()).into_model_error("m"), model);
        let config = ConfigError::new("limits.v", "must be a number");
        assert_eq!(Failure::from(config.clone()).into_config_error("robot `r`"), config);
        let singular = ModelError::Singular { model: "m".into() };
        assert_eq!(Failure::from(singular.clone()).into_model_error("m"), singular);
    }
}
