//! The report page of a study.

use super::diagnose::Diagnosed;
use crate::report::{self, Outcome, RecordingFacts, ReportInput};
use crate::study::{Findings, Study};

/// The page, also when there is no identification to show.
pub(super) fn study_page(study: &Study, findings: &Findings) -> String {
    let failure = findings.identification.as_ref().err().map(ToString::to_string);
    let outcome = match &findings.identification {
        Ok(found) => Outcome::Identified(found),
        Err(_) => Outcome::Failed { error: failure.as_deref().unwrap_or_default(), data: &findings.train },
    };
    let recordings: Vec<_> = findings.recordings.iter().chain(&findings.validation_recordings).cloned().collect();
    let title = recordings.iter().map(|r| file_name(&r.path)).collect::<Vec<_>>().join(", ");
    let done = if failure.is_some() { "could not be identified by" } else { "identified by" };
    let subtitle = format!("{} {done} {}", study.model.name(), study.solver.name());
    let facts =
        [("held out".to_owned(), format!("{} % of the samples", 100.0 * study.holdout)), ("seed".to_owned(), study.seed.to_string())];
    let online = findings.online.as_ref().map(|trace| report::online::html(trace, &findings.train));
    let sections: Vec<_> = online.into_iter().map(|body| ("online", "Estimates over time", body)).collect();
    let input = ReportInput {
        title: &title,
        subtitle: &subtitle,
        command: &command_line(),
        version: env!("CARGO_PKG_VERSION"),
        model: &*study.model,
        model_about: &study.model_about,
        outcome,
        recordings: &recordings,
        steps: &[],
        evidence: &findings.evidence.sentences(),
        warnings: &findings.evidence.concerns(),
        facts: &facts,
    };
    report::html_with(&input, &sections)
}

/// The page of a diagnosis.
pub(super) fn diagnosis_page(diagnosed: &Diagnosed) -> String {
    let recordings: Vec<_> = diagnosed
        .sources
        .iter()
        .map(|s| RecordingFacts { used_for: "diagnosis".to_owned(), ..s.facts.clone() })
        .chain(diagnosed.validation.iter().map(|s| RecordingFacts { used_for: "validation".to_owned(), ..s.facts.clone() }))
        .collect();
    let title = diagnosed.sources.iter().map(|s| file_name(&s.facts.path)).collect::<Vec<_>>().join(", ");
    let held_out = match diagnosed.validation.is_empty() {
        true => format!("{} % of the samples", 100.0 * diagnosed.inquiry.holdout),
        false => format!("{} recording(s) of its own", diagnosed.validation.len()),
    };
    let facts = [("held out".to_owned(), held_out), ("seed".to_owned(), diagnosed.inquiry.seed.to_string())];
    report::diagnosis::html(&report::diagnosis::Input {
        title: &title,
        command: &command_line(),
        version: env!("CARGO_PKG_VERSION"),
        model: diagnosed.inquiry.model.name(),
        found: &diagnosed.found,
        comparison: diagnosed.comparison.as_ref(),
        recordings: &recordings,
        warnings: &diagnosed.warnings,
        facts: &facts,
    })
}

fn file_name(path: &str) -> String {
    std::path::Path::new(path).file_name().map_or_else(|| path.to_owned(), |name| name.to_string_lossy().into_owned())
}

/// The command that makes the page again, as the user typed it.
pub(super) fn command_line() -> String {
    let quoted = |a: String| if a.contains(char::is_whitespace) { format!("'{a}'") } else { a };
    std::iter::once("wheelwright".to_owned()).chain(std::env::args().skip(1).map(quoted)).collect::<Vec<_>>().join(" ")
}
