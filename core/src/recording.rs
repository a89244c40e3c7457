//! A recording: columns over one clock, cut into segments.

use std::ops::Range;
use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::channel;

/// Rows further apart than this many median periods are a break: the robot went unobserved for several periods, and
/// neither a filter nor a held command can be trusted across it.
pub const GAP_PERIODS: f64 = 5.0;

/// One named column of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Column name; the contract's names where they apply.
    pub name: String,
    /// SI unit, empty where unknown.
    pub unit: String,
    /// One finite value a row.
    pub values: Vec<f64>,
}

impl Column {
    /// A column whose unit is the contract's unit of `name`.
    pub fn new(name: impl Into<String>, values: Vec<f64>) -> Self {
        let name = name.into();
        let unit = channel::unit_of(&name).to_owned();
        Self { name, unit, values }
    }
}

/// A stretch of rows without a break: nothing is filtered, differentiated or simulated beyond its ends.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Segment {
    /// The label the file gives it.
    pub label: String,
    /// Rows of the recording.
    pub rows: Range<usize>,
}

/// Where a recording came from.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Source {
    /// The file or folder as the user named it; empty for data made in memory.
    pub path: PathBuf,
    /// Format as found from the content, such as `csv` or `rosbag2 (sqlite3)`.
    pub format: String,
}

/// What a recording's clock was found to be.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ClockReport {
    /// Where row times come from: `column`, `header stamp`, `log time`.
    pub source: String,
    /// Offset of the recorder's clock against the stamps, log − stamp \[s\] (its low quantile); none where there is one clock.
    pub offset_s: Option<f64>,
    /// Spread of log − stamp above that offset, median and 95 % quantile \[s\].
    pub jitter_s: Option<(f64, f64)>,
}

/// What is in a file besides the rows that were kept: a topic, an entry, a table column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stream {
    /// Topic, entry or column name.
    pub name: String,
    /// Message or value type as the file states it.
    pub kind: String,
    /// Messages or values.
    pub count: u64,
    /// True if rows of the recording come from it.
    pub used: bool,
}

/// Rows of a recording with unequal clocks already mapped into one.
///
/// Invariants, enforced by [`Recording::new`]: at least two rows; every column as long as `time`; every value
/// finite; time strictly increasing inside a segment; segments cover all rows in order.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// Origin.
    pub source: Source,
    /// Clock findings.
    pub clock: ClockReport,
    /// Everything the file holds, used or not.
    pub streams: Vec<Stream>,
    /// What a user should know: truncation, dropped duplicates, converted signs.
    pub warnings: Vec<String>,
    time: Vec<f64>,
    columns: Vec<Column>,
    segments: Vec<Segment>,
}

/// Why rows cannot be a recording. Row numbers count data rows from 1.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// Fewer than two rows.
    #[error("{rows} data row(s): at least two are needed")]
    TooShort {
        /// Rows present.
        rows: usize,
    },
    /// A column's length differs from the time column's.
    #[error("column `{column}` has {found} values for {expected} times")]
    Ragged {
        /// Column name.
        column: String,
        /// Its length.
        found: usize,
        /// Number of times.
        expected: usize,
    },
    /// NaN or infinity.
    #[error("row {row}, column `{column}`: {value} is not a finite number; remove the row or repair the export")]
    NotFinite {
        /// Data row from 1.
        row: usize,
        /// Column name.
        column: String,
        /// The value.
        value: f64,
    },
    /// Time goes back inside a segment.
    #[error("row {row}: time goes back from {before} s to {after} s; sort the rows, or mark separate runs with a `segment` column")]
    TimeReversal {
        /// Data row from 1 of the later sample.
        row: usize,
        /// Time of the row before.
        before: f64,
        /// Time of this row.
        after: f64,
    },
    /// The time stamps do not advance.
    #[error(
        "row {row}: {count} consecutive rows carry the same time stamp {time} s: the clock was frozen; record with a running clock (or check use_sim_time)"
    )]
    FrozenStamps {
        /// Data row from 1 of the first of them.
        row: usize,
        /// Number of rows.
        count: usize,
        /// The stamp.
        time: f64,
    },
    /// Every measured or commanded velocity is constant.
    #[error("no motion: {columns} never change{hint}; nothing can be learned from it")]
    NoMotion {
        /// The columns looked at.
        columns: String,
        /// What may be wrong, or empty.
        hint: String,
    },
    /// Segments leave rows out, overlap or are empty.
    #[error("row {row}: segments must cover all rows once and in order")]
    BadSegments {
        /// Data row from 1 where the next segment should begin.
        row: usize,
    },
    /// A needed column is absent.
    #[error("no column `{name}`; the file has {available}. Map another name with --map {name}=COLUMN")]
    MissingColumn {
        /// Column wanted.
        name: String,
        /// Columns present, as a list.
        available: String,
    },
}

