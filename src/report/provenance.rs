//! Where the data came from, what was done to it, and how to do it again.

use wheelwright_core::recording::ClockReport;

use crate::report::number::{self, THIN};
use crate::report::page::{escape, prose};
use crate::report::table::facts;
use crate::report::{Outcome, RecordingFacts, ReportInput};

/// Steps before and inside the solver, in order.
pub(super) fn steps(input: &ReportInput<'_>) -> String {
    let solver: &[String] = match input.outcome {
        Outcome::Identified(found) => &found.solution.steps,
        Outcome::Failed { .. } => &[],
    };
    let items: String = input.steps.iter().chain(solver).map(|step| format!("<li>{}</li>", prose(step))).collect();
    if items.is_empty() { items } else { format!("<ol class=\"steps\">{items}</ol>\n") }
}

/// Sentences that stand beside the result.
pub(super) fn evidence(sentences: &[String]) -> String {
    let items: String = sentences.iter().map(|sentence| format!("<li>{}</li>", escape(sentence))).collect();
    if items.is_empty() { items } else { format!("<ul class=\"evidence\">{items}</ul>\n") }
}

/// A card a recording.
pub(super) fn recordings(recordings: &[RecordingFacts]) -> String {
    let card = |r: &RecordingFacts| {
        let mut pairs = vec![
            ("used for".to_owned(), r.used_for.clone()),
            ("format".to_owned(), r.format.clone()),
            ("samples".to_owned(), number::count(r.samples)),
            ("segments".to_owned(), number::count(r.segments)),
            ("duration".to_owned(), format!("{}{THIN}s", number::significant(r.duration_s, 4))),
            ("rate".to_owned(), format!("{}{THIN}Hz", number::significant(r.rate_hz, 4))),
            ("clock".to_owned(), clock(&r.clock)),
            ("SHA-256".to_owned(), r.sha256.clone()),
        ];
        pairs.retain(|(_, text)| !text.is_empty());
        format!("<article class=\"recording\"><h3>{}</h3>{}</article>\n", escape(&r.path), facts(&pairs))
    };
    recordings.iter().map(card).collect()
}

/// Clock findings in words; nothing if nothing is known.
fn clock(clock: &ClockReport) -> String {
    let milliseconds = |s: f64| format!("{}{THIN}ms", number::significant(1e3 * s, 3));
    let mut parts = vec![clock.source.clone()];
    if let Some(offset) = clock.offset_s {
        parts.push(format!("recorder's clock {} against it", milliseconds(offset)));
    }
    if let Some((median, high)) = clock.jitter_s {
        parts.push(format!("jitter {} (median), {} (95 %)", milliseconds(median), milliseconds(high)));
    }
    parts.retain(|p| !p.is_empty());
    parts.join("; ")
}

/// Settings, command line and version.
pub(super) fn repeat(input: &ReportInput<'_>) -> String {
    let command = if input.command.is_empty() { String::new() } else { format!("<pre>{}</pre>\n", escape(input.command)) };
    let mut pairs = vec![("model".to_owned(), input.model.name().to_owned())];
    if let Outcome::Identified(found) = input.outcome {
        pairs.push(("solver".to_owned(), found.solver.clone()));
    }
    pairs.extend(input.facts.iter().cloned());
    pairs.push(("version".to_owned(), input.version.to_owned()));
    format!("{command}{}", facts(&pairs))
}
