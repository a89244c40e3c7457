//! Recordings as the commands use them: read, cut at gaps, with the facts a report states.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};
use wheelwright_core::recording::{ClockReport, ReadOptions, Recording};

use crate::error::Error;

/// Rows further apart than this many median periods are a break: the robot went unobserved for several periods, and
/// neither a filter nor a held command can be trusted across it.
const GAP_PERIODS: f64 = 5.0;

/// A recording with its facts.
#[derive(Debug, Clone)]
pub struct Source {
    /// The rows.
    pub recording: Recording,
    /// What a report states about them.
    pub facts: Facts,
}

/// What a report states about a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Facts {
    /// File or folder as the user named it.
    pub path: PathBuf,
    /// Format found from the content.
    pub format: String,
    /// Rows.
    pub samples: usize,
    /// Segments after cutting at gaps.
    pub segments: usize,
    /// Time covered \[s\].
    pub duration_s: f64,
    /// One over the median period \[Hz\].
    pub rate_hz: f64,
    /// SHA-256 of the file, or of the names and contents of a folder's files in order of name; empty for no file.
    pub sha256: String,
    /// Clock findings.
    pub clock: ClockReport,
    /// What the reader warned of.
    pub warnings: Vec<String>,
}

impl Source {
    /// Reads a file or bag folder.
    ///
    /// # Errors
    /// [`Error::Recording`] with position and reason, [`Error::Io`] if it cannot be opened.
    pub fn open(path: &Path, options: &ReadOptions) -> Result<Self, Error> {
        let io = |error| Error::Io { path: path.to_owned(), error };
        std::fs::metadata(path).map_err(io)?;
        let recording = wheelwright_recordings::open(path, options).map_err(|error| Error::Recording { path: path.to_owned(), error })?;
        let sha256 = digest(path).map_err(io)?;
        Ok(Self::new(recording, path, sha256))
    }

    /// A recording made by driving a robot, after it was written to `path`, if it was.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read back for its digest.
    pub fn driven(recording: Recording, path: Option<&Path>) -> Result<Self, Error> {
        let Some(path) = path else { return Ok(Self::new(recording, Path::new("(not kept)"), String::new())) };
        let sha256 = digest(path).map_err(|error| Error::Io { path: path.to_owned(), error })?;
        Ok(Self::new(recording, path, sha256))
    }

    fn new(mut recording: Recording, path: &Path, sha256: String) -> Self {
        recording.split_at_gaps(GAP_PERIODS);
        let period = recording.period();
        let facts = Facts {
            path: path.to_owned(),
            format: recording.source.format.clone(),
            samples: recording.rows(),
            segments: recording.segments().len(),
            duration_s: recording.duration(),
            rate_hz: if period > 0.0 { 1.0 / period } else { 0.0 },
            sha256,
            clock: recording.clock.clone(),
            warnings: recording.warnings.clone(),
        };
        Self { recording, facts }
    }
}

/// SHA-256 in hexadecimal of a file, or of a folder's file names and contents.
fn digest(path: &Path) -> std::io::Result<String> {
    let mut hash = Sha256::new();
    if path.is_dir() {
        let mut files: Vec<PathBuf> = std::fs::read_dir(path)?.map(|entry| entry.map(|e| e.path())).collect::<Result<_, _>>()?;
        files.sort();
        for file in files.iter().filter(|f| f.is_file()) {
            hash.update(file.file_name().unwrap_or_default().as_encoded_bytes());
            feed(&mut hash, file)?;
        }
    } else {
        feed(&mut hash, path)?;
    }
    Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}

fn feed(hash: &mut Sha256, path: &Path) -> std::io::Result<()> {
    let mut file = File::open(path)?;
    let mut buffer = vec![0; 1 << 16];
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok(()),
            n => hash.update(&buffer[..n]),
        }
    }
}
