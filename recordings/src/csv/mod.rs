//! Text tables: a header of column names, then rows of numbers, read at the speed of the disk.
//!
//! Rows are read in place from one buffer; a row with quotes, spaces, an empty cell or anything else out of the ordinary is
//! split with care instead ([`rows`]). Only the columns are kept, never the text.

mod header;
mod record;
mod rows;
mod write;

use std::fs::File;
use std::path::Path;

use wheelwright_core::recording::{ReadError, ReadOptions, Recording, RecordingReader};

use crate::columns::Plan;
use header::Header;
use rows::Table;

pub use record::CsvRecorder;
pub use write::write_csv;

/// Reads CSV with comma, semicolon or tab, a header and decimal points.
pub(crate) struct Csv;

impl RecordingReader for Csv {
    fn format(&self) -> &'static str {
        "csv"
    }

    fn recognises(&self, _path: &Path, head: &[u8]) -> bool {
        Header::find(head).is_some()
    }

    fn read(&self, path: &Path, options: &ReadOptions) -> Result<Recording, ReadError> {
        let head = crate::detect::head(path)?;
        let header = Header::find(&head).ok_or_else(|| crate::detect::unrecognised(path, &head))?;
        let plan = Plan::new(header.names.clone(), options)?;
        let table = Table::read(File::open(path)?, &header, &plan)?;
        let lines = table.lines;
        let mut recording =
            plan.assemble(table.values, table.segments, path, self.format(), &|row| format!("line {}", lines.of_row(row)))?;
        recording.warnings.extend(table.warnings);
        Ok(recording)
    }
}
