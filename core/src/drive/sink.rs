//! Where rows go while a robot is driven: each is handed on before the command in it is sent.

use thiserror::Error;

use crate::channel::Channel;
use crate::recording::{Column, Recording, RecordingError, Source};

/// Takes rows as they come. A row is safe from the program's own death once [`row`](Self::row) has returned.
pub trait RowSink {
    /// Takes a row: the time \[s\], then one value a channel, commands before measurements.
    ///
    /// # Errors
    /// [`SinkError`]; the robot is then stopped.
    fn row(&mut self, t: f64, values: &[f64]) -> Result<(), SinkError>;

    /// Ends the recording in order. Without it what was written is readable all the same.
    ///
    /// # Errors
    /// [`SinkError`].
    fn finish(&mut self) -> Result<(), SinkError>;
}

/// A row that could not be kept.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{target}: {reason}")]
pub struct SinkError {
    /// The file, or whatever was written to.
    pub target: String,
    /// What happened.
    pub reason: String,
}

/// Rows kept in memory.
#[derive(Debug, Clone, Default)]
pub struct Rows {
    time: Vec<f64>,
    columns: Vec<Column>,
}

impl Rows {
    /// No rows yet, of those channels.
    pub fn new<'a>(channels: impl IntoIterator<Item = &'a Channel>) -> Self {
        let column = |c: &Channel| Column { name: c.name.to_string(), unit: c.unit.to_string(), values: Vec::new() };
        Self { time: Vec::new(), columns: channels.into_iter().map(column).collect() }
    }

    /// Adds a row.
    pub fn push(&mut self, t: f64, values: &[f64]) {
        self.time.push(t);
        for (column, value) in self.columns.iter_mut().zip(values) {
            column.values.push(*value);
        }
    }

    /// The rows as a recording.
    ///
    /// # Errors
    /// [`RecordingError`] for fewer than two rows, or channels of one name.
    pub fn into_recording(self) -> Result<Recording, RecordingError> {
        let mut recording = Recording::new(Source { format: "robot".to_owned(), ..Source::default() }, self.time, self.columns, None)?;
        "robot".clone_into(&mut recording.clock.source);
        Ok(recording)
    }
}
