//! `plugins`: what can be named in a configuration.

use clap::Args;
use serde_json::{Value, json};

use super::Shared;
use super::console::Console;
use super::setup::Setup;
use crate::error::Error;
use crate::registry::{Entry, KINDS};

#[derive(Debug, Args)]
pub(super) struct Arguments {}

pub(super) fn run(_: &Arguments, shared: &Shared, console: &Console) -> Result<(), Error> {
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
    format!("  {:<18} {} ({})\n", entry.name, entry.about, entry.source)
}

fn entry(entry: &Entry) -> Value {
    json!({ "name": entry.name, "about": entry.about, "source": entry.source })
}
