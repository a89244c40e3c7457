//! The rows of a text table.

use std::io::Read;

use wheelwright_core::recording::{ReadError, Segment};

use super::header::{Header, split};
use crate::columns::{LeftOut, Plan, Role, Values};
use crate::number;

/// Bytes read at a time.
const CHUNK: usize = 1 << 20;

/// The longest record: longer ones are no table of measurements.
const LONGEST_RECORD: usize = 16 << 20;

/// Columns and segments of a whole file.
#[derive(Debug)]
pub(super) struct Table {
    pub(super) values: Vec<Values>,
    pub(super) segments: Vec<Segment>,
    pub(super) lines: Lines,
    pub(super) warnings: Vec<String>,
}

/// Which line each data row stands on: rows follow one another but where lines were passed over.
#[derive(Debug, Default)]
pub(super) struct Lines {
    /// (data row from 1, its line) at the start of each run of rows on consecutive lines.
    runs: Vec<(usize, u64)>,
}

impl Lines {
    fn push(&mut self, row: usize, line: u64) {
        if self.runs.last().is_none_or(|&(first, at)| at + (row - first) as u64 != line) {
            self.runs.push((row, line));
        }
    }

    /// The line, from 1, of a data row, from 1.
    pub(super) fn of_row(&self, row: usize) -> u64 {
        let run = self.runs.partition_point(|&(first, _)| first <= row);
        self.runs[..run].last().map_or(row as u64, |&(first, line)| line + (row - first) as u64)
    }
}

/// What a column's cells are read as while the file is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Cell {
    Number,
    Label,
    Skipped,
}

/// Where a record ended.
enum Record {
    /// Read; the next begins here.
    Next(usize),
    /// The buffer ends inside it.
    Unfinished,
}

struct Parser<'a> {
    delimiter: u8,
    names: &'a [String],
    roles: &'a [Role],
    cells: Vec<Cell>,
    values: Vec<Values>,
    segments: Vec<Segment>,
    label: Vec<u8>,
    rows: usize,
    line: u64,
    lines: Lines,
    warnings: Vec<String>,
}

impl Table {
    /// Reads every row after the header.
    pub(super) fn read(mut input: impl Read, header: &Header, plan: &Plan) -> Result<Self, ReadError> {
        let mut parser = Parser::new(header, plan);
        let mut buffer = Vec::with_capacity(2 * CHUNK);
        let mut start = header.length;
        loop {
            let read = input.by_ref().take(CHUNK as u64).read_to_end(&mut buffer)?;
            let last = read == 0;
            if start < buffer.len() {
                start = parser.parse(&buffer, start, last)?;
                buffer.drain(..start);
                start = 0;
            }
            if last {
                return Ok(parser.finish());
            }
            if buffer.len() > LONGEST_RECORD {
                let reason = format!("the line is longer than {} MiB: this is no table of measurements", LONGEST_RECORD >> 20);
                return Err(ReadError::Malformed { position: format!("line {}", parser.line), reason });
            }
        }
    }
}

impl<'a> Parser<'a> {
    fn new(header: &Header, plan: &'a Plan) -> Self {
        let cell = |role: &Role| match role {
            Role::Number | Role::Extra => Cell::Number,
            Role::Label => Cell::Label,
            Role::Ignored => Cell::Skipped,
        };
        let kind = |role: &Role| if *role == Role::Label { "label" } else { "number" };
        let empty = |role: &Role| Values { kind: kind(role).to_owned(), ..Values::default() };
        Self {
            delimiter: header.delimiter,
            names: plan.names(),
            roles: plan.roles(),
            cells: plan.roles().iter().map(cell).collect(),
            values: plan.roles().iter().map(empty).collect(),
            segments: Vec::new(),
            label: Vec::new(),
            rows: 0,
            line: header.lines + 1,
            lines: Lines::default(),
            warnings: Vec::new(),
        }
    }

