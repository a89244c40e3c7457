//! WPILib's data log (`.wpilog`): SysId since 2024 and everything else a team's robot logs.
//!
//! Entries have clocks of their own. Rows stand at the stamps of a velocity; every other entry gives its latest value there.
//! SysId's state entry cuts the log into tests; what is outside a test is dropped.

mod entries;
mod records;
mod roles;

use std::fs::File;
use std::io::BufReader;
use std::ops::Range;
use std::path::Path;

use wheelwright_core::recording::{Column, ReadError, ReadOptions, Recording, RecordingReader, Segment, Source, Stream, list};

use crate::assemble::Rows;
use entries::{Entry, Log, STATE};
use records::Records;
use roles::Choice;

/// Columns whose stamps become the rows', the first that is there; otherwise the first column chosen.
const CLOCKS: [&str; 6] = ["vel_left", "vel_right", "v", "omega", "omega_left", "omega_right"];

/// A program logs one loop's values one after the other, some microseconds apart: a value that follows a row's stamp by
/// less than this share of the period belongs to the row.
const SAME_LOOP: f64 = 0.1;

/// Reads `.wpilog`.
pub(crate) struct WpiLog;

impl RecordingReader for WpiLog {
    fn format(&self) -> &'static str {
        "wpilog"
    }

    fn recognises(&self, _path: &Path, head: &[u8]) -> bool {
        head.starts_with(records::MAGIC)
    }

    fn read(&self, path: &Path, options: &ReadOptions) -> Result<Recording, ReadError> {
        let records = Records::new(BufReader::with_capacity(1 << 18, File::open(path)?))?;
        let Log { entries, mut warnings } = Log::read(records, |entry| roles::is_candidate(entry, options))?;
        let state = state_entry(&entries, options)?;
        let choices = roles::choose(&entries, options, &mut warnings)?;
        warnings.extend(choices.iter().filter_map(|c| unit_warning(c, &entries[c.entry])));
        let rows = join(&entries, &choices, state, &mut warnings)?;
        let times = rows.time.clone();
        let source = Source { path: path.to_owned(), format: self.format().to_owned() };
        let locate = |row: usize| times.get(row - 1).map_or_else(|| format!("row {row}"), |t| format!("row {row} at log time {t} s"));
        let mut recording = rows.into_recording(source, &locate)?;
        recording.clock.source = "log time".to_owned();
        recording.streams = streams(&entries, &choices, state);
        recording.warnings.extend(warnings);
        Ok(recording)
    }
}

fn streams(entries: &[Entry], choices: &[Choice], state: Option<usize>) -> Vec<Stream> {
    let used = |index: usize| state == Some(index) || choices.iter().any(|c| c.entry == index);
    let stream = |(index, e): (usize, &Entry)| Stream { name: e.name.clone(), kind: e.kind.clone(), count: e.count, used: used(index) };
    entries.iter().enumerate().map(stream).collect()
}

/// The entry that marks tests: the mapped one, or SysId's if there is one.
fn state_entry(entries: &[Entry], options: &ReadOptions) -> Result<Option<usize>, ReadError> {
    if let Some(map) = options.columns.iter().find(|m| m.name == "segment") {
        let found = entries.iter().position(|e| e.name == map.from && e.kind == "string");
        let strings = || list(entries.iter().filter(|e| e.kind == "string").map(|e| e.name.as_str()));
        return found.map(Some).ok_or_else(|| ReadError::Malformed {
            position: format!("mapping segment={}", map.from),
            reason: format!("no such string entry; there are {}", strings()),
        });
    }
    let tested = |e: &Entry| e.texts.iter().any(|(_, state)| state != "none");
    let found: Vec<usize> = (0..entries.len()).filter(|&i| entries[i].name.starts_with(STATE) && tested(&entries[i])).collect();
    if found.len() > 1 {
        let names = list(found.iter().map(|&i| entries[i].name.as_str()));
        let reason = format!("{names} all mark tests; choose a mechanism with --map segment=ENTRY");
        return Err(ReadError::Malformed { position: "entries".to_owned(), reason });
    }
    Ok(found.first().copied())
}

