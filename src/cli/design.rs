//! `design`: an excitation as short as the wanted accuracy and the limits allow, as a file that `record` runs.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value as Json, json};
use toml::{Table, Value};
use wheelwright_core::model::RegressorModel;
use wheelwright_core::profile::RobotProfile;

use super::Shared;
use super::attend::safety;
use super::console::Console;
use super::setup::{ReadArguments, Setup, StudyArguments};
use crate::design::{Design, DesignSection, Task};
use crate::error::Error;
use crate::model_file::ModelFile;
use crate::output::Folder;
use crate::toml_file::TomlFile;

/// Name of the file of commands.
const COMMANDS: &str = "excitation.csv";
/// Name of the configuration that drives it.
const CONFIG: &str = "excitation.toml";

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Configuration: [design], [limits], [robot], [model]
    #[arg(value_name = "CONFIG.toml")]
    file: PathBuf,
    /// Profile of the robot: its limits, and the parameters about which to design
    #[arg(long, value_name = "robot.toml")]
    robot: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments, shared: &Shared, console: &Console) -> Result<(), Error> {
    let setup = Setup::load_file(Some(&arguments.file), shared)?;
    let missing = || Error::setting("design", "is missing: [design] says what accuracy is wanted, as in width = 0.1");
    let section = setup.config.sections.design.clone().ok_or_else(missing)?;
    let study = StudyArguments { robot: arguments.robot.clone(), ..StudyArguments::default() };
    let study = setup.study(shared, &study, setup.read_options(&ReadArguments::default())?)?;
    let names: Vec<String> = study.model.parameters().iter().map(|p| p.name.clone()).collect();
    section.check(&names).map_err(|e| setup.config.error_in("design", e))?;
    let task = Task {
        model: &*study.model,
        map: &study.freedom.map,
        theta: theta(&setup, &section, &*study.model, study.robot.as_ref())?,
        period: period(&setup, &section, study.seed)?,
        safety: safety(&setup, study.robot.as_ref())?,
        fitted: 1.0 - study.holdout,
        section: &section,
        seed: study.seed,
    };
    console.progress("searching an excitation");
    let design = task.solve();
    console.end_progress();
    let design = design?;
    let folder = setup.folder(shared)?.map_or_else(|| Folder::create(Path::new(".")), Ok)?;
    let commands = folder.write(COMMANDS, &csv(&design, &*study.model))?;
    let config = folder.write(CONFIG, &config(arguments, &setup, &design)?)?;
    let document = document(&design, &*study.model, &[&commands, &config]);
    folder.write("result.json", &format!("{document:#}\n"))?;
    console.document(&document);
    console.result(&text(&design, &*study.model, &config));
    Ok(())
}

/// Parameters about which to design: the section's, its model file's, or the profile's.
fn theta(setup: &Setup, section: &DesignSection, model: &dyn RegressorModel, robot: Option<&RobotProfile>) -> Result<Vec<f64>, Error> {
    let wanted = model.parameters().len();
    let named = match &section.model {
        Some(path) => Some(
            ModelFile::read(&setup.config.resolve(path))?.theta(model).map_err(|e| setup.config.error_in("design", e.inside("model")))?,
        ),
        None => None,
    };
    let profile = || robot.filter(|r| r.model == model.name()).and_then(|r| r.theta.as_ref()).map(|t| t.values.clone());
    let missing = || {
        Error::setting(
            "design.theta",
            "is missing: about which parameters? Give theta, model = \"model.toml\", or --robot with a profile that has them",
        )
    };
    let theta = section.theta.clone().or(named).or_else(profile).ok_or_else(missing)?;
    if theta.len() == wanted && theta.iter().all(|t| t.is_finite()) {
        return Ok(theta);
    }
    Err(Error::setting("design.theta", format!("has {} values; model `{}` needs {wanted} finite ones", theta.len(), model.name())))
}

/// The control period: the section's, or the robot's own.
fn period(setup: &Setup, section: &DesignSection, seed: u64) -> Result<f64, Error> {
    if let Some(period) = section.period {
        return Ok(period);
    }
    let missing = || Error::setting("design.period", "is missing, and there is no [robot] to be asked for its control period");
    let robot = setup.config.sections.robot.clone().ok_or_else(missing)?;
    Ok(setup.connect(robot, seed)?.period())
}

/// The commands row by row.
fn csv(design: &Design, model: &dyn RegressorModel) -> String {
    let mut text = std::iter::once("t").chain(model.inputs().iter().map(|c| c.name.as_ref())).collect::<Vec<_>>().join(",") + "\n";
    for (k, t) in design.time.iter().enumerate() {
        // Writing to a String cannot fail.
        let _ = write!(text, "{t}");
        for column in &design.commands {
            let _ = write!(text, ",{}", column[k]);
        }
        text.push('\n');
    }
    text
}

/// The configuration with the designed excitation in place of the wishes; its paths are made to hold from any folder.
fn config(arguments: &Arguments, setup: &Setup, design: &Design) -> Result<String, Error> {
    let mut table = TomlFile::read(&arguments.file)?.table()?;
    table.remove("design");
    table.remove("output");
    let excitation = [("type", Value::from("table")), ("file", Value::from(COMMANDS)), ("duration", Value::from(design.duration))];
    table.insert("excitation".to_owned(), Value::Table(excitation.into_iter().map(|(k, v)| (k.to_owned(), v)).collect()));
    let anchor = |value: Option<&mut Value>| {
        if let Some(Value::String(path)) = value
            && let Ok(whole) = std::path::absolute(setup.config.resolve(Path::new(path.as_str())))
        {
            *path = whole.display().to_string();
        }
    };
    for plugin in table.get_mut("plugin").and_then(Value::as_array_mut).into_iter().flatten() {
        anchor(plugin.get_mut("path"));
    }
    let profile = table.get_mut("limits").and_then(|limits| limits.get_mut("profile"));
    if profile.as_ref().and_then(|p| p.as_str()).is_some_and(|p| p.ends_with(".toml")) {
        anchor(profile);
    }
    let head = format!("# An excitation of {:.1} s, designed. Drive it: wheelwright record {CONFIG} --out DIR\n\n", design.duration);
    Ok(head + &toml::to_string(&ordered(table)).unwrap_or_default())
}

/// Plain keys before tables, as TOML wants them.
fn ordered(table: Table) -> Table {
    let (tables, plain): (Vec<_>, Vec<_>) = table.into_iter().partition(|(_, v)| matches!(v, Value::Table(_) | Value::Array(_)));
    plain.into_iter().chain(tables).collect()
}

fn document(design: &Design, model: &dyn RegressorModel, files: &[&PathBuf]) -> Json {
    let each = model.parameters().iter().zip(&design.widths);
    let parameters: Vec<Json> =
        each.map(|(p, (width, wanted))| json!({ "name": p.name, "unit": p.unit, "width": width, "wanted": wanted })).collect();
    json!({
        "schema": "wheelwright.design/1",
        "duration_s": design.duration,
        "parameters": parameters,
        "candidates": design.candidates,
        "files": files.iter().map(|f| f.display().to_string()).collect::<Vec<_>>(),
    })
}

fn text(design: &Design, model: &dyn RegressorModel, config: &Path) -> String {
    let mut text = format!("an excitation of {:.1} s, the shortest of {} candidates\n", design.duration, design.candidates);
    for (p, (width, wanted)) in model.parameters().iter().zip(&design.widths) {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "  {:<10} interval {width:.2e} {}, wanted {wanted:.2e}", p.name, p.unit);
    }
    let _ = writeln!(text, "drive it: wheelwright record {}", config.display());
    text
}
