//! Driving: the loop that commands a robot and keeps what it measured.
//!
//! Row k of the recording holds the measurement at t_k and the command held from t_k to t_k+1, so the first row is the
//! robot before the first command. Whatever ends the loop, the robot is stopped and the rows so far are kept.
//!
//! [`steer`] is the loop, for whatever decides commands; [`drive`] is the same for an excitation. Everything that keeps it safe is
//! a small type of its own: [`limits`] hold commands back, [`floor`] foresees where the robot would come to rest, [`guard`] doubts
//! what the robot says, a [`dead_man`] switch has to be held, [`sink`]s keep each row before its command is sent, and a robot in real
//! time is stopped at the deadline whatever law, sink or observer is still at work.

pub mod dead_man;
mod fault;
pub mod floor;
pub mod guard;
mod keeper;
pub mod limits;
pub mod sink;
pub mod watchdog;

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::excitation::Excitation;
use crate::profile::Limits;
use crate::recording::{Recording, RecordingError};
use crate::robot::Live;

pub use dead_man::DeadMan;
pub use fault::{DriveError, DriveFault};
pub use floor::{Floor, FloorWatch, Leaving};
pub use guard::Guard;
use keeper::minded;
pub use limits::{Bite, LimitError, Limiter, Wheels};
pub use sink::{RowSink, Rows, SinkError};
pub use watchdog::Watchdog;

/// A drive that makes fewer than this share of its planned progress per step is given up: a clock that crawls would
/// otherwise never end it.
const SLOWEST_CLOCK: f64 = 0.1;
/// Time that frozen data are let pass unless told otherwise \[s\].
const PATIENCE: f64 = 0.5;
/// The program's own deadline unless told otherwise: so many periods, and at least so many seconds.
const DEADLINE: (f64, f64) = (2.0, 0.25);
/// A robot may take this many periods, and this many seconds, for one.
const SLOWEST_STEP: (f64, f64) = (10.0, 1.0);

/// What a drive keeps within.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Safety {
    /// Limits on commands; none by default.
    pub limits: Limits,
    /// Dimensions, for the limit on the wheels.
    pub wheels: Option<Wheels>,
    /// The floor there is; without one the robot may go anywhere.
    pub floor: Option<Floor>,
    /// Longest drive \[s\]; a longer one is cut short.
    pub time: Option<f64>,
    /// Time \[s\] that measurements may stay the same, to the last bit, while motion is commanded.
    pub frozen: f64,
    /// Longest time \[s\] from a measurement to the command that answers it, on a robot that lives in real time. By default two
    /// periods, and at least 0.25 s.
    pub deadline: Option<f64>,
}

impl Default for Safety {
    fn default() -> Self {
        Self { limits: Limits::default(), wheels: None, floor: None, time: None, frozen: PATIENCE, deadline: None }
    }
}

/// What a drive looks at besides the robot.
#[derive(Default)]
pub struct DriveOptions<'a> {
    /// Length \[s\]; the excitation's own if `None`.
    pub duration: Option<f64>,
    /// What it keeps within.
    pub safety: Safety,
    /// Ends the drive when it becomes true; looked at before every command.
    pub stop: Option<&'a AtomicBool>,
    /// Ends the drive when nobody holds it; looked at before every command.
    pub dead_man: Option<&'a DeadMan>,
    /// Given every row before its command is sent.
    pub sinks: Vec<&'a mut dyn RowSink>,
    /// Told after every row.
    pub observer: Option<&'a mut dyn FnMut(&DriveProgress<'_>)>,
}

/// One row of a running drive.
#[derive(Debug, Clone, Copy)]
pub struct DriveProgress<'a> {
    /// Time since the first measurement \[s\].
    pub t: f64,
    /// Planned length \[s\].
    pub duration: f64,
    /// Command about to be held.
    pub command: &'a [f64],
    /// Values measured at `t`.
    pub measured: &'a [f64],
    /// Where limits held commands back so far.
    pub bites: &'a [Bite],
    /// Distance from where the robot should be \[m\], if it follows a trajectory.
    pub distance: Option<f64>,
}

/// Decides commands: given the time \[s\] and what was measured then, it writes the command to be held for a period, and may end
/// the drive with `Break`.
pub type Law<'a> = dyn FnMut(f64, &[f64], &mut [f64]) -> Result<ControlFlow<()>, DriveFault> + 'a;

