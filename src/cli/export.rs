//! `export`: an identified model for other tools.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::Shared;
use super::console::Console;
use super::setup::Setup;
use crate::error::Error;
use crate::export::{FORMATS, export};
use crate::model_file::ModelFile;
use crate::registry::ModelFailure;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Identified model, as `identify --out` writes it
    #[arg(value_name = "model.toml")]
    model: PathBuf,
    /// What to write
    #[arg(long, value_name = "FORMAT", value_parser = FORMATS)]
    to: String,
}

pub(super) fn run(arguments: &Arguments, shared: &Shared, console: &Console) -> Result<(), Error> {
    let setup = Setup::load(shared)?;
    let file = ModelFile::read(&arguments.model)?;
    let model = setup.registry.model(file.model.clone()).map_err(|e| match e {
        ModelFailure::Config(error) => Error::Config { file: arguments.model.clone(), position: None, error: error.inside("model") },
        ModelFailure::Model(error) => Error::Identify(error.into()),
    })?;
    let exported = export(&file, &*model, &arguments.to)?;
    exported.warnings.iter().for_each(|w| console.note(&format!("warning: {w}")));
    let path = setup.folder(shared)?.map(|folder| folder.write(exported.name, &exported.text)).transpose()?;
    console.document(&json!({
        "schema": "wheelwright.export/1",
        "format": arguments.to,
        "path": path.as_ref().map(|p| p.display().to_string()),
        "content": exported.text,
        "warnings": exported.warnings,
    }));
    match path {
        Some(path) => console.result(&format!("{}\n", path.display())),
        None => console.result(&exported.text),
    }
    Ok(())
}
