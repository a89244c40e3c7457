//! What the drivers of real robots share: a byte stream over TCP or a serial line, and how time passes on it.

mod link;
#[cfg(unix)]
pub(crate) mod serial;
mod tally;

use serde::{Deserialize, Serialize};
use wheelwright_core::profile::Limits;
use wheelwright_core::robot::RobotError;

pub(crate) use link::{Endpoint, Link};
pub(crate) use tally::Tally;

/// How time passes for a driver and for an emulator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Clock {
    /// As on the wall; for every real robot.
    #[default]
    Real,
    /// Only when the driver asks for it, by a command that no real robot knows: a drive through an emulator is then as
    /// fast as the machine and the same every time. Both ends must be set to it.
    Stepped,
}

/// Clamps a magnitude.
pub(crate) fn clamp(value: f64, limit: Option<f64>) -> f64 {
    limit.map_or(value, |limit| value.clamp(-limit, limit))
}

/// Limits of a configuration, checked.
pub(crate) fn check_limits(limits: &Limits) -> Result<(), RobotError> {
    limits.check().map_err(|e| e.inside("limits")).map_err(|e| config(&e.path, e.message))
}

/// A configuration error at a key.
pub(crate) fn config(key: &str, reason: impl Into<String>) -> RobotError {
    RobotError::Config { key: key.to_owned(), reason: reason.into() }
}

/// A time of a configuration must be positive and at most a minute.
pub(crate) fn check_time(key: &str, value: f64) -> Result<(), RobotError> {
    if value > 0.0 && value <= 60.0 {
        Ok(())
    } else {
        Err(config(key, format!("must be above 0 and at most 60 (it is in seconds), not {value}")))
    }
}

/// The two command values of a velocity-driven robot, finite.
pub(crate) fn velocity_command(command: &[f64]) -> Result<[f64; 2], RobotError> {
    let &[v, omega] = command else {
        return Err(RobotError::Driver(format!("{} command values for the channels v_ref, omega_ref", command.len())));
    };
    for (name, value) in [("v_ref", v), ("omega_ref", omega)] {
        if !value.is_finite() {
            return Err(RobotError::Fault(format!("command {name} is {value}, not a finite number; it was not sent")));
        }
    }
    Ok([v, omega])
}

/// Room for the measured values.
pub(crate) fn check_room(measured: &[f64], channels: usize) -> Result<(), RobotError> {
    if measured.len() == channels {
        return Ok(());
    }
    Err(RobotError::Driver(format!("room for {} measured values, there are {channels}", measured.len())))
}

/// Longest time that one step of a stepped clock may take \[s\].
const LONGEST_STEP: f64 = 60.0;

/// The argument of a step in microseconds, as the text protocols carry it.
pub(crate) fn seconds_of_step(argument: &str) -> Option<f64> {
    let microseconds: u32 = argument.trim_start_matches('l').parse().ok()?;
    Some(1e-6 * f64::from(microseconds)).filter(|s| *s <= LONGEST_STEP)
}
