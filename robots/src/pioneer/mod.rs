//! Pioneer robots and their relatives, by the packets of ARCOS, AROS and P2OS.
//!
//! One idea: the robot sets the pace. It sends a packet every cycle; a command goes out when one has come, and the next
//! packet is its answer. Layers: [`packet`] frames bytes, [`command`], [`sip`] and [`firmware`] give them a meaning,
//! [`conversion`] gives them units, `cycle` gives them a time, `session` opens and closes the line.

pub mod command;
mod config;
pub mod conversion;
mod cycle;
mod executed;
pub mod firmware;
pub mod packet;
mod session;
pub mod sip;

use std::time::{Duration, Instant};

use wheelwright_core::channel::{self, Channel};
use wheelwright_core::robot::{Robot, RobotError};

use crate::wire::{Clock, Link, check_room, config as wrong, velocity_command};
use command::number;
pub use config::{CommandKind, OmegaSource, PioneerConfig};
use conversion::{Conversion, Unwrapped, WRAP};
use cycle::CycleClock;
use executed::Execution;
use firmware::Firmware;
use session::{Received, Session};
use sip::Sip;

static INPUTS: [Channel; 2] = [channel::V_REF, channel::OMEGA_REF];
static OUTPUTS: [Channel; 10] = [
    channel::V,
    channel::OMEGA,
    channel::X,
    channel::Y,
    channel::PHI,
    channel::VEL_LEFT,
    channel::VEL_RIGHT,
    Channel::new("battery", "V"),
    Channel::new("pos_left", "m"),
    Channel::new("pos_right", "m"),
];
/// Channels without the encoders' two.
const WITHOUT_ENCODERS: usize = 8;

/// Cycle if the firmware does not say \[s\].
const CYCLE: f64 = 0.1;
/// Motors are powered within this many cycles, or not at all.
const ENABLING: u32 = 30;
/// Cycles that a robot may take to come to rest before its motors are switched off.
const COMING_TO_REST: u32 = 20;
/// A connected Pioneer with powered motors.
#[derive(Debug)]
pub struct Pioneer {
    session: Session,
    conversion: Conversion,
    omega: OmegaSource,
    execution: Execution,
    clock: CycleClock,
    cycle: f64,
    /// Cycles a control period.
    cycles: u32,
    timeout: Duration,
    stepped: bool,
    /// Metres a tick of the encoders, if they are asked for.
    tick: Option<f64>,
    pose: [Unwrapped; 3],
    last: Option<Sip>,
    measured: [f64; OUTPUTS.len()],
    state: State,
    remarks: Vec<String>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Driving,
    /// Told to stand, with the motors off.
    Stopped,
    /// Nothing may be driven any more; whether the robot was told to stand is not known.
    Failed,
}

impl Pioneer {
    pub(super) fn connect(config: &PioneerConfig) -> Result<Self, RobotError> {
        let mut session = Session::new(Link::open(&config.endpoint()?)?, config.clock);
        let identity = session.synchronise()?;
        let conversion = match config.conversion {
            Some(conversion) => conversion,
            None => Conversion::of(config.subclass.as_deref().unwrap_or(&identity.subclass))?,
        };
        session.send(&command::integer(number::OPEN, 1))?;
        let firmware = session.firmware()?;
        let mut remarks = Vec::new();
        if firmware.is_none() {
            remarks.push(format!(
                "the robot {} ({} {}) does not tell its settings: a cycle of {CYCLE} s and the limits of the configuration are assumed",
                identity.name, identity.class, identity.subclass
            ));
        }
        let firmware = firmware.unwrap_or_default();
        let cycle = if firmware.cycle == 0 { CYCLE } else { 1e-3 * f64::from(firmware.cycle) };
        // A session that is left again is closed.
        let close = |_: &RobotError| drop(session.send(&command::plain(number::CLOSE)));
        let counted = cycles(config.period, cycle).and_then(|n| Ok((n, config.encoders.then(|| tick(&firmware)).transpose()?)));
        let (cycles, tick) = counted.inspect_err(close)?;
        let mut robot = Self {
            session,
            conversion,
            omega: config.omega,
            execution: Execution::new(config, conversion, &firmware),
            clock: CycleClock::new(cycle),
            cycle,
            cycles,
            timeout: Duration::from_secs_f64(config.timeout),
            stepped: config.clock == Clock::Stepped,
            tick,
            pose: [Unwrapped::default(); 3],
            last: None,
            measured: [0.0; OUTPUTS.len()],
            state: State::Driving,
            remarks,
        };
        robot.prepare()?;
        Ok(robot)
    }

