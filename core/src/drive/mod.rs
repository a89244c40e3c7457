//! Driving: the loop that commands a robot and keeps what it measured.
//!
//! Row k of the recording holds the measurement at t_k and the command held from t_k to t_k+1, so the first row is the
//! robot before the first command. Whatever ends the loop, the robot is stopped and the rows so far are kept.
//!
//! [`steer`] is the loop, for whatever decides commands; [`drive`] is the same for an excitation. Everything that keeps it safe is
//! a small type of its own: [`limits`] hold commands back, [`floor`] foresees where the robot would come to rest, [`guard`] doubts
//! what the robot says, a [`dead_man`] switch has to be held, and [`sink`]s keep each row before its command is sent.
//!
//! A robot in real time does not wait for a law, a sink or an observer: two periods after a measurement it is told to stand beside them,
//! and stopped at the deadline. If they come back before, the drive goes on from a new measurement, with a gap in the rows.

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

use crate::excitation::Excitation;
use crate::profile::Limits;
use crate::recording::{GAP_PERIODS, Recording, RecordingError};
use crate::robot::Live;

pub use dead_man::DeadMan;
pub use fault::{DriveError, DriveFault};
pub use floor::{Floor, FloorWatch, Leaving};
pub use guard::Guard;
use keeper::Keeper;
pub use limits::{Bite, LimitError, Limiter, Wheels};
pub use sink::{RowSink, Rows, SinkError};
pub use watchdog::Watchdog;

/// A drive that makes fewer than this share of its planned progress per step is given up: a clock that crawls would
/// otherwise never end it.
const SLOWEST_CLOCK: f64 = 0.1;
/// Time that frozen data are let pass unless told otherwise \[s\].
const PATIENCE: f64 = 0.5;

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
    /// Longest time \[s\] from a measurement to the command that answers it, on a robot that lives in real time: then the drive ends.
    /// The robot stands from two periods on. By default two periods, and at least 0.25 s.
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
/// the drive with `Break`. Its time leaves out those for which a robot in real time had to stand because somebody was late.
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
        // As whoever reads its files.
        recording.split_at_gaps(GAP_PERIODS);
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
    let duration = shortened(duration, safety.time, remarks)?;
    let mut limiter = Limiter::new(safety.limits, safety.wheels, robot.inputs())?;
    let mut floor = floor_watch(&safety, robot)?;
    let (inputs, outputs) = (robot.inputs().len(), robot.outputs().len());
    let (mut command, mut measured, mut row) = (vec![0.0; inputs], vec![0.0; outputs], vec![0.0; inputs + outputs]);
    let most_steps = (duration / period / SLOWEST_CLOCK).ceil();
    let mut keeper = Keeper::begin(robot, &safety, &mut measured)?;
    // The plan waits while the robot has to stand because somebody was late.
    let (mut since, mut waited) = (period, 0.0);
    let outcome = loop {
        let (t, planned) = (keeper.t(), keeper.t() - waited);
        let going = match keeper.mind(|| law(planned, &measured, &mut command)) {
            Ok(going) => going,
            Err(fault) => break Err(fault),
        };
        if let Some(i) = command.iter().position(|c| !c.is_finite()) {
            break Err(DriveFault::Command { channel: keeper.robot.inputs()[i].name.to_string(), value: command[i], t });
        }
        limiter.apply(t, since, &mut command);
        row[..inputs].copy_from_slice(&command);
        keeper.robot.executed(&mut row[..inputs]);
        row[inputs..].copy_from_slice(&measured);
        rows.push(t, &row);
        let progress = DriveProgress { t, duration, command: &command, measured: &measured, bites: limiter.bites(), distance: None };
        if let Err(fault) = keeper.mind(|| tell(options, &row, &progress)) {
            break Err(fault);
        }
        // Half a period of grace: a sum of periods seldom hits the duration to the last bit.
        let over = |t: f64, end: f64| t > end - 0.5 * period;
        if going.is_break() || over(planned, duration) || safety.time.is_some_and(|end| over(t, end)) {
            break Ok(());
        }
        if let Some(fault) = halted(options, t) {
            break Err(fault);
        }
        match keeper.resume(&mut measured, |t| halted(options, t)) {
            Ok(false) => {}
            Ok(true) => {
                // The command that was late is never sent: another one answers what is measured now.
                limiter.stand();
                (since, waited) = (period, waited + keeper.t() - t - period);
                continue;
            }
            Err(fault) => break Err(fault),
        }
        if let Some(leaving) = floor.as_mut().and_then(|floor| floor.check(&measured, &command)) {
            break Err(DriveFault::Floor { leaving, t });
        }
        if keeper.steps() as f64 >= most_steps {
            break Err(DriveFault::SlowClock { elapsed: t, steps: keeper.steps(), period });
        }
        if let Err(fault) = keeper.step(&command, &mut measured) {
            break Err(fault);
        }
        since = keeper.t() - t;
    };
    remarks.extend(limiter.bites().iter().map(Bite::statement));
    remarks.extend(keeper.remark());
    remarks.extend(keeper.robot.warnings());
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
