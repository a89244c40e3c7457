//! `migrate`: a controller tuned on one robot, carried to another, with the tracking error before and after.

use std::path::PathBuf;

use clap::Args;
use serde_json::{Value as Json, json};
use toml::{Table, Value};
use wheelwright_core::controller::Subject;
use wheelwright_core::drive::{DriveOptions, Safety};
use wheelwright_core::identification::Identification;
use wheelwright_core::robot::Live;

use super::Shared;
use super::console::Console;
use super::halt::{self, Halt};
use super::page::command_line;
use super::setup::{Setup, profile};
use super::track::{bounds, progress};
use crate::control::migration::{self, ALL_ONES, Case, MIGRATED, Migration, UNMIGRATED, error_of, informed, learn, tuning, verdict};
use crate::control::plan::{envelope, knowledge, trajectory};
use crate::control::run::Outcome;
use crate::control::{Knowledge, TrackRun, files};
use crate::error::Error;
use crate::model_file::ModelFile;
use crate::output::Folder;
use crate::report::track::{TrackPage, metres};

/// Added to the seed where other noise is wanted: for the identification that stands for a native one.
const OTHER_NOISE: u64 = 1_000_003;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Configuration: [source], [robot], [model], [excitation], [trajectory], [track], [migrate], [limits]
    #[arg(value_name = "CONFIG.toml")]
    file: PathBuf,
    /// Profile of the target: its dimensions and limits
    #[arg(long, value_name = "robot.toml")]
    robot: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments, shared: &Shared, console: &Console) -> Result<(), Error> {
    let setup = Setup::load_file(Some(&arguments.file), shared)?;
    let given = arguments.robot.as_deref().map(profile).transpose()?;
    let sections = &setup.config.sections;
    let missing =
        |name: &str, what: &str| setup.config.error(wheelwright_core::config::ConfigError::new(name, format!("is missing: {what}")));
    let robot = sections.robot.clone().ok_or_else(|| missing("robot", "[robot] is the target"))?;
    let from = sections.source.as_ref().ok_or_else(|| missing("source", "[source] is the robot that the controller was tuned on"))?;
    let known = knowledge(&setup.config, &setup.registry, "source.model", from.model.clone())?;
    let target = knowledge(&setup.config, &setup.registry, "model", sections.model.clone().unwrap_or_default())?;
    let safety = bounds(&setup, given.as_ref(), target.profile.as_ref())?;
    let source_theta =
        known.theta.clone().ok_or_else(|| missing("source.model.theta", "a controller is carried over with its parameters"))?;
    let source = Subject { period: from.period, ..known.subject(source_theta, None, envelope(&safety)) };
    let tuned = tuning(from.controller.clone()).map_err(|e| setup.config.error_in("source.controller", e))?;
    let (trajectory, _) = trajectory(&setup.config, &setup.registry)?;
    let _halt = Halt::watch()?;
    let target = Target { setup: &setup, robot, known: &target, safety, console };
    let seed = setup.seed(shared);
    let (subject, found) = target.subject(seed)?;
    let task = Migration {
        tuning: tuned,
        source: &source,
        target: &subject,
        rule: sections.migrate.gains,
        section: &sections.track,
        trajectory: &*trajectory,
        adaptation: sections.migrate.adaptation.as_ref(),
    };
    task.gains()?;
    let native = target.native(seed, &subject)?;
    let cases = task.run(native.as_deref(), sections.migrate.compare, &mut |run| target.drive(run, seed))?;
    conclude(&setup, &task, &cases, found.as_ref(), target.known, shared, console)
}

/// The target robot.
struct Target<'a> {
    setup: &'a Setup,
    robot: Table,
    known: &'a Knowledge,
    safety: Safety,
    console: &'a Console,
}

