//! Writing a recording as CSV.

use std::io::{BufWriter, Write};
use std::path::Path;

use wheelwright_core::recording::{ReadError, Recording};

use crate::beside::file_beside;

/// Writes `recording` as CSV: `t`, `segment`, then every column by its name. Numbers are the shortest that read back as the
/// same double. The file appears whole or not at all: it is written under another name beside `path`, then renamed.
///
/// # Errors
/// [`ReadError::Io`] if the folder cannot be written to.
pub fn write_csv(path: &Path, recording: &Recording) -> Result<(), ReadError> {
    let file = file_beside(path)?;
    let mut out = BufWriter::with_capacity(1 << 16, file);
    write_rows(&mut out, recording)?;
    let file = out.into_inner().map_err(std::io::IntoInnerError::into_error)?;
    file.persist(path).map_err(|e| e.error)?;
    Ok(())
}

fn write_rows(out: &mut impl Write, recording: &Recording) -> std::io::Result<()> {
    let columns: Vec<_> = recording.columns().iter().filter(|c| c.name != "segment").collect();
    write!(out, "t,segment")?;
    for column in &columns {
        write!(out, ",{}", quoted(&column.name))?;
    }
    writeln!(out)?;
    for segment in recording.segments() {
        let label = quoted(&segment.label);
        for row in segment.rows.clone() {
            write!(out, "{},{label}", recording.time()[row])?;
            for column in &columns {
                write!(out, ",{}", column.values[row])?;
            }
            writeln!(out)?;
        }
    }
    Ok(())
}

/// A name or label as a cell, in quotes where it needs them.
pub(super) fn quoted(text: &str) -> String {
    let special = text.contains([',', '"', '\n', '\r', '#', ';', '\t']) || text.trim() != text;
    if special { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}