impl Recording {
    /// Checks the invariants and builds a recording. `labels` gives each row's segment; `None` makes one segment.
    ///
    /// # Errors
    /// [`RecordingError`] with row and column of the first violation. Equal stamps count as frozen: readers that know
    /// exact duplicates to be harmless drop them before.
    pub fn new(source: Source, time: Vec<f64>, columns: Vec<Column>, labels: Option<&[String]>) -> Result<Self, RecordingError> {
        let segments = match labels {
            Some(labels) if labels.len() != time.len() => {
                return Err(RecordingError::Ragged { column: "segment".to_owned(), found: labels.len(), expected: time.len() });
            }
            Some(labels) => segments_of(labels),
            None => vec![Segment { label: "0".to_owned(), rows: 0..time.len() }],
        };
        Self::with_segments(source, time, columns, segments)
    }

    /// As [`Recording::new`], for readers that already know where segments begin and end: no label a row is needed.
    ///
    /// # Errors
    /// [`RecordingError`] with row and column of the first violation; `BadSegments` if the segments are empty, overlap or
    /// leave rows out.
    pub fn with_segments(source: Source, time: Vec<f64>, columns: Vec<Column>, segments: Vec<Segment>) -> Result<Self, RecordingError> {
        let rows = time.len();
        if rows < 2 {
            return Err(RecordingError::TooShort { rows });
        }
        check_finite("t", &time)?;
        for column in &columns {
            if column.values.len() != rows {
                return Err(RecordingError::Ragged { column: column.name.clone(), found: column.values.len(), expected: rows });
            }
            check_finite(&column.name, &column.values)?;
        }
        check_cover(&segments, rows)?;
        for segment in &segments {
            check_time(&time, segment.rows.clone())?;
        }
        Ok(Self { source, clock: ClockReport::default(), streams: Vec::new(), warnings: Vec::new(), time, columns, segments })
    }

    /// Row times \[s\].
    pub fn time(&self) -> &[f64] {
        &self.time
    }

    /// All columns.
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// All segments, in order, without gaps between them.
    pub fn segments(&self) -> &[Segment] {
        &self.segments
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.time.len()
    }

    /// Values of a column.
    ///
    /// # Errors
    /// [`RecordingError::MissingColumn`] listing what there is.
    pub fn column(&self, name: &str) -> Result<&[f64], RecordingError> {
        self.columns.iter().find(|c| c.name == name).map(|c| c.values.as_slice()).ok_or_else(|| RecordingError::MissingColumn {
            name: name.to_owned(),
            available: list(self.columns.iter().map(|c| c.name.as_str())),
        })
    }

    /// Time covered by the segments, without the breaks between them \[s\].
    pub fn duration(&self) -> f64 {
        self.segments.iter().map(|s| self.time[s.rows.end - 1] - self.time[s.rows.start]).sum()
    }

    /// Median step between rows of a segment \[s\]; zero if no segment has two rows.
    pub fn period(&self) -> f64 {
        let mut steps: Vec<f64> = self.segments.iter().flat_map(|s| self.time[s.rows.clone()].windows(2).map(|w| w[1] - w[0])).collect();
        median(&mut steps)
    }

