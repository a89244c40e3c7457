//! Controllers: what a robot is to be told so that it follows a trajectory.
//!
//! A [`Controller`] sees, once a control period, the desired motion and what was measured ([`Observation`]), and writes
//! the command. It is built for a robot ([`Subject`]) and can say beforehand what it fears ([`Controller::assess`]).

use std::fmt::Debug;
use std::sync::Arc;

use thiserror::Error;

use crate::channel::Channel;
use crate::model::{ModelError, RegressorModel};
use crate::trajectory::{Envelope, Reference, Trajectory};

/// What a controller sees at one instant.
#[derive(Debug, Clone, Copy)]
pub struct Observation<'a> {
    /// Time since the start \[s\].
    pub t: f64,
    /// The desired motion at `t`.
    pub reference: Reference,
    /// Measured pose: x \[m\], y \[m\], φ \[rad\].
    pub pose: [f64; 3],
    /// One measured value a channel of [`Controller::outputs`].
    pub outputs: &'a [f64],
}

/// A tracking controller. Live object, built from a [`ControllerConfig`].
pub trait Controller: Debug + Send {
    /// Commands it writes.
    fn inputs(&self) -> &[Channel];

    /// Measured channels it needs besides the pose.
    fn outputs(&self) -> &[Channel];

    /// Writes the command for one control period, one value a channel of [`inputs`](Self::inputs).
    fn step(&mut self, now: &Observation<'_>, command: &mut [f64]);

    /// Names of the parameters it works with; empty if it has none.
    fn parameters(&self) -> &[String] {
        &[]
    }

    /// Their present values, one a name.
    fn theta(&self) -> &[f64] {
        &[]
    }

    /// What became of the last step.
    fn state(&self) -> StepState {
        StepState::default()
    }

    /// What there is to fear on this trajectory, before the robot moves.
    fn assess(&self, _plan: &Plan<'_>) -> Vec<Concern> {
        Vec::new()
    }
}

/// What became of a controller's step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepState {
    /// Share of the wanted command that the robot's limits left, 1 if all of it.
    pub share: f64,
    /// True while parameters are being adapted.
    pub adapting: bool,
}

impl Default for StepState {
    fn default() -> Self {
        Self { share: 1.0, adapting: false }
    }
}

/// What is about to be tracked.
#[derive(Debug, Clone, Copy)]
pub struct Plan<'a> {
    /// The trajectory.
    pub trajectory: &'a dyn Trajectory,
    /// Length \[s\].
    pub duration: f64,
    /// Standard deviation of measured forward \[m/s\] and angular \[rad/s\] velocity, if known.
    pub noise: Option<[f64; 2]>,
}

/// Something to know before a robot moves.
#[derive(Debug, Clone, PartialEq)]
pub struct Concern {
    /// How bad.
    pub gravity: Gravity,
    /// What it is, with its numbers and what to do.
    pub message: String,
}

/// How bad a concern is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Gravity {
    /// Good to know.
    Note,
    /// The result may suffer.
    Warning,
    /// The loop is unstable or a limit is exceeded: the robot should not be driven so.
    Danger,
}

impl Concern {
    /// A concern.
    pub fn new(gravity: Gravity, message: impl Into<String>) -> Self {
        Self { gravity, message: message.into() }
    }
}

/// The robot that a controller is built for.
#[derive(Debug, Clone)]
pub struct Subject {
    /// Its model.
    pub model: Arc<dyn RegressorModel>,
    /// Parameters that the controller starts from, in the model's order.
    pub theta: Vec<f64>,
    /// 95 % interval of each, where the identification gave one.
    pub intervals: Vec<Option<(f64, f64)>>,
    /// The robot's own parameters as far as known, where they are not those of the controller: stability depends on both.
    pub own: Option<Vec<f64>>,
    /// Control period \[s\].
    pub period: f64,
    /// Limits and dimensions.
    pub envelope: Envelope,
    /// The motion it is to be led through, at instants of equal distance ([`course`]); empty if that is not known yet.
    ///
    /// [`course`]: crate::trajectory::course
    pub course: Vec<Reference>,
}

/// Plain data from which a controller is built; `type = "NAME"` in a configuration picks it.
#[typetag::serde]
pub trait ControllerConfig: Debug + Send + Sync {
    /// One line on what the controller is, for `wheelwright plugins`.
    fn about(&self) -> String;

    /// Builds it for a robot.
    ///
    /// # Errors
    /// [`ControlError`] naming the key that is wrong, or what the model lacks.
    fn build(&self, subject: &Subject) -> Result<Box<dyn Controller>, ControlError>;
}

/// Why there is no controller.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum ControlError {
    /// A setting is impossible.
    #[error("`{key}`: {reason}")]
    Config {
        /// Key inside the controller's table.
        key: String,
        /// What is wrong and what to do.
        reason: String,
    },
    /// The model does not tell how the body moves.
    #[error("model `{model}` cannot be tracked with: {reason}")]
    Model {
        /// Model name.
        model: String,
        /// What it lacks.
        reason: String,
    },
    /// The model's equations give no command.
    #[error(transparent)]
    Inverse(#[from] ModelError),
}

impl ControlError {
    /// An impossible setting.
    pub fn config(key: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Config { key: key.into(), reason: reason.into() }
    }
}
