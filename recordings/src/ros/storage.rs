//! One storage file: which container it is, and a zstd wrapper around it that rosbag2 calls file compression.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use wheelwright_core::recording::ReadError;

use super::collect::{Collector, malformed};
use super::stream::array;
use super::{bag1, mcap, sqlite};

const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// Most bytes that a compressed database may decompress to; they go to a temporary file.
const LARGEST_DATABASE: u64 = 64 << 30;

/// A kind of container.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Storage {
    /// MCAP.
    Mcap,
    /// rosbag2's SQLite 3 database.
    Sqlite,
    /// ROS 1 bag.
    Bag1,
}

impl Storage {
    /// The container whose first bytes these are.
    pub(crate) fn of(head: &[u8]) -> Option<Self> {
        if head.starts_with(&mcap::MAGIC) {
            Some(Self::Mcap)
        } else if head.starts_with(&sqlite::MAGIC) {
            Some(Self::Sqlite)
        } else if head.starts_with(&bag1::MAGIC) {
            Some(Self::Bag1)
        } else {
            None
        }
    }

    /// The container inside the zstd frame at `path`, whose first bytes are `head`; none for any other content.
    pub(crate) fn compressed(path: &Path, head: &[u8]) -> Option<Self> {
        if !head.starts_with(&ZSTD_MAGIC) {
            return None;
        }
        let mut frame = zstd::stream::read::Decoder::new(File::open(path).ok()?).ok()?;
        Self::of(&array::<16>(&mut frame).ok()??)
    }

    /// Name for people.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Mcap => "MCAP",
            Self::Sqlite => "rosbag2 (sqlite3)",
            Self::Bag1 => "ROS 1 bag",
        }
    }
}

/// Enough to know every container.
const HEAD: u64 = 64;

/// Scans one file of any container, compressed or not, and says which it was.
///
/// # Errors
/// As the container's; `Malformed` if it is none.
pub(crate) fn scan(path: &Path, collector: &mut Collector) -> Result<Storage, ReadError> {
    let mut head = Vec::new();
    File::open(path)?.take(HEAD).read_to_end(&mut head)?;
    if let Some(storage) = Storage::of(&head) {
        match storage {
            Storage::Sqlite => sqlite::scan(path, &head, collector)?,
            Storage::Mcap => mcap::scan(File::open(path)?, collector)?,
            Storage::Bag1 => bag1::scan(File::open(path)?, collector)?,
        }
        return Ok(storage);
    }
    let Some(storage) = Storage::compressed(path, &head) else {
        return Err(malformed("byte 0", "neither MCAP nor SQLite nor a ROS 1 bag, as it is or inside a zstd frame"));
    };
    let plain = zstd::stream::read::Decoder::new(File::open(path)?)?;
    match storage {
        Storage::Sqlite => scan_compressed_database(plain, collector)?,
        Storage::Mcap => mcap::scan(CutFrame(plain), collector)?,
        Storage::Bag1 => bag1::scan(CutFrame(plain), collector)?,
    }
    Ok(storage)
}

/// A frame that is cut short ends like a file that is: what was decompressed before is whole.
struct CutFrame<R>(R);

impl<R: Read> Read for CutFrame<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self.0.read(buffer) {
            Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => Ok(0),
            other => other,
        }
    }
}

/// SQLite wants a file to seek in, so the database is decompressed into a temporary one.
fn scan_compressed_database(plain: impl Read, collector: &mut Collector) -> Result<(), ReadError> {
    let mut file = tempfile::NamedTempFile::new()?;
    let written = io::copy(&mut CutFrame(plain).take(LARGEST_DATABASE + 1), &mut file)?;
    if written > LARGEST_DATABASE {
        return Err(ReadError::Unsupported {
            what: format!("a compressed database of more than {} GiB", LARGEST_DATABASE >> 30),
            reason: "decompress it with `zstd -d` and read the result".to_owned(),
        });
    }
    let mut head = Vec::new();
    File::open(file.path())?.take(HEAD).read_to_end(&mut head)?;
    sqlite::scan(file.path(), &head, collector)
}
