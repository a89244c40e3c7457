//! Somebody at the robot while others take their time: what decides a command, keeps its row or shows it may be late or hang, and the
//! robot must not drive on meanwhile.
//!
//! Two periods after a measurement without its command the robot is told to stand, period by period, beside the late work. Work that comes
//! back lets the drive go on; at the deadline the robot is stopped for good. To stand is to step with zero, which every robot can.

use std::panic::resume_unwind;
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError, channel};
use std::thread::{self, ScopedJoinHandle};
use std::time::{Duration, Instant};

use super::fault::DriveFault;
use super::guard::Guard;
use super::{Safety, positive};
use crate::recording::GAP_PERIODS;
use crate::robot::Live;

/// Periods from a measurement without its command until the robot is told to stand.
const PATIENCE: f64 = 2.0;
/// The program's own deadline unless told otherwise: so many periods, and at least so many seconds.
const DEADLINE: (f64, f64) = (2.0, 0.25);
/// A robot may take this many periods, and this many seconds, for one.
const SLOWEST_STEP: (f64, f64) = (10.0, 1.0);
/// Periods that a stand takes at least. No row is kept of them, so that whoever reads the recording finds a gap there.
const STAND: usize = GAP_PERIODS as usize + 2;
/// Stands that are let pass, and commands that each further one needs: who is late more often cannot drive this robot.
const STANDS: (usize, usize) = (2, 10);

/// Whoever measures and commands a robot during a drive.
pub(super) struct Keeper<'a> {
    pub(super) robot: &'a mut Live,
    guard: Guard,
    real_time: bool,
    period: f64,
    deadline: f64,
    /// When the last measurement came.
    came: Instant,
    /// Commands sent, those to stand left out.
    steps: usize,
    stands: Vec<Stand>,
    /// True while the last stand is not over.
    standing: bool,
    zero: Vec<f64>,
    /// What was measured last while it stood.
    seen: Vec<f64>,
}

/// A time for which the robot was told to stand because somebody was late.
struct Stand {
    /// Time of the measurement that was not answered \[s\].
    t: f64,
    begun: Instant,
    periods: usize,
    lasted: Duration,
}

impl<'a> Keeper<'a> {
    /// Takes charge of a robot with a first measurement.
    pub(super) fn begin(robot: &'a mut Live, safety: &Safety, measured: &mut [f64]) -> Result<Self, DriveFault> {
        let (period, real_time) = (robot.period(), robot.real_time());
        positive("the robot's control period", period)?;
        let start = robot.measure(measured)?;
        let guard = Guard::begin(robot.inputs(), robot.outputs(), period, safety.frozen, start, measured)?;
        let deadline = safety.deadline.unwrap_or_else(|| (DEADLINE.0 * period).max(DEADLINE.1));
        let (zero, seen) = (vec![0.0; robot.inputs().len()], measured.to_vec());
        Ok(Self {
            robot,
            guard,
            real_time,
            period,
            deadline,
            came: Instant::now(),
            steps: 0,
            stands: Vec::new(),
            standing: false,
            zero,
            seen,
        })
    }

    /// Does a part of the work between a measurement and its command; a robot in real time is minded meanwhile by a thread.
    ///
    /// Work that never returns is left to the program's watchdog; the robot is stopped by then.
    pub(super) fn mind<T>(&mut self, work: impl FnOnce() -> Result<T, DriveFault>) -> Result<T, DriveFault> {
        if !self.real_time {
            return work();
        }
        let came = self.came;
        let (done, waited) = channel::<()>();
        let keeper = &mut *self;
        let (worked, late, kept) = thread::scope(|scope| {
            let keeper = thread::Builder::new().spawn_scoped(scope, move || keeper.keep(&waited));
            let worked = work();
            let late = came.elapsed();
            drop(done);
            // Without a thread for it, lateness is only looked at afterwards.
            (worked, late, keeper.map_or(Ok(Ok(false)), ScopedJoinHandle::join))
        });
        let worked = worked?;
        let stopped = kept.unwrap_or_else(|panic| resume_unwind(panic))?;
        if stopped { Err(self.missed(late)) } else { Ok(worked) }
    }