/// Drives a robot with an excitation and records `t`, the commands and the measurements, `t` counted from the first
/// measurement. The last row holds the command that would have come next. The robot is stopped at the end.
///
/// # Errors
/// [`DriveError`] with the cause and the rows so far. A panic in the excitation or the observer passes through; the
/// caller's [`Live`] then stops the robot.
pub fn drive(robot: &mut Live, excitation: &dyn Excitation, options: DriveOptions<'_>) -> Result<Recording, DriveError> {
    if let Err(error) = excitation.check(robot.inputs()) {
        return Err(DriveError { fault: error.into(), recorded: None, stop_failed: robot.stop().err() });
    }
    let inputs = robot.inputs().to_vec();
    let duration = options.duration.unwrap_or_else(|| excitation.duration());
    let mut law = |t: f64, _: &[f64], command: &mut [f64]| {
        excitation.command(t, &inputs, command);
        Ok(ControlFlow::Continue(()))
    };
    steer(robot, duration, &mut law, options)
}

/// Drives a robot for `duration` \[s\] by a law that sees what is measured, and records as [`drive`] does.
///
/// What limits held back, and a length cut short, stand in the recording's warnings.
///
/// # Errors
/// As [`drive`].
pub fn steer(robot: &mut Live, duration: f64, law: &mut Law<'_>, mut options: DriveOptions<'_>) -> Result<Recording, DriveError> {
    let mut rows = Rows::new(robot.inputs().iter().chain(robot.outputs()));
    let mut remarks = Vec::new();
    let outcome = cycles(robot, duration, law, &mut options, &mut rows, &mut remarks);
    // First the robot, then the files.
    let stopped = robot.stop();
    let mut finished = Ok(());
    for sink in &mut options.sinks {
        // Each is finished, also after one that failed.
        finished = finished.and(sink.finish());
    }
    let recording = rows.into_recording().map(|mut recording: Recording| {
        recording.warnings = remarks;
        recording
    });
    conclude(outcome.and(finished.map_err(DriveFault::from)), stopped, recording)
}

fn conclude(
    outcome: Result<(), DriveFault>,
    stopped: Result<(), crate::robot::RobotError>,
    recording: Result<Recording, RecordingError>,
) -> Result<Recording, DriveError> {
    match (outcome, stopped) {
        (Ok(()), Ok(())) => recording.map_err(|e| DriveError { fault: e.into(), recorded: None, stop_failed: None }),
        (Ok(()), Err(error)) => {
            Err(DriveError { fault: error.clone().into(), recorded: recording.ok().map(Box::new), stop_failed: Some(error) })
        }
        (Err(fault), stopped) => Err(DriveError { fault, recorded: recording.ok().map(Box::new), stop_failed: stopped.err() }),
    }
}

/// The loop itself; rows are added as they come.
fn cycles(
    robot: &mut Live,
    duration: f64,
    law: &mut Law<'_>,
    options: &mut DriveOptions<'_>,
    rows: &mut Rows,
    remarks: &mut Vec<String>,
) -> Result<(), DriveFault> {
    let safety = options.safety;
    let period = robot.period();
    positive("the drive's duration", duration)?;
    positive("the robot's control period", period)?;
    let duration = shortened(duration, safety.time, remarks)?;
    let mut limiter = Limiter::new(safety.limits, safety.wheels, robot.inputs())?;
    let mut floor = floor_watch(&safety, robot)?;
    let mut clock = Pace::new(robot, &safety);
    let (inputs, outputs) = (robot.inputs().len(), robot.outputs().len());
    let (mut command, mut measured, mut row) = (vec![0.0; inputs], vec![0.0; outputs], vec![0.0; inputs + outputs]);
    let most_steps = (duration / period / SLOWEST_CLOCK).ceil();
    let start = robot.measure(&mut measured)?;
    clock.measured();
    let mut guard = Guard::begin(robot.inputs(), robot.outputs(), period, safety.frozen, start, &measured)?;
    let (mut t, mut since, mut steps) = (0.0, period, 0_usize);
    let outcome = loop {
        let going = match clock.mind(robot, t, || law(t, &measured, &mut command)) {
            Ok(going) => going,
            Err(fault) => break Err(fault),
        };
        if let Some(i) = command.iter().position(|c| !c.is_finite()) {
            break Err(DriveFault::Command { channel: robot.inputs()[i].name.to_string(), value: command[i], t });
        }
        limiter.apply(t, since, &mut command);
        row[..inputs].copy_from_slice(&command);
        robot.executed(&mut row[..inputs]);
        row[inputs..].copy_from_slice(&measured);
        rows.push(t, &row);
        let progress = DriveProgress { t, duration, command: &command, measured: &measured, bites: limiter.bites(), distance: None };
        if let Err(fault) = clock.mind(robot, t, || tell(options, &row, &progress)) {
            break Err(fault);
        }
        // Half a period of grace: a sum of periods seldom hits the duration to the last bit.
        if going.is_break() || t > duration - 0.5 * period {
            break Ok(());
        }
        if let Some(fault) = halted(options, t) {
            break Err(fault);
        }
        if let Some(leaving) = floor.as_mut().and_then(|floor| floor.check(&measured, &command)) {
            break Err(DriveFault::Floor { leaving, t });
        }
        if steps as f64 >= most_steps {
            break Err(DriveFault::SlowClock { elapsed: t, steps, period });
        }
        let stepped = clock.step(robot, t, &command, &mut measured).and_then(|time| guard.check(&command, time, &measured));
        match stepped {
            Ok(after) => (since, t) = (after - t, after),
            Err(fault) => break Err(fault),
        }
        steps += 1;
    };
    remarks.extend(limiter.bites().iter().map(Bite::statement));
    remarks.extend(robot.warnings());
    outcome
}

