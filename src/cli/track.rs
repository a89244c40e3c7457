//! `track`: a robot follows a trajectory under a controller.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use wheelwright_core::RobotProfile;
use wheelwright_core::drive::{DriveOptions, Safety};
use wheelwright_core::robot::Live;

use super::Shared;
use super::attend::{self, AttendArguments, Attendant};
use super::console::Console;
use super::page::command_line;
use super::setup::{Setup, profile};
use crate::control::run::Outcome;
use crate::control::{ControlPlan, TrackRun, files};
use crate::error::Error;
use crate::output::Folder;
use crate::report::track::{TrackPage, metres};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Configuration: [robot] or [simulation], [model], [trajectory], [controller], [track], [limits]
    #[arg(value_name = "CONFIG.toml")]
    file: PathBuf,
    /// Profile of the robot: its dimensions and limits
    #[arg(long, value_name = "robot.toml")]
    robot: Option<PathBuf>,
    #[command(flatten)]
    attend: AttendArguments,
}

pub(super) fn run(arguments: &Arguments, shared: &Shared, console: &Console) -> Result<(), Error> {
    let setup = Setup::load_file(Some(&arguments.file), shared)?;
    let given = arguments.robot.as_deref().map(profile).transpose()?;
    let plan = ControlPlan::read(&setup.config, &setup.registry)?;
    let safety = bounds(&setup, given.as_ref(), plan.knowledge.profile.as_ref())?;
    let attendant = Attendant::new(&setup, &arguments.attend, safety, console)?;
    let folder = setup.folder(shared)?;
    let (outcome, kept) = match &setup.config.sections.robot {
        None => (plan.run(&setup.config, None, None, DriveOptions { safety, ..DriveOptions::default() })?, None),
        Some(robot) => {
            let subject = plan.subject(&setup.config, None, &safety)?;
            let mut connected = attendant.connect(robot, setup.seed(shared))?;
            attended(&attendant, &mut connected.robot, &plan.track_run(&setup.config, &subject), folder.as_ref())?
        }
    };
    let told = tell(&outcome, &plan, folder.as_ref(), shared, console);
    match outcome.ended {
        // What ended the drive comes before what may have gone wrong in telling of it.
        Some(error) => Err(Error::Drive { error: Box::new(error), kept }),
        None => told,
    }
}

/// Drives a run under every watch there is. Rows are kept as they come, in the file whose path comes back; what is joined with the
/// desired motion is written at the end.
pub(super) fn attended(
    attendant: &Attendant<'_>,
    robot: &mut Live,
    run: &TrackRun<'_>,
    folder: Option<&Folder>,
) -> Result<(Outcome, Option<PathBuf>), Error> {
    // Whatever is wrong is said before anybody steps back.
    let ready = run.ready(robot)?;
    let folder = folder.map(|folder| folder.path(""));
    let attended = attendant.drive(robot, folder.as_deref(), None, |robot, options| ready.drive(robot, options))?;
    Ok((attended.outcome?, attended.files.map(|files| files.csv_path)))
}

/// What a drive keeps within: the configuration's limits, and those of a profile, from the command line, the configuration or the
/// model file.
pub(super) fn bounds(setup: &Setup, given: Option<&RobotProfile>, own: Option<&RobotProfile>) -> Result<Safety, Error> {
    let configured = setup.config.sections.limits.profile.is_some();
    attend::safety(setup, given.or(own.filter(|_| !configured)))
}

fn tell(outcome: &Outcome, plan: &ControlPlan, folder: Option<&Folder>, shared: &Shared, console: &Console) -> Result<(), Error> {
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
    Ok(())
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
