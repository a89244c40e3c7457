//! Every simulation and experiment of J. W. Laut, *A Dynamic Parameter Identification Method for Migrating Control Strategies
//! Between Heterogeneous Wheeled Mobile Robots* (2011), chapter 4, made again, on one page beside what the thesis states:
//!
//!     cargo run --release --example thesis [FOLDER]
//!
//! Each has its configuration in this folder, which `wheelwright track` or `wheelwright run` takes as it is.

mod cases;
mod errata;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use cases::{CASES, Case, Kind, Verdict};
use wheelwright::config::Config;
use wheelwright::control::migration::learn;
use wheelwright::control::plan::{ControlPlan, knowledge};
use wheelwright::control::run::Outcome;
use wheelwright::core::controller::Subject;
use wheelwright::core::drive::{DriveOptions, drive};
use wheelwright::core::identification::Identification;
use wheelwright::core::robot::Live;
use wheelwright::core::trajectory::Envelope;
use wheelwright::core::{Recording, RegressorModel};
use wheelwright::registry::{Registry, RobotFailure};
use wheelwright::report::figures;
use wheelwright::report::page::{Page, escape};
use wheelwright::report::table::Table;
use wheelwright::report::track::{distance, parameters, plane};

/// What a case gave.
pub(crate) enum Ran {
    Tracked(Box<Outcome>),
    Identified(Box<Identification>, Arc<dyn RegressorModel>),
    Driven(Box<Recording>),
}

/// Results so far, by the name of their case.
pub(crate) type Results = Vec<(&'static str, Ran)>;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).map_or_else(|| PathBuf::from("out/thesis"), PathBuf::from);
    std::fs::create_dir_all(&folder)?;
    let mut results: Results = Vec::new();
    for case in &CASES {
        println!("{}", case.name);
        results.push((case.name, run(case)?));
    }
    let verdicts: Vec<(String, Verdict)> = CASES.iter().map(|case| (case.judge)(&results)).collect();
    let path = folder.join("thesis.html");
    std::fs::write(&path, page(&results, &verdicts))?;
    for (case, (ours, verdict)) in CASES.iter().zip(&verdicts) {
        println!("{:<26} {:<16} {ours}", case.name, verdict.word());
    }
    println!("{}", path.display());
    Ok(())
}

fn run(case: &Case) -> Result<Ran, Box<dyn std::error::Error>> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/thesis").join(case.file);
    let settings: Vec<String> = case.set.iter().map(|s| (*s).to_owned()).collect();
    let config = Config::load(Some(&file), &settings)?;
    let registry = Registry::load(&config)?;
    let seed = config.sections.seed.unwrap_or_default();
    let connect = || -> Result<Option<Live>, Box<dyn std::error::Error>> {
        let Some(table) = config.sections.robot.clone() else { return Ok(None) };
        match registry.robot(table, seed) {
            Ok(robot) => Ok(Some(Live::new(robot))),
            Err(RobotFailure::Config(error)) => Err(config.error_in("robot", error).into()),
            Err(RobotFailure::Robot(error)) => Err(error.into()),
        }
    };
    if case.kind == Kind::Track {
        let mut robot = connect()?;
        let outcome = ControlPlan::read(&config, &registry)?.run(&config, None, robot.as_mut(), DriveOptions::default())?;
        return Ok(Ran::Tracked(Box::new(outcome)));
    }
    let mut robot = connect()?.ok_or("a robot is needed")?;
    let excitation = registry.excitation(config.sections.excitation.clone().unwrap_or_default())?;
    if case.kind == Kind::Drive {
        return Ok(Ran::Driven(Box::new(drive(&mut robot, &*excitation, DriveOptions::default())?)));
    }
    let solver = registry.solver(config.sections.solver.clone().unwrap_or_default())?;
    let known = knowledge(&config, &registry, "model", config.sections.model.clone().unwrap_or_default())?;
    let subject: Subject = known.subject(Vec::new(), None, Envelope::default());
    let found = learn(&mut robot, &*excitation, &subject, &*solver, DriveOptions::default())?;
    Ok(Ran::Identified(Box::new(found), subject.model))
}

fn page(results: &Results, verdicts: &[(String, Verdict)]) -> String {
    let mut page = Page::new("Laut 2011, chapter 4, made again", "our figures and numbers beside what the thesis states");
    page.push(
        "<p>The thesis gives no gains, amplitudes, durations, payloads or raw data, so its numbers can be met only where they do not hang on \
         them. Simulations integrate model and controller as one system; experiments run on robots from first principles with current-driven \
         motors, whose lags are those that the thesis identified.</p>",
    );
    let mut table = Table::new(&["Figure or table", "The thesis", "Here", "Verdict"]);
    for (case, (ours, verdict)) in CASES.iter().zip(verdicts) {
        let name = format!("<a href=\"#{}\">{}</a>", case.anchor(), escape(case.name));
        let wrapped = |html: String| format!("<div style=\"white-space:normal;min-width:11em\">{html}</div>");
        let verdict = format!("<b>{}</b>{}", verdict.word(), verdict.why());
        table.row(vec![name, wrapped(escape(case.states)), wrapped(escape(ours)), wrapped(verdict)]);
    }
    page.section("overview", "All of them", &table.html());
    page.section("errata", "What the printed formulas would give", &errata::html());
    for ((case, (_, ran)), (ours, _)) in CASES.iter().zip(results).zip(verdicts) {
        let (verb, shown) = match ran {
            Ran::Tracked(outcome) => ("track", plane(&[("actual", outcome)]) + &distance(&outcome.log).html() + &parameters(outcome)),
            Ran::Identified(found, model) => ("run", figures(&**model, found)),
            // Its steady speeds stand in the table.
            Ran::Driven(_) => ("record", String::new()),
        };
        let set: String = case.set.iter().map(|setting| format!(" --set '{setting}'")).collect();
        let text = format!(
            "<p>The thesis: {}<br>Here: {}</p>\n{shown}<p class=\"note\"><code>wheelwright {verb} examples/thesis/{}{}</code></p>",
            escape(case.states),
            escape(ours),
            escape(case.file),
            escape(&set)
        );
        page.section(&case.anchor(), case.name, &text);
    }
    page.finish("Made by the example `thesis` of wheelwright.")
}
