//! From decoded rows to a checked recording: the checks every reader owes its user, in one place.

use wheelwright_core::recording::{Column, ReadError, Recording, RecordingError, Segment, Source, list};

/// Columns of which at least one must change, if any of them is there.
const MOTION: [&str; 7] = ["v", "omega", "vel_left", "vel_right", "omega_left", "omega_right", "vel"];

/// Speeds that no wheeled robot reaches: beyond them the unit is wrong, most often the one named here.
const ABSURD: [(&str, f64, &str, f64); 6] = [
    ("v", 100.0, "mm/s", 1e-3),
    ("v_ref", 100.0, "mm/s", 1e-3),
    ("vel_left", 100.0, "mm/s", 1e-3),
    ("vel_right", 100.0, "mm/s", 1e-3),
    ("omega", 100.0, "deg/s", std::f64::consts::PI / 180.0),
    ("omega_ref", 100.0, "deg/s", std::f64::consts::PI / 180.0),
];

/// A command and its answer differ by less than this factor unless their units do: deg/s and rad/s are 57 apart.
const UNIT_RATIO: f64 = 20.0;

/// Median steps beyond this are a time column in milliseconds or finer [s].
const SLOWEST_PERIOD: f64 = 5.0;

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
    /// `locate` turns a data row, counted from 1, into the place a user finds it at, such as `line 17`.
    ///
    /// # Errors
    /// [`ReadError::Malformed`] with the place for what is wrong in one row; [`ReadError::Content`] for what is wrong with
    /// the whole.
    pub(crate) fn into_recording(mut self, source: Source, locate: &dyn Fn(usize) -> String) -> Result<Recording, ReadError> {
        let dropped = self.isolated_repeats();
        let warning = dropped.first().map(|&row| {
            let (count, at) = (dropped.len(), self.time[row]);
            format!("{count} row(s) repeat the time stamp of the row before and were dropped, the first at t = {at} s")
        });
        self.drop_rows(&dropped);
        let locate = |row: usize| locate(row_before_dropping(row, &dropped));
        let mut recording = Recording::with_segments(source, self.time, self.columns, self.segments).map_err(|e| with_place(e, &locate))?;
        recording.clock.source = "column".to_owned();
        recording.warnings.extend(warning);
        check_units(&mut recording, &locate)?;
        recording.require_motion(&MOTION)?;
        Ok(recording)
    }

    /// Rows that repeat the stamp before them, if each stands alone and they are at most one in a hundred: a logger's
    /// stutter. Longer or more frequent repeats are a frozen clock, and none is returned.
    fn isolated_repeats(&self) -> Vec<usize> {
        let time = &self.time;
        let inside = |s: &Segment| s.rows.start + 1..s.rows.end.min(time.len());
        let repeats: Vec<usize> = self.segments.iter().flat_map(inside).filter(|&i| time[i] == time[i - 1]).collect();
        let alone = repeats.windows(2).all(|w| w[1] - w[0] > 1);
        let few = repeats.len() <= (time.len() / 100).max(1) && time.len() > 2;
        if alone && few { repeats } else { Vec::new() }
    }

    fn drop_rows(&mut self, rows: &[usize]) {
        if rows.is_empty() {
            return;
        }
        without(&mut self.time, rows);
        for column in &mut self.columns {
            without(&mut column.values, rows);
        }
        let kept = |end: usize| end - rows.partition_point(|&r| r < end);
        for segment in &mut self.segments {
            segment.rows = kept(segment.rows.start)..kept(segment.rows.end);
        }
    }
}

/// Removes the values at ascending indices.
fn without(values: &mut Vec<f64>, rows: &[usize]) {
    let mut next = rows.iter().copied().peekable();
    let mut index = 0;
    values.retain(|_| {
        let drop = next.next_if_eq(&index).is_some();
        index += 1;
        !drop
    });
}

/// The number, from 1, that a kept row had before the rows at the ascending indices `dropped` were taken out.
fn row_before_dropping(row: usize, dropped: &[usize]) -> usize {
    dropped.iter().fold(row, |row, &gone| if gone < row { row + 1 } else { row })
}

/// An error about one row with the place in the file instead of the row's number.
fn with_place(error: RecordingError, locate: &dyn Fn(usize) -> String) -> ReadError {
    let row = match error {
        RecordingError::TimeReversal { row, .. } | RecordingError::FrozenStamps { row, .. } | RecordingError::NotFinite { row, .. } => row,
        other => return other.into(),
    };
    let text = error.to_string();
    let rest = text.strip_prefix(&format!("row {row}")).unwrap_or(&text);
    match rest.split_once(": ") {
        Some((column, reason)) => ReadError::Malformed { position: format!("{}{column}", locate(row)), reason: reason.to_owned() },
        None => error.into(),
    }
}

fn check_units(recording: &mut Recording, locate: &dyn Fn(usize) -> String) -> Result<(), ReadError> {
    let mut warnings = Vec::new();
    for (name, limit, unit, scale) in ABSURD {
        warnings.extend(check_speed(recording, name, limit, &format!("if it is in {unit}, map it with scale = {scale}"), locate)?);
    }
    for (reference, measured) in [("v_ref", "v"), ("omega_ref", "omega")] {
        warnings.extend(compare_units(recording, reference, measured));
    }
    let period = recording.period();
    if period > SLOWEST_PERIOD {
        warnings.push(format!("the median step of `t` is {period} s: if `t` is in milliseconds, map it with scale = 0.001"));
    }
    recording.warnings.extend(warnings);
    Ok(())
}

