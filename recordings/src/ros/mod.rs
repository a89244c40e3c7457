//! Recordings of ROS robots: MCAP, rosbag2 and ROS 1 bags.
//!
//! One idea: every container is scanned forward into the same [`collect::Collector`], which keeps a few numbers of each
//! message of a type that is read and nothing of the others; what is done with clocks, topics and rows is done once,
//! behind it. Memory grows with the drive data, not with the file.
//!
//! Times: rows are on the odometry's header stamps where those advance (see [`clock`]); commands are held from one to the
//! next and averaged over each row's interval (see [`hold`]).

mod bag1;
mod clock;
mod collect;
mod definitions;
mod folder;
pub(crate) mod hold;
mod join;
mod mcap;
mod message;
mod record;
mod select;
mod sqlite;
mod storage;
mod stream;
mod wire;
mod writer;

use std::path::Path;

use wheelwright_core::recording::{ReadError, ReadOptions, Recording, RecordingReader};

pub use record::McapRecorder;
pub use writer::{WriteError, write_mcap};

use collect::Collector;
use storage::Storage;

/// A single storage file of one container, as it is or inside a zstd frame.
pub(crate) struct BagFile(Storage);

/// A rosbag2 folder with its `metadata.yaml`.
pub(crate) struct BagFolder;

/// The readers of this module.
pub(crate) fn readers() -> Vec<Box<dyn RecordingReader>> {
    let file = |storage| Box::new(BagFile(storage)) as Box<dyn RecordingReader>;
    vec![file(Storage::Mcap), file(Storage::Sqlite), file(Storage::Bag1), Box::new(BagFolder)]
}

impl RecordingReader for BagFile {
    fn format(&self) -> &'static str {
        self.0.name()
    }

    fn recognises(&self, path: &Path, head: &[u8]) -> bool {
        Storage::of(head).or_else(|| Storage::compressed(path, head)) == Some(self.0)
    }

    fn read(&self, path: &Path, options: &ReadOptions) -> Result<Recording, ReadError> {
        let mut collector = Collector::new(options);
        let storage = storage::scan(path, &mut collector)?;
        join::recording(collector, path, storage.name(), options)
    }
}

impl RecordingReader for BagFolder {
    fn format(&self) -> &'static str {
        "rosbag2 folder"
    }

    fn recognises(&self, path: &Path, _head: &[u8]) -> bool {
        folder::of(path).is_some()
    }

    fn read(&self, path: &Path, options: &ReadOptions) -> Result<Recording, ReadError> {
        let folder = folder::of(path).unwrap_or_else(|| path.to_owned());
        let mut collector = Collector::new(options);
        let storage = folder::scan(&folder, &mut collector)?;
        join::recording(collector, path, &format!("rosbag2 folder, {}", storage.name()), options)
    }
}
