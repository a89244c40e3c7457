//! `migrate`: a controller tuned on one robot, carried to another, with the tracking error before and after.

use std::path::PathBuf;

use clap::Args;
use serde_json::{Value as Json, json};
use toml::{Table, Value};
use wheelwright_core::controller::Subject;
use wheelwright_core::identification::Identification;
use wheelwright_core::robot::Live;

use super::Shared;
use super::attend::{AttendArguments, Attendant};
use super::console::Console;
use super::drive::Drive;
use super::page::command_line;
use super::setup::{Setup, profile};
use super::track::{attended, bounds};
use crate::control::migration::{self, ALL_ONES, Case, MIGRATED, Migration, UNMIGRATED, error_of, informed, learned, tuning, verdict};
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
    #[command(flatten)]
    attend: AttendArguments,
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
    let attendant = Attendant::new(&setup, &arguments.attend, safety, console)?;
    let folder = setup.folder(shared)?;
    let target = Target { setup: &setup, attendant, robot, known: &target, folder: folder.as_ref(), seed: setup.seed(shared) };
    let (subject, found) = target.subject()?;
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
    let native = target.native(&subject)?;
    let cases = task.run(native.as_deref(), sections.migrate.compare, &mut |name, run| target.drive(name, run))?;
    let document = document(&task, &cases, found.as_ref())?;
    tell(&cases, &document, console);
    let written = folder.as_ref().map(|folder| write(folder, &task, &cases, found.as_ref(), target.known, &document)).transpose();
    // What ended a run comes before what may have gone wrong in telling of it.
    conclude(cases, folder.as_ref())?;
    if let Some(page) = written?.filter(|_| shared.open) {
        super::browser::open(&page, console);
    }
    Ok(())
}

/// The target robot.
struct Target<'a> {
    setup: &'a Setup,
    attendant: Attendant<'a>,
    robot: Table,
    known: &'a Knowledge,
    folder: Option<&'a Folder>,
    seed: u64,
}

impl Target<'_> {
    /// What is known of the target: given, or identified now.
    fn subject(&self) -> Result<(Subject, Option<Identification>), Error> {
        let mut connected = self.attendant.connect(&self.robot, self.seed)?;
        let given = self.known.theta.clone().unwrap_or_default();
        let envelope = envelope(&self.attendant.safety);
        let blank = Subject { period: connected.robot.period(), ..self.known.subject(given, None, envelope) };
        if self.known.theta.is_some() && !self.setup.config.sections.migrate.identify {
            return Ok((blank, None));
        }
        let found = self.learn(&mut connected.robot, "identification", &blank)?;
        Ok((informed(&blank, &found), Some(found)))
    }

    fn learn(&self, robot: &mut Live, name: &str, blank: &Subject) -> Result<Identification, Error> {
        let excitation = self.setup.excitation()?;
        let table = super::setup::chosen(self.setup.config.sections.solver.as_ref(), None, super::setup::SOLVER);
        let solver = self.setup.registry.solver(table).map_err(|e| self.setup.config.error_in("solver", e))?;
        let folder = self.folder_of(name)?.map(|folder| folder.path(""));
        let drive = Drive { attendant: &self.attendant, excitation: &*excitation, folder: folder.as_deref(), part: None };
        learned(&drive.run(robot)?.recording, blank, &*solver)
    }

    /// Parameters to compare with: given, or a second identification where that costs nothing but time.
    fn native(&self, subject: &Subject) -> Result<Option<Vec<f64>>, Error> {
        let section = &self.setup.config.sections.migrate;
        if section.native_theta.is_some() || !section.compare || self.setup.config.sections.excitation.is_none() {
            return Ok(section.native_theta.clone());
        }
        let mut connected = self.attendant.connect(&self.robot, self.seed.wrapping_add(OTHER_NOISE))?;
        if connected.robot.real_time() {
            return Ok(None);
        }
        Ok(Some(self.learn(&mut connected.robot, "native identification", subject)?.solution.theta))
    }

    fn drive(&self, name: &str, run: &TrackRun<'_>) -> Result<Outcome, Error> {
        let mut connected = self.attendant.connect(&self.robot, self.seed)?;
        // A simulated robot may show how bad it is; a real one is not driven into danger.
        let mut section = run.section.clone();
        section.force |= !connected.robot.real_time();
        let run = TrackRun { section: &section, ..*run };
        Ok(attended(&self.attendant, &mut connected.robot, &run, self.folder_of(name)?.as_ref())?.0)
    }

    /// The folder of one run's recording.
    fn folder_of(&self, name: &str) -> Result<Option<Folder>, Error> {
        self.folder.map(|folder| Folder::create(&folder.path(&folder_name(name)))).transpose()
    }
}

/// A run's name as that of its folder: what comes before a colon, in words joined by hyphens.
fn folder_name(name: &str) -> String {
    let words = name.split(':').next().unwrap_or_default().split(|c: char| !c.is_alphanumeric());
    words.filter(|word| !word.is_empty()).collect::<Vec<_>>().join("-")
}

fn tell(cases: &[Case], document: &Json, console: &Console) {
    for case in cases {
        match &case.outcome {
            Ok(outcome) => outcome.concerns.iter().for_each(|c| console.note(&format!("{}: foreseen: {}", case.name, c.message))),
            Err(error) => console.note(&format!("{}: {error}", case.name)),
        }
    }
    console.document(document);
    console.result(&summary(cases));
}

/// The migration failed if somebody or something ended it, or if the migrated controller did not bring its run to an end.
fn conclude(cases: Vec<Case>, folder: Option<&Folder>) -> Result<(), Error> {
    let decisive = cases.iter().position(Case::is_last).or_else(|| cases.iter().position(|c| c.name == MIGRATED));
    let Some(case) = decisive.and_then(|i| cases.into_iter().nth(i)) else { return Ok(()) };
    let ended = case.outcome?.ended;
    let kept = folder.map(|folder| folder.path(&folder_name(case.name)));
    ended.map_or(Ok(()), |error| Err(Error::Drive { error: Box::new(error), kept }))
}

fn document(task: &Migration<'_>, cases: &[Case], found: Option<&Identification>) -> Result<Json, Error> {
    let (tuning, margins) = task.gains()?;
    let run = |case: &Case| {
        let mut run = json!({ "name": case.name, "folder": folder_name(case.name), "theta": case.theta, "gains": case.tuning });
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

/// Writes everything there is; the path of the page.
fn write(
    folder: &Folder,
    task: &Migration<'_>,
    cases: &[Case],
    found: Option<&Identification>,
    known: &Knowledge,
    document: &Json,
) -> Result<PathBuf, Error> {
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
    folder.write("report.html", &page.html())
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
