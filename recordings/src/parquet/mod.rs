//! Apache Parquet: the table format of pandas, Polars and DuckDB.
//!
//! Columns mean what they mean in CSV. The table of contents stands at the end of the file, so a file cut short holds
//! nothing that can be read.

mod decode;

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader, SerializedFileReader};
use wheelwright_core::recording::{ReadError, ReadOptions, Recording, RecordingReader, Segment};

use crate::columns::{LeftOut, Plan, Role, Values};
use decode::{Decoded, Kind};

const MAGIC: &[u8] = b"PAR1";

/// Rows a byte of file can stand for: far more than the best compression of a real recording, far fewer than a forged count.
const ROWS_PER_BYTE: u64 = 4096;

/// Reads Parquet.
pub(crate) struct Parquet;

impl RecordingReader for Parquet {
    fn format(&self) -> &'static str {
        "parquet"
    }

    fn recognises(&self, _path: &Path, head: &[u8]) -> bool {
        head.starts_with(MAGIC)
    }

    fn read(&self, path: &Path, options: &ReadOptions) -> Result<Recording, ReadError> {
        let mut file = File::open(path)?;
        let length = check_ends(&mut file)?;
        let reader = guarded("footer", || SerializedFileReader::new(file))?;
        let schema = reader.metadata().file_metadata().schema_descr();
        let kinds: Vec<Kind> = schema.columns().iter().map(|column| Kind::of(column)).collect();
        let plan = Plan::new(schema.columns().iter().map(|column| column.path().string()).collect(), options)?;
        check_kinds(&plan, &kinds)?;
        check_claims(&reader, length)?;
        let wanted: Vec<bool> = plan.roles().iter().zip(&kinds).map(|(role, kind)| is_wanted(*role, *kind)).collect();
        let decoded = decode(&reader, &plan, &kinds, &wanted)?;
        let mut segments = Vec::new();
        let mut values = Vec::with_capacity(decoded.len());
        for (index, column) in decoded.into_iter().enumerate() {
            if plan.roles()[index] == Role::Label {
                segments = runs(&column);
            }
            let descriptor = schema.column(index);
            let kind = descriptor.logical_type_ref().map_or_else(|| descriptor.physical_type().to_string(), |t| format!("{t:?}"));
            values.push(as_values(column, kind, plan.roles()[index], wanted[index], &plan.names()[index])?);
        }
        plan.assemble(values, segments, path, self.format(), &|row| format!("row {row}"))
    }
}

/// Checks the marks at both ends and the footer's length; returns the file's length.
fn check_ends(file: &mut File) -> Result<u64, ReadError> {
    let refuse = |reason: &str| Err(ReadError::Malformed { position: "footer".to_owned(), reason: reason.to_owned() });
    let length = file.seek(SeekFrom::End(0))?;
    if length < 12 {
        return refuse("the file ends behind its first bytes; write it again");
    }
    let mut tail = [0; 8];
    file.seek(SeekFrom::End(-8))?;
    file.read_exact(&mut tail)?;
    if tail.ends_with(b"PARE") {
        return Err(ReadError::Unsupported {
            what: "an encrypted Parquet file".to_owned(),
            reason: "write it without encryption".to_owned(),
        });
    }
    if !tail.ends_with(MAGIC) {
        return refuse(
            "the file was cut short: Parquet keeps its table of contents at the end, and without it nothing can be read; write it again",
        );
    }
    let footer = u64::from(u32::from_le_bytes([tail[0], tail[1], tail[2], tail[3]]));
    if footer + 12 > length {
        return refuse(&format!("it claims {footer} bytes in a file of {length}; write the file again"));
    }
    file.rewind()?;
    Ok(length)
}

fn check_kinds(plan: &Plan, kinds: &[Kind]) -> Result<(), ReadError> {
    for ((role, kind), name) in plan.roles().iter().zip(kinds).zip(plan.names()) {
        let fits = match role {
            Role::Number => matches!(kind, Kind::Number { .. } | Kind::Stamp { .. }),
            Role::Label => matches!(kind, Kind::Text | Kind::Number { .. }),
            Role::Extra | Role::Ignored => true,
        };
        if !fits {
            let reason =
                "its type is not one that is read here: numbers and time stamps for values, text or numbers for segments".to_owned();
            return Err(ReadError::Unsupported { what: format!("column `{name}`"), reason });
        }
    }
    Ok(())
}

