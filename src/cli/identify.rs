//! `identify`: parameters, intervals and held-out fit from recordings.

use std::path::PathBuf;

use clap::Args;
use serde_json::Value;
use wheelwright_core::identification::IdentifyError;

use super::browser;
use super::console::Console;
use super::setup::{RECURSIVE, ReadArguments, Setup, StudyArguments, split};
use super::{Shared, page, text};
use crate::documents;
use crate::error::Error;
use crate::model_file::ModelFile;
use crate::online::Trace;
use crate::output::{Folder, series_csv};
use crate::study::{Findings, Study};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Recordings: files or bag folders; several are pooled
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// Replay them sample by sample through the recursive estimator, as on the robot: parameters over time with intervals
    #[arg(long)]
    online: bool,
    #[command(flatten)]
    study: StudyArguments,
    #[command(flatten)]
    read: ReadArguments,
}

pub(super) fn run(arguments: &Arguments, shared: &Shared, console: &Console) -> Result<(), Error> {
    let setup = Setup::load(shared)?;
    let mut asked = arguments.study.clone();
    if arguments.online {
        if let Some(other) = asked.solver.filter(|solver| solver != RECURSIVE) {
            return Err(Error::Usage(format!("--online runs the solver {RECURSIVE}, not {other}: leave --solver out")));
        }
        asked.solver = Some(RECURSIVE.to_owned());
    }
    let study = setup.study(shared, &asked, setup.read_options(&arguments.read)?)?;
    let folder = setup.folder(shared)?;
    let sources = study.open(&arguments.recordings)?;
    let validation = study.open(&setup.validation_paths(&arguments.study))?;
    let mut findings = study.identify(&sources, &validation)?;
    if arguments.online && findings.identification.is_ok() {
        let settings = setup.recursive()?;
        let trace = Trace::replay(&settings, &*study.model, &study.freedom.map, &findings.train).map_err(IdentifyError::from)?;
        findings.online = Some(trace);
    }
    conclude(&study, findings, folder.as_ref(), &arguments.study.require, shared, console)
}

/// Writes and prints a study's findings; gates come last, so that a failed gate still leaves the whole result.
pub(super) fn conclude(
    study: &Study,
    findings: Findings,
    folder: Option<&Folder>,
    require: &[String],
    shared: &Shared,
    console: &Console,
) -> Result<(), Error> {
    if let Some(folder) = folder {
        let path = folder.write("report.html", &page::study_page(study, &findings))?;
        if shared.open {
            browser::open(&path, console);
        }
    }
    let found = match &findings.identification {
        Ok(found) => found,
        Err(error) => return Err(error.clone().into()),
    };
    let document = documents::identify(&findings, found);
    if let Some(folder) = folder {
        folder.write("result.json", &format!("{document:#}\n"))?;
        folder.write("model.toml", &ModelFile::new(&study.model_table, study.robot.clone(), found).to_toml())?;
        let mut parts = vec![("train", &found.train)];
        parts.extend(found.held_out.as_ref().map(|v| ("validate", v)));
        if let Some(trace) = &findings.online {
            folder.write("online.csv", &trace.csv())?;
        }
        let series = folder.write("simulated.csv", &series_csv(&findings.train, &parts))?;
        console.note(&format!("wrote {} beside result.json, model.toml and {}", folder.path("report.html").display(), series.display()));
    }
    console.document(&document);
    console.result(&text::identification(&findings, found));
    for warning in &findings.warnings {
        console.note(&format!("warning: {warning}"));
    }
    check_gates(&document, require)
}

/// Fails unless every number named reaches its bound.
pub(super) fn check_gates(document: &Value, require: &[String]) -> Result<(), Error> {
    for gate in require {
        let (key, bound) = split(gate, "--require", "fit.validate.v=95")?;
        let bound: f64 = bound.parse().map_err(|_| Error::Usage(format!("--require {gate}: `{bound}` is not a number")))?;
        let found = documents::lookup(document, key).ok_or_else(|| Error::Usage(format!("--require {gate}: the result has no `{key}`")))?;
        match found.as_f64() {
            Some(value) if value >= bound => {}
            Some(value) => return Err(Error::Gate(format!("{key} is {value:.3}, below {bound}"))),
            None => return Err(Error::Gate(format!("{key} is {found}, not a number of at least {bound}"))),
        }
    }
    Ok(())
}
