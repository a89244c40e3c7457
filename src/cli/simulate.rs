//! `simulate`: free-run simulation of an identified model, driven by a recording's commands.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use wheelwright_core::dataset::Dataset;
use wheelwright_core::effect::Effect;
use wheelwright_core::model::RegressorModel;
use wheelwright_core::recording::{Column, Recording, RecordingError, Source as RecordingOrigin};
use wheelwright_core::validation::{Comparison, Validation, validate, validate_with_effects};

use super::Shared;
use super::console::Console;
use super::setup::{ReadArguments, Setup};
use crate::documents;
use crate::error::Error;
use crate::model_file::ModelFile;
use crate::registry::{ModelFailure, Registry};
use crate::source::{Source, headings};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Identified model, as `identify --out` writes it
    #[arg(value_name = "model.toml")]
    model: PathBuf,
    /// Recording whose commands drive the model
    #[arg(long, value_name = "RECORDING")]
    commands: PathBuf,
    #[command(flatten)]
    read: ReadArguments,
}

pub(super) fn run(arguments: &Arguments, shared: &Shared, console: &Console) -> Result<(), Error> {
    let setup = Setup::load(shared)?;
    let file = ModelFile::read(&arguments.model)?;
    let in_file = |error| Error::Config { file: arguments.model.clone(), position: None, error };
    let model = setup.registry.model(file.model.clone()).map_err(|e| match e {
        ModelFailure::Config(error) => in_file(error.inside("model")),
        ModelFailure::Model(error) => Error::Identify(error.into()),
    })?;
    let theta = file.theta(&*model).map_err(in_file)?;
    let source = Source::open(&arguments.commands, &setup.read_options(&arguments.read)?)?;
    let commands = dataset(&source, &*model)?;
    let measured = commands.measured;
    let data = commands.data;
    let simulation = free_run(&file, &*model, &theta, &data, &source, &setup.registry).map_err(|e| match e {
        ModelFailure::Config(error) => in_file(error),
        ModelFailure::Model(error) => Error::Identify(error.into()),
    })?;
    if let Some(error) = &simulation.failure {
        return Err(Error::Identify(error.clone().into()));
    }
    let fit = if measured { documents::fit(&data.outputs, &simulation) } else { serde_json::Value::Null };
    let document = json!({
        "schema": "wheelwright.simulate/1",
        "model": model.name(),
        "effects": file.effect.iter().map(|e| &e.settings["type"]).collect::<Vec<_>>(),
        "samples": data.samples(),
        "fit": fit,
        "recordings": [documents::recording(&source.facts)],
        "warnings": source.facts.warnings,
    });
    if let Some(folder) = setup.folder(shared)? {
        folder.write("result.json", &format!("{document:#}\n"))?;
        let path = folder.path("simulated.csv");
        let recording = as_recording(&data, &simulation, measured).map_err(|e| Error::content(&path, e))?;
        wheelwright_recordings::write_csv(&path, &recording).map_err(|error| Error::Recording { path: path.clone(), error })?;
        console.note(&format!("wrote {}", path.display()));
    }
    console.document(&document);
    console.result(&summary(&data, &simulation, measured));
    Ok(())
}

/// The model alone, or with the file's effects beside it.
fn free_run(
    file: &ModelFile,
    model: &dyn RegressorModel,
    theta: &[f64],
    data: &Dataset,
    source: &Source,
    registry: &Registry,
) -> Result<Validation, ModelFailure> {
    if file.scene.is_none() && file.effect.is_empty() {
        return validate(model, theta, data).map_err(ModelFailure::Model);
    }
    let headings = headings(&source.recording);
    let scene = file.scene(data, model, headings.as_deref()).map_err(ModelFailure::Config)?;
    let loaded = file.effects(&scene, registry).map_err(ModelFailure::Config)?;
    let effects: Vec<&dyn Effect> = loaded.iter().map(|l| &*l.effect).collect();
    let values: Vec<f64> = loaded.iter().flat_map(|l| l.values.iter().copied()).collect();
    validate_with_effects(model, theta, &effects, &values, (&scene, file.readout()), data).map_err(ModelFailure::Model)
}

/// A recording's commands, with its measurements if it has them.
struct Commands {
    data: Dataset,
    measured: bool,
}

/// The model's channels of a recording; one that has no outputs gets a robot at rest.
fn dataset(source: &Source, model: &dyn RegressorModel) -> Result<Commands, Error> {
    let refuse = |error| Error::content(&source.facts.path, error);
    if let Ok(data) = Dataset::select(&source.recording, model.inputs(), model.outputs()) {
        return Ok(Commands { data, measured: true });
    }
    let mut data = Dataset::select(&source.recording, model.inputs(), &[]).map_err(refuse)?;
    data.outputs = model.outputs().to_vec();
    for stretch in &mut data.stretches {
        stretch.outputs = vec![vec![0.0; stretch.len()]; data.outputs.len()];
    }
    Ok(Commands { data, measured: false })
}

/// The simulation as a recording that other commands read: outputs are the simulated ones, measured ones stand beside them.
fn as_recording(data: &Dataset, simulation: &Validation, measured: bool) -> Result<Recording, RecordingError> {
    let joined = |pick: &dyn Fn(&Comparison) -> Vec<f64>| simulation.comparisons.iter().flat_map(pick).collect::<Vec<f64>>();
    let mut columns = Vec::new();
    for (i, channel) in data.inputs.iter().enumerate() {
        columns.push(Column::new(channel.name.to_string(), joined(&|c| c.measured.inputs[i].clone())));
    }
    for (i, channel) in data.outputs.iter().enumerate() {
        columns.push(Column::new(channel.name.to_string(), joined(&|c| c.simulated[i].clone())));
    }
    for (i, channel) in data.outputs.iter().enumerate().filter(|_| measured) {
        columns.push(Column::new(format!("{}_measured", channel.name), joined(&|c| c.measured.outputs[i].clone())));
    }
    let labels: Vec<String> = data.stretches.iter().flat_map(|s| vec![s.label.clone(); s.len()]).collect();
    Recording::new(RecordingOrigin::default(), joined(&|c| c.measured.time.clone()), columns, Some(&labels))
}

fn summary(data: &Dataset, simulation: &Validation, measured: bool) -> String {
    let mut text = format!("simulated {} samples, {:.1} s\n", data.samples(), data.duration());
    for (channel, fit) in data.outputs.iter().zip(&simulation.fit) {
        match fit.filter(|_| measured) {
            Some(fit) => text.push_str(&format!("  {:<12} fit {fit:.2} %\n", channel.name)),
            None => text.push_str(&format!("  {:<12} nothing measured to compare with: simulated from rest\n", channel.name)),
        }
    }
    text
}