    fn finish(mut self) -> Table {
        if let Some(last) = self.segments.last_mut() {
            last.rows.end = self.rows;
        }
        Table { values: self.values, segments: self.segments, lines: self.lines, warnings: self.warnings }
    }

    /// Reads the records that end in `buffer`, from `start`; returns where the first unread one begins.
    fn parse(&mut self, buffer: &[u8], start: usize, last: bool) -> Result<usize, ReadError> {
        let mut at = start;
        // A record without its line end is not whole: it waits for the next chunk.
        let end = if last { buffer.len() } else { buffer.iter().rposition(|&b| b == b'\n').map_or(start, |n| n + 1) };
        let whole = &buffer[..end.max(start)];
        while at < whole.len() {
            if let Some(next) = self.plain_row(whole, at) {
                self.lines.push(self.rows + 1, self.line);
                self.rows += 1;
                self.line += 1;
                at = next;
                continue;
            }
            self.forget_unfinished_row();
            match self.any_row(whole, at, last)? {
                Record::Next(next) => at = next,
                Record::Unfinished => break,
            }
        }
        Ok(at)
    }

    /// Reads a row of bare numbers and the label of the row before; nothing, with a part of the row stored, for any other.
    #[inline]
    fn plain_row(&mut self, bytes: &[u8], start: usize) -> Option<usize> {
        let mut at = start;
        let last = self.cells.len() - 1;
        (bytes[at] != b'#').then_some(())?;
        for (index, cell) in self.cells.iter().enumerate() {
            match cell {
                Cell::Number => {
                    let (value, length) = number::leading(&bytes[at..])?;
                    self.values[index].numbers.push(value);
                    at += length;
                }
                Cell::Label if !self.segments.is_empty() && bytes[at..].starts_with(&self.label) => at += self.label.len(),
                Cell::Label => return None,
                Cell::Skipped => {
                    let ends = |&b: &u8| b == self.delimiter || b == b'\n' || b == b'\r' || b == b'"';
                    at += bytes[at..].iter().position(ends)?;
                }
            }
            if index < last {
                (*bytes.get(at)? == self.delimiter).then_some(())?;
                at += 1;
            }
        }
        if bytes.get(at) == Some(&b'\r') {
            at += 1;
        }
        (*bytes.get(at)? == b'\n').then_some(at + 1)
    }

    fn forget_unfinished_row(&mut self) {
        for values in &mut self.values {
            values.numbers.truncate(self.rows);
        }
    }

    /// Reads any record: blank, comment, quoted, broken. `last` is true if no more bytes follow.
    fn any_row(&mut self, bytes: &[u8], start: usize, last: bool) -> Result<Record, ReadError> {
        let Some((end, closed)) = record_end(bytes, start) else {
            if !last {
                return Ok(Record::Unfinished);
            }
            return self.open_quote(bytes, start);
        };
        let record = bytes[start..end].trim_ascii_end();
        let lines = bytes[start..end].iter().filter(|&&b| b == b'\n').count() as u64 + u64::from(!closed);
        let first = record.trim_ascii_start();
        if !first.is_empty() && !first.starts_with(b"#") {
            // Cells at the end of a record may be empty with a tab as delimiter: only the line end is cut off.
            let record = bytes[start..end].strip_suffix(b"\n").unwrap_or(&bytes[start..end]);
            let cells = split(record.strip_suffix(b"\r").unwrap_or(record), self.delimiter).unwrap_or_default();
            self.row(&cells, closed)?;
        }
        self.line += lines;
        Ok(Record::Next(end))
    }

    fn open_quote(&mut self, bytes: &[u8], start: usize) -> Result<Record, ReadError> {
        let rest = bytes[start..].trim_ascii_end();
        if rest.contains(&b'\n') {
            let reason = "a quote is opened and never closed; remove it or double it".to_owned();
            return Err(ReadError::Malformed { position: format!("line {}", self.line), reason });
        }
        self.warn_of_cut_line();
        Ok(Record::Next(bytes.len()))
    }

