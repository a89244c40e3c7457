//! `track`: a robot follows a trajectory under a controller.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use wheelwright_core::RobotProfile;
use wheelwright_core::drive::{DriveOptions, DriveProgress, Safety};

use super::Shared;
use super::console::Console;
use super::halt::{self, Halt};
use super::page::command_line;
use super::setup::{Setup, profile};
use crate::control::run::Outcome;
use crate::control::{ControlPlan, files};
use crate::error::Error;
use crate::output::Folder;
use crate::record::RecordingFiles;
use crate::report::track::{TrackPage, metres};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Configuration: [robot] or [simulation], [model], [trajectory], [controller], [track], [limits]
    #[arg(value_name = "CONFIG.toml")]
    file: PathBuf,
    /// Profile of the robot: its dimensions and limits
    #[arg(long, value_name = "robot.toml")]
    robot: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments, shared: &Shared, console: &Console) -> Result<(), Error> {
    let setup = Setup::load_file(Some(&arguments.file), shared)?;
    let given = arguments.robot.as_deref().map(profile).transpose()?;
    let plan = ControlPlan::read(&setup.config, &setup.registry)?;
    let safety = bounds(&setup, given.as_ref(), plan.knowledge.profile.as_ref())?;
    let folder = setup.folder(shared)?;
    let outcome = match setup.config.sections.robot.clone() {
        None => plan.run(&setup.config, None, None, DriveOptions { safety, ..DriveOptions::default() })?,
        Some(robot) => {
            let _halt = Halt::watch()?;
            let mut robot = setup.connect(robot, setup.seed(shared))?;
            let mut show = progress(console);
            // Rows are kept as they come; what is joined with the desired motion is written at the end.
            let channels = || robot.inputs().iter().chain(robot.outputs());
            let mut files = folder.as_ref().map(|f| RecordingFiles::create(&f.path(""), channels())).transpose()?;
            let sinks = files.as_mut().map(RecordingFiles::sinks).unwrap_or_default();
            let options = DriveOptions { safety, sinks, stop: Some(&halt::STOP), observer: Some(&mut show), ..DriveOptions::default() };
            let outcome = plan.run(&setup.config, None, Some(&mut robot), options);
            console.end_progress();
            outcome?
        }
    };
    conclude(&outcome, &plan, folder.as_ref(), shared, console)
}

/// What a drive keeps within: the configuration's limits, and those of a profile, from the command line, the configuration or the
/// model file.
pub(super) fn bounds(setup: &Setup, given: Option<&RobotProfile>, own: Option<&RobotProfile>) -> Result<Safety, Error> {
    let configured = setup.config.sections.limits.profile.is_some();
    super::drive::safety(setup, given.or(own.filter(|_| !configured)))
}

/// A line of progress, as often as an eye can follow.
pub(super) fn progress(console: &Console) -> impl FnMut(&DriveProgress<'_>) + '_ {
    let mut shown = f64::NEG_INFINITY;
    move |progress| {
        if progress.t - shown >= 0.1 {
            shown = progress.t;
            console.progress(&format!("tracking {:.1} of {:.1} s", progress.t, progress.duration));
        }
    }
}

fn conclude(outcome: &Outcome, plan: &ControlPlan, folder: Option<&Folder>, shared: &Shared, console: &Console) -> Result<(), Error> {
    let mut document = json!({
        "schema": "wheelwright.track/1",
        "controller": plan.controller_name(),
        "trajectory": plan.trajectory_name,
        "model": plan.knowledge.model.name(),
    });
    if let (Some(document), Some(facts)) = (document.as_object_mut(), outcome.facts().as_object()) {
        document.extend(facts.clone());
    }
    if let Some(folder) = folder {
        files::write(outcome, folder)?;
        folder.write("result.json", &format!("{document:#}\n"))?;
        let runs = [(plan.controller_name().to_owned(), outcome)];
        let page = TrackPage {
            title: &format!("{} on a {}", plan.controller_name(), plan.trajectory_name),
            subtitle: &format!("model {}", plan.knowledge.model.name()),
            command: &command_line(),
            runs: &runs,
            facts: &[("pace".to_owned(), outcome.pace.to_string())],
            text: &[],
        };
        let path = folder.write("report.html", &page.html())?;
        if shared.open {
            super::browser::open(&path, console);
        }
    }
    outcome.concerns.iter().for_each(|c| console.note(&format!("foreseen: {}", c.message)));
    console.document(&document);
    console.result(&summary(outcome));
    match &outcome.ended {
        None => Ok(()),
        Some(error) => Err(Error::Drive { error: Box::new(error.clone()), kept: folder.map(|f| f.path("track.csv")) }),
    }
}

fn summary(outcome: &Outcome) -> String {
    let Some(d) = outcome.distances() else { return "nothing was tracked\n".to_owned() };
    let mut text =
        format!("distance error {} (root mean square), {} at most, {} at the end\n", metres(d.rms), metres(d.max), metres(d.last));
    for (from, to, rms) in &d.windows {
        text.push_str(&format!("  {from:>3} to {to:>3} s  {}\n", metres(*rms)));
    }
    for (name, series) in outcome.parameters.iter().zip(&outcome.log.theta) {
        if let (Some(first), Some(last)) = (series.first(), series.last())
            && first != last
        {
            text.push_str(&format!("  {name:<8} {first:.4} to {last:.4}\n"));
        }
    }
    text
}
