use super::*;
use crate::channel::{OMEGA_REF, U_LEFT, V, V_REF};
use crate::excitation::ExcitationError;
use crate::model::{Flow, Parameter, ParameterMap};
use crate::robot::RobotError;

/// u = a v' + b v, with one promise broken at will.
#[derive(Debug)]
struct Lag {
    broken: &'static str,
    parameters: Vec<Parameter>,
    outputs: Vec<Channel>,
}

impl Lag {
    fn new(broken: &'static str) -> Self {
        let name = if broken == "duplicate" { "a" } else { "b" };
        let parameters =
            vec![Parameter::new("a", "s", "lag", "steps").within(0.0, f64::INFINITY), Parameter::new(name, "1", "gain", "driving")];
        Self { broken, parameters, outputs: vec![if broken == "unit" { Channel::new("v", "") } else { V }] }
    }
}

impl RegressorModel for Lag {
    fn name(&self) -> &str {
        if self.broken == "name" { " " } else { "lag" }
    }
    fn inputs(&self) -> &[Channel] {
        const { &[V_REF] }
    }
    fn outputs(&self) -> &[Channel] {
        &self.outputs
    }
    fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }
    fn regressor(&self, sample: Sample<'_>, phi: &mut [f64], y: &mut [f64]) {
        let a = sample.accelerations[0];
        phi[0] = if self.broken == "affine" { a * a } else { a };
        if self.broken != "unwritten" {
            phi[1] = sample.outputs[0];
        }
        y[0] = sample.inputs[0];
    }
    fn map(&self) -> ParameterMap {
        let mut map = ParameterMap::identity(&self.parameters);
        if self.broken == "map" {
            map.offset.pop();
        }
        map
    }
    fn accelerations(&self, theta: &[f64], inputs: &[f64], outputs: &[f64], accelerations: &mut [f64]) -> Result<(), ModelError> {
        if self.broken == "fails" {
            return Err(ModelError::Singular { model: "lag".into() });
        }
        let sign = if self.broken == "closed" { -1.0 } else { 1.0 };
        accelerations[0] = (inputs[0] - sign * theta[1] * outputs[0]) / theta[0];
        Ok(())
    }
    fn flow(&self) -> Option<&dyn Flow> {
        Some(self)
    }
}

impl Flow for Lag {
    fn advance(&self, theta: &[f64], inputs: &[f64], interval: f64, outputs: &mut [f64], travelled: &mut [f64]) -> Result<(), ModelError> {
        let (final_value, before) = (inputs[0] / theta[1], outputs[0]);
        let late = if self.broken == "flow" { 0.99 } else { 1.0 };
        outputs[0] = final_value + (before - final_value) * (-late * interval * theta[1] / theta[0]).exp();
        travelled[0] = final_value * interval - theta[0] / theta[1] * (outputs[0] - before);
        if self.broken == "way" {
            travelled[0] = 0.0;
        }
        Ok(())
    }
}

fn first(result: Result<(), Vec<Violation>>) -> String {
    result.unwrap_err()[0].to_string()
}

#[test]
fn a_model_that_keeps_its_promises_passes() {
    assert_eq!(check_model(&Lag::new("")), Ok(()));
}

#[test]
fn every_broken_promise_of_a_model_is_named() {
    for (broken, start) in [
        ("name", "the model's name is empty"),
        ("unit", "the unit of `v` is empty"),
        ("duplicate", "two parameters are named `a`"),
        ("affine", "the column of `a` in equation 1 is not affine in the accelerations: "),
        ("unwritten", "the column of `b` in equation 1 was not written or is not finite at inputs ["),
        ("map", "the offset of map() has 1 values: 2 are needed"),
        ("closed", "accelerations() gives "),
        ("flow", "flow() takes `v` to "),
        ("way", "flow() takes the integral of `v` to 0 where "),
        ("fails", "accelerations() ends with \"model `lag` cannot be simulated"),
    ] {
        let message = first(check_model(&Lag::new(broken)));
        assert!(message.starts_with(start), "{broken}: {message}");
    }
}

struct Cart {
    broken: &'static str,
    time: f64,
    stops: usize,
}

impl Robot for Cart {
    fn inputs(&self) -> &[Channel] {
        const { &[V_REF] }
    }
    fn outputs(&self) -> &[Channel] {
        const { &[V] }
    }
    fn period(&self) -> f64 {
        if self.broken == "period" { 0.0 } else { 0.1 }
    }
    fn measure(&mut self, measured: &mut [f64]) -> Result<f64, RobotError> {
        if self.broken != "measure" {
            measured[0] = 0.0;
        }
        Ok(self.time)
    }
    fn step(&mut self, command: &[f64], measured: &mut [f64]) -> Result<f64, RobotError> {
        if self.broken == "step" {
            return Err(RobotError::Fault("bumper".into()));
        }
        measured[0] = command[0];
        if self.broken != "clock" {
            self.time += 0.1;
        }
        Ok(self.time)
    }
    fn stop(&mut self) -> Result<(), RobotError> {
        self.stops += 1;
        if self.broken == "stop" && self.stops > 1 { Err(RobotError::Driver("already closed".into())) } else { Ok(()) }
    }
}

#[test]
fn robots_are_checked_and_stopped() {
    for (broken, message) in [
        ("period", "the period is 0: it must be a number of seconds above zero"),
        ("measure", "`v` by measure was not written or is not finite at t = 0 s"),
        ("step", "step failed: the robot reported a fault: bumper"),
        ("clock", "the robot's time went from 0 s to 0 s over a control period"),
        ("stop", "a second stop failed: the robot's driver failed: already closed"),
    ] {
        let mut cart = Cart { broken, time: 0.0, stops: 0 };
        assert_eq!(first(check_robot(&mut cart)), message);
        assert_eq!(cart.stops, 2);
    }
    assert_eq!(check_robot(&mut Cart { broken: "", time: 5.0, stops: 0 }), Ok(()));
}

#[derive(Debug, serde::Serialize, serde::Deserialize)]
struct FirstChannel {}

#[typetag::serde(name = "first-channel-of-a-test")]
impl Excitation for FirstChannel {
    fn about(&self) -> String {
        String::new()
    }
    fn duration(&self) -> f64 {
        1.0
    }
    fn check(&self, _: &[Channel]) -> Result<(), ExcitationError> {
        Ok(())
    }
    fn command(&self, t: f64, _: &[Channel], command: &mut [f64]) {
        command.fill(0.0);
        command[0] = t;
    }
}

#[test]
fn excitations_go_by_name() {
    use crate::excitation::thesis::{ThesisConstant, ThesisKhepera, ThesisMultisine, ThesisPioneer};
    let inputs = [V_REF, OMEGA_REF];
    let built_in: [Box<dyn Excitation>; 4] = [
        Box::new(ThesisConstant::default()),
        Box::new(ThesisKhepera::default()),
        Box::new(ThesisMultisine::default()),
        Box::new(ThesisPioneer::default()),
    ];
    for excitation in built_in {
        assert_eq!(check_excitation(&*excitation, &inputs), Ok(()), "{excitation:?}");
    }
    let message = first(check_excitation(&FirstChannel {}, &inputs));
    assert!(message.starts_with("the command of `omega_ref` at t = 0.015625 s is 0.015625 where 0 was expected"), "{message}");
    let message = first(check_excitation(&ThesisPioneer::default(), &[U_LEFT]));
    assert_eq!(message, "check failed: the robot has no command `v_ref`; it takes `u_left`");
}
