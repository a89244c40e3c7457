//! Recording into CSV while a robot drives: one line a row, handed to the operating system whole.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use wheelwright_core::channel::Channel;
use wheelwright_core::drive::{RowSink, SinkError};

use super::write::quoted;

/// A CSV file that grows by a line a row. Every line is one write, so that whenever the program dies, and however, the file
/// holds all rows handed over, each whole. A line cut by a full disk is taken back.
#[derive(Debug)]
pub struct CsvRecorder {
    path: PathBuf,
    file: File,
    line: String,
    /// Bytes of whole lines.
    whole: u64,
}

impl CsvRecorder {
    /// Creates the file, which must not be there, and writes the header: `t`, `segment`, then the channels.
    ///
    /// # Errors
    /// The operating system's; [`io::ErrorKind::AlreadyExists`] if the file is there.
    pub fn create<'a>(path: &Path, channels: impl IntoIterator<Item = &'a Channel>) -> io::Result<Self> {
        let file = File::create_new(path)?;
        let mut recorder = Self { path: path.to_owned(), file, line: "t,segment".to_owned(), whole: 0 };
        for channel in channels {
            recorder.line.push(',');
            recorder.line.push_str(&quoted(&channel.name));
        }
        recorder.end_line()?;
        Ok(recorder)
    }

    fn end_line(&mut self) -> io::Result<()> {
        self.line.push('\n');
        if let Err(error) = self.file.write_all(self.line.as_bytes()) {
            // What is left of the line would be read with a warning; without it the file is whole. If even this fails, so be it.
            let _ = self.file.set_len(self.whole);
            return Err(error);
        }
        self.whole += self.line.len() as u64;
        Ok(())
    }

    fn failed(&self, error: &io::Error) -> SinkError {
        SinkError { target: self.path.display().to_string(), reason: error.to_string() }
    }
}

impl RowSink for CsvRecorder {
    fn row(&mut self, t: f64, values: &[f64]) -> Result<(), SinkError> {
        self.line.clear();
        // Writing to a String cannot fail.
        let _ = write!(self.line, "{t},0");
        for value in values {
            let _ = write!(self.line, ",{value}");
        }
        self.end_line().map_err(|e| self.failed(&e))
    }

    fn finish(&mut self) -> Result<(), SinkError> {
        self.file.sync_all().map_err(|e| self.failed(&e))
    }
}
