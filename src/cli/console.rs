//! What goes to standard output and what to standard error.

use std::io::{IsTerminal, Write};

use serde_json::Value;

/// Standard output carries the result, as text or as one JSON document; everything else goes to standard error.
#[derive(Debug)]
pub(super) struct Console {
    json: bool,
    quiet: bool,
}

impl Console {
    pub(super) fn new(json: bool, quiet: bool) -> Self {
        Self { json, quiet }
    }

    /// The result for a person, or nothing under `--json`.
    pub(super) fn result(&self, text: &str) {
        if !self.json {
            let _ = write!(std::io::stdout().lock(), "{text}");
        }
    }

    /// The result for a program, or nothing without `--json`.
    pub(super) fn document(&self, document: &Value) {
        if self.json {
            let _ = writeln!(std::io::stdout().lock(), "{document:#}");
        }
    }

    /// A remark that is no result.
    pub(super) fn note(&self, text: &str) {
        if !self.quiet {
            let _ = writeln!(std::io::stderr().lock(), "{text}");
        }
    }

    /// True if progress is shown: on a terminal, unless asked to be quiet.
    pub(super) fn is_live(&self) -> bool {
        !self.quiet && std::io::stderr().is_terminal()
    }

    /// Replaces the line of progress, on a terminal only.
    pub(super) fn progress(&self, text: &str) {
        if self.is_live() {
            let _ = write!(std::io::stderr().lock(), "\r\x1b[2K{text}");
        }
    }

    /// Removes the line of progress.
    pub(super) fn end_progress(&self) {
        self.progress("");
    }

    pub(super) fn error(&self, text: &str) {
        let _ = writeln!(std::io::stderr().lock(), "error: {text}");
    }
}
