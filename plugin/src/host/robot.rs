//! A library's robot as a [`Robot`], guarded.
//!
//! Every call runs on one thread that belongs to the robot, under a deadline. A call that misses it is left behind; then the
//! robot is told to stop from yet another thread, as the header allows, and nothing but `stop` reaches it any more. Values
//! that are not finite, time that goes back and writes past the end of an array are faults.

#![allow(unsafe_code)]

use std::ffi::{CString, c_void};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::time::Duration;

use wheelwright_core::channel::Channel;
use wheelwright_core::robot::{Robot, RobotError};

use crate::abi;
use crate::deadline::{Late, start, wait, within};
use crate::host::library::{Limits, RobotCalls, RobotTable};
use crate::host::read;
use crate::message::Buffer;
use crate::status::Failure;

/// Bytes of a message of a robot.
const MESSAGE: usize = 1024;
/// Written behind an array that a library fills; it must be there afterwards.
const CANARY: f64 = -7.734e-155;
/// Number of canaries.
const CANARIES: usize = 4;

/// Values as a library wrote them, and the robot's time \[s\].
type Measured = Result<(f64, Vec<f64>), Failure>;
/// A call, made on the robot's thread.
type Job = Box<dyn FnOnce(&Handle) + Send>;

/// Array for `count` values that a library is to write: a value it leaves out stays NaN.
pub(crate) fn guarded(count: usize) -> Vec<f64> {
    let mut values = vec![f64::NAN; count + CANARIES];
    values[count..].fill(CANARY);
    values
}

/// Takes the canaries off; an error if one is dead.
pub(crate) fn unguarded(mut values: Vec<f64>, what: &str) -> Result<Vec<f64>, Failure> {
    let count = values.len() - CANARIES;
    if values[count..].iter().any(|x| x.to_bits() != CANARY.to_bits()) {
        return Err(Failure::new(abi::DRIVER, format!("it wrote more than {count} values to `{what}`, and memory is damaged")));
    }
    values.truncate(count);
    Ok(values)
}

/// Outcome of a call that writes a message.
pub(crate) fn outcome<const N: usize>(status: abi::Status, message: &Buffer<N>) -> Result<(), Failure> {
    if status == abi::OK { Ok(()) } else { Err(Failure::new(status, message.text())) }
}

/// A connected robot inside the library; closed when the last owner goes.
struct Handle {
    pointer: *mut c_void,
    calls: RobotCalls,
    inputs: usize,
    outputs: usize,
}

// SAFETY: the header promises that a handle may be used from any thread, one call at a time. The host keeps to that by calling
// from the robot's own thread only; `stop`, which may come beside another call, is the exception on both sides.
unsafe impl Send for Handle {}
// SAFETY: as above.
unsafe impl Sync for Handle {}

impl Handle {
    fn measure(&self) -> Measured {
        self.read("measure", |pointer, time, values, message| {
            // SAFETY: an open handle and room for all outputs.
            unsafe { (self.calls.measure)(pointer, time, values, message) }
        })
    }

    fn step(&self, command: &[f64]) -> Measured {
        debug_assert_eq!(command.len(), self.inputs);
        self.read("step", |pointer, time, values, message| {
            // SAFETY: an open handle, one value an input and room for all outputs.
            unsafe { (self.calls.step)(pointer, command.as_ptr(), time, values, message) }
        })
    }

    fn read(&self, what: &str, call: impl FnOnce(*mut c_void, *mut f64, *mut f64, *const abi::Message) -> abi::Status) -> Measured {
        let mut buffer = Buffer::<MESSAGE>::new();
        let message = buffer.abi();
        let (mut time, mut values) = (f64::NAN, guarded(self.outputs));
        let status = call(self.pointer, &raw mut time, values.as_mut_ptr(), &raw const message);
        outcome(status, &buffer)?;
        Ok((time, unguarded(values, what)?))
    }

    fn stop(&self) -> Result<(), Failure> {
        let mut buffer = Buffer::<MESSAGE>::new();
        let message = buffer.abi();
        // SAFETY: an open handle; the header allows `stop` at any time.
        let status = unsafe { (self.calls.stop)(self.pointer, &raw const message) };
        outcome(status, &buffer)
    }
}

impl Drop for Handle {
    fn drop(&mut self) {
        // A robot that cannot be told is closed all the same; its own watchdog is next in line.
        let _ = self.stop();
        // SAFETY: the last call of this handle.
        unsafe { (self.calls.close)(self.pointer) }
    }
}

/// What `open` says of a robot.
struct Info {
    inputs: Vec<Channel>,
    outputs: Vec<Channel>,
    period: f64,
    real_time: bool,
}

