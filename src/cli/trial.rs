//! `trial`: `diagnose` on every case of a folder, without any key.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use clap::Args;
use rayon::prelude::*;
use serde_json::{Value, json};

use super::Shared;
use super::console::Console;
use super::diagnose::{QuestionArguments, inquiry};
use super::setup::{ReadArguments, Setup};
use crate::documents::{self, Context};
use crate::error::Error;
use crate::output::Folder;
use crate::score::HEADER;
use crate::source::Source;
use crate::trial::{Case, cases, check_seal, failure, header};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Folder of cases: folders with train.csv, validate.csv and, if there is one, robot.toml
    #[arg(value_name = "DIR")]
    cases: PathBuf,
    /// Folder for the answers, one CASE.json each
    #[arg(long, value_name = "DIR")]
    answers: PathBuf,
    /// SHA-256 of the key, kept in the answers' header: shows that the key was fixed before them
    #[arg(long, value_name = "KEY_SHA256")]
    seal: Option<String>,
    #[command(flatten)]
    question: QuestionArguments,
    #[command(flatten)]
    read: ReadArguments,
}

pub(super) fn run(arguments: &Arguments, shared: &Shared, console: &Console) -> Result<(), Error> {
    let setup = Setup::load(shared)?;
    if let Some(seal) = &arguments.seal {
        check_seal(seal)?;
    }
    // A wrong option is one error, not a failure of every case.
    crate::inquiry::library(&setup.registry, &arguments.question.without)?;
    let cases = cases(&arguments.cases)?;
    let folder = Folder::create(&arguments.answers)?;
    let mut document = header(&cases, &arguments.question.without, arguments.seal.as_deref())?;
    folder.write(HEADER, &format!("{document:#}\n"))?;
    let done = AtomicUsize::new(0);
    let answered: Vec<(String, bool)> = cases
        .par_iter()
        .map(|case| {
            let answer = answer(case, arguments, &setup, shared);
            folder.write(&format!("{}.json", case.name), &format!("{answer:#}\n"))?;
            let count = done.fetch_add(1, Ordering::Relaxed) + 1;
            console.progress(&format!("{count} of {} cases", cases.len()));
            let verdict = answer["verdict"].as_str().unwrap_or_default().to_owned();
            Ok((verdict, answer.get("failed").is_some()))
        })
        .collect::<Result<_, Error>>()?;
    console.end_progress();
    let count = |verdict: &str| answered.iter().filter(|(v, failed)| v == verdict && !failed).count();
    let verdicts = ["no_mismatch", "explained", "ambiguous", "unexplained"].map(|v| (v, count(v)));
    let failed = answered.iter().filter(|a| a.1).count();
    document["verdicts"] = verdicts.iter().map(|(v, n)| ((*v).to_owned(), json!(n))).collect();
    document["failed"] = json!(failed);
    console.document(&document);
    let list: Vec<String> = verdicts.iter().map(|(v, n)| format!("{v} {n}")).collect();
    console.result(&format!("{} cases: {}\n", cases.len(), list.join(", ")));
    if failed > 0 {
        let names = cases.iter().zip(&answered).filter(|(_, a)| a.1).map(|(c, _)| c.name.as_str()).collect::<Vec<_>>().join(", ");
        console.note(&format!("warning: {failed} could not be diagnosed and abstain, each with the reason in its answer: {names}"));
    }
    console.note(&format!("wrote {}", arguments.answers.display()));
    Ok(())
}

/// The answer to a case, also where there is none. `seconds` is the one part that differs between runs.
fn answer(case: &Case, arguments: &Arguments, setup: &Setup, shared: &Shared) -> Value {
    let started = Instant::now();
    // Not even a defect of the program may cost the other cases their answers.
    let attempt = catch_unwind(AssertUnwindSafe(|| diagnose(case, arguments, setup, shared)));
    let mut answer = match attempt {
        Ok(Ok(answer)) => answer,
        Ok(Err(error)) => failure(&error.to_string()),
        Err(_) => failure("the program met a defect of its own; please report it with this case"),
    };
    answer["case"] = json!(case.name);
    answer["seconds"] = json!((1e3 * started.elapsed().as_secs_f64()).round() / 1e3);
    answer
}

fn diagnose(case: &Case, arguments: &Arguments, setup: &Setup, shared: &Shared) -> Result<Value, Error> {
    let read = setup.read_options(&arguments.read)?;
    let open = |name: &str| case.file(name).map(|path| Source::open(&path, &read)).transpose();
    let sources: Vec<Source> = open("train.csv")?.into_iter().collect();
    let validation: Vec<Source> = open("validate.csv")?.into_iter().collect();
    let Some(first) = sources.first() else { return Err(Error::TooLittle("train.csv is gone".to_owned())) };
    let question =
        QuestionArguments { robot: case.file("robot.toml").or_else(|| arguments.question.robot.clone()), ..arguments.question.clone() };
    let inquiry = inquiry(&question, None, first, setup, shared)?;
    let found = inquiry.diagnose(&sources, &validation)?;
    let facts = |sources: &[Source]| sources.iter().map(|s| s.facts.clone()).collect::<Vec<_>>();
    let warnings: Vec<String> = sources.iter().chain(&validation).flat_map(|s| s.facts.warnings.clone()).collect();
    Ok(documents::diagnose(
        &found,
        &Context {
            model: inquiry.model.name(),
            compared_with: "identified",
            recordings: &facts(&sources),
            validation_recordings: &facts(&validation),
            simulation: &Value::Null,
            warnings: &warnings,
        },
    ))
}
