//! Folders of cases, and the key beside them.

use crate::error::Error;
use crate::referee::key::{Key, SCHEMA, seal};
use std::path::Path;

/// Creates a folder with all above it.
pub fn create(path: &Path) -> Result<(), Error> {
    std::fs::create_dir_all(path).map_err(|source| Error::File { what: "create", path: path.into(), source })
}

/// Writes a file whole.
pub fn write(path: &Path, text: &str) -> Result<(), Error> {
    std::fs::write(path, text).map_err(|source| Error::File { what: "write", path: path.into(), source })
}

/// Refuses a key that lies among the cases.
pub fn apart(key: &Path, out: &Path) -> Result<(), Error> {
    let whole = |p: &Path| std::path::absolute(p).unwrap_or_else(|_| p.into());
    if whole(key).starts_with(whole(out)) {
        return Err(Error::KeyAmongCases { key: key.into(), out: out.into() });
    }
    Ok(())
}

/// Writes a key and returns the hash that seals it.
pub fn write_key(path: &Path, key: &Key) -> Result<String, Error> {
    let mut text = serde_json::to_string_pretty(key).map_err(|e| Error::Key { path: path.into(), reason: e.to_string() })?;
    text.push('\n');
    write(path, &text)?;
    Ok(seal(text.as_bytes()))
}

/// Reads a key.
pub fn read_key(path: &Path) -> Result<Key, Error> {
    let text = std::fs::read_to_string(path).map_err(|source| Error::File { what: "read", path: path.into(), source })?;
    let key: Key = serde_json::from_str(&text).map_err(|e| Error::Key { path: path.into(), reason: e.to_string() })?;
    if key.schema != SCHEMA {
        return Err(Error::Key { path: path.into(), reason: format!("its schema is \"{}\", wanted is \"{SCHEMA}\"", key.schema) });
    }
    Ok(key)
}
