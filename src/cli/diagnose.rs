//! `diagnose`: where a recording differs from its simulation, what physics was left out, and the proof.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::Value;
use toml::Table;
use wheelwright_core::profile::RobotProfile;
use wheelwright_diagnosis::{Diagnosis, Verdict};

use super::console::Console;
use super::identify::check_gates;
use super::setup::{ReadArguments, Setup, chosen, profile};
use super::{Shared, browser, page, text};
use crate::constraints::freedom;
use crate::documents::{self, Context};
use crate::error::Error;
use crate::experiment;
use crate::feedforward;
use crate::inquiry::{Comparison, Inquiry, Part, Simulated, library, model_of};
use crate::model_file::ModelFile;
use crate::output::{Folder, replay_csv};
use crate::registry::ModelFailure;
use crate::source::Source;

/// Share held out unless asked otherwise.
const HOLDOUT: f64 = 0.3;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Recordings: files or bag folders; several are pooled
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    #[command(flatten)]
    question: QuestionArguments,
    /// Simulation to compare with: a model.toml, or a recording of any simulator [default: the base model identified on the same data]
    #[arg(long, value_name = "RECORDING|model.toml")]
    sim: Option<PathBuf>,
    /// Recording of another drive that no estimate sees (may be repeated)
    #[arg(long, value_name = "RECORDING")]
    validate: Vec<PathBuf>,
    /// Hold the parameters of the simulation as they are, instead of fitting them to the recording
    #[arg(long, requires = "sim")]
    fixed: bool,
    /// Write feedforward.csv and feedforward.toml: what a controller adds to its commands against the effects found
    #[arg(long)]
    compensate: bool,
    /// Fail with status 4 if anything beyond noise is missing from the simulation
    #[arg(long, value_name = "WHAT")]
    fail_on: Option<FailOn>,
    /// Fail with status 4 unless the result reaches a number, as in fit.after.v=95 (may be repeated)
    #[arg(long, value_name = "KEY=NUMBER")]
    require: Vec<String>,
    #[command(flatten)]
    read: ReadArguments,
}

