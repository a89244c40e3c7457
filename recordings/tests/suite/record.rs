//! Recordings that grow while a robot drives: readable wherever they end, and never on top of another.

use std::path::Path;

use wheelwright_core::Recording;
use wheelwright_core::channel::{self, Channel};
use wheelwright_core::drive::RowSink;
use wheelwright_core::recording::ReadOptions;
use wheelwright_recordings::{CsvRecorder, McapRecorder, WriteError, open};

const CHANNELS: [Channel; 7] = [channel::V_REF, channel::OMEGA_REF, channel::V, channel::OMEGA, channel::X, channel::Y, channel::PHI];
const ROWS: usize = 40;

fn row(k: usize) -> (f64, [f64; 7]) {
    let t = 0.05 * k as f64;
    (t, [(2.0 * t).sin(), 0.3, (2.0 * t - 0.1).sin(), 0.29 + 0.01 * t, 0.1 * t, -0.2 * t, 0.3 * t])
}

fn fill(sink: &mut dyn RowSink) {
    for k in 0..ROWS {
        let (t, values) = row(k);
        sink.row(t, &values).unwrap();
    }
}

fn read(path: &Path) -> Recording {
    open(path, &ReadOptions::default()).unwrap()
}

fn assert_rows(recording: &Recording, rows: usize) {
    assert_eq!(recording.rows(), rows);
    for (i, channel) in CHANNELS.iter().enumerate() {
        let column = recording.column(&channel.name).unwrap();
        for (k, value) in column.iter().enumerate() {
            let expected = row(k).1[i];
            // A heading goes through a quaternion in MCAP.
            assert!((value - expected).abs() < 1e-12, "{} row {k}: {value} {expected}", channel.name);
        }
    }
}

#[test]
fn what_was_recorded_is_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let (csv, mcap) = (folder.path().join("a.csv"), folder.path().join("a.mcap"));
    let mut text = CsvRecorder::create(&csv, &CHANNELS).unwrap();
    let mut binary = McapRecorder::create(&mcap, &CHANNELS).unwrap();
    for sink in [&mut text as &mut dyn RowSink, &mut binary] {
        fill(sink);
        sink.finish().unwrap();
    }
    for path in [csv, mcap] {
        let recording = read(&path);
        assert_rows(&recording, ROWS);
        assert!(recording.warnings.is_empty(), "{:?}", recording.warnings);
    }
}

#[test]
fn a_program_that_dies_leaves_every_row_it_handed_over() {
    let folder = tempfile::tempdir().unwrap();
    let (csv, mcap) = (folder.path().join("a.csv"), folder.path().join("a.mcap"));
    let mut text = CsvRecorder::create(&csv, &CHANNELS).unwrap();
    let mut binary = McapRecorder::create(&mcap, &CHANNELS).unwrap();
    fill(&mut text);
    fill(&mut binary);
    // As kill -9 does: no destructor runs.
    std::mem::forget((text, binary));
    assert_rows(&read(&csv), ROWS);
    let recording = read(&mcap);
    assert_rows(&recording, ROWS);
    assert!(recording.warnings.iter().any(|w| w.contains("cut off")), "{:?}", recording.warnings);
}

#[test]
fn a_file_that_ends_at_any_byte_gives_its_whole_rows() {
    let folder = tempfile::tempdir().unwrap();
    let (csv, mcap) = (folder.path().join("a.csv"), folder.path().join("a.mcap"));
    fill(&mut CsvRecorder::create(&csv, &CHANNELS).unwrap());
    fill(&mut McapRecorder::create(&mcap, &CHANNELS).unwrap());
    for path in [csv, mcap] {
        let bytes = std::fs::read(&path).unwrap();
        let cut = folder.path().join("cut");
        let mut last = ROWS;
        for length in (bytes.len() / 2..=bytes.len()).rev().step_by(bytes.len() / 150) {
            std::fs::write(&cut, &bytes[..length]).unwrap();
            let rows = read(&cut).rows();
            assert!(rows <= last && rows + 2 >= last && rows >= 15, "{}: {rows} of {length} bytes after {last}", path.display());
            last = rows;
        }
    }
}

#[test]
fn no_recording_is_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    std::fs::write(&path, "precious").unwrap();
    assert_eq!(CsvRecorder::create(&path, &CHANNELS).unwrap_err().kind(), std::io::ErrorKind::AlreadyExists);
    match McapRecorder::create(&path, &CHANNELS).unwrap_err() {
        WriteError::Io(error) => assert_eq!(error.kind(), std::io::ErrorKind::AlreadyExists),
        other => panic!("{other}"),
    }
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "precious");
}

#[test]
fn channels_without_a_message_have_no_mcap_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let error = McapRecorder::create(&path, &[channel::U_LEFT, channel::OMEGA_LEFT]).unwrap_err();
    assert!(matches!(error, WriteError::Columns(_)) && !path.exists(), "{error}");
}