    fn warn_of_cut_line(&mut self) {
        self.warnings.push(format!("line {}: the file ends in the middle of this line, which is left out", self.line));
    }

    /// Stores one row of cells. `closed` is false if the file ends without a line end behind it.
    fn row(&mut self, cells: &[Vec<u8>], closed: bool) -> Result<(), ReadError> {
        if cells.len() != self.cells.len() {
            if !closed && cells.len() < self.cells.len() {
                self.warn_of_cut_line();
                return Ok(());
            }
            return Err(self.wrong_width(cells.len()));
        }
        let ends_in_number = self.cells.last() == Some(&Cell::Number);
        if !closed && ends_in_number && cells.last().is_some_and(|cell| is_cut_number(cell)) {
            self.warn_of_cut_line();
            return Ok(());
        }
        for (index, cell) in cells.iter().enumerate() {
            match self.cells[index] {
                Cell::Number => self.number(index, cell)?,
                Cell::Label => self.segment(index, cell.trim_ascii())?,
                Cell::Skipped => {}
            }
        }
        self.lines.push(self.rows + 1, self.line);
        self.rows += 1;
        Ok(())
    }

    fn number(&mut self, index: usize, cell: &[u8]) -> Result<(), ReadError> {
        let reason = match number::cell(cell) {
            Ok(value) => {
                self.values[index].numbers.push(value);
                return Ok(());
            }
            Err(reason) => reason,
        };
        let position = format!("line {}, column `{}`", self.line, self.names[index]);
        if self.roles[index] == Role::Number {
            return Err(ReadError::Malformed { position, reason });
        }
        let text =
            self.rows == 0 && !cell.trim_ascii().is_empty() && std::str::from_utf8(cell).is_ok_and(|c| c.trim().parse::<f64>().is_err());
        self.cells[index] = Cell::Skipped;
        let kind = if text { "text" } else { "number" };
        let left_out = if text { LeftOut::Text } else { LeftOut::Broken(format!("{position}: {reason}")) };
        self.values[index] = Values { kind: kind.to_owned(), left_out: Some(left_out), ..Values::default() };
        Ok(())
    }

    fn segment(&mut self, index: usize, cell: &[u8]) -> Result<(), ReadError> {
        if cell.is_empty() {
            let position = format!("line {}, column `{}`", self.line, self.names[index]);
            return Err(ReadError::Malformed { position, reason: "the cell is empty; every row needs its segment's label".to_owned() });
        }
        if self.segments.is_empty() || self.label != cell {
            if let Some(last) = self.segments.last_mut() {
                last.rows.end = self.rows;
            }
            self.label = cell.to_vec();
            self.segments.push(Segment { label: String::from_utf8_lossy(cell).into_owned(), rows: self.rows..self.rows });
        }
        Ok(())
    }

    fn wrong_width(&self, found: usize) -> ReadError {
        let expected = self.cells.len();
        let hint = if self.delimiter == b',' && found == 2 * expected {
            "; if numbers have decimal commas, export the file with decimal points"
        } else {
            ""
        };
        let reason = format!("{found} field(s) where the header names {expected}{hint}");
        ReadError::Malformed { position: format!("line {}", self.line), reason }
    }
}

/// True for what the end of a file can leave of a number: nothing, `-`, `1e`.
fn is_cut_number(cell: &[u8]) -> bool {
    let part = |b: &u8| b.is_ascii_digit() || b"+-.eE".contains(b);
    cell.trim_ascii().iter().all(part) && number::cell(cell).is_err()
}

/// Where the record that begins at `start` ends, behind its line end if it has one; nothing if a quote is left open.
fn record_end(bytes: &[u8], start: usize) -> Option<(usize, bool)> {
    let mut quoted = false;
    for (index, &byte) in bytes[start..].iter().enumerate() {
        quoted ^= byte == b'"';
        if byte == b'\n' && !quoted {
            return Some((start + index + 1, true));
        }
    }
    (!quoted).then_some((bytes.len(), false))
}
