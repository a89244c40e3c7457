//! Readers and writers of robot recordings.
//!
//! One idea: whatever the file, a reader gives the same [`Recording`]: columns under the contract's names in SI units over
//! one clock, cut into segments, with everything doubtful either refused with its position or reported as a warning. The
//! format is found from the content, never from the ending of the name.
//!
//! ```no_run
//! use wheelwright_core::ReadOptions;
//! let recording = wheelwright_recordings::open("run.csv".as_ref(), &ReadOptions::default())?;
//! println!("{} rows at {} s", recording.rows(), recording.period());
//! # Ok::<(), wheelwright_core::recording::ReadError>(())
//! ```

mod assemble;
mod beside;
mod columns;
mod csv;
mod detect;
mod json;
mod number;
mod parquet;
mod ros;
mod wpilog;

use std::path::Path;

use wheelwright_core::recording::{ReadError, ReadOptions, Recording, RecordingReader};

pub use beside::file_beside;
pub use csv::{CsvRecorder, write_csv};
pub use ros::{McapRecorder, WriteError, write_mcap};

/// Every built-in reader, in the order in which they are asked whether they know a file.
pub fn readers() -> Vec<Box<dyn RecordingReader>> {
    let mut readers = ros::readers();
    let text_and_tables: [Box<dyn RecordingReader>; 4] =
        [Box::new(parquet::Parquet), Box::new(wpilog::WpiLog), Box::new(json::Json), Box::new(csv::Csv)];
    readers.extend(text_and_tables);
    readers
}

/// Reads the recording at `path`, a file or a bag folder, with the first of [`readers`] that knows its content.
///
/// # Errors
/// [`ReadError::Unrecognised`] saying what the content looks like if no reader knows it; otherwise what the reader found
/// wrong. The message does not hold the path.
pub fn open(path: &Path, options: &ReadOptions) -> Result<Recording, ReadError> {
    let head = detect::head(path)?;
    match readers().iter().find(|reader| reader.recognises(path, &head)) {
        Some(reader) => reader.read(path, options),
        None => Err(detect::unrecognised(path, &head)),
    }
}
