//! `plugins`: what can be named in a configuration; `plugins check`: whether a library keeps its promises.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use serde_json::{Value, json};
use wheelwright_plugin::check::{Checked, Outcome, Report, check};
use wheelwright_plugin::{Library, PluginEntry};

use super::Shared;
use super::console::Console;
use super::setup::Setup;
use crate::error::Error;
use crate::registry::{Entry, KINDS};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    action: Option<Action>,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Open everything a shared library offers and run the conformance checks; it connects robots and commands them to stand
    Check {
        /// Shared library
        #[arg(value_name = "PATH")]
        path: PathBuf,
    },
}

pub(super) fn run(arguments: &Arguments, shared: &Shared, console: &Console) -> Result<(), Error> {
    match &arguments.action {
        None => list(shared, console),
        Some(Action::Check { path }) => check_library(path, shared, console),
    }
}

fn list(shared: &Shared, console: &Console) -> Result<(), Error> {
    let registry = Setup::load(shared)?.registry;
    let mut document = json!({ "schema": "wheelwright.plugins/1" });
    let mut text = String::new();
    for kind in KINDS {
        let entries = registry.list(kind);
        text.push_str(&format!("{kind}\n{}\n", entries.iter().map(line).collect::<String>()));
        document[kind] = entries.iter().map(entry).collect();
    }
    console.document(&document);
    console.result(&text);
    Ok(())
}

fn line(entry: &Entry) -> String {
    let place = entry.place.map_or_else(String::new, |place| format!("{place:?}, ").to_lowercase());
    format!("  {:<18} {} ({place}{})\n", entry.name, entry.about, entry.source)
}

fn entry(entry: &Entry) -> Value {
    let mut document = json!({ "name": entry.name, "about": entry.about, "source": entry.source });
    if let Some(place) = entry.place {
        document["place"] = json!(place);
    }
    document
}

/// Robots and models that need settings take them from the configuration's `[robot]` and `[model]`.
fn check_library(path: &Path, shared: &Shared, console: &Console) -> Result<(), Error> {
    let setup = Setup::load(shared)?;
    let settings: Vec<_> = [&setup.config.sections.robot, &setup.config.sections.model].into_iter().flatten().cloned().collect();
    let report = check(Library::load(Path::new(""), &PluginEntry::new(path))?, &settings)?;
    console.document(&checked_document(&report));
    console.result(&report.to_string());
    match report.checked.iter().find(|c| matches!(c.outcome, Outcome::Broken(_))) {
        None => Ok(()),
        Some(broken) => Err(Error::Nonconforming { library: path.to_owned(), name: broken.name.clone() }),
    }
}

fn checked_document(report: &Report) -> Value {
    let outcome = |c: &Checked| match &c.outcome {
        Outcome::Kept => json!({ "outcome": "ok" }),
        Outcome::NeedsSettings(reason) => json!({ "outcome": "needs-settings", "reasons": [reason] }),
        Outcome::Broken(reasons) => json!({ "outcome": "broken", "reasons": reasons }),
    };
    let checked = report.checked.iter().map(|c| {
        let mut document = json!({ "kind": c.kind.word(), "name": c.name, "about": c.about });
        if let (Value::Object(all), Value::Object(outcome)) = (&mut document, outcome(c)) {
            all.extend(outcome);
        }
        document
    });
    json!({ "schema": "wheelwright.plugins-check/1", "library": report.library, "checked": checked.collect::<Vec<_>>() })
}
