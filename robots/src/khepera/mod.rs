//! Khepera III and IV, by the text protocol of K-Team's servers.
//!
//! One idea: the driver sets the pace. A period is: speeds out, wait, speeds and encoders in; each command waits for its
//! answer (`line`). The robot has no clock of its own on the wire and no watchdog: it drives on when the host is gone.

mod config;
pub mod dialect;
mod line;

use std::time::{Duration, Instant};

use wheelwright_core::channel::{self, Channel};
use wheelwright_core::robot::{Robot, RobotError};

use crate::wire::{Clock, Link, Tally, check_room, clamp, config as wrong, velocity_command};
pub use config::KheperaConfig;
use dialect::{Dialect, Generation};
use line::{Line, two};

/// Lets time pass in an emulator with a stepped clock, as in `Y,l20000` for 20 ms; no real robot knows it.
pub(crate) const STEP: char = 'Y';

static INPUTS: [Channel; 2] = [channel::V_REF, channel::OMEGA_REF];
static OUTPUTS: [Channel; 7] =
    [channel::V, channel::OMEGA, channel::X, channel::Y, channel::PHI, channel::OMEGA_LEFT, channel::OMEGA_RIGHT];

/// A connected Khepera.
#[derive(Debug)]
pub struct Khepera {
    line: Line,
    dialect: Dialect,
    period: f64,
    clock: Clock,
    /// +1, or −1 for a wheel whose motor is mounted the other way.
    signs: [i32; 2],
    /// Highest magnitudes of v, ω and a wheel's speed at the rim.
    limits: [Option<f64>; 3],
    started: Instant,
    /// When the period under way ends.
    due: Instant,
    time: f64,
    counters: Option<[i32; 2]>,
    measured: [f64; OUTPUTS.len()],
    tally: Tally,
    /// Wheel commands below what the motors hold.
    slow: u64,
    state: State,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Driving,
    Stopped,
    Failed,
}

impl Khepera {
    pub(super) fn connect(config: &KheperaConfig) -> Result<Self, RobotError> {
        let mut line = Line::new(Link::open(&config.endpoint()?)?, config.timeout);
        line.resynchronise()?;
        let version = line.ask("B")?;
        let named = config.generation.or_else(|| version.first().and_then(|v| Generation::of_version(v)));
        let generation = named.ok_or_else(|| {
            let reason = format!("the robot answers version `{}`, whose units are not known; set `generation`", version.join(","));
            wrong("generation", reason)
        })?;
        let dialect = config.adapt(generation.dialect());
        let now = Instant::now();
        let sign = |reversed: bool| if reversed { -1 } else { 1 };
        let mut robot = Self {
            line,
            dialect,
            period: config.period,
            clock: config.clock,
            signs: [sign(config.reverse_left), sign(config.reverse_right)],
            limits: [config.limits.v, config.limits.omega, config.limits.wheel_speed.map(|w| w * dialect.radius)],
            started: now,
            due: now,
            time: 0.0,
            counters: None,
            measured: [0.0; OUTPUTS.len()],
            tally: Tally::default(),
            slow: 0,
            state: State::Driving,
        };
        robot.send_speeds([0; 2])?;
        robot.read()?;
        Ok(robot)
    }

    /// The wheels' set points within all limits, in the robot's units but not rounded; left and right.
    fn wheels(&self, [v, omega]: [f64; 2]) -> [f64; 2] {
        let [v, omega] = [clamp(v, self.limits[0]), clamp(omega, self.limits[1])];
        let lead = 0.5 * self.dialect.track * omega;
        let fastest = f64::from(self.dialect.fastest);
        [v - lead, v + lead].map(|rim| (clamp(rim, self.limits[2]) * self.dialect.speed).clamp(-fastest, fastest))
    }

    fn body(&self, [left, right]: [f64; 2]) -> [f64; 2] {
        [0.5 * (left + right), (right - left) / self.dialect.track]
    }

    /// v and ω of set points in the robot's units.
    fn of_units(&self, units: [f64; 2]) -> [f64; 2] {
        self.body(units.map(|u| u / self.dialect.speed))
    }

    fn speeds_command(&self, [left, right]: [i32; 2]) -> String {
        let [left, right] = [left * self.signs[0], right * self.signs[1]].map(|s| self.dialect.long(s));
        format!("D,{left},{right}")
    }

    fn send_speeds(&mut self, units: [i32; 2]) -> Result<(), RobotError> {
        self.line.ask(&self.speeds_command(units)).map(drop)
    }

