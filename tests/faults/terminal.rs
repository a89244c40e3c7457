//! The program at a terminal of its own: a key held and let go, ctrl-C, what is seen meanwhile, and the terminal afterwards.

use std::fs::File;
use std::io::{Read, Write};
use std::process::{Child, Command, ExitStatus};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{LocalModes, Winsize, tcgetattr, tcsetwinsize};

use super::machine::undisturbed;
use super::signals::{HELD, PATIENCE, readable, simulated};

/// As a held key repeats.
const REPEAT: Duration = Duration::from_millis(30);

/// A terminal with the program recording at it.
struct Session {
    keyboard: File,
    /// The program's end, held open so that the terminal outlives the program.
    line: File,
    screen: Arc<Mutex<Vec<u8>>>,
    child: Child,
    folder: tempfile::TempDir,
}

impl Session {
    fn start() -> Self {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let path = ptsname(&master, Vec::new()).unwrap();
        let line = File::from(rustix::fs::open(path, OFlags::RDWR | OFlags::NOCTTY, Mode::empty()).unwrap());
        tcsetwinsize(&line, Winsize { ws_row: 40, ws_col: 100, ws_xpixel: 0, ws_ypixel: 0 }).unwrap();
        let keyboard = File::from(master);
        let screen = Arc::new(Mutex::new(Vec::new()));
        let (mut seen, shown) = (keyboard.try_clone().unwrap(), screen.clone());
        std::thread::spawn(move || {
            let mut chunk = [0; 4096];
            while let Ok(count @ 1..) = seen.read(&mut chunk) {
                shown.lock().unwrap().extend_from_slice(&chunk[..count]);
            }
        });
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("c.toml"), simulated()).unwrap();
        // Its own session, whose terminal this is, so that ctrl-C is a signal.
        let mut command = Command::new("setsid");
        command.args(["--ctty", env!("CARGO_BIN_EXE_wheelwright"), "record", "c.toml", "--out", "out", "--dead-man"]);
        command.arg("--set").arg(format!("record.dead_man_timeout={HELD}"));
        let end = || line.try_clone().unwrap();
        let child = command.current_dir(folder.path()).stdin(end()).stdout(end()).stderr(end()).spawn().unwrap();
        Self { keyboard, line, screen, child, folder }
    }

    fn sees(&self, text: &str) -> bool {
        String::from_utf8_lossy(&self.screen.lock().unwrap()).contains(text)
    }

    /// Holds a key until a text is seen, or presses none.
    fn until(&mut self, text: &str, key: Option<u8>) {
        let begun = Instant::now();
        while !self.sees(text) {
            assert!(begun.elapsed() < PATIENCE, "no `{text}`: {}", String::from_utf8_lossy(&self.screen.lock().unwrap()));
            if let Some(key) = key {
                self.keyboard.write_all(&[key]).unwrap();
            }
            std::thread::sleep(REPEAT);
        }
    }

    /// The program's end; its last words are on the screen.
    fn end(&mut self) -> ExitStatus {
        let begun = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                return status;
            }
            assert!(begun.elapsed() < PATIENCE, "the program did not end");
            std::thread::sleep(REPEAT);
        }
    }

    /// Whether keys are shown and handed over line by line, as at a shell.
    fn as_at_a_shell(&self) -> bool {
        tcgetattr(&self.line).unwrap().local_modes.contains(LocalModes::ICANON | LocalModes::ECHO)
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn a_key_is_held_at_a_terminal_and_the_drive_is_seen() {
    for (name, last, says) in [("key let go", None, "dead man"), ("ctrl-C while it is held", Some(3), "stopped by request")] {
        undisturbed(|| held(name, last, says));
    }
}

fn held(name: &str, last: Option<u8>, says: &str) {
    let mut session = Session::start();
    session.until("hold a key", None);
    assert!(!session.as_at_a_shell(), "keys are taken one by one");
    assert!(!session.folder.path().join("out/recording.csv").exists(), "nothing moves before a key is held");
    for seen in ["s left, let the key go to stop", "v_ref", "measured", "█"] {
        session.until(seen, Some(b' '));
    }
    if let Some(key) = last {
        session.keyboard.write_all(&[key]).unwrap();
    }
    session.until(says, None);
    assert_eq!(session.end().code(), Some(1), "{name}");
    assert!(session.as_at_a_shell(), "{name}: the terminal is as it was");
    super::line(&format!("{name}, terminal"), 0, readable(&session.folder.path().join("out")), says);
}