    /// Sonar off, odometry to zero, limits into the firmware, motors on.
    fn prepare(&mut self) -> Result<(), RobotError> {
        self.session.send(&command::integer(number::SONAR, 0))?;
        self.session.send(&self.execution.standing())?;
        self.session.send(&self.execution.settings())?;
        self.session.send(&command::plain(number::SETO))?;
        if self.tick.is_some() {
            self.session.send(&command::integer(number::ENCODER, 2))?;
        }
        self.session.send(&command::integer(number::ENABLE, 1))?;
        for _ in 0..ENABLING {
            self.session.send(&command::plain(number::PULSE))?;
            self.advance()?;
            if let Some(sip) = self.last.take_if(|sip| sip.motors_on()) {
                // The odometry is at zero since before the motors were on.
                self.pose = [Unwrapped::default(); 3];
                self.read(&sip);
                self.last = Some(sip);
                return Ok(());
            }
        }
        let flags = self.last.as_ref().map_or(0, |s| s.flags);
        Err(RobotError::Fault(format!(
            "the motors stay off {:.0} s after ENABLE (flags {flags:#06x}); release the emergency stop and the motors button",
            f64::from(ENABLING) * self.cycle
        )))
    }

    /// Waits for the next packet, which ends a cycle. A robot that is silent for two cycles is told to stand.
    fn advance(&mut self) -> Result<(), RobotError> {
        self.session.let_pass()?;
        let begin = Instant::now();
        let patience = Duration::from_secs_f64(2.0 * self.cycle).min(self.timeout);
        if self.take_until(begin + patience)? {
            return Ok(());
        }
        self.session.send(&self.execution.standing())?;
        if self.take_until(begin + self.timeout)? {
            let silence = begin.elapsed().as_secs_f64();
            let time = self.clock.time();
            self.remarks.push(format!("the robot was silent for {silence:.2} s at t = {time:.2} s; it was told to stand meanwhile"));
            return Ok(());
        }
        let what = "its information packet; was it switched off, or the line cut?".to_owned();
        Err(RobotError::Timeout { limit_s: self.timeout.as_secs_f64(), what })
    }

