//! `wheelwright.diagnose/1`: the contract's keys, and what the report shows besides.

use serde_json::{Map, Value, json};
use wheelwright_diagnosis::finding::{Diagnosis, Experiment, Finding, FoundParameter, Location};

use crate::documents::recording;
use crate::report::RecordingFacts;

/// What a diagnosis was made of and compared with.
#[derive(Debug, Clone, Copy)]
pub struct Context<'a> {
    /// Name of the base model.
    pub model: &'a str,
    /// What was compared with: `identified`, `model`, `recording`.
    pub compared_with: &'a str,
    /// The recordings that were diagnosed.
    pub recordings: &'a [RecordingFacts],
    /// Recordings that only validate.
    pub validation_recordings: &'a [RecordingFacts],
    /// What a recording of another simulator says beside; `null` without.
    pub simulation: &'a Value,
    /// Warnings besides the diagnosis' own.
    pub warnings: &'a [String],
}

/// The document of a diagnosis.
pub fn diagnose(found: &Diagnosis, context: &Context<'_>) -> Value {
    let mut document = answer(found, context.warnings);
    let besides = json!({
        "model": context.model,
        "compared_with": context.compared_with,
        "simulation": context.simulation,
        "recordings": context.recordings.iter().map(recording).collect::<Vec<_>>(),
        "validation_recordings": context.validation_recordings.iter().map(recording).collect::<Vec<_>>(),
    });
    extend(&mut document, besides);
    document
}

/// The keys that `diagnose` and `trial` have in common.
pub fn answer(found: &Diagnosis, warnings: &[String]) -> Value {
    let outputs: Vec<&str> = found.training.measured.outputs.iter().map(|c| c.name.as_ref()).collect();
    let by_output =
        |values: &[f64]| -> Value { Value::Object(outputs.iter().zip(values).map(|(n, v)| ((*n).to_owned(), json!(v))).collect()) };
    let fit = &found.fit;
    let warnings: Vec<&String> = found.warnings.iter().chain(warnings).collect();
    json!({
        "schema": "wheelwright.diagnose/1",
        "verdict": found.verdict,
        "effects": effects(&found.effects),
        "where": location(&found.location),
        "fit": {
            "before": by_output(&fit.before),
            "after": by_output(&fit.after),
            "noise_ceiling": fit.noise_ceiling.as_deref().map(by_output),
            "narx": fit.narx.as_deref().map(by_output),
        },
        "next_experiment": found.next_experiment.as_ref().map(experiment),
        "warnings": warnings,
        "headline": found.headline,
        "partial": effects(&found.partial),
        "waterfall": found.waterfall.iter().map(|r| json!({ "effects": r.effects, "fit": by_output(&r.fit) })).collect::<Vec<_>>(),
        "untestable": found.untestable,
        "base": found.base.iter().map(|p| json!({
            "name": p.name, "unit": p.unit, "before": p.before, "after": p.after, "ci95": p.ci95,
        })).collect::<Vec<_>>(),
        "noise": by_output(&found.noise),
        "ranking": found.ranking.iter().map(|(name, gain)| json!({ "name": name, "delta_bic": gain })).collect::<Vec<_>>(),
    })
}

/// Each effect once: what was found of it on several sides or axes is put together.
fn effects(findings: &[Finding]) -> Vec<Value> {
    let mut names: Vec<&str> = Vec::new();
    for finding in findings {
        if !names.contains(&finding.name.as_str()) {
            names.push(&finding.name);
        }
    }
    let of = |name: &&str| findings.iter().filter(|f| f.name == *name).collect::<Vec<_>>();
    names.iter().map(of).filter_map(|parts| effect(&parts)).collect()
}

fn effect(parts: &[&Finding]) -> Option<Value> {
    let first = parts.first()?;
    let statements: Vec<&str> = parts.iter().map(|p| p.statement.as_str()).collect();
    let gains: Option<Vec<f64>> = parts.iter().map(|p| p.holdout_gain).collect();
    let alternatives = || parts.iter().flat_map(|p| &p.alternatives);
    Some(json!({
        "name": first.name,
        "statement": statements.join("; and "),
        "parameters": parts.iter().flat_map(|p| &p.parameters).map(parameter).collect::<Vec<_>>(),
        "evidence": {
            "delta_bic": parts.iter().map(|p| p.delta_bic).sum::<f64>(),
            "holdout_gain": gains.map(|gains| gains.iter().sum::<f64>()),
        },
        "alternatives": alternatives().map(|a| &a.name).collect::<Vec<_>>(),
        "alternatives_why": alternatives().collect::<Vec<_>>(),
        "place": first.place,
    }))
}

/// A parameter with its side or axis as a key of its own: `"wheel": "left"`.
fn parameter(found: &FoundParameter) -> Value {
    let mut document = json!({ "name": found.name, "value": found.value, "ci95": found.ci95, "unit": found.unit });
    if let Some((kind, which)) = &found.label {
        extend(&mut document, json!({ *kind: which }));
    }
    document
}

fn location(place: &Location) -> Value {
    let channels: Map<String, Value> = place.channels.iter().map(|(name, share)| (name.clone(), json!(share))).collect();
    json!({
        "channels": channels,
        "times": place.times,
        "regions": place.regions,
        "frequencies_hz": place.frequencies_hz,
        "statement": place.statement,
        "wheels": place.wheels.map(|(left, right)| json!({ "left": left, "right": right })),
        "changes": place.changes.iter().map(|c| json!({ "time_s": c.time, "interval_s": c.interval, "words": c.words })).collect::<Vec<_>>(),
        "tests": place.tests,
    })
}

fn experiment(next: &Experiment) -> Value {
    let commands: Map<String, Value> = next.commands.iter().map(|(name, values)| (name.clone(), json!(values))).collect();
    let separates = next.separates.iter().map(|(a, b, by)| json!({ "between": [a, b], "evidence": by }));
    json!({
        "statement": next.statement,
        "time": next.time,
        "commands": commands,
        "separates": separates.collect::<Vec<_>>(),
    })
}

/// Adds the keys of another object.
pub(super) fn extend(document: &mut Value, more: Value) {
    if let (Value::Object(all), Value::Object(more)) = (document, more) {
        all.extend(more);
    }
}
