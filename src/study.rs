//! A study: recordings, a model and a solver brought together, from which an identification comes.

use std::path::PathBuf;

use toml::Table;
use wheelwright_core::dataset::Dataset;
use wheelwright_core::identification::{Identification, IdentifyError, identify};
use wheelwright_core::model::{ModelConfig, RegressorModel};
use wheelwright_core::profile::RobotProfile;
use wheelwright_core::recording::{ReadOptions, RecordingError};
use wheelwright_core::solver::{Problem, Solver};
use wheelwright_solvers::Ols;

use crate::constraints::Freedom;
use crate::error::Error;
use crate::evidence::Evidence;
use crate::online::Trace;
use crate::report::RecordingFacts;
use crate::source::Source;

/// What is to be identified, and how.
#[derive(Debug)]
pub struct Study {
    /// The model's table, kept for `model.toml`.
    pub model_table: Table,
    /// The model.
    pub model: Box<dyn RegressorModel>,
    /// One line on what the model is.
    pub model_about: String,
    /// Which parameters are free, and within which bounds.
    pub freedom: Freedom,
    /// The solver.
    pub solver: Box<dyn Solver>,
    /// Profile of the robot, if one was given.
    pub robot: Option<RobotProfile>,
    /// How recordings are read.
    pub read: ReadOptions,
    /// Share of the samples held out of the recordings fitted.
    pub holdout: f64,
    /// Whether evidence is gathered around the identification.
    pub evidence: bool,
    /// Seed of whatever is random.
    pub seed: u64,
}

/// A study's result. The data is there also when the identification failed, for the pictures.
#[derive(Debug)]
pub struct Findings {
    /// Facts of the recordings fitted, in the order given.
    pub recordings: Vec<RecordingFacts>,
    /// Facts of the recordings that only validate.
    pub validation_recordings: Vec<RecordingFacts>,
    /// What was fitted.
    pub train: Dataset,
    /// What no estimate saw.
    pub held_out: Dataset,
    /// The identification, or why there is none.
    pub identification: Result<Identification, IdentifyError>,
    /// What surrounds the identification; empty if there is none.
    pub evidence: Evidence,
    /// What a user should know: readers' warnings, then the solver's.
    pub warnings: Vec<String>,
    /// What the estimator that runs on the robot said over time, if it was asked.
    pub online: Option<Trace>,
}

impl Study {
    /// Identifies on the recordings, holding out a share of each, and validates on that share and on `validation`.
    ///
    /// # Errors
    /// [`Error`] if a recording does not have what the model needs, or too little is left. That the data cannot answer is
    /// in [`Findings::identification`].
    pub fn identify(&self, sources: &[Source], validation: &[Source]) -> Result<Findings, Error> {
        let mut train = self.empty();
        let mut held_out = self.empty();
        let mut each = Vec::new();
        for source in sources {
            let (kept, held) = self.dataset(source)?.hold_out(self.holdout);
            each.push((source.facts.path.clone(), kept.clone()));
            train.extend(kept);
            held_out.extend(held);
        }
        for source in validation {
            held_out.extend(self.dataset(source)?);
        }
        if train.stretches.is_empty() {
            return Err(Error::TooLittle(format!(
                "nothing is left to fit after holding out {:.0} % of the samples: give a smaller --holdout or a longer recording",
                100.0 * self.holdout
            )));
        }
        let Freedom { map, bounds } = self.freedom.clone();
        let problem = Problem { model: &*self.model, data: &train, map, bounds, seed: self.seed };
        let mut identification = identify(&problem, &*self.solver, &held_out);
        if let Ok(found) = &mut identification {
            lend_regression(found, &problem);
        }
        let gather = |found: &Identification| Evidence::gather(&problem, &*self.solver, found, &held_out, &each);
        let evidence = identification.as_ref().ok().filter(|_| self.evidence).map(gather).unwrap_or_default();
        let recordings: Vec<_> = sources.iter().map(|s| s.facts.clone()).collect();
        let used = |s: &Source| RecordingFacts { used_for: "validation".to_owned(), ..s.facts.clone() };
        let validation_recordings: Vec<_> = validation.iter().map(used).collect();
        let mut warnings = warnings(recordings.iter().chain(&validation_recordings), &identification);
        warnings.extend(evidence.concerns());
        Ok(Findings { recordings, validation_recordings, identification, evidence, warnings, train, held_out, online: None })
    }

    /// Opens recordings by path.
    ///
    /// # Errors
    /// As [`Source::open`].
    pub fn open(&self, paths: &[PathBuf]) -> Result<Vec<Source>, Error> {
        paths.iter().map(|path| Source::open(path, &self.read)).collect()
    }

    fn empty(&self) -> Dataset {
        Dataset { inputs: self.model.inputs().to_vec(), outputs: self.model.outputs().to_vec(), stretches: Vec::new() }
    }

    fn dataset(&self, source: &Source) -> Result<Dataset, Error> {
        Dataset::new(&source.recording, &*self.model).map_err(|error| explain(&*self.model, source, error))
    }
}

/// A solver that fits free runs has no regression of its own; the report draws that of `ols`, under the parameters found.
fn lend_regression(found: &mut Identification, problem: &Problem<'_>) {
    if found.solution.regression.is_some() {
        return;
    }
    if let Ok(regressed) = Ols::default().solve(problem) {
        found.solution.regression = regressed.regression;
        found
            .solution
            .steps
            .push("for the regression plots only, rows were made as by ols; the parameters do not come from them".to_owned());
    }
}

/// A column that this model misses may be one that another model would use: say so.
pub(crate) fn explain(model: &dyn RegressorModel, source: &Source, error: RecordingError) -> Error {
    let fits = |config: &dyn ModelConfig| {
        let model = config.build().ok()?;
        let has_all = model.inputs().iter().chain(model.outputs()).all(|c| source.recording.column(&c.name).is_ok());
        has_all.then(|| model.name().to_owned())
    };
    let path = &source.facts.path;
    let RecordingError::MissingColumn { name, available } = &error else { return Error::content(path, error) };
    let fitting: Vec<String> = built_in_models().iter().filter_map(|config| fits(&**config)).filter(|name| name != model.name()).collect();
    match fitting.first() {
        Some(other) => Error::content(
            path,
            RecordingError::MissingColumn {
                name: name.clone(),
                available: format!("{available}, which suits --model {other} (model {} needs `{name}`)", model.name()),
            },
        ),
        None => Error::content(path, error),
    }
}

/// Built-in models that need no settings, in order of name.
fn built_in_models() -> Vec<Box<dyn ModelConfig>> {
    let names = wheelwright_core::config::names::<Box<dyn ModelConfig>>();
    let table = |name: String| Table::from_iter([("type".to_owned(), toml::Value::String(name))]);
    names.into_iter().filter_map(|name| wheelwright_core::config::tagged(table(name)).ok()).collect()
}

fn warnings<'a>(facts: impl Iterator<Item = &'a RecordingFacts>, identification: &Result<Identification, IdentifyError>) -> Vec<String> {
    let mut warnings: Vec<String> = facts.flat_map(|f| f.warnings.iter().map(|warning| format!("{}: {warning}", f.path))).collect();
    if let Ok(found) = identification {
        warnings.extend(found.solution.warnings.iter().cloned());
        for (part, validation) in [("the data fitted", Some(&found.train)), ("the held-out data", found.held_out.as_ref())] {
            if let Some(error) = validation.and_then(|v| v.failure.as_ref()) {
                warnings.push(format!("free run on {part}: {error}"));
            }
        }
    }
    warnings
}
