//! The words of Wheelwright.
//!
//! One idea: a model of a wheeled robot is, for each of its equations, linear in its parameters θ and affine in the
//! accelerations of its outputs,
//!
//! Φ(inputs, outputs, accelerations) θ = y(inputs, outputs),
//!
//! so one function serves identification, simulation, control and diagnosis. This crate holds that function's trait
//! ([`model`]), the traits of everything around it ([`recording`], [`robot`], [`excitation`], [`solver`]) and what needs
//! no file format, wire or plugin: signal conditioning, free-run simulation, identification and validation.

pub mod agreement;
pub mod ceiling;
pub mod channel;
pub mod config;
pub mod conformance;
pub mod controller;
pub mod dataset;
pub mod drive;
pub mod effect;
pub mod excitation;
pub mod gram;
pub mod identifiability;
pub mod identification;
pub mod integral_action;
pub mod lag;
pub mod least_squares;
mod local;
pub mod model;
mod noise;
pub mod profile;
pub mod recording;
pub mod regression;
pub mod robot;
pub mod signal;
pub mod simulation;
pub mod solver;
pub mod start;
pub mod tracking;
pub mod trajectory;
pub mod validation;

pub use channel::Channel;
pub use controller::{Controller, ControllerConfig};
pub use dataset::{Dataset, Stretch};
pub use effect::Effect;
pub use model::{ModelConfig, Parameter, ParameterMap, RegressorModel, Sample};
pub use profile::RobotProfile;
pub use recording::{ReadOptions, Recording, RecordingReader};
pub use robot::{Live, Robot, RobotConfig};
pub use solver::{Problem, Solution, Solver};
pub use trajectory::{Reference, Trajectory, TrajectoryConfig};
