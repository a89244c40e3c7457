//! What can be known of a library's file before any of its code runs.

use std::fs::{self, Metadata};
use std::path::{Path, PathBuf};

use crate::error::PluginError;

/// Resolves a library's path and refuses what must not or cannot be loaded: no file, a file (or folder) that everybody may
/// write, a file that is no whole shared library.
pub(crate) fn checked(base: &Path, path: &Path) -> Result<PathBuf, PluginError> {
    let given = base.join(path);
    let resolved = fs::canonicalize(&given).map_err(|e| unreadable(&given, &e))?;
    let metadata = fs::metadata(&resolved).map_err(|e| unreadable(&given, &e))?;
    if !metadata.is_file() {
        return Err(PluginError::NotALibrary { path: given, reason: "it is not a regular file".to_owned() });
    }
    refuse_open_doors(&given, &resolved, &metadata)?;
    #[cfg(target_os = "linux")]
    elf::check(&resolved, metadata.len()).map_err(|reason| PluginError::NotALibrary { path: given, reason })?;
    Ok(resolved)
}

fn unreadable(path: &Path, error: &std::io::Error) -> PluginError {
    match error.kind() {
        std::io::ErrorKind::NotFound => PluginError::Missing { path: path.to_owned() },
        _ => PluginError::Unreadable { path: path.to_owned(), reason: error.to_string() },
    }
}

/// The library itself, and its folder: whoever may rename files there may replace the library, unless the folder is sticky.
#[cfg(unix)]
fn refuse_open_doors(given: &Path, resolved: &Path, metadata: &Metadata) -> Result<(), PluginError> {
    use std::os::unix::fs::MetadataExt;

    const WRITABLE_BY_OTHERS: u32 = 0o002;
    const STICKY: u32 = 0o1000;
    let refused = |what: String, mode: u32| PluginError::WorldWritable { path: given.to_owned(), what, mode: mode & 0o7777 };
    if metadata.mode() & WRITABLE_BY_OTHERS != 0 {
        return Err(refused("it".to_owned(), metadata.mode()));
    }
    let Some(folder) = resolved.parent() else { return Ok(()) };
    let mode = fs::metadata(folder).map_err(|e| unreadable(given, &e))?.mode();
    if mode & WRITABLE_BY_OTHERS != 0 && mode & STICKY == 0 {
        return Err(refused(format!("its folder {}", folder.display()), mode));
    }
    Ok(())
}

#[cfg(not(unix))]
fn refuse_open_doors(_: &Path, _: &Path, _: &Metadata) -> Result<(), PluginError> {
    Ok(())
}

/// The system's loader maps a file without asking whether all of it is there, and a truncated library then ends the process
/// with a bus error. The program headers tell beforehand.
#[cfg(target_os = "linux")]
mod elf {
    use std::fs::File;
    use std::io::{Read, Seek, SeekFrom};
    use std::path::Path;

    const HEADER_BYTES: usize = 64;
    const SEGMENT_BYTES: usize = 56;
    const CLASS_64: u8 = 2;
    const LITTLE_ENDIAN: u8 = 1;
    const SHARED_OBJECT: u64 = 3;
    const LOADED: u64 = 1;

    /// Checks a library of `length` bytes; layouts other than 64-bit little-endian are left to the loader.
    pub(super) fn check(path: &Path, length: u64) -> Result<(), String> {
        let mut file = File::open(path).map_err(|e| e.to_string())?;
        let mut header = [0; HEADER_BYTES];
        if length < HEADER_BYTES as u64 {
            return Err(format!("it has only {length} bytes"));
        }
        file.read_exact(&mut header).map_err(|e| e.to_string())?;
        if header[..4] != *b"\x7fELF" {
            return Err("it does not begin as one (no ELF header)".to_owned());
        }
        if header[4] != CLASS_64 || header[5] != LITTLE_ENDIAN || cfg!(not(all(target_pointer_width = "64", target_endian = "little"))) {
            return Ok(());
        }
        if number(&header, 16, 2) != SHARED_OBJECT {
            return Err("it is an ELF file of another kind (an object file or a program?); link it with -shared".to_owned());
        }
        let (table, count) = (number(&header, 32, 8), number(&header, 56, 2));
        let truncated = |needed: u64| Err(format!("it is cut off: {length} bytes of at least {needed}"));
        let end = table.saturating_add(count * SEGMENT_BYTES as u64);
        if end > length {
            return truncated(end);
        }
        file.seek(SeekFrom::Start(table)).map_err(|e| e.to_string())?;
        for _ in 0..count {
            let mut segment = [0; SEGMENT_BYTES];
            file.read_exact(&mut segment).map_err(|e| e.to_string())?;
            let end = number(&segment, 8, 8).saturating_add(number(&segment, 32, 8));
            if number(&segment, 0, 4) == LOADED && end > length {
                return truncated(end);
            }
        }
        Ok(())
    }

    /// Little-endian number of `size` bytes at `offset`.
    fn number(bytes: &[u8], offset: usize, size: usize) -> u64 {
        bytes[offset..offset + size].iter().rev().fold(0, |n, &b| n << 8 | u64::from(b))
    }
}