impl Target<'_> {
    fn connect(&self, seed: u64) -> Result<Live, Error> {
        self.setup.connect(self.robot.clone(), seed)
    }

    /// What is known of the target: given, or identified now.
    fn subject(&self, seed: u64) -> Result<(Subject, Option<Identification>), Error> {
        let mut robot = self.connect(seed)?;
        let given = self.known.theta.clone().unwrap_or_default();
        let blank = Subject { period: robot.period(), ..self.known.subject(given, None, envelope(&self.safety)) };
        if self.known.theta.is_some() && !self.setup.config.sections.migrate.identify {
            return Ok((blank, None));
        }
        let found = self.learn(&mut robot, &blank)?;
        Ok((informed(&blank, &found), Some(found)))
    }

    fn learn(&self, robot: &mut Live, blank: &Subject) -> Result<Identification, Error> {
        let excitation = self.setup.excitation()?;
        let table = super::setup::chosen(self.setup.config.sections.solver.as_ref(), None, super::setup::SOLVER);
        let solver = self.setup.registry.solver(table).map_err(|e| self.setup.config.error_in("solver", e))?;
        let mut show = progress(self.console);
        let options = DriveOptions { safety: self.safety, stop: Some(&halt::STOP), observer: Some(&mut show), ..DriveOptions::default() };
        let found = learn(robot, &*excitation, blank, &*solver, options);
        self.console.end_progress();
        found
    }

    /// Parameters to compare with: given, or a second identification where that costs nothing but time.
    fn native(&self, seed: u64, subject: &Subject) -> Result<Option<Vec<f64>>, Error> {
        let section = &self.setup.config.sections.migrate;
        if section.native_theta.is_some() || !section.compare || self.setup.config.sections.excitation.is_none() {
            return Ok(section.native_theta.clone());
        }
        let mut robot = self.connect(seed.wrapping_add(OTHER_NOISE))?;
        if robot.real_time() {
            return Ok(None);
        }
        Ok(Some(self.learn(&mut robot, subject)?.solution.theta))
    }

    fn drive(&self, run: &TrackRun<'_>, seed: u64) -> Result<Outcome, Error> {
        let mut robot = self.connect(seed)?;
        // A simulated robot may show how bad it is; a real one is not driven into danger.
        let mut section = run.section.clone();
        section.force |= !robot.real_time();
        let mut show = progress(self.console);
        let options = DriveOptions { safety: self.safety, stop: Some(&halt::STOP), observer: Some(&mut show), ..DriveOptions::default() };
        let outcome = TrackRun { section: &section, ..*run }.drive(&mut robot, options);
        self.console.end_progress();
        match halt::asked() {
            true => Err(Error::Usage("interrupted: the robot was stopped".to_owned())),
            false => outcome,
        }
    }
}

fn conclude(
    setup: &Setup,
    task: &Migration<'_>,
    cases: &[Case],
    found: Option<&Identification>,
    known: &Knowledge,
    shared: &Shared,
    console: &Console,
) -> Result<(), Error> {
    let document = document(task, cases, found)?;
    if let Some(folder) = setup.folder(shared)? {
        write(&folder, task, cases, found, known, &document, shared, console)?;
    }
    for case in cases {
        match &case.outcome {
            Ok(outcome) => outcome.concerns.iter().for_each(|c| console.note(&format!("{}: foreseen: {}", case.name, c.message))),
            Err(error) => console.note(&format!("{}: {error}", case.name)),
        }
    }
    console.document(&document);
    console.result(&summary(cases));
    let migrated = cases.iter().find(|c| c.name == MIGRATED).map(|c| &c.outcome);
    match migrated {
        Some(Ok(Outcome { ended: Some(error), .. })) => Err(Error::Drive { error: Box::new(error.clone()), kept: None }),
        Some(Err(Error::Danger(concerns))) => Err(Error::Danger(concerns.clone())),
        _ => Ok(()),
    }
}