/// What `diagnose` and `trial` ask alike.
#[derive(Debug, Clone, Default, Args)]
pub(super) struct QuestionArguments {
    /// Model of the simulation [default: by the recording's columns, or the robot profile's]
    #[arg(long, value_name = "NAME")]
    pub(super) model: Option<String>,
    /// Profile of the robot: its dimensions and limits
    #[arg(long, value_name = "robot.toml")]
    pub(super) robot: Option<PathBuf>,
    /// Share of the samples that no estimate sees, where no recording validates [default: 0.3]
    #[arg(long, value_name = "SHARE")]
    pub(super) holdout: Option<f64>,
    /// Leave an effect out of the library (may be repeated)
    #[arg(long, value_name = "EFFECT")]
    pub(super) without: Vec<String>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum FailOn {
    /// Any verdict but no_mismatch
    Mismatch,
}

/// A diagnosis with what it was made of.
pub(super) struct Diagnosed {
    pub(super) inquiry: Inquiry,
    pub(super) sources: Vec<Source>,
    pub(super) validation: Vec<Source>,
    pub(super) found: Diagnosis,
    pub(super) comparison: Option<Comparison>,
    pub(super) warnings: Vec<String>,
}

pub(super) fn run(arguments: &Arguments, shared: &Shared, console: &Console) -> Result<(), Error> {
    let setup = Setup::load(shared)?;
    let folder = setup.folder(shared)?;
    console.progress("simulating with every effect of the library …");
    let diagnosed = diagnosed(arguments, &setup, shared);
    console.end_progress();
    let diagnosed = diagnosed?;
    let document = document(&diagnosed);
    if let Some(folder) = &folder {
        write(&diagnosed, &document, arguments.compensate, folder, &setup, shared, console)?;
    } else if arguments.compensate {
        return Err(Error::Usage("--compensate writes files: say where with --out DIR".to_owned()));
    }
    console.document(&document);
    console.result(&text::diagnosis(&diagnosed.found, diagnosed.comparison.as_ref()));
    for warning in diagnosed.found.warnings.iter().chain(&diagnosed.warnings) {
        console.note(&format!("warning: {warning}"));
    }
    check_gates(&document, &arguments.require)?;
    match (arguments.fail_on, diagnosed.found.verdict) {
        (Some(FailOn::Mismatch), verdict) if verdict != Verdict::NoMismatch => {
            Err(Error::Gate(format!("the verdict is {}: {}", text::verdict(verdict), diagnosed.found.headline)))
        }
        _ => Ok(()),
    }
}

fn diagnosed(arguments: &Arguments, setup: &Setup, shared: &Shared) -> Result<Diagnosed, Error> {
    let read = setup.read_options(&arguments.read)?;
    let open = |paths: &[PathBuf]| paths.iter().map(|path| Source::open(path, &read)).collect::<Result<Vec<_>, _>>();
    let sources = open(&arguments.recordings)?;
    let validation = open(&setup.validation_paths_or(&arguments.validate))?;
    let sim = arguments.sim.as_deref().map(|path| Sim::open(path, &read)).transpose()?;
    let file = match &sim {
        Some(Sim::Model(file, _)) => Some(&**file),
        _ => None,
    };
    let mut inquiry = inquiry(&arguments.question, file, &sources[0], setup, shared)?;
    let (training, held_out) = inquiry.parts(&sources, &validation)?;
    let simulated = sim.map(|sim| sim.simulated(&inquiry, &training, setup)).transpose()?;
    if let Some(simulated) = &simulated {
        inquiry.theta = Some(simulated.theta());
        inquiry.fixed = arguments.fixed;
    }
    inquiry.yardstick = true;
    let mut found = inquiry.ask(&training, held_out.as_ref())?;
    let comparison = simulated.map(|s| s.compare(&mut found, &*inquiry.model, &training, held_out.as_ref())).transpose()?;
    let warnings =
        sources.iter().chain(&validation).flat_map(|s| s.facts.warnings.iter().map(|w| format!("{}: {w}", s.facts.path))).collect();
    Ok(Diagnosed { inquiry, sources, validation, found, comparison, warnings })
}

/// The question of a recording: model, dimensions, library.
pub(super) fn inquiry(
    arguments: &QuestionArguments,
    file: Option<&ModelFile>,
    source: &Source,
    setup: &Setup,
    shared: &Shared,
) -> Result<Inquiry, Error> {
    let given = arguments.robot.as_deref().map(profile).transpose()?;
    let robot = given.or_else(|| file.and_then(|f| f.robot.clone()));
    let model_table = match file {
        Some(file) => file.model.clone(),
        None => model_table(arguments.model.as_deref(), robot.as_ref(), source, setup),
    };
    let model = setup.registry.model(model_table.clone()).map_err(|e| match e {
        ModelFailure::Config(error) => setup.config.error_in("model", error),
        ModelFailure::Model(error) => Error::Identify(error.into()),
    })?;
    let constraints = &setup.config.sections.parameters;
    let freedom = freedom(&*model, constraints).map_err(|e| setup.config.error_in("parameters", e))?;
    let holdout = arguments.holdout.or(setup.config.sections.validation.holdout).unwrap_or(HOLDOUT);
    check_holdout(holdout)?;
    let seed = setup.seed(shared);
    let library = library(&setup.registry, &arguments.without)?;
    Ok(Inquiry { model_table, model, freedom, theta: None, fixed: false, robot, library, holdout, seed, yardstick: false })
}

/// The model's table: option and configuration before the recording's columns, and these before the robot's profile.
fn model_table(option: Option<&str>, robot: Option<&RobotProfile>, source: &Source, setup: &Setup) -> Table {
    let by_columns = model_of(source).unwrap_or_default();
    let name = by_columns.get("type").and_then(toml::Value::as_str).or(robot.map(|r| r.model.as_str())).unwrap_or("vw-pd");
    let mut table = chosen(setup.config.sections.model.as_ref(), option, name);
    if table.get("type") == by_columns.get("type") {
        for (key, value) in by_columns {
            table.entry(key).or_insert(value);
        }
    }
    table
}

/// A holdout must leave something to fit.
pub(super) fn check_holdout(holdout: f64) -> Result<(), Error> {
    if (0.0..=0.9).contains(&holdout) {
        return Ok(());
    }
    Err(Error::setting("validation.holdout", format!("is {holdout}; it is a share of the samples from 0 to 0.9, such as 0.3")))
}

/// What `--sim` names.
enum Sim {
    Model(Box<ModelFile>, PathBuf),
    Recording(Box<Source>, PathBuf),
}

impl Sim {
    /// A file that ends in `.toml` is a model, anything else a recording.
    fn open(path: &Path, read: &wheelwright_core::recording::ReadOptions) -> Result<Self, Error> {
        if path.extension().is_some_and(|e| e == "toml") {
            return Ok(Self::Model(Box::new(ModelFile::read(path)?), path.to_owned()));
        }
        Ok(Self::Recording(Box::new(Source::open(path, read)?), path.to_owned()))
    }

