//! A configuration's controller on its trajectory, ready to be run on a robot or simulated.

use toml::{Table, Value};
use wheelwright_core::config::ConfigError;
use wheelwright_core::controller::{ControllerConfig, Subject};
use wheelwright_core::drive::{DriveOptions, Safety};
use wheelwright_core::robot::Live;
use wheelwright_core::trajectory::{Envelope, TrajectoryConfig};

use super::knowledge::Knowledge;
use super::run::{Outcome, TrackRun};
use super::simulation::{integrable, simulate};
use crate::config::Config;
use crate::error::Error;
use crate::registry::Registry;

/// What `track` runs.
#[derive(Debug)]
pub struct ControlPlan {
    /// What the controller knows of its robot.
    pub knowledge: Knowledge,
    /// The controller.
    pub controller: Box<dyn ControllerConfig>,
    /// Its table.
    pub controller_table: Table,
    /// The trajectory.
    pub trajectory: Box<dyn TrajectoryConfig>,
    /// Its name.
    pub trajectory_name: String,
}

impl ControlPlan {
    /// Reads `[model]`, `[controller]` and `[trajectory]`.
    ///
    /// # Errors
    /// [`Error::Config`] with line and column.
    pub fn read(config: &Config, registry: &Registry) -> Result<Self, Error> {
        let controller_table = needed(config, config.sections.controller.as_ref(), "controller", "type = \"inverse-dynamics\"")?;
        let controller = registry.controller(controller_table.clone()).map_err(|e| config.error_in("controller", e))?;
        let (trajectory, trajectory_name) = trajectory(config, registry)?;
        let knowledge = knowledge(config, registry, "model", config.sections.model.clone().unwrap_or_default())?;
        if config.sections.robot.is_some() && config.sections.simulation.is_some() {
            return Err(config.error(ConfigError::new("robot", "and [simulation] are both there: keep one of them")));
        }
        Ok(Self { knowledge, controller, controller_table, trajectory, trajectory_name })
    }

    /// The controller's name.
    pub fn controller_name(&self) -> &str {
        self.controller_table.get("type").and_then(Value::as_str).unwrap_or_default()
    }

    /// The parameters to control with. A controller that knows no model needs none.
    ///
    /// # Errors
    /// [`Error::Config`] if none are given.
    pub fn theta(&self) -> Result<Vec<f64>, Error> {
        if let Some(theta) = &self.knowledge.theta {
            return Ok(theta.clone());
        }
        if self.controller_name() == "kinematic" {
            return Ok(vec![1.0; self.knowledge.model.parameters().len()]);
        }
        let message = "no parameters are given: [model] needs `file = \"model.toml\"`, or `theta = [...]` beside its type";
        Err(Error::setting("model", message))
    }

    /// What the controller is told of its robot, which keeps within `safety`. `theta` stands for the configured parameters, if given.
    ///
    /// # Errors
    /// As [`theta`](Self::theta).
    pub fn subject(&self, config: &Config, theta: Option<Vec<f64>>, safety: &Safety) -> Result<Subject, Error> {
        let theta = theta.map_or_else(|| self.theta(), Ok)?;
        Ok(self.knowledge.subject(theta, config.sections.track.own_theta.clone(), envelope(safety)))
    }

    /// The run as configured, for whoever connects the robot.
    pub fn track_run<'a>(&'a self, config: &'a Config, subject: &'a Subject) -> TrackRun<'a> {
        TrackRun { subject, controller: &*self.controller, trajectory: &*self.trajectory, section: &config.sections.track }
    }

    /// Simulates or, with a robot, drives what the configuration asks for. `theta` stands for the configured parameters, if
    /// given.
    ///
    /// # Errors
    /// As [`TrackRun::drive`] and [`simulate`].
    pub fn run(
        &self,
        config: &Config,
        theta: Option<Vec<f64>>,
        robot: Option<&mut Live>,
        options: DriveOptions<'_>,
    ) -> Result<Outcome, Error> {
        let subject = self.subject(config, theta, &options.safety)?;
        let run = self.track_run(config, &subject);
        match (robot, &config.sections.simulation) {
            (Some(robot), _) => run.drive(robot, options),
            (None, Some(simulation)) => {
                let controller = integrable(self.controller_table.clone()).map_err(|e| config.error_in("controller", e))?;
                simulate(&run, &controller, simulation)
            }
            (None, None) => Err(config.error(ConfigError::new("robot", "is missing, and so is [simulation]"))),
        }
    }
}

/// What a drive's safety tells a controller of the robot's bounds.
pub fn envelope(safety: &Safety) -> Envelope {
    let wheels = safety.wheels;
    Envelope { limits: safety.limits, track_width: wheels.map(|w| w.track_width), wheel_radius: wheels.map(|w| w.radius) }
}

/// A table that a configuration must have.
fn needed(config: &Config, table: Option<&Table>, name: &str, example: &str) -> Result<Table, Error> {
    table.cloned().ok_or_else(|| config.error(ConfigError::new(name, format!("is missing: [{name}] needs a type, as in {example}"))))
}

/// The trajectory of a configuration and its name.
///
/// # Errors
/// [`Error::Config`].
pub fn trajectory(config: &Config, registry: &Registry) -> Result<(Box<dyn TrajectoryConfig>, String), Error> {
    let table = needed(config, config.sections.trajectory.as_ref(), "trajectory", "type = \"figure-eight\"")?;
    let name = table.get("type").and_then(Value::as_str).unwrap_or_default().to_owned();
    let trajectory = registry.trajectory(table).map_err(|e| config.error_in("trajectory", e))?;
    Ok((trajectory, name))
}

/// What a table like `[model]` tells, which stands in the section `name`; without a type it is `vw-pd`.
///
/// # Errors
/// [`Error::Config`], or what is wrong with the model file.
pub fn knowledge(config: &Config, registry: &Registry, name: &str, mut table: Table) -> Result<Knowledge, Error> {
    if !table.contains_key("type") && !table.contains_key("file") {
        table.insert("type".to_owned(), Value::from("vw-pd"));
    }
    Knowledge::read(table, config.folder(), registry)?.map_err(|e| config.error_in(name, e))
}
