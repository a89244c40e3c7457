//! `record`: drive a robot with an excitation, safely, and keep what it measured.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;

use super::Shared;
use super::attend::{AttendArguments, Attendant, safety};
use super::console::Console;
use super::drive::{Drive, Driven};
use super::setup::{Setup, profile};
use crate::error::Error;
use crate::output::Folder;
use crate::record;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Configuration: [robot], [excitation], [limits], [record]
    #[arg(value_name = "CONFIG.toml")]
    file: PathBuf,
    /// Profile of the robot, whose limits hold
    #[arg(long, value_name = "robot.toml")]
    robot: Option<PathBuf>,
    #[command(flatten)]
    attend: AttendArguments,
}

pub(super) fn run(arguments: &Arguments, shared: &Shared, console: &Console) -> Result<(), Error> {
    let setup = Setup::load_file(Some(&arguments.file), shared)?;
    let robot = setup.config.sections.robot.clone();
    let robot = robot.ok_or_else(|| Error::setting("robot", "is missing: [robot] says what to drive, as in type = \"simulator\""))?;
    let profile = arguments.robot.as_deref().map(profile).transpose()?;
    let excitation = setup.excitation()?;
    let folder = setup.folder(shared)?.map_or_else(|| PathBuf::from("."), |folder| folder.path(""));
    let attendant = Attendant::new(&setup, &arguments.attend, safety(&setup, profile.as_ref())?, console)?;
    let drive = Drive { attendant: &attendant, excitation: &*excitation, folder: Some(&folder), part: None };
    let driven = drive.run(&mut attendant.connect(&robot, setup.seed(shared))?.robot)?;
    report(&driven, &folder, console)
}

/// Says what was recorded, and where it lies.
fn report(driven: &Driven, folder: &Path, console: &Console) -> Result<(), Error> {
    let Some(files) = &driven.files else { return Ok(()) };
    let mut document = record::document(&driven.recording, files, &driven.bites, Some(driven.coverage))?;
    document["stopped"] = json!(true);
    Folder::create(folder)?.write("result.json", &format!("{document:#}\n"))?;
    console.document(&document);
    let recording = &driven.recording;
    let mut text = format!("recorded {} rows in {:.1} s\n", recording.rows(), recording.duration());
    for path in files.paths() {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "  {}", path.display());
    }
    let _ = writeln!(text, "  {:.0} % of the planned commands were visited; the robot was stopped", 100.0 * driven.coverage);
    console.result(&text);
    for warning in &recording.warnings {
        console.note(&format!("warning: {warning}"));
    }
    Ok(())
}
