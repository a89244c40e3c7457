//! What a controller knows of its robot: `[model]` with `file`, or `type` and `theta`.

use std::path::Path;
use std::sync::Arc;

use toml::{Table, Value};
use wheelwright_core::RegressorModel;
use wheelwright_core::config::{self as core_config, ConfigError};
use wheelwright_core::controller::Subject;
use wheelwright_core::profile::RobotProfile;
use wheelwright_core::trajectory::Envelope;

use crate::error::Error;
use crate::model_file::ModelFile;
use crate::registry::{ModelFailure, Registry};

/// A model with parameters.
#[derive(Debug, Clone)]
pub struct Knowledge {
    /// The model.
    pub model: Arc<dyn RegressorModel>,
    /// Its configuration.
    pub table: Table,
    /// Parameters in the model's order; `None` where none are given.
    pub theta: Option<Vec<f64>>,
    /// 95 % interval of each.
    pub intervals: Vec<Option<(f64, f64)>>,
    /// Profile of the robot, if the model file holds one.
    pub profile: Option<RobotProfile>,
}

impl Knowledge {
    /// Reads a `[model]` table. `file` is a `model.toml` relative to `folder`; beside `type`, `theta` is a list, or `"ones"`.
    ///
    /// # Errors
    /// The inner [`ConfigError`] is relative to the table; an outer [`Error`] is that of the model file or of the model.
    pub fn read(mut table: Table, folder: &Path, registry: &Registry) -> Result<Result<Self, ConfigError>, Error> {
        let theta = table.remove("theta");
        let Some(file) = table.remove("file") else { return Self::given(table, theta, registry) };
        let wrong = |key: &str, message: &str| Ok(Err(ConfigError::new(key, message)));
        let Value::String(file) = file else { return wrong("file", "must be the path of a model.toml") };
        if !table.is_empty() {
            return wrong("file", "stands beside other keys: a model file holds its model; only `theta` may stand beside it");
        }
        let path = folder.join(file);
        let content = ModelFile::read(&path)?;
        let in_file = |error| Error::Config { file: path.clone(), position: None, error };
        let model: Arc<dyn RegressorModel> =
            Arc::from(built(registry, &content.model).map_err(|e| e.unwrap_or_else(|c| in_file(c.inside("model"))))?);
        let own = content.theta(&*model).map_err(in_file)?;
        let interval = |name: &str| content.parameter.iter().find(|p| p.name == name).and_then(|p| p.ci95);
        let intervals = model.parameters().iter().map(|p| interval(&p.name)).collect();
        let theta = match theta {
            None => Ok(Some(own)),
            Some(theta) => values(&theta, &*model).map(Some),
        };
        Ok(theta.map(|theta| Self { theta, intervals, table: content.model.clone(), profile: content.robot.clone(), model }))
    }

    fn given(table: Table, theta: Option<Value>, registry: &Registry) -> Result<Result<Self, ConfigError>, Error> {
        let model: Arc<dyn RegressorModel> = match built(registry, &table) {
            Ok(model) => Arc::from(model),
            Err(Ok(error)) => return Err(error),
            Err(Err(error)) => return Ok(Err(error)),
        };
        let intervals = vec![None; model.parameters().len()];
        let theta = theta.map(|theta| values(&theta, &*model)).transpose();
        Ok(theta.map(|theta| Self { model, table, theta, intervals, profile: None }))
    }

    /// The robot for a controller that starts from `theta`.
    pub fn subject(&self, theta: Vec<f64>, own: Option<Vec<f64>>, envelope: Envelope) -> Subject {
        let model = Arc::clone(&self.model);
        // The period is the robot's, which is known when it is connected; the course is laid then.
        Subject { model, theta, intervals: self.intervals.clone(), own, period: f64::NAN, envelope, course: Vec::new() }
    }
}

/// A model, or what is wrong: an error of its own, or a key of its table.
fn built(registry: &Registry, table: &Table) -> Result<Box<dyn RegressorModel>, Result<Error, ConfigError>> {
    registry.model(table.clone()).map_err(|failure| match failure {
        ModelFailure::Config(error) => Err(error),
        ModelFailure::Model(error) => Ok(Error::Identify(error.into())),
    })
}

/// θ as a list of numbers, or `"ones"`.
fn values(theta: &Value, model: &dyn RegressorModel) -> Result<Vec<f64>, ConfigError> {
    let n = model.parameters().len();
    if theta.as_str() == Some("ones") {
        return Ok(vec![1.0; n]);
    }
    let wrong = |message: String| ConfigError::new("theta", message);
    let table = Table::from_iter([("theta".to_owned(), theta.clone())]);
    let list: Listed = core_config::plain(table).map_err(|_| wrong(format!("must be a list of {n} numbers, or \"ones\", not {theta}")))?;
    check_theta(&list.theta, model).map_err(wrong)?;
    Ok(list.theta)
}

#[derive(serde::Deserialize)]
struct Listed {
    theta: Vec<f64>,
}

/// What is wrong with a list of parameter values for a model, if anything.
pub fn check_theta(theta: &[f64], model: &dyn RegressorModel) -> Result<(), String> {
    let n = model.parameters().len();
    if theta.len() != n {
        return Err(format!("has {} values; model `{}` has the {n} parameters {}", theta.len(), model.name(), names(model)));
    }
    match theta.iter().find(|v| !v.is_finite()) {
        Some(value) => Err(format!("holds {value}, which is no finite number")),
        None => Ok(()),
    }
}

fn names(model: &dyn RegressorModel) -> String {
    model.parameters().iter().map(|p| p.name.as_str()).collect::<Vec<_>>().join(", ")
}
