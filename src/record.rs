//! Recording a drive into files that cannot be lost: a CSV and an MCAP that grow row by row under names nobody used before.
//!
//! The files bear their final names from the first row on. A temporary name would have to be found again after a crash, and renaming
//! at the end protects only what ends in order; here the number in the name protects what was there before, and every row is whole
//! in the file before its command is sent.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde_json::{Value, json};
use wheelwright_core::Recording;
use wheelwright_core::channel::Channel;
use wheelwright_core::drive::{Bite, RowSink};
use wheelwright_recordings::{CsvRecorder, McapRecorder, WriteError};

use crate::error::Error;
use crate::source::digest;

/// Names are numbered up to this; a folder with more recordings is a mistake.
const MOST: usize = 9999;

/// `[record]`
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RecordSection {
    /// Seconds to step back before the robot moves; by default three on a robot that lives in real time, else none.
    pub countdown: Option<f64>,
    /// A key has to be held, as under `--dead-man`.
    pub dead_man: bool,
    /// How long one key press holds \[s\]; 0.4 by default, as a held key repeats several times in it.
    pub dead_man_timeout: Option<f64>,
}

/// The files of one drive.
#[derive(Debug)]
pub struct RecordingFiles {
    csv: CsvRecorder,
    mcap: Option<McapRecorder>,
    /// Path of the CSV file.
    pub csv_path: PathBuf,
    /// Path of the MCAP file; `None` for a robot without velocities, which has no place in its messages.
    pub mcap_path: Option<PathBuf>,
}

impl RecordingFiles {
    /// Creates `recording.csv` and `recording.mcap` in a folder, or `recording-2`, `-3`, … if either name is taken.
    ///
    /// # Errors
    /// [`Error::Io`] if the folder cannot be written to.
    pub fn create<'a>(folder: &Path, channels: impl IntoIterator<Item = &'a Channel>) -> Result<Self, Error> {
        let channels: Vec<&Channel> = channels.into_iter().collect();
        (1..=MOST)
            .find_map(|n| Self::numbered(folder, n, &channels).transpose())
            .unwrap_or_else(|| Err(Error::Usage(format!("{} holds {MOST} recordings: give another folder with --out", folder.display()))))
    }

    /// The files of that number; `None` if a name is taken.
    fn numbered(folder: &Path, n: usize, channels: &[&Channel]) -> Result<Option<Self>, Error> {
        let stem = if n == 1 { "recording".to_owned() } else { format!("recording-{n}") };
        let (csv_path, mcap_path) = (folder.join(format!("{stem}.csv")), folder.join(format!("{stem}.mcap")));
        let io = |path: &Path, error| Error::Io { path: path.to_owned(), error };
        if mcap_path.exists() {
            return Ok(None);
        }
        let csv = match CsvRecorder::create(&csv_path, channels.iter().copied()) {
            Ok(csv) => csv,
            Err(error) if error.kind() == ErrorKind::AlreadyExists => return Ok(None),
            Err(error) => return Err(io(&csv_path, error)),
        };
        let mcap = match McapRecorder::create(&mcap_path, channels.iter().copied()) {
            Ok(mcap) => Some(mcap),
            Err(WriteError::Columns(_)) => None,
            Err(WriteError::Io(error)) => return Err(io(&mcap_path, error)),
            Err(error) => return Err(io(&mcap_path, std::io::Error::other(error))),
        };
        let mcap_path = mcap.is_some().then_some(mcap_path);
        Ok(Some(Self { csv, mcap, csv_path, mcap_path }))
    }

    /// The files as sinks of a drive.
    pub fn sinks(&mut self) -> Vec<&mut dyn RowSink> {
        let mut sinks: Vec<&mut dyn RowSink> = vec![&mut self.csv];
        sinks.extend(self.mcap.as_mut().map(|mcap| mcap as &mut dyn RowSink));
        sinks
    }

    /// Paths of what is there.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        std::iter::once(self.csv_path.as_path()).chain(self.mcap_path.as_deref())
    }
}

/// `wheelwright.record/1`: what was recorded, where it lies and what limits held back.
///
/// # Errors
/// [`Error::Io`] if a file cannot be read back for its digest.
pub fn document(recording: &Recording, files: &RecordingFiles, bites: &[Bite], coverage: Option<f64>) -> Result<Value, Error> {
    let file = |path: &Path| {
        let sha256 = digest(path).map_err(|error| Error::Io { path: path.to_owned(), error })?;
        Ok(json!({ "path": path.display().to_string(), "sha256": sha256 }))
    };
    let period = recording.period();
    Ok(json!({
        "schema": "wheelwright.record/1",
        "files": files.paths().map(file).collect::<Result<Vec<_>, Error>>()?,
        "samples": recording.rows(),
        "duration_s": recording.duration(),
        "rate_hz": if period > 0.0 { json!(1.0 / period) } else { Value::Null },
        "limits": bites,
        "coverage": coverage,
        "warnings": recording.warnings,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use wheelwright_core::channel::{OMEGA, OMEGA_LEFT, U_LEFT, V};

    #[test]
    fn names_are_numbered_and_both_files_bear_the_same() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("recording-2.mcap"), "taken").unwrap();
        let names: Vec<String> = (0..2)
            .map(|_| RecordingFiles::create(folder.path(), &[V, OMEGA]).unwrap())
            .flat_map(|files| files.paths().map(|p| p.file_name().unwrap().to_string_lossy().into_owned()).collect::<Vec<_>>())
            .collect();
        assert_eq!(names, ["recording.csv", "recording.mcap", "recording-3.csv", "recording-3.mcap"]);
        assert_eq!(std::fs::read_to_string(folder.path().join("recording-2.mcap")).unwrap(), "taken");
    }

    #[test]
    fn a_robot_of_voltages_is_recorded_as_csv_only() {
        let folder = tempfile::tempdir().unwrap();
        let files = RecordingFiles::create(folder.path(), &[U_LEFT, OMEGA_LEFT]).unwrap();
        assert_eq!(files.mcap_path, None);
    }
}
