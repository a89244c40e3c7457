//! Results as text for a terminal.

use std::fmt::Write;

use wheelwright_core::ceiling::OutputCeiling;
use wheelwright_core::identification::{Estimate, Identification};
use wheelwright_core::validation::Validation;

use crate::study::Findings;

/// Parameters and fits of an identification.
pub(super) fn identification(findings: &Findings, found: &Identification) -> String {
    let mut text = String::new();
    for facts in &findings.recordings {
        let _ = writeln!(
            text,
            "{}: {} samples, {:.1} s at {:.4} Hz in {} segment(s)",
            facts.path, facts.samples, facts.duration_s, facts.rate_hz, facts.segments
        );
    }
    let _ = writeln!(text, "model {}, solver {}\n", found.model, found.solver);
    for estimate in &found.estimates {
        let _ = writeln!(text, "  {}", parameter(estimate));
    }
    let names: Vec<String> = findings.train.outputs.iter().map(|c| c.name.to_string()).collect();
    let _ = writeln!(text, "\nfree-run fit   {}", names.iter().map(|n| format!("{n:>12}")).collect::<String>());
    if let Some(held_out) = &found.held_out {
        let _ = writeln!(text, "  held out     {}", fits(held_out));
    }
    let _ = writeln!(text, "  fitted       {}", fits(&found.train));
    if let Some(ceiling) = &findings.evidence.ceiling {
        let row = |pick: fn(&OutputCeiling) -> Option<f64>| ceiling.iter().map(|c| percent(pick(c))).collect::<String>();
        let _ = writeln!(text, "  ceiling      {}   (the best that any model could reach)", row(|c| c.fit));
        let _ = writeln!(text, "  NARX         {}   (a short black-box model)", row(|c| c.narx));
    }
    if let Some(trace) = &findings.online {
        let _ = writeln!(text, "\n{}", trace.statement());
    }
    for sentence in findings.evidence.sentences() {
        let _ = writeln!(text, "\n{sentence}");
    }
    text
}

fn parameter(estimate: &Estimate) -> String {
    let spread = match (estimate.std, estimate.ci95) {
        (Some(std), Some((low, high))) => format!("± {std:<11.3e} 95 % [{low:.5}, {high:.5}]"),
        _ => "(no honest interval from this solver)".to_owned(),
    };
    let bound = if estimate.at_bound { "  at its bound" } else { "" };
    format!("{:<10} {:>12.6} {:<8} {spread}{bound}", estimate.parameter.name, estimate.value, estimate.parameter.unit)
}

fn fits(validation: &Validation) -> String {
    validation.fit.iter().map(|fit| percent(*fit)).collect()
}

fn percent(fit: Option<f64>) -> String {
    fit.map_or_else(|| format!("{:>12}", "—"), |f| format!("{f:>10.2} %"))
}