impl Info {
    /// # Safety
    /// `raw` was written by a successful `open` whose handle is not closed.
    unsafe fn read(raw: &abi::RobotInfo) -> Result<Self, String> {
        // SAFETY: as the caller vouches.
        let (inputs, outputs) =
            unsafe { (read::channels(raw.inputs, raw.n_inputs, "inputs")?, read::channels(raw.outputs, raw.n_outputs, "outputs")?) };
        if outputs.is_empty() {
            return Err("it measures nothing (n_outputs is 0)".to_owned());
        }
        if !(raw.period > 0.0 && raw.period <= Limits::LONGEST_S) {
            return Err(format!("its period is {} s; it must be above 0 and at most {} s", raw.period, Limits::LONGEST_S));
        }
        Ok(Self { inputs, outputs, period: raw.period, real_time: raw.simulated == 0 })
    }
}

/// Connects; on the robot's thread.
fn open(table: &RobotTable, config: &CString, seed: u64) -> Result<(Handle, Info), Failure> {
    let mut buffer = Buffer::<MESSAGE>::new();
    let message = buffer.abi();
    let nothing = std::ptr::null();
    let mut raw = abi::RobotInfo { inputs: nothing, outputs: nothing, n_inputs: 0, n_outputs: 0, period: 0.0, simulated: 0 };
    let mut pointer = std::ptr::null_mut();
    // SAFETY: a text with its NUL, and places to write that live until the call returns.
    let status = unsafe { (table.open)(config.as_ptr(), seed, &raw mut raw, &raw mut pointer, &raw const message) };
    outcome(status, &buffer)?;
    let mut handle = Handle { pointer, calls: table.calls, inputs: 0, outputs: 0 };
    // SAFETY: `open` succeeded, and the handle is open.
    let info = unsafe { Info::read(&raw) }.map_err(|e| Failure::new(abi::DRIVER, format!("`open` broke its contract: {e}")))?;
    (handle.inputs, handle.outputs) = (info.inputs.len(), info.outputs.len());
    Ok((handle, info))
}

/// A library's robot behind the trait that built-in ones have.
pub(crate) struct PluginRobot {
    who: String,
    info: Info,
    limit: Duration,
    handle: Option<Arc<Handle>>,
    /// To the robot's thread; `None` once a call was left behind there.
    jobs: Option<Sender<Job>>,
    /// Disconnected when the robot's thread has closed the handle.
    closed: Receiver<()>,
    /// True while a `stop` beside another call has not returned.
    stopping: Arc<AtomicBool>,
    time: f64,
    ended: bool,
}

/// Connects a library's robot with a configuration text.
pub(crate) fn connect(table: &RobotTable, config: CString, seed: u64) -> Result<PluginRobot, RobotError> {
    let who = format!("plugin robot `{}`", table.offer.name);
    let (jobs, inbox) = mpsc::channel::<Job>();
    let (opened, answer) = mpsc::channel();
    let (closing, closed) = mpsc::channel::<()>();
    let own = table.clone();
    let run = move || {
        // Dropped last, when the handle of this thread is gone.
        let _closing = closing;
        let (handle, info) = match open(&own, &config, seed) {
            Ok((handle, info)) => (Arc::new(handle), info),
            // A caller that stopped waiting does not want the reason either.
            Err(failure) => return drop(opened.send(Err(failure))),
        };
        if opened.send(Ok((handle.clone(), info))).is_ok() {
            inbox.into_iter().for_each(|job| job(&handle));
        }
    };
    let limit = table.offer.limits.open;
    let late = |late| missed(&who, "open", late, limit, "");
    start(table.offer.name, run).map_err(late)?;
    let (handle, info) = wait(&answer, limit).map_err(late)?.map_err(|failure| failure.into_robot_error(&who, limit.as_secs_f64()))?;
    let limit = table.offer.limits.call(info.period);
    let stopping = Arc::new(AtomicBool::new(false));
    let (handle, jobs, time) = (Some(handle), Some(jobs), f64::NEG_INFINITY);
    Ok(PluginRobot { who, info, limit, handle, jobs, closed, stopping, time, ended: false })
}

/// The error for a call without a result.
fn missed(who: &str, call: &str, late: Late, limit: Duration, then: &str) -> RobotError {
    match late {
        Late::Timeout => {
            RobotError::Timeout { limit_s: limit.as_secs_f64(), what: format!("{who}: the call of `{call}` has not returned{then}") }
        }
        Late::Lost(reason) => RobotError::Driver(format!("{who}: `{call}`: {reason}{then}")),
    }
}

