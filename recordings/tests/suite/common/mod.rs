//! What the reader tests share.
#![allow(dead_code, reason = "each test file uses its part")]

use std::path::{Path, PathBuf};

use wheelwright_core::recording::{ColumnMap, ReadError, ReadOptions, Recording};

/// The folder of recordings that are not part of the project; nothing, said plainly, where it is absent.
pub(crate) fn shared() -> Option<PathBuf> {
    let default = || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared"));
    let folder = std::env::var_os("WHEELWRIGHT_SHARED").map_or_else(default, PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("SKIPPED: no recordings at {}; set WHEELWRIGHT_SHARED", folder.display());
    None
}

/// Reads bytes as a file.
pub(crate) fn open_bytes(bytes: &[u8], options: &ReadOptions) -> Result<Recording, ReadError> {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    wheelwright_recordings::open(file.path(), options)
}

/// Reads text as a file, with no options.
pub(crate) fn open_text(text: &str) -> Result<Recording, ReadError> {
    open_bytes(text.as_bytes(), &ReadOptions::default())
}

/// The message for text that is refused.
pub(crate) fn refusal(text: &str) -> String {
    match open_text(text) {
        Ok(read) => panic!("{} rows were read, with {:?}", read.rows(), read.warnings),
        Err(error) => error.to_string(),
    }
}

/// Reads a file under the shared folder.
pub(crate) fn open_shared(folder: &Path, name: &str) -> Recording {
    wheelwright_recordings::open(&folder.join(name), &ReadOptions::default()).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// One mapping.
pub(crate) fn map(name: &str, from: &str, scale: f64, offset: f64) -> ColumnMap {
    ColumnMap { name: name.to_owned(), from: from.to_owned(), scale, offset }
}

/// Options with mappings only.
pub(crate) fn mapping(columns: Vec<ColumnMap>) -> ReadOptions {
    ReadOptions { columns, ..ReadOptions::default() }
}
