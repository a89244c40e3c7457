//! Results as text for a terminal.

use std::fmt::Write;

use wheelwright_core::ceiling::OutputCeiling;
use wheelwright_core::identification::{Estimate, Identification};
use wheelwright_core::validation::Validation;
use wheelwright_diagnosis::Verdict;
use wheelwright_diagnosis::finding::{Diagnosis, Finding};

use crate::inquiry::Comparison;
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
    match fit {
        None => format!("{:>12}", "—"),
        Some(f) if f.is_finite() => format!("{f:>10.2} %"),
        // The run left the range of numbers.
        Some(_) => format!("{:>12}", "diverges"),
    }
}

/// A verdict as the documents spell it.
pub(super) fn verdict(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::NoMismatch => "no_mismatch",
        Verdict::Explained => "explained",
        Verdict::Ambiguous => "ambiguous",
        Verdict::Unexplained => "unexplained",
    }
}

/// A diagnosis: the sentence, the effects, the proof, where, and what to do next.
pub(super) fn diagnosis(found: &Diagnosis, comparison: Option<&Comparison>) -> String {
    let mut text = format!("{}: {}\n", verdict(found.verdict), found.headline);
    for finding in &found.effects {
        effect(&mut text, finding, &found.headline);
    }
    for finding in &found.partial {
        let _ = writeln!(text, "\na part of it looks like {}: {}", finding.name, finding.statement);
    }
    for sentence in comparison.iter().flat_map(|c| &c.sentences) {
        let _ = writeln!(text, "\n{sentence}");
    }
    proof(&mut text, found);
    if !found.location.statement.is_empty() {
        let _ = writeln!(text, "\nwhere: {}", found.location.statement);
    }
    if let Some(next) = &found.next_experiment {
        let _ = writeln!(text, "\nnext: {}", next.statement);
    }
    if !found.untestable.is_empty() {
        // One effect may stand in the library several times, once a side: it is named once.
        let mut names: Vec<&str> = Vec::new();
        for name in found.untestable.iter().map(|u| u.name.as_str()) {
            if !names.contains(&name) && found.effects.iter().all(|f| f.name != name) {
                names.push(name);
            }
        }
        let _ = writeln!(text, "\nnot testable with this recording: {}", names.join(", "));
    }
    text
}

fn effect(text: &mut String, finding: &Finding, headline: &str) {
    let _ = writeln!(text, "\n{}", finding.name);
    // A single effect's statement is the headline already.
    if !headline.contains(&finding.statement) {
        let _ = writeln!(text, "  {}", finding.statement);
    }
    for p in &finding.parameters {
        let side = p.label.as_ref().map(|(kind, which)| format!("  ({kind} {which})")).unwrap_or_default();
        let interval = p.ci95.map_or_else(|| "(no interval)".to_owned(), |(low, high)| format!("95 % [{low:.5}, {high:.5}]"));
        let unit = if p.unit == "1" { "" } else { &p.unit };
        let _ = writeln!(text, "  {:<16} {:>12.6} {unit:<8} {interval}{side}", p.name, p.value);
    }
    for alternative in &finding.alternatives {
        let _ = writeln!(text, "  or {}: {}", alternative.name, alternative.because);
    }
}

/// Held-out fits: before, effect by effect, after, and what could be reached at most.
fn proof(text: &mut String, found: &Diagnosis) {
    let names: String = found.training.measured.outputs.iter().map(|c| format!("{:>12}", c.name)).collect();
    let row = |values: &[f64]| values.iter().map(|v| percent(Some(*v))).collect::<String>();
    let which = if found.held_out.is_some() { "held-out fit" } else { "fit (nothing held out)" };
    let _ = writeln!(text, "\n{which:<30}{names}");
    let _ = writeln!(text, "  {:<28}{}", "before", row(&found.fit.before));
    for rung in found.waterfall.iter().filter(|r| !r.effects.is_empty()) {
        let last = rung.effects.last().map(String::as_str).unwrap_or_default();
        let _ = writeln!(text, "  {:<28}{}", format!("+ {last}"), row(&rung.fit));
    }
    if found.waterfall.is_empty() && !found.effects.is_empty() {
        let _ = writeln!(text, "  {:<28}{}", "after", row(&found.fit.after));
    }
    if let Some(ceiling) = &found.fit.noise_ceiling {
        let _ = writeln!(text, "  {:<28}{}", "noise ceiling", row(ceiling));
    }
    if let Some(narx) = &found.fit.narx {
        let _ = writeln!(text, "  {:<28}{}", "NARX", row(narx));
    }
}

#[cfg(test)]
mod tests {
    use super::percent;

    #[test]
    fn a_run_that_left_the_range_of_numbers_has_no_percentage() {
        assert_eq!(percent(Some(f64::NAN)).trim(), "diverges");
        assert_eq!(percent(Some(98.765)).trim(), "98.77 %");
        assert_eq!(percent(None).trim(), "—");
    }
}