/// Refuses a column of which more than a stray sample is beyond `limit`; a stray one is a warning.
fn check_speed(
    recording: &Recording,
    name: &str,
    limit: f64,
    advice: &str,
    locate: &dyn Fn(usize) -> String,
) -> Result<Option<String>, ReadError> {
    let Some(column) = recording.columns().iter().find(|c| c.name == name) else { return Ok(None) };
    let beyond = column.values.iter().filter(|v| v.abs() > limit).count();
    let Some(row) = column.values.iter().position(|v| v.abs() > limit) else { return Ok(None) };
    let (value, unit, place) = (column.values[row], &column.unit, locate(row + 1));
    let reason = format!("{value} {unit} is faster than any wheeled robot ({beyond} row(s) are beyond {limit} {unit}); {advice}");
    if beyond >= 3 {
        return Err(ReadError::Malformed { position: format!("{place}, column `{name}`"), reason });
    }
    Ok(Some(format!("{place}, column `{name}`: {reason}")))
}

/// A warning if a command and its answer are too far apart in size to share a unit.
fn compare_units(recording: &Recording, reference: &str, measured: &str) -> Option<String> {
    let size = |name: &str| recording.column(name).ok().map(|v| (v.iter().map(|x| x * x).sum::<f64>() / v.len() as f64).sqrt());
    let (asked, got) = (size(reference)?, size(measured)?);
    let ratio = got / asked;
    if asked == 0.0 || got == 0.0 || (ratio < UNIT_RATIO && ratio > 1.0 / UNIT_RATIO) {
        return None;
    }
    Some(format!("`{measured}` is {ratio:.3} times as large as `{reference}`: check that both are in SI units (rad/s, m/s)"))
}

/// `did you mean ...? the file has ...` for a name that is not there.
pub(crate) fn absent_hint<'a>(wanted: &str, names: impl Iterator<Item = &'a str> + Clone) -> String {
    match nearest(wanted, names.clone()) {
        Some(near) => format!("did you mean `{near}`? The file has {}", list(names)),
        None => format!("the file has {}", list(names)),
    }
}

/// The one of `names` nearest to `wanted` in spelling, if any is near.
fn nearest<'a>(wanted: &str, names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let scored = names.map(|name| (strsim::jaro_winkler(wanted, name), name));
    scored.filter(|(score, _)| *score > 0.75).max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, name)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(time: Vec<f64>, name: &str, values: Vec<f64>) -> Result<Recording, ReadError> {
        let segments = vec![Segment { label: "0".to_owned(), rows: 0..time.len() }];
        let columns = vec![Column::new(name, values)];
        Rows { time, columns, segments }.into_recording(Source::default(), &|row| format!("line {}", row + 1))
    }

    #[test]
    fn a_single_repeated_stamp_is_dropped_and_said() {
        let recording = rows(vec![0.0, 0.1, 0.1, 0.2], "v", vec![0.0, 1.0, 2.0, 3.0]).unwrap();
        assert_eq!(recording.time(), [0.0, 0.1, 0.2]);
        assert_eq!(recording.column("v").unwrap(), [0.0, 1.0, 3.0]);
        assert_eq!(recording.segments()[0].rows, 0..3);
        assert!(recording.warnings[0].contains("1 row(s) repeat"), "{:?}", recording.warnings);
    }

    #[test]
    fn a_frozen_clock_is_refused_at_its_line() {
        let error = rows(vec![0.0, 0.1, 0.1, 0.1, 0.2], "v", vec![0.0, 1.0, 2.0, 3.0, 4.0]).unwrap_err().to_string();
        assert!(error.starts_with("line 3: 3 consecutive rows carry the same time stamp 0.1 s"), "{error}");
    }

    #[test]
    fn places_count_rows_that_were_dropped() {
        let error = rows(vec![0.0, 0.1, 0.1, 0.2, 0.15], "v", vec![0.0, 1.0, 2.0, 3.0, 4.0]).unwrap_err().to_string();
        assert!(error.starts_with("line 6: time goes back from 0.2 s to 0.15 s"), "{error}");
    }

    #[test]
    fn no_motion_is_refused() {
        let error = rows(vec![0.0, 0.1, 0.2], "omega", vec![0.5; 3]).unwrap_err();
        assert!(matches!(error, ReadError::Content(RecordingError::NoMotion { .. })), "{error}");
    }

    #[test]
    fn velocities_in_other_units_are_refused_with_the_scale() {
        let time: Vec<f64> = (0..10).map(f64::from).collect();
        let error = rows(time.clone(), "v", (0..10).map(|k| 100.0 * f64::from(k)).collect()).unwrap_err().to_string();
        assert!(error.contains("line 4, column `v`: 200 m/s") && error.contains("scale = 0.001"), "{error}");
        let error = rows(time.clone(), "omega", (0..10).map(|k| -60.0 * f64::from(k)).collect()).unwrap_err().to_string();
        assert!(error.contains("deg/s") && error.contains("scale = 0.01745"), "{error}");
        let mut stray: Vec<f64> = (0..10).map(f64::from).collect();
        stray[4] = 1e4;
        assert!(rows(time, "v", stray).unwrap().warnings[0].contains("10000 m/s"));
    }

    #[test]
    fn near_names_are_suggested() {
        assert!(absent_hint("twist_y", ["twist_x", "gyro"].into_iter()).starts_with("did you mean `twist_x`?"));
        assert!(absent_hint("zzz", ["twist_x"].into_iter()).starts_with("the file has `twist_x`"));
    }
}