    /// Refuses a recording in which none of `names` ever changes; names that are absent are passed over.
    ///
    /// # Errors
    /// [`RecordingError::NoMotion`].
    pub fn require_motion(&self, names: &[&str]) -> Result<(), RecordingError> {
        let present: Vec<&Column> = self.columns.iter().filter(|c| names.contains(&c.name.as_str())).collect();
        let moves = |c: &&Column| c.values.iter().any(|v| *v != c.values[0]);
        if present.is_empty() || present.iter().any(moves) {
            return Ok(());
        }
        Err(RecordingError::NoMotion { columns: list(present.iter().map(|c| c.name.as_str())), hint: String::new() })
    }

    /// Breaks segments wherever two rows are more than `factor` median periods apart ([`GAP_PERIODS`]), and says so in the warnings.
    pub fn split_at_gaps(&mut self, factor: f64) {
        let limit = factor * self.period();
        let mut split = Vec::with_capacity(self.segments.len());
        let mut gaps = Vec::new();
        for segment in &self.segments {
            let mut start = segment.rows.start;
            let mut part = 0;
            for row in segment.rows.start + 1..segment.rows.end {
                let step = self.time[row] - self.time[row - 1];
                if step > limit {
                    split.push(Segment { label: part_label(&segment.label, part), rows: start..row });
                    gaps.push((self.time[row - 1], step));
                    start = row;
                    part += 1;
                }
            }
            split.push(Segment { label: part_label(&segment.label, part), rows: start..segment.rows.end });
        }
        if let Some((at, longest)) = gaps.iter().copied().reduce(|a, b| if b.1 > a.1 { b } else { a }) {
            self.warnings.push(format!(
                "{} gap(s) longer than {limit:.3} s, the longest {longest:.3} s at t = {at:.3} s: treated as breaks between segments",
                gaps.len()
            ));
        }
        self.segments = split;
    }
}

/// What parts the label of a segment from the number of a part of it.
const PART: char = '+';

fn part_label(label: &str, part: usize) -> String {
    if part == 0 { label.to_owned() } else { format!("{label}{PART}{part}") }
}

/// The label of the segment that a part is of.
pub(crate) fn segment_label(label: &str) -> Option<&str> {
    label.split(PART).next()
}

fn check_finite(name: &str, values: &[f64]) -> Result<(), RecordingError> {
    match values.iter().position(|v| !v.is_finite()) {
        Some(i) => Err(RecordingError::NotFinite { row: i + 1, column: name.to_owned(), value: values[i] }),
        None => Ok(()),
    }
}

fn check_cover(segments: &[Segment], rows: usize) -> Result<(), RecordingError> {
    let mut next = 0;
    for segment in segments {
        if segment.rows.start != next || segment.rows.end <= next || segment.rows.end > rows {
            return Err(RecordingError::BadSegments { row: next + 1 });
        }
        next = segment.rows.end;
    }
    if next == rows { Ok(()) } else { Err(RecordingError::BadSegments { row: next + 1 }) }
}

fn check_time(time: &[f64], rows: Range<usize>) -> Result<(), RecordingError> {
    for i in rows.start + 1..rows.end {
        if time[i] < time[i - 1] {
            return Err(RecordingError::TimeReversal { row: i + 1, before: time[i - 1], after: time[i] });
        }
        if time[i] == time[i - 1] {
            let count = time[i - 1..rows.end].iter().take_while(|t| **t == time[i]).count();
            return Err(RecordingError::FrozenStamps { row: i, count, time: time[i] });
        }
    }
    Ok(())
}

fn segments_of(labels: &[String]) -> Vec<Segment> {
    let mut segments: Vec<Segment> = Vec::new();
    for (row, label) in labels.iter().enumerate() {
        match segments.last_mut() {
            Some(last) if last.label == *label => last.rows.end = row + 1,
            _ => segments.push(Segment { label: label.clone(), rows: row..row + 1 }),
        }
    }
    segments
}

