//! `inspect`: what is in a recording.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use serde_json::{Value, json};
use wheelwright_core::recording::{Column, Recording};

use super::Shared;
use super::console::Console;
use super::setup::{ReadArguments, Setup};
use crate::documents;
use crate::error::Error;
use crate::source::Source;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Recording: a file or bag folder
    #[arg(value_name = "RECORDING")]
    recording: PathBuf,
    #[command(flatten)]
    read: ReadArguments,
}

pub(super) fn run(arguments: &Arguments, shared: &Shared, console: &Console) -> Result<(), Error> {
    let setup = Setup::load(shared)?;
    let source = Source::open(&arguments.recording, &setup.read_options(&arguments.read)?)?;
    let steps = Steps::of(&source.recording);
    let document = document(&source, &steps);
    if let Some(folder) = setup.folder(shared)? {
        folder.write("result.json", &format!("{document:#}\n"))?;
    }
    console.document(&document);
    console.result(&text(&source, &steps));
    for warning in &source.recording.warnings {
        console.note(&format!("warning: {warning}"));
    }
    Ok(())
}

/// Steps between rows, inside segments \[s\].
#[derive(Debug, Clone, Copy)]
struct Steps {
    shortest: f64,
    median: f64,
    longest: f64,
    /// Share of the steps that differ from the median by more than a tenth of it.
    uneven: f64,
}

impl Steps {
    fn of(recording: &Recording) -> Self {
        let rows = recording.segments().iter().map(|s| &recording.time()[s.rows.clone()]);
        let steps: Vec<f64> = rows.flat_map(|t| t.windows(2).map(|w| w[1] - w[0])).collect();
        let median = recording.period();
        let uneven = steps.iter().filter(|s| (**s - median).abs() > 0.1 * median).count() as f64 / steps.len().max(1) as f64;
        let extreme = |pick: fn(f64, f64) -> f64| steps.iter().copied().reduce(pick).unwrap_or(0.0);
        Self { shortest: extreme(f64::min), median, longest: extreme(f64::max), uneven }
    }
}

/// How a column moves.
struct Motion {
    least: f64,
    most: f64,
    /// Changes of sign, not counting values within a hundredth of the largest.
    reversals: usize,
    /// Share of rows on which it differs from the row before.
    changing: f64,
}

impl Motion {
    fn of(column: &Column) -> Self {
        let least = column.values.iter().copied().fold(f64::INFINITY, f64::min);
        let most = column.values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let dead = 0.01 * least.abs().max(most.abs());
        let signs: Vec<bool> = column.values.iter().filter(|v| v.abs() > dead).map(|v| *v > 0.0).collect();
        let reversals = signs.windows(2).filter(|w| w[0] != w[1]).count();
        let changes = column.values.windows(2).filter(|w| w[0] != w[1]).count();
        Self { least, most, reversals, changing: changes as f64 / (column.values.len() - 1).max(1) as f64 }
    }
}

fn document(source: &Source, steps: &Steps) -> Value {
    let recording = &source.recording;
    let columns = recording.columns().iter().map(|column| {
        let motion = Motion::of(column);
        json!({
            "name": column.name, "unit": column.unit, "min": motion.least, "max": motion.most,
            "reversals": motion.reversals, "changing": motion.changing,
        })
    });
    let streams = recording.streams.iter().map(|s| json!({ "name": s.name, "type": s.kind, "count": s.count, "used": s.used }));
    let segments = recording.segments().iter().map(|s| {
        let (first, last) = (recording.time()[s.rows.start], recording.time()[s.rows.end - 1]);
        json!({ "label": s.label, "samples": s.rows.len(), "from_s": first, "to_s": last })
    });
    let mut document = json!({ "schema": "wheelwright.inspect/1" });
    if let (Value::Object(all), Value::Object(facts)) = (&mut document, documents::recording(&source.facts)) {
        all.extend(facts);
    }
    document["period_s"] = json!({ "min": steps.shortest, "median": steps.median, "max": steps.longest, "uneven": steps.uneven });
    document["columns"] = columns.collect();
    document["streams"] = streams.collect();
    document["segment_list"] = segments.collect();
    document["warnings"] = json!(recording.warnings);
    document
}

fn text(source: &Source, steps: &Steps) -> String {
    let (recording, facts) = (&source.recording, &source.facts);
    let mut text = String::new();
    let _ = writeln!(text, "{}: {}", facts.path, facts.format);
    let _ = writeln!(
        text,
        "{} rows in {} segment(s), {:.2} s at {:.4} Hz (steps {:.2} to {:.2} ms, {:.1} % uneven)",
        facts.samples,
        facts.segments,
        facts.duration_s,
        facts.rate_hz,
        1e3 * steps.shortest,
        1e3 * steps.longest,
        100.0 * steps.uneven
    );
    if let Some(offset) = facts.clock.offset_s {
        let (median, high) = facts.clock.jitter_s.unwrap_or_default();
        let _ = writeln!(
            text,
            "clock: {}; log − stamp {:.3} ms, jitter above it {:.3} ms median, {:.3} ms at 95 %",
            facts.clock.source,
            1e3 * offset,
            1e3 * median,
            1e3 * high
        );
    }
    let _ = writeln!(text, "\n  {:<16} {:<6} {:>12} {:>12} {:>10} {:>10}", "column", "unit", "min", "max", "reversals", "changing");
    for column in recording.columns() {
        let m = Motion::of(column);
        let (share, unit) = (100.0 * m.changing, column.unit.as_str());
        let _ = writeln!(text, "  {:<16} {unit:<6} {:>12.5} {:>12.5} {:>10} {share:>8.1} %", column.name, m.least, m.most, m.reversals);
    }
    let unused: Vec<_> = recording.streams.iter().filter(|s| !s.used).collect();
    if !unused.is_empty() {
        let _ = writeln!(text, "\n  also in the file, not read:");
        for stream in unused {
            let _ = writeln!(text, "  {:<40} {:<36} {:>8}", stream.name, stream.kind, stream.count);
        }
    }
    text
}
