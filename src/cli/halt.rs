//! Ctrl-C, SIGTERM and a closed terminal: while a robot is connected they ask the drive to stop it; otherwise they end the program.

use std::sync::Once;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use crate::error::Error;

/// Raised by a signal; a drive looks at it before every command.
pub(super) static STOP: AtomicBool = AtomicBool::new(false);
/// True while a robot is connected.
static CONNECTED: AtomicBool = AtomicBool::new(false);
/// Signals since the program began.
static SIGNALS: AtomicUsize = AtomicUsize::new(0);
/// With this signal the program ends whatever the robot's driver is doing: the link goes down, the robot's own watchdog is next.
const LAST_SIGNAL: usize = 3;
/// Status of a program that was told to end.
const INTERRUPTED: i32 = 1;

/// Catches signals as long as it lives; a robot is connected meanwhile.
pub(super) struct Halt(());

impl Halt {
    /// From here on signals stop the robot.
    pub(super) fn watch() -> Result<Self, Error> {
        static ONCE: Once = Once::new();
        let mut outcome = Ok(());
        ONCE.call_once(|| outcome = ctrlc::set_handler(signalled));
        // Without a handler a signal would end the program between two commands, with the last one still held by the robot.
        outcome.map_err(|e| Error::Usage(format!("ctrl-C cannot be caught: {e}")))?;
        CONNECTED.store(true, Ordering::SeqCst);
        Ok(Self(()))
    }
}

impl Drop for Halt {
    fn drop(&mut self) {
        CONNECTED.store(false, Ordering::SeqCst);
    }
}

fn signalled() {
    STOP.store(true, Ordering::SeqCst);
    let count = SIGNALS.fetch_add(1, Ordering::SeqCst) + 1;
    if !CONNECTED.load(Ordering::SeqCst) || count >= LAST_SIGNAL {
        wheelwright_plugin::exit(INTERRUPTED);
    }
}

/// True once a signal came.
pub(super) fn asked() -> bool {
    STOP.load(Ordering::SeqCst)
}
