//! A robot from first principles.
//!
//! One idea: integrate forces and voltages, measure what a robot would measure. A command passes the robot's limits
//! (`command`), a low-level controller turns it into voltages ([`control`]), motors push a body ([`plant`]), and encoders
//! look at the wheels ([`sensors`]). No equation of a model that is fitted to the recordings occurs.
//!
//! It runs as fast as the machine can; its clock is its own, unless `realtime` ties it to the world's.

mod command;
mod config;
pub mod control;
mod noise;
mod pace;
pub mod physics;
pub mod plant;
pub mod sensors;

use rand::rngs::StdRng;
use wheelwright_core::channel::{self, Channel};
use wheelwright_core::robot::{Robot, RobotError};

pub use config::{Settings, SimulatorConfig};
pub use control::{ControlLaw, VwGains, WheelGains};
pub use physics::Physics;
pub use plant::{Plant, PlantConstants, State};
pub use sensors::{PoseSource, Sensors, VelocitySource};

use command::SetPoint;
use noise::{Noise, Source, stream, uniform};
use pace::Pace;
use physics::link::OnTheWay;
use physics::machine::Machine;
use physics::sensing::{History, Observed};
use plant::Sides;
use sensors::{CHANNELS, OUTPUTS, Sensing};

/// Command channels.
static INPUTS: [Channel; 2] = [channel::V_REF, channel::OMEGA_REF];

/// A simulated robot: plant, limits, sensors and a clock.
#[derive(Debug)]
pub struct SimulatedRobot {
    plant: Plant,
    /// The plant with the parts that are on, in place of the rigid one.
    machine: Option<Machine>,
    link: Option<physics::Link>,
    on_the_way: OnTheWay,
    history: Option<History>,
    /// Errors of the stamps, and the last stamp.
    stamps: Noise,
    stamp: f64,
    jittered: bool,
    set_point: SetPoint,
    sensing: Sensing,
    period: f64,
    jitter: f64,
    pace: Option<Pace>,
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
        let physics = &settings.physics;
        let plant = Plant::new(settings.plant, settings.controller);
        let machine = physics.is_mechanical().then(|| Machine::new(settings.plant, settings.controller, physics.clone(), plant.step()));
        let sensing_way = physics.sensing.clone().unwrap_or_default();
        let mut sensing = Sensing::new(settings.sensors, &settings.plant, seed);
        let reading = sensing.measure(0.0, &Observed::default());
        Self {
            plant,
            machine,
            link: physics.link.clone(),
            on_the_way: OnTheWay::default(),
            history: (sensing_way.delay > 0.0).then(|| History::new(sensing_way.delay)),
            stamps: Noise::new(sensing_way.stamp_jitter, 0.0, stream(seed, Source::Stamp)),
            stamp: 0.0,
            jittered: sensing_way.stamp_jitter > 0.0,
            set_point: SetPoint::new(settings.limits, &settings.plant),
            sensing,
            period: settings.period,
            jitter: settings.jitter,
            pace: settings.realtime.then(Pace::default),
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

    /// Longest integration step \[s\].
    pub(crate) fn step_length(&self) -> f64 {
        self.machine.as_ref().map_or(self.plant.step(), Machine::step)
    }

    /// Moves for `interval` \[s\], command by command as they arrive.
    fn travel(&mut self, interval: f64) {
        let (start, end) = (self.time, self.time + interval);
        let mut t = start;
        while let Some((arrival, command)) = self.on_the_way.next(end) {
            self.glide(t, (arrival - t).max(0.0));
            t = arrival.max(t);
            self.set_point.command(command);
        }
        // One period without an arrival in it is not taken apart, so that it has its length to the last bit.
        self.glide(t, if t == start { interval } else { end - t });
    }

    /// Moves for `interval` \[s\] from time `from` \[s\] under the set point as it is.
    fn glide(&mut self, from: f64, interval: f64) {
        if interval <= 0.0 {
            return;
        }
        let Self { plant, machine, history, state, set_point, .. } = self;
        match machine {
            Some(machine) => {
                let note = |t: f64, observed| history.as_mut().map_or((), |history| history.push(t, observed));
                machine.advance(interval, |t| set_point.at(t), note);
                *state = machine.state();
            }
            None => {
                // A delayed sensor looks between these steps.
                let parts = if history.is_some() { (interval / SENSED_STEP).ceil().max(1.0) } else { 1.0 };
                let h = interval / parts;
                for k in 0..parts as usize {
                    plant.advance(state, h, |t| set_point.at(h * k as f64 + t));
                    if let Some(history) = history {
                        history.push(from + h * (k + 1) as f64, rigid(plant, state));
                    }
                }
            }
        }
        self.set_point.finish(interval);
    }

    /// What the sensors see at the end of a period.
    fn seen(&self) -> Observed {
        match (&self.history, &self.machine) {
            (Some(history), _) => history.seen(self.time),
            (None, Some(machine)) => machine.observed(),
            (None, None) => rigid(&self.plant, &self.state),
        }
    }

    /// The stamp of a measurement: the time, with the error of the stamps, later than the one before.
    fn stamped(&mut self) -> f64 {
        let least = self.stamp + 1e-3 * self.period;
        self.stamp = (self.time + self.stamps.next()).max(least).max(f64::MIN_POSITIVE);
        self.stamp
    }

    /// Length of the next period.
    fn interval(&mut self) -> f64 {
        if self.jitter > 0.0 { self.period * (1.0 + self.jitter * uniform(&mut self.periods)) } else { self.period }
    }

    fn switch_off(&mut self) {
        self.enabled = false;
        self.on_the_way.clear();
        self.set_point.reset();
    }
}

/// How finely the rigid plant's past is kept for a delayed sensor \[s\].
const SENSED_STEP: f64 = 2e-3;

/// What sensors see of the rigid plant.
fn rigid(plant: &Plant, state: &State) -> Observed {
    let c = plant.constants();
    let speeds = Sides::of_body(state.v, state.omega, c.track_width, c.wheel_radius);
    Observed { angles: state.wheels, speeds, pose: [state.x, state.y, state.phi] }
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

    fn real_time(&self) -> bool {
        self.pace.is_some()
    }

    fn measure(&mut self, measured: &mut [f64]) -> Result<f64, RobotError> {
        check_length(measured)?;
        measured.copy_from_slice(&self.reading);
        Ok(self.stamp)
    }

    fn step(&mut self, command: &[f64], measured: &mut [f64]) -> Result<f64, RobotError> {
        let command = self.check(command, measured).inspect_err(|_| self.switch_off())?;
        let interval = self.interval();
        self.on_the_way.send(self.link.as_ref(), self.time, command);
        self.travel(interval);
        self.count += 1;
        // Equal periods are counted, as a sum of them would drift by its rounding.
        self.time = if self.jitter > 0.0 { self.time + interval } else { self.count as f64 * self.period };
        if !self.state.is_finite() || self.machine.as_ref().is_some_and(|m| !m.is_finite()) {
            self.switch_off();
            return Err(RobotError::Fault(format!("the simulated motion left the range of numbers at t = {} s", self.time)));
        }
        let stamp = if self.jittered { self.stamped() } else { self.time };
        let seen = self.seen();
        self.reading = self.sensing.measure(self.time, &seen);
        self.stamp = stamp;
        if let Some(pace) = &mut self.pace {
            pace.wait(interval);
        }
        measured.copy_from_slice(&self.reading);
        Ok(stamp)
    }

    fn stop(&mut self) -> Result<(), RobotError> {
        self.switch_off();
        Ok(())
    }
}