impl PluginRobot {
    /// Makes a call on the robot's thread.
    fn call<T: Send + 'static>(&mut self, call: impl FnOnce(&Handle) -> T + Send + 'static) -> Result<T, Late> {
        let (sender, results) = mpsc::channel();
        // A caller that stopped waiting does not want the result.
        let job: Job = Box::new(move |handle| drop(sender.send(call(handle))));
        let sent = self.jobs.as_ref().is_some_and(|jobs| jobs.send(job).is_ok());
        let result = if sent { wait(&results, self.limit) } else { Err(Late::Lost("an earlier call has not returned".to_owned())) };
        if result.is_err() {
            self.jobs = None;
        }
        result
    }

    /// Tells the robot to stop while a call has not returned.
    fn stop_beside(&self) -> Result<(), RobotError> {
        let Some(handle) = self.handle.clone() else { return Ok(()) };
        if self.stopping.swap(true, Ordering::SeqCst) {
            return Err(missed(&self.who, "stop", Late::Timeout, self.limit, ""));
        }
        let stopping = self.stopping.clone();
        let stop = move || {
            let stopped = handle.stop();
            stopping.store(false, Ordering::SeqCst);
            stopped
        };
        within(&self.who, self.limit, stop)
            .map_err(|late| missed(&self.who, "stop", late, self.limit, ""))?
            .map_err(|failure| failure.into_robot_error(&self.who, self.limit.as_secs_f64()))
    }

    /// Makes a call that measures; after an error the robot is stopped.
    fn take(
        &mut self,
        name: &str,
        call: impl FnOnce(&Handle) -> Measured + Send + 'static,
        measured: &mut [f64],
    ) -> Result<f64, RobotError> {
        if self.ended {
            return Err(RobotError::Driver(format!("{}: it was stopped after an error; connect it again", self.who)));
        }
        self.fits("measurements", measured.len(), self.info.outputs.len())?;
        let checked = match self.call(call) {
            Ok(result) => {
                result.map_err(|failure| failure.into_robot_error(&self.who, self.limit.as_secs_f64())).and_then(|m| self.checked(m))
            }
            Err(late) => {
                self.ended = true;
                let then = match self.stop_beside() {
                    Ok(()) => "; the robot was told to stop".to_owned(),
                    Err(error) => format!("; it could not be told to stop: {error}"),
                };
                return Err(missed(&self.who, name, late, self.limit, &then));
            }
        };
        match checked {
            Ok((time, values)) => {
                measured.copy_from_slice(&values);
                self.time = time;
                Ok(time)
            }
            Err(error) => {
                self.ended = true;
                // The first error is what the user needs; `stop` reports its own when it is called again.
                let _ = self.stop();
                Err(error)
            }
        }
    }

    fn checked(&self, (time, values): (f64, Vec<f64>)) -> Result<(f64, Vec<f64>), RobotError> {
        if !time.is_finite() || time < self.time {
            return Err(RobotError::Fault(format!("{}: time {time} s after {} s", self.who, self.time)));
        }
        match values.iter().position(|value| !value.is_finite()) {
            Some(i) => {
                let name = &self.info.outputs[i].name;
                Err(RobotError::Fault(format!("{}: `{name}` is {} at t = {time} s (not written by the plugin?)", self.who, values[i])))
            }
            None => Ok((time, values)),
        }
    }

    fn fits(&self, what: &str, given: usize, wanted: usize) -> Result<(), RobotError> {
        let error = || RobotError::Driver(format!("{}: room for {given} {what}, but there are {wanted}", self.who));
        (given == wanted).then_some(()).ok_or_else(error)
    }
}

impl Robot for PluginRobot {
    fn inputs(&self) -> &[Channel] {
        &self.info.inputs
    }

    fn outputs(&self) -> &[Channel] {
        &self.info.outputs
    }

    fn period(&self) -> f64 {
        self.info.period
    }

    fn real_time(&self) -> bool {
        self.info.real_time
    }

    fn measure(&mut self, measured: &mut [f64]) -> Result<f64, RobotError> {
        self.take("measure", Handle::measure, measured)
    }

    fn step(&mut self, command: &[f64], measured: &mut [f64]) -> Result<f64, RobotError> {
        self.fits("commands", command.len(), self.info.inputs.len())?;
        if let Some(i) = command.iter().position(|value| !value.is_finite()) {
            let name = &self.info.inputs[i].name;
            return Err(RobotError::Driver(format!("{}: the command `{name}` is {}; nothing was sent", self.who, command[i])));
        }
        let command = command.to_vec();
        self.take("step", move |handle| handle.step(&command), measured)
    }

    fn stop(&mut self) -> Result<(), RobotError> {
        if self.jobs.is_none() {
            return self.stop_beside();
        }
        match self.call(Handle::stop) {
            Ok(stopped) => stopped.map_err(|failure| failure.into_robot_error(&self.who, self.limit.as_secs_f64())),
            Err(late) => Err(missed(&self.who, "stop", late, self.limit, "")),
        }
    }
}

impl Drop for PluginRobot {
    fn drop(&mut self) {
        self.handle = None;
        if self.jobs.take().is_some() {
            // The robot's thread stops and closes it. One that hangs in that is left behind; there is nobody to tell.
            let _ = wait(&self.closed, self.limit);
        }
    }
}
