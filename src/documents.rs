//! The JSON documents of the contract.

mod diagnosis;
#[cfg(test)]
#[path = "documents/tests.rs"]
mod tests;

use serde_json::{Map, Value, json};
use wheelwright_core::channel::Channel;
use wheelwright_core::identification::Identification;
use wheelwright_core::validation::Validation;

use crate::error::Error;
use crate::report::RecordingFacts;
use crate::study::Findings;

pub use diagnosis::{Context, answer, diagnose};

/// `wheelwright.identify/1`.
pub fn identify(findings: &Findings, found: &Identification) -> Value {
    let parameters = found.estimates.iter().enumerate().map(|(i, e)| {
        json!({
            "name": e.parameter.name,
            "value": e.value,
            "std": e.std,
            "ci95": e.ci95.map(|(low, high)| [low, high]),
            "unit": e.parameter.unit,
            "identifiable": findings.evidence.identifiable(i),
            "at_bound": e.at_bound,
        })
    });
    let mut document = json!({
        "schema": "wheelwright.identify/1",
        "model": found.model,
        "solver": found.solver,
        "parameters": parameters.collect::<Vec<_>>(),
        "fit": {
            "train": fit(&findings.train.outputs, &found.train),
            "validate": found.held_out.as_ref().map(|v| fit(&findings.train.outputs, v)),
        },
        "recordings": findings.recordings.iter().map(recording).collect::<Vec<_>>(),
        "validation_recordings": findings.validation_recordings.iter().map(recording).collect::<Vec<_>>(),
        "status": found.solution.status,
        "condition": number(found.solution.condition),
        "steps": found.solution.steps,
        "warnings": findings.warnings,
    });
    diagnosis::extend(&mut document, findings.evidence.document());
    if let Some(trace) = &findings.online {
        document["online"] = trace.document();
    }
    document
}

/// Fit in percent by output name; `null` where there is none.
pub fn fit(outputs: &[Channel], validation: &Validation) -> Value {
    let each = outputs.iter().zip(&validation.fit).map(|(c, fit)| (c.name.to_string(), json!(fit)));
    Value::Object(each.collect::<Map<_, _>>())
}

/// A recording's facts.
pub fn recording(facts: &RecordingFacts) -> Value {
    json!({
        "path": facts.path,
        "format": facts.format,
        "samples": facts.samples,
        "segments": facts.segments,
        "duration_s": facts.duration_s,
        "rate_hz": facts.rate_hz,
        "sha256": facts.sha256,
        "clock": { "source": facts.clock.source, "offset_s": facts.clock.offset_s, "jitter_s": facts.clock.jitter_s.map(|(m, h)| [m, h]) },
    })
}

/// `wheelwright.error/1`, so that `--json` prints one document whatever happens.
pub fn error(error: &Error) -> Value {
    json!({ "schema": "wheelwright.error/1", "status": error.status(), "message": error.to_string() })
}

/// JSON knows no infinity: it becomes `null`.
pub fn number(value: f64) -> Value {
    if value.is_finite() { json!(value) } else { Value::Null }
}

/// Looks up a dotted path such as `fit.validate.v`.
pub fn lookup<'a>(document: &'a Value, path: &str) -> Option<&'a Value> {
    path.split('.').try_fold(document, |value, key| match value {
        Value::Array(items) => key.parse::<usize>().ok().and_then(|i| items.get(i)),
        _ => value.get(key),
    })
}
