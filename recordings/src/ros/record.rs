//! Recording into MCAP while a robot drives: messages outside of chunks, each row handed to the operating system whole.
//!
//! Chunks are left out on purpose: a file of plain records is readable up to any byte at which a program may die. It is what
//! `ros2 bag record --storage-preset-profile fastwrite` writes; `mcap compress` makes the usual chunked file of it.

use std::cell::RefCell;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use mcap::write::NoSeek;
use wheelwright_core::channel::Channel;
use wheelwright_core::drive::{RowSink, SinkError};
use wheelwright_core::recording::{RecordingError, list};

use super::writer::{Topics, WriteError, odometry, stamp, twist};

/// An MCAP file of Twist on `/cmd_vel` and Odometry on `/odom` that grows row by row, as `write_mcap` would write it at once.
#[derive(Debug)]
pub struct McapRecorder {
    path: PathBuf,
    file: File,
    /// Bytes of whole rows.
    whole: u64,
    framing: Framing,
    topics: Topics,
    places: Places,
    message: Vec<u8>,
    last: Option<u64>,
}

/// The writer of records, and what it wrote since the last row: a failing disk never meets it.
struct Framing {
    writer: mcap::Writer<NoSeek<Tail>>,
    tail: Tail,
}

impl std::fmt::Debug for Framing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Framing").finish_non_exhaustive()
    }
}

/// Bytes not yet written to the file.
#[derive(Clone, Default)]
struct Tail(Rc<RefCell<Vec<u8>>>);

impl Write for Tail {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Where in a row the messages' fields stand.
#[derive(Debug)]
struct Places {
    command: Option<[usize; 2]>,
    motion: Option<[usize; 2]>,
    pose: [Option<usize>; 3],
}

impl Places {
    fn of(channels: &[&Channel]) -> Result<Self, WriteError> {
        let place = |name: &str| channels.iter().position(|c| c.name == name);
        let pair = |first: &str, second: &str| Some([place(first)?, place(second)?]);
        let (command, motion) = (pair("v_ref", "omega_ref"), pair("v", "omega"));
        if command.is_none() && motion.is_none() {
            let available = list(channels.iter().map(|c| c.name.as_ref()));
            return Err(RecordingError::MissingColumn { name: "v".to_owned(), available }.into());
        }
        Ok(Self { command, motion, pose: ["x", "y", "phi"].map(place) })
    }
}

impl McapRecorder {
    /// Creates the file, which must not be there, for rows of those channels.
    ///
    /// # Errors
    /// [`WriteError::Columns`] if the channels have no place in these messages; otherwise the operating system's, of kind
    /// `AlreadyExists` if the file is there.
    pub fn create<'a>(path: &Path, channels: impl IntoIterator<Item = &'a Channel>) -> Result<Self, WriteError> {
        let places = Places::of(&channels.into_iter().collect::<Vec<_>>())?;
        let file = File::create_new(path)?;
        let tail = Tail::default();
        let options = mcap::WriteOptions::new().profile("ros2").compression(None).use_chunks(false).disable_seeking(true);
        let mut writer = options.create(NoSeek::new(tail.clone()))?;
        let topics = Topics::declare(&mut writer, places.command.is_some(), places.motion.is_some())?;
        let framing = Framing { writer, tail };
        let mut recorder = Self { path: path.to_owned(), file, whole: 0, framing, topics, places, message: Vec::new(), last: None };
        recorder.pass_on()?;
        Ok(recorder)
    }

    fn add(&mut self, t: f64, values: &[f64]) -> Result<(), WriteError> {
        let stamp = stamp(t)?;
        if self.last.is_some_and(|last| stamp <= last) {
            return Err(WriteError::Time { time: t });
        }
        self.last = Some(stamp);
        let writer = &mut self.framing.writer;
        if let Some([v, omega]) = self.places.command {
            twist(&mut self.message, values[v], values[omega]);
            self.topics.write(writer, self.topics.command, stamp, &self.message)?;
        }
        if let Some([v, omega]) = self.places.motion {
            let pose = self.places.pose.map(|place| place.map_or(0.0, |i| values[i]));
            odometry(&mut self.message, stamp, pose, (values[v], values[omega]));
            self.topics.write(writer, self.topics.odometry, stamp, &self.message)?;
        }
        Ok(self.pass_on()?)
    }

    /// Hands the bytes of whole records over; what a full disk cut is taken back.
    fn pass_on(&mut self) -> io::Result<()> {
        let bytes = std::mem::take(&mut *self.framing.tail.0.borrow_mut());
        if let Err(error) = self.file.write_all(&bytes) {
            let _ = self.file.set_len(self.whole);
            return Err(error);
        }
        self.whole += bytes.len() as u64;
        Ok(())
    }

    fn failed(&self, error: &WriteError) -> SinkError {
        SinkError { target: self.path.display().to_string(), reason: error.to_string() }
    }
}

impl RowSink for McapRecorder {
    fn row(&mut self, t: f64, values: &[f64]) -> Result<(), SinkError> {
        self.add(t, values).map_err(|e| self.failed(&e))
    }

    fn finish(&mut self) -> Result<(), SinkError> {
        let end = |recorder: &mut Self| -> Result<(), WriteError> {
            recorder.framing.writer.finish()?;
            recorder.pass_on()?;
            Ok(recorder.file.sync_all()?)
        };
        end(self).map_err(|e| self.failed(&e))
    }
}
