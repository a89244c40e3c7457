#![doc = include_str!("../README.md")]

// A crate of built-ins that nothing mentions is not linked, and its registrations vanish without a word.
use wheelwright_controllers as _;
use wheelwright_robots as _;

pub mod autonomous;
pub mod cli;
pub mod config;
pub mod constraints;
pub mod control;
pub mod design;
pub mod documents;
pub mod error;
pub mod evidence;
pub mod experiment;
pub mod export;
pub mod feedforward;
pub mod inquiry;
pub mod model_file;
pub mod online;
pub mod output;
pub mod record;
pub mod registry;
pub mod report;
pub mod safety;
pub mod score;
pub mod source;
pub mod study;
pub mod toml_file;
pub mod trial;

pub use error::Error;
pub use wheelwright_controllers as controllers;
pub use wheelwright_core as core;
pub use wheelwright_diagnosis as diagnosis;
pub use wheelwright_models as models;
pub use wheelwright_recordings as recordings;
pub use wheelwright_robots as robots;
pub use wheelwright_solvers as solvers;

/// What most programs need.
pub mod prelude {
    pub use wheelwright_core::identification::{Identification, identify};
    pub use wheelwright_core::{Channel, Dataset, ModelConfig, Problem, ReadOptions, Recording, RegressorModel, Solver};
    pub use wheelwright_models::{VwPdConfig, WheelPdConfig, WheelVoltageConfig};
    pub use wheelwright_solvers::{BoundedSolver, Ols, OutputError, SteadyState, Thesis};
}
