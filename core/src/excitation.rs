//! Excitations: the commands that make a robot show its dynamics.

use std::fmt::Debug;

use thiserror::Error;

use crate::channel::Channel;

/// A planned command, a function of time only. Plain data, picked by `type = "NAME"`.
#[typetag::serde]
pub trait Excitation: Debug + Send + Sync {
    /// One line on what the excitation is, for `wheelwright plugins`.
    fn about(&self) -> String;

    /// Length \[s\].
    fn duration(&self) -> f64;

    /// Checks the settings and that every channel they name is one of `inputs`.
    ///
    /// # Errors
    /// [`ExcitationError`].
    fn check(&self, inputs: &[Channel]) -> Result<(), ExcitationError>;

    /// Writes the command at time `t` \[s\] since the start, one value a channel of `inputs`; channels the excitation
    /// does not name are zero.
    fn command(&self, t: f64, inputs: &[Channel], command: &mut [f64]);
}

/// Why an excitation cannot be driven.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum ExcitationError {
    /// A setting is impossible.
    #[error("`{key}`: {reason}")]
    Config {
        /// Key inside the excitation's table.
        key: String,
        /// What is wrong and what to do.
        reason: String,
    },
    /// The robot has no such command.
    #[error("the robot has no command `{channel}`; it takes {available}")]
    UnknownChannel {
        /// Channel named by the excitation.
        channel: String,
        /// Channels of the robot.
        available: String,
    },
}