/// Refuses counts and places that the file cannot hold, before anything is reserved or sought for them.
fn check_claims(reader: &SerializedFileReader<File>, length: u64) -> Result<(), ReadError> {
    let refuse = |reason: String| Err(ReadError::Malformed { position: "footer".to_owned(), reason });
    let rows = reader.metadata().file_metadata().num_rows();
    if !u64::try_from(rows).is_ok_and(|rows| rows <= length.saturating_mul(ROWS_PER_BYTE)) {
        return refuse(format!("it claims {rows} rows in a file of {length} bytes"));
    }
    for column in reader.metadata().row_groups().iter().flat_map(|group| group.columns()) {
        let start = column.dictionary_page_offset().unwrap_or(column.data_page_offset());
        let end = start.checked_add(column.compressed_size());
        let inside = |place: i64| u64::try_from(place).is_ok_and(|place| place <= length);
        if !inside(start) || column.compressed_size() < 0 || !end.is_some_and(inside) {
            let name = column.column_path().string();
            return refuse(format!("column `{name}` is said to lie outside the file of {length} bytes; write the file again"));
        }
    }
    Ok(())
}

/// Runs a step of the library's decoder, which may panic where damaged bytes contradict each other.
fn guarded<T>(position: &str, step: impl FnOnce() -> Result<T, ParquetError>) -> Result<T, ReadError> {
    // What the step borrowed is dropped, not used again, once it has panicked.
    let outcome = catch_unwind(AssertUnwindSafe(step));
    let contradiction = || Err(ParquetError::General("the bytes contradict each other".to_owned()));
    outcome
        .unwrap_or_else(|_| contradiction())
        .map_err(|e| ReadError::Malformed { position: position.to_owned(), reason: format!("{e}; write the file again") })
}

fn is_wanted(role: Role, kind: Kind) -> bool {
    match role {
        Role::Number | Role::Label => true,
        Role::Extra => matches!(kind, Kind::Number { .. } | Kind::Stamp { .. }),
        Role::Ignored => false,
    }
}

/// Reads the wanted columns; the others stay empty.
fn decode(reader: &SerializedFileReader<File>, plan: &Plan, kinds: &[Kind], wanted: &[bool]) -> Result<Vec<Decoded>, ReadError> {
    let limit = usize::try_from(reader.metadata().file_metadata().num_rows()).unwrap_or(0);
    let mut decoded: Vec<Decoded> = kinds.iter().map(|_| Decoded::default()).collect();
    for group in 0..reader.num_row_groups() {
        let row_group = guarded(&format!("row group {group}"), || reader.get_row_group(group))?;
        for index in (0..kinds.len()).filter(|&i| wanted[i]) {
            let column = &mut decoded[index];
            if column.null.is_some() {
                continue;
            }
            let remaining = limit - column.rows().min(limit);
            guarded(&format!("row group {group}, column `{}`", plan.names()[index]), || {
                column.append(row_group.get_column_reader(index)?, kinds[index], remaining)
            })?;
        }
    }
    Ok(decoded)
}

/// Runs of equal labels, numbers being labels by their shortest text.
fn runs(column: &Decoded) -> Vec<Segment> {
    let numbers = column.numbers.iter().map(f64::to_string);
    let labels = column.labels.iter().cloned().chain(numbers);
    let mut segments: Vec<Segment> = Vec::new();
    for (row, label) in labels.enumerate() {
        match segments.last_mut() {
            Some(last) if last.label == label => last.rows.end = row + 1,
            _ => segments.push(Segment { label, rows: row..row + 1 }),
        }
    }
    segments
}

/// A column's values for the plan; an extra one that is not all finite numbers is left out.
fn as_values(column: Decoded, kind: String, role: Role, wanted: bool, name: &str) -> Result<Values, ReadError> {
    let mut values = Values { kind, ..Values::default() };
    if role == Role::Label {
        return match column.null {
            Some(row) => Err(missing(row, name, "every row needs its segment's label")),
            None => Ok(values),
        };
    }
    if !wanted {
        values.left_out = Some(LeftOut::Text);
        return Ok(values);
    }
    if let Some(row) = column.null {
        if role == Role::Number {
            return Err(missing(row, name, "fill it or remove the row"));
        }
        values.left_out = Some(LeftOut::Broken(format!("row {row}, column `{name}`: no value")));
        return Ok(values);
    }
    let broken = column.numbers.iter().position(|v| !v.is_finite()).filter(|_| role == Role::Extra);
    if let Some(index) = broken {
        let why = format!("row {}, column `{name}`: {} is not a finite number", index + 1, column.numbers[index]);
        values.left_out = Some(LeftOut::Broken(why));
        return Ok(values);
    }
    values.numbers = column.numbers;
    Ok(values)
}

fn missing(row: usize, name: &str, what_to_do: &str) -> ReadError {
    ReadError::Malformed { position: format!("row {row}, column `{name}`"), reason: format!("no value; {what_to_do}") }
}