    /// Minds the robot until others are done: it stands if they are late, and is stopped at the deadline. True if it was stopped.
    fn keep(&mut self, done: &Receiver<()>) -> Result<bool, DriveFault> {
        let came = self.came;
        let patience = (PATIENCE * self.period).min(self.deadline) - came.elapsed().as_secs_f64();
        // A deadline longer than any duration is none.
        let patience = Duration::try_from_secs_f64(patience.max(0.0)).unwrap_or(Duration::MAX);
        if done.recv_timeout(patience) != Err(RecvTimeoutError::Timeout) {
            return Ok(false);
        }
        let mut stood = Ok(());
        while stood.is_ok() && came.elapsed().as_secs_f64() < self.deadline {
            stood = self.stand();
            if stood.is_ok() && done.try_recv() == Err(TryRecvError::Disconnected) {
                return Ok(false);
            }
        }
        // A robot that cannot be told is reported by the stop that ends every drive.
        let _ = self.robot.stop();
        stood.and(Ok(true))
    }

    /// Stands for a period.
    fn stand(&mut self) -> Result<(), DriveFault> {
        let t = self.guard.t();
        if !self.standing {
            if self.stands.len() >= STANDS.0 + self.steps / STANDS.1 {
                return Err(DriveFault::TooLate { times: self.stands.len() + 1, commands: self.steps, period: self.period, t });
            }
            self.stands.push(Stand { t, begun: Instant::now(), periods: 0, lasted: Duration::ZERO });
            self.standing = true;
        }
        self.came = held(self.robot, &mut self.guard, &self.zero, &mut self.seen)?;
        if let Some(stand) = self.stands.last_mut() {
            (stand.periods, stand.lasted) = (stand.periods + 1, stand.begun.elapsed());
        }
        Ok(())
    }

    /// True if the last stand has lasted too short a time to be told from a late row.
    fn unsettled(&self) -> bool {
        self.standing && self.stands.last().is_some_and(|stand| stand.periods < STAND)
    }

    /// If the robot had to stand, has it stand long enough to be a gap in the recording, and gives what it measures then. True if so.
    pub(super) fn resume(&mut self, measured: &mut [f64], halted: impl Fn(f64) -> Option<DriveFault>) -> Result<bool, DriveFault> {
        while self.unsettled() {
            if let Some(fault) = halted(self.guard.t()) {
                return Err(fault);
            }
            self.stand()?;
        }
        let stood = std::mem::take(&mut self.standing);
        if stood {
            measured.copy_from_slice(&self.seen);
        }
        Ok(stood)
    }

    /// Holds the command for a period, unless it is too late for it.
    pub(super) fn step(&mut self, command: &[f64], measured: &mut [f64]) -> Result<(), DriveFault> {
        let late = self.came.elapsed();
        if self.real_time && late.as_secs_f64() > self.deadline {
            return Err(self.missed(late));
        }
        self.came = held(self.robot, &mut self.guard, command, measured)?;
        self.steps += 1;
        Ok(())
    }

    /// Time since the start of the last measurement \[s\].
    pub(super) fn t(&self) -> f64 {
        self.guard.t()
    }

    /// Commands sent.
    pub(super) fn steps(&self) -> usize {
        self.steps
    }

    fn missed(&self, late: Duration) -> DriveFault {
        DriveFault::Deadline { late_s: late.as_secs_f64(), limit_s: self.deadline, t: self.guard.t() }
    }

    /// When and for how long the robot had to stand, if it had to.
    pub(super) fn remark(&self) -> Option<String> {
        let first = self.stands.first()?;
        let (times, seconds) = (self.stands.len(), self.stands.iter().map(|s| s.lasted).sum::<Duration>().as_secs_f64());
        Some(format!(
            "the next command was late {times} time(s), first after t = {:.2} s: the robot was told to stand meanwhile, {seconds:.2} s in all; \
             no rows are kept of it, and those before and after are separate segments",
            first.t
        ))
    }
}

/// Has the robot hold a command for a period, and doubts its answer; gives when that came.
fn held(robot: &mut Live, guard: &mut Guard, command: &[f64], measured: &mut [f64]) -> Result<Instant, DriveFault> {
    let (sent, t, period) = (Instant::now(), guard.t(), robot.period());
    let time = robot.step(command, measured)?;
    let came = Instant::now();
    let took_s = (came - sent).as_secs_f64();
    if robot.real_time() && took_s > (SLOWEST_STEP.0 * period).max(SLOWEST_STEP.1) {
        return Err(DriveFault::SlowRobot { took_s, period, t });
    }
    guard.check(command, time, measured)?;
    Ok(came)
}
