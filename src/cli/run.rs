//! `run`: a whole identification from a configuration, from robot or recording to report.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Args;
use toml::Table;
use wheelwright_core::drive::{DriveError, DriveOptions, DriveProgress, drive};

use super::Shared;
use super::console::Console;
use super::identify::conclude;
use super::setup::{ReadArguments, Setup, StudyArguments};
use crate::error::Error;
use crate::output::Folder;
use crate::source::Source;

/// Raised by ctrl-C; the drive looks at it before every command.
static STOP: AtomicBool = AtomicBool::new(false);

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Configuration of the run
    #[arg(value_name = "CONFIG.toml")]
    file: PathBuf,
    #[command(flatten)]
    study: StudyArguments,
}

pub(super) fn run(arguments: &Arguments, shared: &Shared, console: &Console) -> Result<(), Error> {
    let setup = Setup::load_file(Some(&arguments.file), shared)?;
    let study = setup.study(shared, &arguments.study, setup.read_options(&ReadArguments::default())?)?;
    let folder = setup.folder(shared)?;
    let sources = match (setup.config.sections.robot.clone(), setup.recording_paths()) {
        (Some(robot), paths) if paths.is_empty() => vec![excite(&setup, robot, study.seed, folder.as_ref(), console)?],
        (None, paths) if !paths.is_empty() => study.open(&paths)?,
        (Some(_), _) => return Err(setup.config.error(both_or_neither("names a robot and recordings: keep one of them"))),
        (None, _) => {
            return Err(setup
                .config
                .error(both_or_neither("names nothing to identify from: add a [robot] to drive, or [recording] paths = [...]")));
        }
    };
    let validation = study.open(&setup.validation_paths(&arguments.study))?;
    let findings = study.identify(&sources, &validation)?;
    conclude(&study, findings, folder.as_ref(), &arguments.study.require, shared, console)
}

fn both_or_neither(message: &str) -> wheelwright_core::config::ConfigError {
    wheelwright_core::config::ConfigError::new("", message)
}

/// Drives the configured robot with the configured excitation and keeps what it measured.
fn excite(setup: &Setup, robot: Table, seed: u64, folder: Option<&Folder>, console: &Console) -> Result<Source, Error> {
    let excitation = setup.excitation()?;
    let mut robot = setup.connect(robot, seed)?;
    // Without a handler ctrl-C would end the program between two commands, with the last one still held by the robot.
    ctrlc::set_handler(|| STOP.store(true, Ordering::Relaxed)).map_err(|e| Error::Usage(format!("ctrl-C cannot be caught: {e}")))?;
    let mut show = |progress: &DriveProgress<'_>| console.progress(&format!("driving {:.1} of {:.1} s", progress.t, progress.duration));
    let options = DriveOptions { stop: Some(&STOP), observer: Some(&mut show), ..DriveOptions::default() };
    let outcome = drive(&mut robot, &*excitation, options);
    console.end_progress();
    match outcome {
        Ok(recording) => {
            let path = folder.map(|folder| keep(&recording, folder)).transpose()?;
            Source::driven(recording, path.as_deref())
        }
        Err(error) => Err(early_end(error, folder)),
    }
}

/// What was recorded before the drive ended is kept.
fn early_end(error: DriveError, folder: Option<&Folder>) -> Error {
    let kept = error.recorded.as_deref().zip(folder).and_then(|(recording, folder)| keep(recording, folder).ok());
    Error::Drive { error: Box::new(error), kept }
}

fn keep(recording: &wheelwright_core::Recording, folder: &Folder) -> Result<PathBuf, Error> {
    let path = folder.path("recording.csv");
    wheelwright_recordings::write_csv(&path, recording).map_err(|error| Error::Recording { path: path.clone(), error })?;
    Ok(path)
}
