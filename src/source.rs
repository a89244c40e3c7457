//! Recordings as the commands use them: read, cut at gaps, with the facts a report states.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};
use wheelwright_core::channel::PHI;
use wheelwright_core::recording::{GAP_PERIODS, ReadOptions, Recording};

use crate::error::Error;
use crate::report::RecordingFacts;

/// A recording with its facts.
#[derive(Debug, Clone)]
pub struct Source {
    /// The rows.
    pub recording: Recording,
    /// What a report states about them.
    pub facts: RecordingFacts,
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
        path.clone_into(&mut recording.source.path);
        let facts = RecordingFacts::new(&recording, "identification", &sha256);
        Self { recording, facts }
    }
}

/// The measured headings \[rad\] of the segments that a data set holds, if the recording has them.
pub fn headings(recording: &Recording) -> Option<Vec<Vec<f64>>> {
    let phi = recording.column(&PHI.name).ok()?;
    // A data set drops segments of a single row.
    Some(recording.segments().iter().filter(|s| s.rows.len() >= 2).map(|s| phi[s.rows.clone()].to_vec()).collect())
}

/// SHA-256 in hexadecimal of a file, or of a folder's file names and contents.
///
/// # Errors
/// The operating system's, if it cannot be read.
pub fn digest(path: &Path) -> std::io::Result<String> {
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