/// Keeps a row, then shows it.
fn tell(options: &mut DriveOptions<'_>, row: &[f64], progress: &DriveProgress<'_>) -> Result<(), DriveFault> {
    options.sinks.iter_mut().try_for_each(|sink| sink.row(progress.t, row))?;
    if let Some(observer) = options.observer.as_mut() {
        observer(progress);
    }
    Ok(())
}

/// Whoever may end a drive between two commands.
fn halted(options: &DriveOptions<'_>, t: f64) -> Option<DriveFault> {
    if options.stop.is_some_and(|stop| stop.load(Ordering::Relaxed)) {
        return Some(DriveFault::Interrupted { t });
    }
    options.dead_man.filter(|switch| !switch.held()).map(|_| DriveFault::Released { t })
}

fn shortened(duration: f64, longest: Option<f64>, remarks: &mut Vec<String>) -> Result<f64, DriveFault> {
    let Some(longest) = longest else { return Ok(duration) };
    positive("the longest time", longest)?;
    if longest < duration {
        remarks.push(format!("the drive was cut short by the limit on its time: {longest} s of {duration} s"));
    }
    Ok(longest.min(duration))
}

fn floor_watch(safety: &Safety, robot: &Live) -> Result<Option<FloorWatch>, DriveFault> {
    let Some(floor) = safety.floor else { return Ok(None) };
    if let Some((key, reason)) = floor.flaw() {
        return Err(DriveFault::BadFloor { key, reason });
    }
    let watch = FloorWatch::new(floor, safety.limits.v_dot, robot.period(), robot.inputs(), robot.outputs());
    watch.ok_or(DriveFault::NoPose).map(Some)
}

fn positive(what: &'static str, value: f64) -> Result<(), DriveFault> {
    if value.is_finite() && value > 0.0 { Ok(()) } else { Err(DriveFault::Time { what, value }) }
}

/// The program's own clock beside a robot that lives in real time.
struct Pace {
    real_time: bool,
    period: f64,
    deadline: f64,
    /// When the last measurement came.
    came: Instant,
}

impl Pace {
    fn new(robot: &Live, safety: &Safety) -> Self {
        let period = robot.period();
        let deadline = safety.deadline.unwrap_or_else(|| (DEADLINE.0 * period).max(DEADLINE.1));
        Self { real_time: robot.real_time(), period, deadline, came: Instant::now() }
    }

    fn measured(&mut self) {
        self.came = Instant::now();
    }

    /// Does a part of the work between a measurement and its command; at the deadline the robot is stopped beside it.
    fn mind<T>(&self, robot: &mut Live, t: f64, work: impl FnOnce() -> Result<T, DriveFault>) -> Result<T, DriveFault> {
        if !self.real_time {
            return work();
        }
        let left = (self.deadline - self.late()).max(0.0);
        // A deadline longer than any duration is none.
        let (worked, stopped) = minded(robot, Duration::try_from_secs_f64(left).unwrap_or(Duration::MAX), work);
        if stopped { worked.and(Err(self.missed(t))) } else { worked }
    }

    /// Time since the last measurement \[s\].
    fn late(&self) -> f64 {
        self.came.elapsed().as_secs_f64()
    }

    fn missed(&self, t: f64) -> DriveFault {
        DriveFault::Deadline { late_s: self.late(), limit_s: self.deadline, t }
    }

    /// Holds the command for a period, unless it is too late for it.
    fn step(&mut self, robot: &mut Live, t: f64, command: &[f64], measured: &mut [f64]) -> Result<f64, DriveFault> {
        if self.real_time && self.late() > self.deadline {
            return Err(self.missed(t));
        }
        let sent = Instant::now();
        let time = robot.step(command, measured)?;
        self.came = Instant::now();
        let took_s = (self.came - sent).as_secs_f64();
        if self.real_time && took_s > (SLOWEST_STEP.0 * self.period).max(SLOWEST_STEP.1) {
            return Err(DriveFault::SlowRobot { took_s, period: self.period, t });
        }
        Ok(time)
    }
}