/// Median of the values, which are reordered; zero for none.
pub fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// `a, b and c` for messages.
pub fn list<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let quoted: Vec<String> = names.map(|n| format!("`{n}`")).collect();
    match quoted.as_slice() {
        [] => "nothing".to_owned(),
        [one] => one.clone(),
        [head @ .., last] => format!("{} and {last}", head.join(", ")),
    }
}

/// How a reader is to see a file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReadOptions {
    /// Columns by another name, scaled and shifted.
    pub columns: Vec<ColumnMap>,
    /// Topics by role: (`cmd` or `odom`, topic name).
    pub topics: Vec<(String, String)>,
}

/// One column under the contract's name: `value = scale × file value + offset`.
#[derive(Debug, Clone, PartialEq)]
pub struct ColumnMap {
    /// Name in the recording, such as `v`.
    pub name: String,
    /// Name in the file, such as `twist_x`.
    pub from: String,
    /// Factor to SI.
    pub scale: f64,
    /// Offset in SI.
    pub offset: f64,
}

/// Reads one format. Formats are found from the content, never from the ending of the name.
pub trait RecordingReader: Send + Sync {
    /// Format name as `inspect` prints it.
    fn format(&self) -> &'static str;

    /// True if the file (or folder) at `path`, whose first bytes are `head`, is of this format.
    fn recognises(&self, path: &Path, head: &[u8]) -> bool;

    /// Reads the whole file into a recording.
    ///
    /// # Errors
    /// [`ReadError`] with the position and the reason; never a panic, whatever the bytes.
    fn read(&self, path: &Path, options: &ReadOptions) -> Result<Recording, ReadError>;
}

/// Why a file could not be read. The path is added by whoever prints it.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The operating system refused.
    #[error("{0}")]
    Io(#[from] std::io::Error),
    /// The content was read and cannot be a recording.
    #[error(transparent)]
    Content(#[from] RecordingError),
    /// The bytes break the format.
    #[error("{position}: {reason}")]
    Malformed {
        /// Line, row, byte offset, topic or key.
        position: String,
        /// What is wrong and what to do.
        reason: String,
    },
    /// Valid, but not of a kind this program reads.
    #[error("{what}: {reason}")]
    Unsupported {
        /// Topic, encoding, compression, row shape.
        what: String,
        /// Why, and what is read instead.
        reason: String,
    },
    /// No reader knows the content.
    #[error("the content is of no known format ({found}); read are {known}")]
    Unrecognised {
        /// What the first bytes look like.
        found: String,
        /// Known formats.
        known: String,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[allow(clippy::single_range_in_vec_init, reason = "the ranges are the values")]
    fn segments_must_cover_all_rows_once_and_in_order() {
        let build = |spans: &[Range<usize>]| {
            let segments = spans.iter().map(|rows| Segment { label: "a".to_owned(), rows: rows.clone() }).collect();
            Recording::with_segments(Source::default(), vec![0.0, 1.0, 0.0, 1.0], Vec::new(), segments).map(|r| r.segments().len())
        };
        assert_eq!(build(&[0..2, 2..4]), Ok(2), "equal labels side by side stay two segments, so time may start again");
        for (spans, row) in
            [(vec![0..2], 3), (vec![0..2, 3..4], 3), (vec![0..3, 2..4], 4), (vec![0..2, 2..2, 2..4], 3), (vec![0..9], 1), (vec![], 1)]
        {
            assert_eq!(build(&spans), Err(RecordingError::BadSegments { row }), "{spans:?}");
        }
    }

    #[test]
    fn labels_must_be_as_many_as_rows() {
        let labels = vec!["a".to_owned(); 3];
        let error = Recording::new(Source::default(), vec![0.0, 1.0], Vec::new(), Some(&labels)).unwrap_err();
        assert_eq!(error, RecordingError::Ragged { column: "segment".to_owned(), found: 3, expected: 2 });
    }
}