    /// Takes packets until an information packet was among them; false if none came in time.
    fn take_until(&mut self, end: Instant) -> Result<bool, RobotError> {
        while let Some(received) = self.session.receive(end)? {
            if self.take(received)? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Takes what has come already. A robot whose clock is stepped has nothing more to say.
    fn drain(&mut self) -> Result<bool, RobotError> {
        let mut any = false;
        while !self.stepped && self.take_until(Instant::now())? {
            any = true;
        }
        Ok(any)
    }

    /// Takes one packet; true if it was an information packet.
    fn take(&mut self, received: Received) -> Result<bool, RobotError> {
        if let (Some(ticks), Some(tick)) = (sip::encoder_ticks(&received.packet), self.tick) {
            let [left, right] = ticks.map(|t| f64::from(t) * tick);
            self.measured[8..].copy_from_slice(&[left, right]);
            return Ok(false);
        }
        let Some(sip) = Sip::decode(&received.packet) else { return Ok(false) };
        self.clock.tick(received.arrival, received.damaged);
        self.read(&sip);
        self.last = Some(sip);
        Ok(true)
    }

    fn read(&mut self, sip: &Sip) {
        let c = &self.conversion;
        let [left, right] = [sip.left, sip.right].map(|speed| f64::from(speed) * c.velocity);
        let [v, from_wheels] = c.to_body(left, right);
        let rotation = sip.tail.and_then(|t| t.rotation).filter(|_| self.omega == OmegaSource::Rotvel);
        let omega = rotation.map_or(from_wheels, |rate| (0.1 * f64::from(rate)).to_radians());
        let raw = [sip.x, sip.y, sip.heading];
        let units = [(c.distance, WRAP), (c.distance, WRAP), (c.angle, c.turn())];
        let mut pose = [0.0; 3];
        for ((pose, counter), (raw, (unit, wrap))) in pose.iter_mut().zip(&mut self.pose).zip(raw.into_iter().zip(units)) {
            *pose = counter.follow(raw, wrap) as f64 * unit;
        }
        let [x, y, phi] = pose;
        self.measured[..WITHOUT_ENCODERS].copy_from_slice(&[v, omega, x, y, phi, left, right, sip.volts()]);
    }

    fn drive(&mut self, wanted: [f64; 2]) -> Result<(), RobotError> {
        if self.drain()? {
            self.execution.late();
        }
        let packets = self.execution.command(wanted, self.cycle * f64::from(self.cycles));
        self.session.send(&packets)?;
        for passed in 0..self.cycles {
            if passed > 0 {
                self.session.send(&command::plain(number::PULSE))?;
            }
            self.advance()?;
        }
        match self.last.as_ref().filter(|sip| !sip.motors_on()) {
            None => Ok(()),
            Some(sip) => Err(RobotError::Fault(format!(
                "the motors went off (flags {:#06x}, stall {:#06x}): emergency stop, motors button or a stall",
                sip.flags, sip.stall
            ))),
        }
    }

    /// Stands, waits until the wheels do, and takes the power off the motors.
    fn halt(&mut self) -> Result<(), RobotError> {
        self.tell_to_stand()?;
        for _ in 0..COMING_TO_REST {
            let resting = self.last.as_ref().is_none_or(|sip| sip.left == 0 && sip.right == 0);
            if resting || self.advance().is_err() {
                break;
            }
            self.tell_to_stand()?;
        }
        self.session.send(&command::integer(number::ENABLE, 0))
    }

    fn tell_to_stand(&mut self) -> Result<(), RobotError> {
        self.session.send(&self.execution.standing())
    }

    /// Tells the robot all that can still be told; nothing can be done if that fails.
    fn leave(&mut self) {
        if self.state != State::Stopped {
            let _ = self.tell_to_stand();
            let _ = self.session.send(&command::integer(number::ENABLE, 0));
        }
        let _ = self.session.send(&command::plain(number::CLOSE));
        self.session.finish();
    }
}

impl Robot for Pioneer {
    fn inputs(&self) -> &[Channel] {
        &INPUTS
    }

    fn outputs(&self) -> &[Channel] {
        if self.tick.is_some() { &OUTPUTS } else { &OUTPUTS[..WITHOUT_ENCODERS] }
    }

    fn period(&self) -> f64 {
        self.cycle * f64::from(self.cycles)
    }

    fn real_time(&self) -> bool {
        !self.stepped
    }

    fn executed(&self, command: &mut [f64]) {
        if let Ok(wanted) = velocity_command(command) {
            command.copy_from_slice(&self.execution.executed(wanted));
        }
    }

    fn measure(&mut self, measured: &mut [f64]) -> Result<f64, RobotError> {
        let channels = self.outputs().len();
        check_room(measured, channels)?;
        if !self.stepped {
            // What has come already is of some time ago; the next packet begins a cycle.
            self.drain()?;
            self.session.send(&command::plain(number::PULSE))?;
            self.advance()?;
        }
        measured.copy_from_slice(&self.measured[..channels]);
        Ok(self.clock.time())
    }

    fn step(&mut self, command: &[f64], measured: &mut [f64]) -> Result<f64, RobotError> {
        if self.state != State::Driving {
            return Err(RobotError::Fault("the motors are off: the robot was stopped; connect again to drive it".to_owned()));
        }
        let channels = self.outputs().len();
        let driven = check_room(measured, channels).and_then(|()| velocity_command(command)).and_then(|wanted| self.drive(wanted));
        if let Err(error) = driven {
            self.state = State::Failed;
            // The error that ended the drive is the one to report; `stop` says whether the robot could be told.
            let _ = self.tell_to_stand();
            return Err(error);
        }
        measured.copy_from_slice(&self.measured[..channels]);
        Ok(self.clock.time())
    }

    fn stop(&mut self) -> Result<(), RobotError> {
        if self.state == State::Stopped {
            return Ok(());
        }
        self.state = State::Failed;
        self.halt()?;
        self.state = State::Stopped;
        Ok(())
    }

    fn warnings(&self) -> Vec<String> {
        self.remarks.iter().cloned().chain(self.execution.warnings()).collect()
    }
}

impl Drop for Pioneer {
    fn drop(&mut self) {
        self.leave();
    }
}

/// Cycles a control period.
fn cycles(period: Option<f64>, cycle: f64) -> Result<u32, RobotError> {
    let wanted = period.unwrap_or(cycle) / cycle;
    let cycles = wanted.round();
    if cycles < 1.0 || (wanted - cycles).abs() > 1e-6 {
        let reason = format!("must be a multiple of the robot's cycle of {cycle} s, not {}", period.unwrap_or(cycle));
        return Err(wrong("period", reason));
    }
    Ok(cycles as u32)
}

/// Metres a tick of the encoders.
fn tick(firmware: &Firmware) -> Result<f64, RobotError> {
    if firmware.ticks_per_mm == 0 {
        return Err(wrong("encoders", "the robot does not say how many ticks a millimetre has: leave `encoders` out"));
    }
    Ok(1e-3 / f64::from(firmware.ticks_per_mm))
}
