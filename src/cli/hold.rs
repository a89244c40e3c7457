//! The dead man's switch at the terminal: a key has to be held. Its repeats press the switch; when they stop coming, so does the robot.
//!
//! A terminal tells of presses only, not of a key that is let go, so a hold is a stream of repeats. Where standard input is no
//! terminal, every byte that comes from it counts, so that a pedal or a radio link can be the switch.

use std::io::{IsTerminal, Read};
use std::sync::Arc;
use std::time::Duration;

use wheelwright_core::drive::DeadMan;

use crate::error::Error;

/// How long one press holds: a held key repeats within this on every common setting, once it repeats.
const LIMIT: f64 = 0.4;

/// A switch fed by standard input; the terminal is as it was when this goes.
pub(super) struct Hold {
    pub(super) switch: Arc<DeadMan>,
    _terminal: Option<Terminal>,
}

impl Hold {
    /// Listens to standard input; `limit` \[s\] is how long one press holds.
    pub(super) fn listen(limit: Option<f64>) -> Result<Self, Error> {
        let limit = limit.unwrap_or(LIMIT);
        let limit = Duration::try_from_secs_f64(limit)
            .ok()
            .filter(|l| !l.is_zero())
            .ok_or_else(|| Error::setting("record.dead_man_timeout", format!("must be a positive number of seconds, not {limit}")))?;
        let terminal = if std::io::stdin().is_terminal() { Some(Terminal::key_by_key()?) } else { None };
        let switch = Arc::new(DeadMan::new(limit));
        let pressed = switch.clone();
        std::thread::spawn(move || {
            let mut byte = [0; 64];
            // Ends with the input: nobody holds any more.
            while std::io::stdin().lock().read(&mut byte).is_ok_and(|read| read > 0) {
                pressed.press();
            }
            pressed.release();
        });
        Ok(Self { switch, _terminal: terminal })
    }
}

/// A terminal that hands over keys one by one and shows none of them. Ctrl-C stays what it is.
struct Terminal {
    #[cfg(unix)]
    before: rustix::termios::Termios,
}

#[cfg(unix)]
impl Terminal {
    fn key_by_key() -> Result<Self, Error> {
        use rustix::termios::{LocalModes, OptionalActions, tcgetattr, tcsetattr};
        let failed = |e: rustix::io::Errno| Error::Usage(format!("the terminal cannot be read key by key: {e}"));
        let stdin = std::io::stdin();
        let before = tcgetattr(&stdin).map_err(failed)?;
        let mut mode = before.clone();
        mode.local_modes.remove(LocalModes::ICANON | LocalModes::ECHO);
        tcsetattr(&stdin, OptionalActions::Now, &mode).map_err(failed)?;
        Ok(Self { before })
    }
}

#[cfg(unix)]
impl Drop for Terminal {
    fn drop(&mut self) {
        // If the terminal is gone, there is nothing to restore.
        let _ = rustix::termios::tcsetattr(std::io::stdin(), rustix::termios::OptionalActions::Now, &self.before);
    }
}

#[cfg(not(unix))]
impl Terminal {
    fn key_by_key() -> Result<Self, Error> {
        Err(Error::Usage("a key cannot be held at this system's terminal: feed the dead man's switch through a pipe".to_owned()))
    }
}