fn document(task: &Migration<'_>, cases: &[Case], found: Option<&Identification>) -> Result<Json, Error> {
    let (tuning, margins) = task.gains()?;
    let run = |case: &Case| {
        let mut run = json!({ "name": case.name, "theta": case.theta, "gains": case.tuning });
        match &case.outcome {
            Ok(outcome) => run["result"] = outcome.facts(),
            Err(error) => run["refused"] = json!(error.to_string()),
        }
        run
    };
    let parameters: Vec<Json> = task
        .target
        .model
        .parameters()
        .iter()
        .enumerate()
        .map(|(i, p)| json!({ "name": p.name, "value": task.target.theta[i], "ci95": task.target.intervals[i], "unit": p.unit }))
        .collect();
    Ok(json!({
        "schema": "wheelwright.migrate/1",
        "model": task.target.model.name(),
        "identified": found.is_some(),
        "parameters": parameters,
        "gains": { "source": task.tuning, "target": tuning, "v": margins[0], "omega": margins[1] },
        "verdict": verdict(cases),
        "runs": cases.iter().map(run).collect::<Vec<_>>(),
    }))
}

#[allow(clippy::too_many_arguments, reason = "it lays out everything there is")]
fn write(
    folder: &Folder,
    task: &Migration<'_>,
    cases: &[Case],
    found: Option<&Identification>,
    known: &Knowledge,
    document: &Json,
    shared: &Shared,
    console: &Console,
) -> Result<(), Error> {
    folder.write("result.json", &format!("{document:#}\n"))?;
    if let Some(found) = found {
        folder.write("model.toml", &ModelFile::new(&known.table, known.profile.clone(), found).to_toml())?;
    }
    let (tuning, _) = task.gains()?;
    let mut model = known.table.clone();
    model.insert("theta".to_owned(), task.target.theta.clone().into());
    let mut controller = Table::try_from(tuning).map_err(|e| Error::setting("controller", e.to_string()))?;
    controller.insert("type".to_owned(), "inverse-dynamics".into());
    let tables = Table::from_iter([("model".to_owned(), Value::Table(model)), ("controller".to_owned(), Value::Table(controller))]);
    folder.write("controller.toml", &format!("# For `track` on the target.\n{tables}"))?;
    let runs: Vec<(String, &Outcome)> = cases.iter().filter_map(|c| Some((c.name.to_owned(), c.outcome.as_ref().ok()?))).collect();
    if let Some((_, outcome)) = runs.iter().find(|(name, _)| name == MIGRATED) {
        files::write(outcome, folder)?;
    }
    let text: Vec<String> = statement(cases).into_iter().collect();
    let page = TrackPage {
        title: "A controller carried to another robot",
        subtitle: &format!("model {}", task.target.model.name()),
        command: &command_line(),
        runs: &runs,
        facts: &[],
        text: &text,
    };
    let path = folder.write("report.html", &page.html())?;
    if shared.open {
        super::browser::open(&path, console);
    }
    Ok(())
}

fn statement(cases: &[Case]) -> Option<String> {
    let (migrated, unmigrated) = (error_of(cases, MIGRATED)?, error_of(cases, UNMIGRATED)?);
    let before = if unmigrated.is_finite() { metres(unmigrated) } else { "a drive that had to be ended".to_owned() };
    let native = error_of(cases, migration::NATIVE).map(|n| format!(", {} natively", metres(n))).unwrap_or_default();
    let ones = error_of(cases, ALL_ONES)
        .filter(|e| e.is_finite())
        .map(|e| format!(" ({} with all parameters one)", metres(e)))
        .unwrap_or_default();
    Some(format!(
        "Distance error after the first third of the run: {before} before migration{ones}, {} after it{native}.",
        metres(migrated)
    ))
}

fn summary(cases: &[Case]) -> String {
    let mut text = String::new();
    for case in cases {
        let error = match &case.outcome {
            Ok(outcome) if outcome.ended.is_none() => metres(outcome.settled()),
            Ok(outcome) => outcome.ended.as_ref().map(|e| e.fault.to_string()).unwrap_or_default(),
            Err(error) => error.to_string(),
        };
        text.push_str(&format!("{:<36} {error}\n", case.name));
    }
    text
}