/// A warning if the log says that a position or velocity is not in metres.
fn unit_warning(choice: &Choice, entry: &Entry) -> Option<String> {
    let unit = entry.metadata.to_ascii_lowercase();
    let linear = choice.name.starts_with("pos") || choice.name.starts_with("vel") || choice.name == "v";
    let other = ["rotation", "radian", "degree", "foot", "feet", "inch"].iter().any(|u| unit.contains(u));
    let (name, metadata) = (&entry.name, &entry.metadata);
    (linear && other && choice.scale == 1.0).then(|| {
        format!("entry `{name}` is logged in `{metadata}` and taken as metres: map `{}` with the metres of one such unit", choice.name)
    })
}

/// Puts the chosen entries on one clock and cuts it into tests.
fn join(entries: &[Entry], choices: &[Choice], state: Option<usize>, warnings: &mut Vec<String>) -> Result<Rows, ReadError> {
    let clock = CLOCKS.iter().find_map(|name| choices.iter().find(|c| c.name == *name)).unwrap_or(&choices[0]);
    for choice in choices {
        check_order(&entries[choice.entry])?;
    }
    let stamps: Vec<u64> = entries[clock.entry].numbers.iter().map(|(stamp, _)| *stamp).collect();
    let slack = same_loop(&stamps);
    let begin = choices.iter().filter_map(|c| entries[c.entry].numbers.first()).map(|(stamp, _)| stamp.saturating_sub(slack)).max();
    let tests = match state {
        Some(state) => tests(&entries[state]),
        None => {
            warnings.push("no SysId state entry marks tests: the whole log is one segment".to_owned());
            vec![("0".to_owned(), 0..u64::MAX)]
        }
    };
    let mut kept = Vec::new();
    let mut early = 0;
    let mut segments = Vec::new();
    for (label, span) in tests {
        let start = kept.len();
        let (before, rows): (Vec<u64>, Vec<u64>) = stamps.iter().filter(|stamp| span.contains(stamp)).partition(|s| Some(**s) < begin);
        early += before.len();
        kept.extend(rows);
        if kept.len() > start {
            segments.push(Segment { label, rows: start..kept.len() });
        }
    }
    if early > 0 {
        warnings.push(format!("{early} row(s) stand before the first value of some entry and were dropped"));
    }
    let columns = choices.iter().map(|c| Column::new(c.name.clone(), hold(&entries[c.entry].numbers, &kept, slack, c))).collect();
    Ok(Rows { time: kept.iter().map(|stamp| *stamp as f64 / 1e6).collect(), columns, segments })
}

fn check_order(entry: &Entry) -> Result<(), ReadError> {
    match entry.numbers.windows(2).find(|pair| pair[1].0 < pair[0].0) {
        Some(pair) => Err(ReadError::Malformed {
            position: format!("entry `{}`", entry.name),
            reason: format!("time goes back from {} s to {} s", pair[0].0 as f64 / 1e6, pair[1].0 as f64 / 1e6),
        }),
        None => Ok(()),
    }
}

/// How far behind a row's stamp a value of the same loop may be \[µs\].
fn same_loop(stamps: &[u64]) -> u64 {
    let mut steps: Vec<f64> = stamps.windows(2).map(|pair| pair[1].saturating_sub(pair[0]) as f64).collect();
    (SAME_LOOP * wheelwright_core::recording::median(&mut steps)) as u64
}

/// Each test's label and span \[µs\], from the changes of the state.
fn tests(state: &Entry) -> Vec<(String, Range<u64>)> {
    let mut changes = state.texts.clone();
    changes.dedup_by(|later, earlier| later.1 == earlier.1);
    let ends = changes.iter().skip(1).map(|(stamp, _)| *stamp).chain([u64::MAX]);
    changes.iter().zip(ends).filter(|((_, label), _)| label != "none").map(|((start, label), end)| (label.clone(), *start..end)).collect()
}

/// The latest value at each stamp, scaled. Stamps ascend within a test and from test to test.
fn hold(samples: &[(u64, f64)], stamps: &[u64], slack: u64, choice: &Choice) -> Vec<f64> {
    let value = |stamp: &u64| {
        let next = samples.partition_point(|(at, _)| *at <= stamp.saturating_add(slack));
        let raw = next.checked_sub(1).map_or(f64::NAN, |last| samples[last].1);
        choice.scale * raw + choice.offset
    };
    stamps.iter().map(value).collect()
}
