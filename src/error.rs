//! One error for whatever a command can meet, with the exit status it means.

use std::path::PathBuf;

use thiserror::Error;
use wheelwright_controllers::migration::MigrationError;
use wheelwright_core::config::ConfigError;
use wheelwright_core::controller::{Concern, ControlError, Gravity};
use wheelwright_core::drive::{DriveError, DriveFault};
use wheelwright_core::excitation::ExcitationError;
use wheelwright_core::identification::IdentifyError;
use wheelwright_core::model::ModelError;
use wheelwright_core::recording::{ReadError, RecordingError};
use wheelwright_core::robot::RobotError;
use wheelwright_core::solver::SolveError;
use wheelwright_core::tracking::TrackError;
use wheelwright_core::trajectory::TrajectoryError;
use wheelwright_diagnosis::DiagnosisError;
use wheelwright_plugin::PluginError;

/// What stopped a command.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// An argument is wrong.
    #[error("{0}")]
    Usage(String),
    /// A configuration file is wrong at a key.
    #[error("{}: {error}", place(.file, .position))]
    Config {
        /// The file; empty for settings given on the command line.
        file: PathBuf,
        /// Line and column from 1, if the key stands in the file.
        position: Option<(usize, usize)>,
        /// Key and reason.
        error: ConfigError,
    },
    /// A file could not be read or written.
    #[error("{}: {error}", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's reason.
        error: std::io::Error,
    },
    /// A recording was refused.
    #[error("{}: {error}", .path.display())]
    Recording {
        /// The file.
        path: PathBuf,
        /// Position and reason.
        error: ReadError,
    },
    /// A JSON document is not what it should be.
    #[error("{}: {message}", .path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// Place and reason.
        message: String,
    },
    /// The recordings hold too little for what was asked.
    #[error("{0}")]
    TooLittle(String),
    /// The data cannot answer, or the model cannot be simulated.
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    /// The data cannot be diagnosed.
    #[error(transparent)]
    Diagnose(#[from] DiagnosisError),
    /// The excitation cannot be driven.
    #[error("excitation: {0}")]
    Excitation(#[from] ExcitationError),
    /// The robot could not be connected.
    #[error("{0}")]
    Connect(RobotError),
    /// A drive ended early.
    #[error("{error}{}", .kept.as_ref().map(|p| format!(" in {}", p.display())).unwrap_or_default())]
    Drive {
        /// What happened, and whether the robot was stopped.
        error: Box<DriveError>,
        /// Where the recording so far was written.
        kept: Option<PathBuf>,
    },
    /// There is no such controller.
    #[error("controller: {0}")]
    Control(ControlError),
    /// There is no such trajectory.
    #[error("trajectory: {0}")]
    Trajectory(TrajectoryError),
    /// The robot lacks a channel that the controller needs.
    #[error(transparent)]
    Track(TrackError),
    /// Tracking would be dangerous; the robot was not moved.
    #[error("refused: {}; `track.force = true` drives all the same", dangers(.0))]
    Danger(Vec<Concern>),
    /// A controller is not carried to another robot.
    #[error(transparent)]
    Migration(#[from] MigrationError),
    /// A recording could not be written.
    #[error("{}: {reason}", .path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What happened.
        reason: String,
    },
    /// A plugin could not be loaded or broke its contract.
    #[error(transparent)]
    Plugin(#[from] PluginError),
    /// A library's robot or model broke a promise; what it was stands in the result.
    #[error("plugin {}: \"{name}\" does not conform", .library.display())]
    Nonconforming {
        /// The library.
        library: PathBuf,
        /// Robot or model.
        name: String,
    },
    /// A gate given with `--require` or `--fail-on` was not passed.
    #[error("gate failed: {0}")]
    Gate(String),
}

impl Error {
    /// The exit status of the contract: 2 wrong usage, config or input; 3 the data cannot answer; 4 a gate failed;
    /// 5 the robot or a plugin failed; 1 anything else.
    pub fn status(&self) -> u8 {
        match self {
            Self::Usage(_) | Self::Config { .. } | Self::Json { .. } | Self::Recording { .. } | Self::Excitation(_) => 2,
            Self::Io { error, .. } if error.kind() == std::io::ErrorKind::NotFound => 2,
            Self::Control(_) | Self::Trajectory(_) | Self::Track(_) | Self::Danger(_) | Self::Migration(_) => 2,
            Self::TooLittle(_) => 3,
            Self::Identify(IdentifyError::Solve(error)) => solve_status(error),
            Self::Identify(IdentifyError::Model(error)) => model_status(error),
            Self::Diagnose(error) => diagnosis_status(error),
            Self::Connect(RobotError::Config { .. }) => 2,
            Self::Drive { error, .. } => drive_status(&error.fault),
            Self::Plugin(error) if !error.is_plugin_failure() => 2,
            Self::Connect(_) | Self::Plugin(_) | Self::Nonconforming { .. } => 5,
            Self::Gate(_) => 4,
            _ => 1,
        }
    }

    /// A configuration error of a setting that stands in no file.
    pub fn setting(path: &str, message: impl Into<String>) -> Self {
        Self::Config { file: PathBuf::new(), position: None, error: ConfigError::new(path, message) }
    }

    /// A document that is not what it should be.
    pub fn json(path: &std::path::Path, message: String) -> Self {
        Self::Json { path: path.to_owned(), message }
    }

    /// A refused recording, from its content alone.
    pub fn content(path: impl Into<PathBuf>, error: RecordingError) -> Self {
        Self::Recording { path: path.into(), error: error.into() }
    }
}

fn dangers(concerns: &[Concern]) -> String {
    let grave = concerns.iter().filter(|c| c.gravity == Gravity::Danger);
    grave.map(|c| c.message.as_str()).collect::<Vec<_>>().join("; ")
}

fn drive_status(fault: &DriveFault) -> u8 {
    match fault {
        DriveFault::Interrupted { .. } | DriveFault::Released { .. } | DriveFault::Floor { .. } | DriveFault::Sink(_) => 1,
        DriveFault::Excitation(_)
        | DriveFault::Command { .. }
        | DriveFault::Time { .. }
        | DriveFault::Limit(_)
        | DriveFault::BadFloor { .. }
        | DriveFault::NoPose => 2,
        _ => 5,
    }
}

fn solve_status(error: &SolveError) -> u8 {
    match error {
        SolveError::NotIdentifiable { .. } | SolveError::TooFewSamples { .. } => 3,
        SolveError::Setting { .. } | SolveError::Signal(_) | SolveError::NotApplicable { .. } | SolveError::EmptyBounds { .. } => 2,
        SolveError::Model(error) => model_status(error),
        _ => 1,
    }
}

fn diagnosis_status(error: &DiagnosisError) -> u8 {
    match error {
        DiagnosisError::Channels { .. } | DiagnosisError::NothingToHold { .. } => 2,
        DiagnosisError::Solve(error) => solve_status(error),
        DiagnosisError::Model(error) => model_status(error),
        _ => 3,
    }
}

fn model_status(error: &ModelError) -> u8 {
    match error {
        ModelError::Config { .. } => 2,
        ModelError::Plugin { .. } => 5,
        _ => 3,
    }
}

fn place(file: &std::path::Path, position: &Option<(usize, usize)>) -> String {
    let file = if file.as_os_str().is_empty() { "command line".into() } else { file.display().to_string() };
    position.map_or_else(|| file.clone(), |(line, column)| format!("{file}:{line}:{column}"))
}
