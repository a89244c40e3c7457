//! Calls that may not return.
//!
//! A thread inside foreign code cannot be stopped. What can be done: run the call on a thread of its own, stop waiting at a
//! deadline, say so, and leave the thread behind. [`exit`] then ends the program without waiting for it.

#![allow(unsafe_code)]

use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

/// True once a call was left behind.
static ABANDONED: AtomicBool = AtomicBool::new(false);

/// What is said of a thread that ended without a result.
const ENDED: &str = "the thread that calls the plugin ended";

/// Why there is no result.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Late {
    /// The call has not returned in time and is left behind.
    Timeout,
    /// There is no thread, or it ended without a result.
    Lost(String),
}

/// Waits for a result at most `limit`; a timeout marks the call as left behind.
pub(crate) fn wait<T>(results: &Receiver<T>, limit: Duration) -> Result<T, Late> {
    results.recv_timeout(limit).map_err(|e| match e {
        RecvTimeoutError::Timeout => {
            abandon();
            Late::Timeout
        }
        RecvTimeoutError::Disconnected => Late::Lost(ENDED.to_owned()),
    })
}

/// Marks that a call was left behind.
pub(crate) fn abandon() {
    ABANDONED.store(true, Ordering::SeqCst);
}

/// Starts a thread.
pub(crate) fn start(name: &str, run: impl FnOnce() + Send + 'static) -> Result<(), Late> {
    let thread = thread::Builder::new().name(format!("plugin {}", name.replace('\0', " "))).spawn(run);
    thread.map(drop).map_err(|e| Late::Lost(format!("no thread for the call could be started: {e}")))
}

/// Where a call leaves its result.
enum Slot<T> {
    Empty,
    Result(T),
    /// The thread ended without one.
    Gone,
}

/// Fills the slot when its thread ends, by whatever way.
struct Filler<T>(Arc<(Mutex<Slot<T>>, Condvar)>);

impl<T> Filler<T> {
    fn fill(&self, content: Slot<T>) {
        let mut slot = self.0.0.lock().unwrap_or_else(PoisonError::into_inner);
        if matches!(*slot, Slot::Empty) {
            *slot = content;
        }
        self.0.1.notify_one();
    }
}

impl<T> Drop for Filler<T> {
    fn drop(&mut self) {
        self.fill(Slot::Gone);
    }
}

/// Runs `call` on a thread of its own for at most `limit`.
///
/// By mutex and condition variable, not by channel: a channel that waits registers a destructor of a thread-local with the C
/// library, which takes the loader's lock, and a library that hangs while it is loaded holds that one.
pub(crate) fn within<T: Send + 'static>(name: &str, limit: Duration, call: impl FnOnce() -> T + Send + 'static) -> Result<T, Late> {
    let shared = Arc::new((Mutex::new(Slot::Empty), Condvar::new()));
    let filler = Filler(shared.clone());
    start(name, move || filler.fill(Slot::Result(call())))?;
    let slot = shared.0.lock().unwrap_or_else(PoisonError::into_inner);
    let waited = shared.1.wait_timeout_while(slot, limit, |slot| matches!(slot, Slot::Empty));
    let (mut slot, _) = waited.unwrap_or_else(PoisonError::into_inner);
    match std::mem::replace(&mut *slot, Slot::Gone) {
        Slot::Result(result) => Ok(result),
        Slot::Gone => Err(Late::Lost(ENDED.to_owned())),
        Slot::Empty => {
            abandon();
            Err(Late::Timeout)
        }
    }
}

/// Ends the program with an exit status, as [`std::process::exit`], but does not wait for a plugin call that never
/// returned: the usual way out runs the libraries' destructors and takes the loader's lock, which such a call may hold.
pub fn exit(status: i32) -> ! {
    #[cfg(unix)]
    if ABANDONED.load(Ordering::SeqCst) {
        // Nothing can be done about a stream that cannot be flushed on the way out.
        let _ = std::io::stdout().flush();
        let _ = std::io::stderr().flush();
        // SAFETY: `_exit` takes any status and does not return; the standard streams are flushed.
        unsafe { _exit(status) }
    }
    std::process::exit(status)
}

#[cfg(unix)]
unsafe extern "C" {
    fn _exit(status: std::ffi::c_int) -> !;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_call_in_time_gives_its_result_and_one_that_hangs_is_left_behind() {
        assert_eq!(within("quick", Duration::from_secs(20), || 7), Ok(7));
        assert!(matches!(
            within("dead", Duration::from_secs(20), || -> u8 { std::panic::resume_unwind(Box::new(())) }),
            Err(Late::Lost(_))
        ));
        let slow = within("slow", Duration::from_millis(20), || thread::sleep(Duration::from_secs(5)));
        assert_eq!(slow, Err(Late::Timeout));
        assert!(ABANDONED.load(Ordering::SeqCst));
    }
}
