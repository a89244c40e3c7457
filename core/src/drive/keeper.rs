//! Somebody at the robot while others take their time: what decides a command, keeps its row or shows it may be late or hang, and the
//! robot must not drive on meanwhile.

use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use crate::robot::Live;

/// Does `work` while a thread of its own minds the robot, and stops it if the work is not done after `limit`. True if it was stopped.
///
/// Work that never returns is left to the program's watchdog; the robot stands by then.
pub(super) fn minded<T>(robot: &mut Live, limit: Duration, work: impl FnOnce() -> T) -> (T, bool) {
    let (done, waited) = channel::<()>();
    thread::scope(|scope| {
        let keeper = thread::Builder::new().spawn_scoped(scope, move || {
            let late = waited.recv_timeout(limit) == Err(RecvTimeoutError::Timeout);
            if late {
                // A robot that cannot be told is reported by the stop that ends every drive.
                let _ = robot.stop();
            }
            late
        });
        let worked = work();
        drop(done);
        // Without a thread for it the deadline is only looked at afterwards; a driver that panics in its stop was told all the same.
        (worked, keeper.is_ok_and(|keeper| keeper.join().unwrap_or(true)))
    })
}
