//! From decoded rows to a checked recording: the checks every reader owes its user, in one place.

use wheelwright_core::recording::{Column, ReadError, Recording, RecordingError, Segment, Source, list};

/// Columns of which at least one must change, if any of them is there.
const MOTION: [&str; 6] = ["v", "omega", "vel_left", "vel_right", "omega_left", "omega_right"];

/// Rows as a reader decoded them, in SI units under the contract's names.
pub(crate) struct Rows {
    /// One time a row \[s\].
    pub(crate) time: Vec<f64>,
    /// Columns of the same length.
    pub(crate) columns: Vec<Column>,
    /// Segments that cover the rows in order.
    pub(crate) segments: Vec<Segment>,
}

impl Rows {
    /// Drops isolated repeated stamps, checks the invariants, the units' plausibility and that something moves.
    ///
    /// # Errors
    /// [`ReadError::Content`] with the first violation; [`ReadError::Malformed`] for velocities in the wrong unit.
    pub(crate) fn into_recording(mut self, source: Source) -> Result<Recording, ReadError> {
        let mut warnings = Vec::new();
        warnings.extend(self.drop_repeated_stamps());
        let mut recording = Recording::with_segments(source, self.time, self.columns, self.segments)?;
        recording.clock.source = "column".to_owned();
        recording.warnings = warnings;
        recording.require_motion(&MOTION)?;
        Ok(recording)
    }

    /// Repeats of one stamp that stand alone and are at most one in a hundred rows are a logger's stutter: the later row is
    /// dropped and the warning returned. Longer or more frequent repeats stay, to be refused as frozen stamps.
    fn drop_repeated_stamps(&mut self) -> Option<String> {
        let repeats: Vec<usize> =
            self.segments.iter().flat_map(|s| s.rows.start + 1..s.rows.end).filter(|&i| self.time[i] == self.time[i - 1]).collect();
        let isolated = repeats.windows(2).all(|w| w[1] - w[0] > 1);
        if repeats.is_empty() || !isolated || repeats.len() > (self.time.len() / 100).max(1) || self.time.len() < 3 {
            return None;
        }
        let first = self.time[repeats[0]];
        drop_rows(&mut self.time, &repeats);
        for column in &mut self.columns {
            drop_rows(&mut column.values, &repeats);
        }
        let before = |row: usize| repeats.partition_point(|&r| r < row);
        for segment in &mut self.segments {
            segment.rows = segment.rows.start - before(segment.rows.start)..segment.rows.end - before(segment.rows.end);
        }
        Some(format!("{} row(s) repeated the time stamp of the row before and were dropped, the first at t = {first} s", repeats.len()))
    }
}

/// Removes the rows at the given ascending indices.
fn drop_rows(values: &mut Vec<f64>, rows: &[usize]) {
    let mut next = rows.iter().copied().peekable();
    let mut index = 0;
    values.retain(|_| {
        let drop = next.next_if_eq(&index).is_some();
        index += 1;
        !drop
    });
}

/// The one of `names` nearest to `wanted` in spelling, if any is near.
pub(crate) fn nearest<'a>(wanted: &str, names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    names
        .map(|n| (strsim::jaro_winkler(wanted, n), n))
        .filter(|(score, _)| *score > 0.75)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, n)| n)
}

/// `; did you mean ...? the file has ...` for a name that is not there.
pub(crate) fn absent_hint<'a>(wanted: &str, names: impl Iterator<Item = &'a str> + Clone) -> String {
    match nearest(wanted, names.clone()) {
        Some(near) => format!("did you mean `{near}`? The file has {}", list(names)),
        None => format!("the file has {}", list(names)),
    }
}

/// True for errors whose row number a text reader turns into a line number.
pub(crate) fn row_of(error: &RecordingError) -> Option<usize> {
    match error {
        RecordingError::TimeReversal { row, .. } | RecordingError::FrozenStamps { row, .. } | RecordingError::NotFinite { row, .. } => {
            Some(*row)
        }
        _ => None,
    }
}
