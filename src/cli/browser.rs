//! Opening a report in the user's browser.

use std::path::Path;
use std::process::{Command, Stdio};

use super::console::Console;

/// Asks the desktop to open a file; where there is none, the note says where the file is.
pub(super) fn open(path: &Path, console: &Console) {
    let mut command = opener();
    let started = command.arg(path).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    if started.is_err() {
        console.note(&format!("no browser could be started: open {} in one", path.display()));
    }
}

fn opener() -> Command {
    if cfg!(target_os = "macos") {
        Command::new("open")
    } else if cfg!(target_os = "windows") {
        let mut command = Command::new("cmd");
        command.args(["/C", "start", ""]);
        command
    } else {
        Command::new("xdg-open")
    }
}
