//! A robot from first principles.
//!
//! One idea: integrate forces and voltages, measure what a robot would measure. A command passes the robot's limits
//! (`command`), a low-level controller turns it into voltages ([`control`]), motors push a body ([`plant`]), and encoders
//! look at the wheels ([`sensors`]). No equation of a model that is fitted to the recordings occurs.
//!
//! It runs as fast as the machine can; its clock is its own.

mod command;
mod config;
pub mod control;
mod noise;
pub mod plant;
pub mod sensors;

use rand::rngs::StdRng;
use wheelwright_core::channel::{self, Channel};
use wheelwright_core::robot::{Robot, RobotError};

pub use config::{Settings, SimulatorConfig};
pub use control::{ControlLaw, VwGains, WheelGains};
pub use plant::{Plant, PlantConstants, State};
pub use sensors::{PoseSource, Sensors, VelocitySource};

use command::SetPoint;
use noise::{Source, stream, uniform};
use sensors::{CHANNELS, OUTPUTS, Sensing};

/// Command channels.
static INPUTS: [Channel; 2] = [channel::V_REF, channel::OMEGA_REF];

/// A simulated robot: plant, limits, sensors and a clock.
#[derive(Debug)]
pub struct SimulatedRobot {
    plant: Plant,
    set_point: SetPoint,
    sensing: Sensing,
    period: f64,
    jitter: f64,
    periods: StdRng,
    /// Periods passed.
    count: u64,
    time: f64,
    state: State,
    /// What was measured at `time`; reading it again does not measure again.
    reading: [f64; CHANNELS],
    enabled: bool,
}

impl SimulatedRobot {
    /// A robot of checked settings, at rest at the origin at time zero.
    pub(crate) fn new(settings: &Settings, seed: u64) -> Self {
        let state = State::default();
        let mut sensing = Sensing::new(settings.sensors, &settings.plant, seed);
        let reading = sensing.measure(0.0, &state);
        Self {
            plant: Plant::new(settings.plant, settings.controller),
            set_point: SetPoint::new(settings.limits, &settings.plant),
            sensing,
            period: settings.period,
            jitter: settings.jitter,
            periods: stream(seed, Source::Period),
            count: 0,
            time: 0.0,
            state,
            reading,
            enabled: true,
        }
    }

    /// The true state, which no sensor blurs.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Body, motors and controller.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    fn check(&self, command: &[f64], measured: &[f64]) -> Result<[f64; 2], RobotError> {
        if !self.enabled {
            return Err(RobotError::Fault("the motors are off: the robot was stopped; connect again to drive it".to_owned()));
        }
        check_length(measured)?;
        let &[v, omega] = command else {
            return Err(RobotError::Driver(format!("{} command values for the channels v_ref, omega_ref", command.len())));
        };
        for (channel, value) in INPUTS.iter().zip([v, omega]) {
            if !value.is_finite() {
                return Err(RobotError::Fault(format!(
                    "command {} is {value}, not a finite number; the motors were switched off",
                    channel.name
                )));
            }
        }
        Ok([v, omega])
    }

    /// Length of the next period.
    fn interval(&mut self) -> f64 {
        if self.jitter > 0.0 { self.period * (1.0 + self.jitter * uniform(&mut self.periods)) } else { self.period }
    }

    fn switch_off(&mut self) {
        self.enabled = false;
        self.set_point.reset();
    }
}

fn check_length(measured: &[f64]) -> Result<(), RobotError> {
    if measured.len() == CHANNELS {
        return Ok(());
    }
    Err(RobotError::Driver(format!("room for {} measured values, there are {}", measured.len(), CHANNELS)))
}

impl Robot for SimulatedRobot {
    fn inputs(&self) -> &[Channel] {
        &INPUTS
    }

    fn outputs(&self) -> &[Channel] {
        &OUTPUTS
    }

    fn period(&self) -> f64 {
        self.period
    }

    fn measure(&mut self, measured: &mut [f64]) -> Result<f64, RobotError> {
        check_length(measured)?;
        measured.copy_from_slice(&self.reading);
        Ok(self.time)
    }

    fn step(&mut self, command: &[f64], measured: &mut [f64]) -> Result<f64, RobotError> {
        let command = self.check(command, measured).inspect_err(|_| self.switch_off())?;
        let interval = self.interval();
        self.set_point.command(command);
        let Self { plant, state, set_point, .. } = self;
        plant.advance(state, interval, |t| set_point.at(t));
        set_point.finish(interval);
        self.count += 1;
        // Equal periods are counted, as a sum of them would drift by its rounding.
        self.time = if self.jitter > 0.0 { self.time + interval } else { self.count as f64 * self.period };
        if !self.state.is_finite() {
            self.switch_off();
            return Err(RobotError::Fault(format!("the simulated motion left the range of numbers at t = {} s", self.time)));
        }
        self.reading = self.sensing.measure(self.time, &self.state);
        measured.copy_from_slice(&self.reading);
        Ok(self.time)
    }

    fn stop(&mut self) -> Result<(), RobotError> {
        self.switch_off();
        Ok(())
    }
}
