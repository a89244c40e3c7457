//! A Rust plugin that panics, or hangs, where its configuration says.
#![allow(clippy::panic, missing_docs, reason = "made to panic")]

use serde::{Deserialize, Serialize};
use wheelwright_core::channel::Channel;
use wheelwright_core::model::{ModelConfig, ModelError, Parameter, RegressorModel, Sample};
use wheelwright_core::robot::{Robot, RobotConfig, RobotError};

wheelwright_plugin::export!();

#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Panicking {
    #[serde(default)]
    when: String,
}

/// A payload that panics again when it is dropped.
struct Bomb;

impl Drop for Bomb {
    fn drop(&mut self) {
        panic!("and again");
    }
}

impl Panicking {
    fn at(&self, place: &str) {
        if self.when == place {
            panic!("at {place}");
        }
        if self.when == format!("{place}, bomb") {
            std::panic::panic_any(Bomb);
        }
        if self.when == format!("{place}, hang") {
            std::thread::sleep(std::time::Duration::from_millis(1500));
        }
    }
}

#[typetag::serde(name = "panicking")]
impl RobotConfig for Panicking {
    fn about(&self) -> String {
        "panics".to_owned()
    }

    fn connect(&self, _seed: u64) -> Result<Box<dyn Robot>, RobotError> {
        self.at("open");
        Ok(Box::new(Base { config: self.clone(), stopped: false }))
    }
}

struct Base {
    config: Panicking,
    stopped: bool,
}

static CHANNEL: [Channel; 1] = [Channel::new("x", "1")];

impl Robot for Base {
    fn inputs(&self) -> &[Channel] {
        &CHANNEL
    }

    fn outputs(&self) -> &[Channel] {
        &CHANNEL
    }

    fn period(&self) -> f64 {
        0.01
    }

    fn measure(&mut self, measured: &mut [f64]) -> Result<f64, RobotError> {
        self.config.at("measure");
        measured[0] = f64::from(u8::from(self.stopped));
        Ok(0.0)
    }

    fn step(&mut self, _command: &[f64], measured: &mut [f64]) -> Result<f64, RobotError> {
        self.config.at("step");
        self.measure(measured)
    }

    fn stop(&mut self) -> Result<(), RobotError> {
        self.stopped = true;
        self.config.at("stop");
        Ok(())
    }
}

impl Drop for Base {
    fn drop(&mut self) {
        self.config.at("drop");
    }
}

#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PanickingModel {
    #[serde(default)]
    when: Option<f64>,
}

#[typetag::serde(name = "panicking")]
impl ModelConfig for PanickingModel {
    fn about(&self) -> String {
        "panics".to_owned()
    }

    fn build(&self) -> Result<Box<dyn RegressorModel>, ModelError> {
        Ok(Box::new(Model { when: self.when, parameters: [Parameter::new("a", "1", "", "")] }))
    }
}

#[derive(Debug)]
struct Model {
    when: Option<f64>,
    parameters: [Parameter; 1],
}

impl RegressorModel for Model {
    fn name(&self) -> &str {
        "panicking"
    }

    fn inputs(&self) -> &[Channel] {
        &CHANNEL
    }

    fn outputs(&self) -> &[Channel] {
        const { &[Channel::new("z", "1")] }
    }

    fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    fn regressor(&self, sample: Sample<'_>, phi: &mut [f64], y: &mut [f64]) {
        if Some(sample.inputs[0]) == self.when {
            panic!("at input {}", sample.inputs[0]);
        }
        phi[0] = sample.accelerations[0];
        y[0] = sample.inputs[0];
    }
}