    /// The simulation as a model; of a recording by its own diagnosis.
    fn simulated(self, inquiry: &Inquiry, training: &Part, setup: &Setup) -> Result<Simulated, Error> {
        match self {
            Self::Model(file, path) => Simulated::from_file(&file, &path, &*inquiry.model, training, &setup.registry),
            Self::Recording(source, path) => {
                let found = inquiry.diagnose(std::slice::from_ref(&source), &[])?;
                Simulated::from_recording(&found, &path, &setup.registry)
            }
        }
    }
}

fn document(diagnosed: &Diagnosed) -> Value {
    let facts = |sources: &[Source]| sources.iter().map(|s| s.facts.clone()).collect::<Vec<_>>();
    let simulation = diagnosed.comparison.as_ref().map_or(&Value::Null, |c| &c.document);
    documents::diagnose(
        &diagnosed.found,
        &Context {
            model: diagnosed.inquiry.model.name(),
            compared_with: simulation.get("kind").and_then(Value::as_str).unwrap_or("identified"),
            recordings: &facts(&diagnosed.sources),
            validation_recordings: &facts(&diagnosed.validation),
            simulation,
            warnings: &diagnosed.warnings,
        },
    )
}

/// Writes everything `--out` gets.
fn write(
    diagnosed: &Diagnosed,
    document: &Value,
    compensate: bool,
    folder: &Folder,
    setup: &Setup,
    shared: &Shared,
    console: &Console,
) -> Result<(), Error> {
    let Diagnosed { inquiry, found, .. } = diagnosed;
    folder.write("result.json", &format!("{document:#}\n"))?;
    let file = ModelFile::diagnosed(&inquiry.model_table, inquiry.robot.clone(), found, &setup.registry)
        .map_err(|error| Error::Config { file: folder.path("model.toml"), position: None, error })?;
    folder.write("model.toml", &file.to_toml())?;
    let mut parts = vec![("train", &found.training)];
    parts.extend(found.held_out.as_ref().map(|r| ("validate", r)));
    folder.write("before.csv", &replay_csv(&parts, |replay| &replay.before))?;
    folder.write("after.csv", &replay_csv(&parts, |replay| &replay.after))?;
    if let Some(next) = &found.next_experiment {
        folder.write("next_experiment.csv", &experiment::csv(next))?;
        folder.write("next_experiment.toml", &experiment::config(next, inquiry))?;
    }
    if compensate {
        let term = feedforward::term(&file, found, &*inquiry.model, &setup.registry)?;
        folder.write("feedforward.csv", &term.csv())?;
        folder.write("feedforward.toml", &term.to_toml())?;
    }
    let report = folder.write("report.html", &page::diagnosis_page(diagnosed))?;
    if shared.open {
        browser::open(&report, console);
    }
    console.note(&format!("wrote {} beside result.json, model.toml, before.csv and after.csv", report.display()));
    Ok(())
}
