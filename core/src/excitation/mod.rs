//! Excitations: the commands that make a robot show its dynamics.
//!
//! Built in are the four of Laut 2011 ([`thesis`]: `thesis-pioneer`, `thesis-khepera`, `thesis-constant`,
//! `thesis-multisine`), any sum of constants, steps, ramps and sines (`signals`, [`signals::Signals`]) and commands written out
//! row by row (`table`, [`table::CommandTable`]).

pub mod signals;
pub mod table;
pub mod thesis;

use std::fmt::Debug;

use thiserror::Error;

use crate::channel::Channel;

/// A planned command, a function of time only. Plain data, picked by `type = "NAME"`.
#[typetag::serde]
pub trait Excitation: Debug + Send + Sync {
    /// One line on what the excitation is, for `wheelwright plugins`.
    fn about(&self) -> String;

    /// Length \[s\]. Whoever drives the robot stops it then; the command itself need not end.
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

impl ExcitationError {
    /// An impossible setting.
    pub fn config(key: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Config { key: key.into(), reason: reason.into() }
    }
}

/// Refuses a duration that is not a positive number of seconds.
///
/// # Errors
/// [`ExcitationError::Config`] at `duration`.
pub fn check_duration(duration: f64) -> Result<(), ExcitationError> {
    if duration.is_finite() && duration > 0.0 {
        return Ok(());
    }
    Err(ExcitationError::config("duration", format!("must be a number of seconds above zero, not {duration}")))
}

/// Refuses a channel that is not among the robot's commands.
///
/// # Errors
/// [`ExcitationError::UnknownChannel`] listing what there is.
pub fn check_channel(channel: &str, inputs: &[Channel]) -> Result<(), ExcitationError> {
    if inputs.iter().any(|c| c.name == channel) {
        return Ok(());
    }
    let available = crate::recording::list(inputs.iter().map(|c| c.name.as_ref()));
    Err(ExcitationError::UnknownChannel { channel: channel.to_owned(), available })
}
