//! A Rust robot behind the C table.

use std::ffi::{CString, c_char, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError, TryLockError};

use wheelwright_core::robot::{Robot, RobotConfig, RobotError};

use crate::abi;
use crate::export::{c_channels, configured, guard, slice, slice_mut};
use crate::status::Failure;

pub(super) fn table(name: *const c_char, about: *const c_char) -> abi::Robot {
    abi::Robot {
        name,
        about,
        keys: std::ptr::null(),
        check: Some(check),
        open: Some(open),
        measure: Some(measure),
        step: Some(step),
        stop: Some(stop),
        close: Some(close),
    }
}

/// A connected robot with what its info points to.
struct Handle {
    robot: Mutex<Box<dyn Robot>>,
    /// Set by a `stop` that came beside another call; that call stops the robot when it returns.
    stop_wanted: AtomicBool,
    inputs: Vec<abi::Channel>,
    outputs: Vec<abi::Channel>,
    _texts: Vec<CString>,
}

impl Handle {
    fn new(robot: Box<dyn Robot>) -> Self {
        let mut texts = Vec::new();
        let inputs = c_channels(robot.inputs(), &mut texts);
        let outputs = c_channels(robot.outputs(), &mut texts);
        Self { robot: Mutex::new(robot), stop_wanted: AtomicBool::new(false), inputs, outputs, _texts: texts }
    }

    fn with(&self, call: impl FnOnce(&mut dyn Robot) -> Result<f64, RobotError>) -> Result<f64, Failure> {
        let result = call(&mut **self.robot.lock().unwrap_or_else(PoisonError::into_inner));
        if self.stop_wanted.load(Ordering::SeqCst) {
            self.stop()?;
        }
        Ok(result?)
    }

    /// A Rust robot is used by one call at a time, so one that hangs cannot be stopped beside it, only after it.
    fn stop(&self) -> Result<(), Failure> {
        self.stop_wanted.store(true, Ordering::SeqCst);
        let mut robot = match self.robot.try_lock() {
            Ok(robot) => robot,
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(TryLockError::WouldBlock) => {
                return Err(Failure::new(abi::TIMEOUT, "a call has not returned; the robot is stopped when it does"));
            }
        };
        self.stop_wanted.store(false, Ordering::SeqCst);
        Ok(robot.stop()?)
    }
}

unsafe extern "C" fn check(config: *const c_char, message: *const abi::Message) -> abi::Status {
    // SAFETY: the host's pointers are as the header says.
    unsafe { super::check::<Box<dyn RobotConfig>>(config, message) }
}

unsafe extern "C" fn open(
    config: *const c_char,
    seed: u64,
    info: *mut abi::RobotInfo,
    handle: *mut *mut c_void,
    message: *const abi::Message,
) -> abi::Status {
    let call = || {
        // SAFETY: the host's pointers are as the header says.
        let robot = unsafe { configured::<Box<dyn RobotConfig>>(config) }?.connect(seed)?;
        let (period, simulated) = (robot.period(), u32::from(!robot.real_time()));
        let opened = Box::new(Handle::new(robot));
        let described = abi::RobotInfo {
            inputs: opened.inputs.as_ptr(),
            outputs: opened.outputs.as_ptr(),
            n_inputs: opened.inputs.len(),
            n_outputs: opened.outputs.len(),
            period,
            simulated,
        };
        // SAFETY: as above.
        unsafe {
            info.write(described);
            handle.write(Box::into_raw(opened).cast());
        }
        Ok(())
    };
    // SAFETY: as above.
    unsafe { guard(message, call) }
}

unsafe extern "C" fn measure(handle: *mut c_void, time: *mut f64, measured: *mut f64, message: *const abi::Message) -> abi::Status {
    let call = || {
        // SAFETY: the host gives back the handle of `open`, and room for all outputs.
        unsafe {
            let handle = &*handle.cast::<Handle>();
            time.write(handle.with(|robot| robot.measure(slice_mut(measured, handle.outputs.len())))?);
        }
        Ok(())
    };
    // SAFETY: the host's message is as the header says.
    unsafe { guard(message, call) }
}

unsafe extern "C" fn step(
    handle: *mut c_void,
    command: *const f64,
    time: *mut f64,
    measured: *mut f64,
    message: *const abi::Message,
) -> abi::Status {
    let call = || {
        // SAFETY: the host gives back the handle of `open`, one value an input and room for all outputs.
        unsafe {
            let handle = &*handle.cast::<Handle>();
            let command = slice(command, handle.inputs.len());
            time.write(handle.with(|robot| robot.step(command, slice_mut(measured, handle.outputs.len())))?);
        }
        Ok(())
    };
    // SAFETY: the host's message is as the header says.
    unsafe { guard(message, call) }
}

unsafe extern "C" fn stop(handle: *mut c_void, message: *const abi::Message) -> abi::Status {
    // SAFETY: the host gives back the handle of `open`; shared use is what `Handle` is made for.
    unsafe { guard(message, || (*handle.cast::<Handle>()).stop()) }
}

unsafe extern "C" fn close(handle: *mut c_void) {
    // SAFETY: the handle comes from `Box::into_raw` in `open`, and this is its last call.
    let close = || drop(unsafe { Box::from_raw(handle.cast::<Handle>()) });
    // A robot that panics while it is dropped is gone all the same, and there is no way to report it; the payload is kept
    // because dropping it might panic in turn.
    if let Err(payload) = catch_unwind(AssertUnwindSafe(close)) {
        std::mem::forget(payload);
    }
}
