//! A machine that serves others too. It may leave a program and its test without a processor for longer than a robot in real time waits,
//! and then says nothing about the program.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// How often the machine is asked whether it is there.
const TICK: Duration = Duration::from_millis(5);
/// Half the shortest period of the tests in real time: from then on cycles are lost that nobody but the machine lost.
const STALL: Duration = Duration::from_millis(25);
/// Attempts for which the machine may be blamed.
const ATTEMPTS: usize = 8;

/// Runs a test in real time. It fails at once where it failed though the machine was there all the time, and is attempted again where it
/// was not; one that fails whenever it is attempted fails.
pub(crate) fn undisturbed(test: impl Fn()) {
    for attempt in 1.. {
        let (outcome, stall) = watched(&test);
        let Err(failure) = outcome else { return };
        if stall < STALL || attempt == ATTEMPTS {
            resume_unwind(failure);
        }
        println!("attempt {attempt} failed while the machine stood for {stall:?}");
    }
}

/// The outcome of a test, and the longest time that a thread beside it had to wait beyond its turn.
fn watched(test: &impl Fn()) -> (std::thread::Result<()>, Duration) {
    let (done, waited) = channel::<()>();
    std::thread::scope(|scope| {
        let watch = scope.spawn(move || {
            let mut longest = Duration::ZERO;
            loop {
                let begun = Instant::now();
                let over = waited.recv_timeout(TICK) != Err(RecvTimeoutError::Timeout);
                longest = longest.max(begun.elapsed().saturating_sub(TICK));
                if over {
                    return longest;
                }
            }
        });
        let outcome = catch_unwind(AssertUnwindSafe(test));
        drop(done);
        (outcome, watch.join().unwrap_or_default())
    })
}