    fn drive(&mut self, wanted: [f64; 2]) -> Result<(), RobotError> {
        let wheels = self.wheels(wanted);
        let units = wheels.map(|u| u.round() as i32);
        self.slow += u64::from(units.iter().any(|u| *u != 0 && u.abs() < self.dialect.slowest));
        self.tally.count(wanted, self.of_units(wheels), self.of_units(units.map(f64::from)));
        self.send_speeds(units)?;
        self.wait()?;
        self.read()
    }

    /// Until the period ends.
    fn wait(&mut self) -> Result<(), RobotError> {
        if self.clock == Clock::Stepped {
            self.time += self.period;
            return self.line.ask(&format!("{STEP},l{:.0}", 1e6 * self.period)).map(drop);
        }
        self.due += Duration::from_secs_f64(self.period);
        let now = Instant::now();
        match self.due.checked_duration_since(now) {
            Some(left) => std::thread::sleep(left),
            None => {
                self.tally.late();
                self.due = now;
            }
        }
        Ok(())
    }

    /// Speeds and encoders.
    fn read(&mut self) -> Result<(), RobotError> {
        let asked = Instant::now();
        let speeds = two(&self.line.ask("E")?, "E")?;
        if self.clock == Clock::Real {
            // The robot measured somewhere between question and answer.
            let middle = asked.duration_since(self.started).as_secs_f64() + 0.5 * asked.elapsed().as_secs_f64();
            self.time = middle;
        }
        let counters = two(&self.line.ask("R")?, "R")?;
        let rims = [0, 1].map(|i| f64::from(speeds[i] * self.signs[i]) / self.dialect.speed);
        let [v, omega] = self.body(rims);
        let last = self.counters.replace(counters).unwrap_or(counters);
        let moved = [0, 1].map(|i| f64::from(counters[i].wrapping_sub(last[i]) * self.signs[i]) * self.dialect.pulse);
        let [way, turn] = self.body(moved);
        let [_, _, x, y, phi, ..] = self.measured;
        let (sin, cos) = (phi + 0.5 * turn).sin_cos();
        let [left, right] = rims.map(|rim| rim / self.dialect.radius);
        self.measured = [v, omega, x + way * cos, y + way * sin, phi + turn, left, right];
        Ok(())
    }
}

impl Robot for Khepera {
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
        self.clock == Clock::Real
    }

    fn executed(&self, command: &mut [f64]) {
        if let Ok(wanted) = velocity_command(command) {
            command.copy_from_slice(&self.of_units(self.wheels(wanted).map(f64::round)));
        }
    }

    fn measure(&mut self, measured: &mut [f64]) -> Result<f64, RobotError> {
        check_room(measured, OUTPUTS.len())?;
        if self.clock == Clock::Real {
            self.due = Instant::now();
            self.read()?;
        }
        measured.copy_from_slice(&self.measured);
        Ok(self.time)
    }

    fn step(&mut self, command: &[f64], measured: &mut [f64]) -> Result<f64, RobotError> {
        if self.state != State::Driving {
            return Err(RobotError::Fault("the robot was stopped; connect again to drive it".to_owned()));
        }
        let driven = check_room(measured, OUTPUTS.len()).and_then(|()| velocity_command(command)).and_then(|wanted| self.drive(wanted));
        if let Err(error) = driven {
            self.state = State::Failed;
            // The error that ended the drive is the one to report; `stop` says whether the robot could be told.
            let _ = self.line.tell(&self.speeds_command([0; 2]));
            return Err(error);
        }
        measured.copy_from_slice(&self.measured);
        Ok(self.time)
    }

    fn stop(&mut self) -> Result<(), RobotError> {
        if self.state == State::Stopped {
            return Ok(());
        }
        self.state = State::Failed;
        self.send_speeds([0; 2])?;
        self.state = State::Stopped;
        Ok(())
    }

    fn warnings(&self) -> Vec<String> {
        let mut warnings = self.tally.warnings();
        let count = self.tally.commands();
        if self.slow > 0 {
            let rim = f64::from(self.dialect.slowest) / self.dialect.speed;
            warnings
                .push(format!("{} of {count} commands asked a wheel for less than the {rim:.4} m/s that its controller holds", self.slow));
        }
        if self.line.missing() > 0 {
            warnings.push(format!("{} answers of the robot never came; the commands were sent again", self.line.missing()));
        }
        warnings
    }
}

impl Drop for Khepera {
    fn drop(&mut self) {
        // It has no watchdog, so that this is the last chance; nothing can be done if it fails.
        let _ = self.stop();
    }
}
