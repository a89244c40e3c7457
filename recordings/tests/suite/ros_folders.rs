//! Bag folders as rosbag2 leaves them: split, in write-ahead mode, incomplete, in other serializations.

use std::path::Path;

use crate::ros_files::{db3, drive, mcap, recording};
use wheelwright_core::recording::{ReadOptions, Recording};

fn open(path: &Path) -> Result<Recording, String> {
    wheelwright_recordings::open(path, &ReadOptions::default()).map_err(|e| e.to_string())
}

fn metadata(folder: &Path, files: &[&str], extra: &str) {
    let files: String = files.iter().map(|f| format!("    - {f}\n")).collect();
    let text = format!("rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths:\n{files}{extra}");
    std::fs::write(folder.join("metadata.yaml"), text).unwrap();
}

#[test]
fn splits_are_one_recording_in_the_listed_order() {
    let folder = tempfile::tempdir().unwrap();
    let sent = drive(40);
    std::fs::write(folder.path().join("b_0.mcap"), mcap(&sent[..30], None)).unwrap();
    std::fs::write(folder.path().join("a_1.mcap"), mcap(&sent[30..], Some(mcap::Compression::Zstd))).unwrap();
    metadata(folder.path(), &["b_0.mcap", "a_1.mcap"], "  compression_mode: \"\"\n");
    let read = open(folder.path()).unwrap();
    assert_eq!(read.time(), recording(40).time());
    assert_eq!(read.column("v_ref").unwrap(), recording(40).column("v_ref").unwrap());
    assert_eq!(read.source.format, "rosbag2 folder, MCAP");
    let streams: Vec<_> = read.streams.iter().map(|s| (s.name.as_str(), s.count)).collect();
    assert_eq!(streams, [("/cmd_vel", 40), ("/odom", 40)]);
}

#[test]
fn folders_that_are_incomplete_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    metadata(folder.path(), &["bag_0.db3"], "");
    let error = open(folder.path()).unwrap_err();
    assert!(error.contains("metadata.yaml, relative_file_paths: `bag_0.db3` is not in the folder"), "{error}");
    metadata(folder.path(), &[], "");
    let error = open(folder.path()).unwrap_err();
    assert!(error.contains("`relative_file_paths` lists no file"), "{error}");
    std::fs::write(folder.path().join("bag_0.db3"), b"SQLite format 3\0 and no more").unwrap();
    metadata(folder.path(), &["bag_0.db3"], "");
    let error = open(folder.path()).unwrap_err();
    assert!(error.contains("bag_0.db3, SQLite storage: file is not a database"), "{error}");
    std::fs::write(folder.path().join("metadata.yaml"), "name: something else\n").unwrap();
    let error = open(folder.path()).unwrap_err();
    assert!(error.contains("not a rosbag2 description"), "{error}");
}

#[test]
fn other_serializations_are_refused_on_both_paths() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag_0.db3");
    std::fs::write(&path, db3(&drive(10))).unwrap();
    let topic = "  topics_with_message_count:\n    - topic_metadata:\n        name: /odom\n        serialization_format: wrong_format\n";
    metadata(folder.path(), &["bag_0.db3"], topic);
    let error = open(folder.path()).unwrap_err();
    assert!(error.contains("topic `/odom` is serialized as `wrong_format`: only cdr is read"), "{error}");
    rusqlite::Connection::open(&path).unwrap().execute_batch("UPDATE topics SET serialization_format = 'wrong_format'").unwrap();
    let error = open(&path).unwrap_err();
    assert!(error.contains("topic `/odom`: its messages are serialized as `wrong_format`; read are cdr and ros1"), "{error}");
}

#[test]
fn a_write_ahead_log_is_read_and_missed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("live.db3");
    std::fs::write(&path, db3(&drive(20))).unwrap();
    let writer = rusqlite::Connection::open(&path).unwrap();
    // The last two rows are only in the log, as after a crash.
    writer.execute_batch("PRAGMA journal_mode = WAL; PRAGMA wal_autocheckpoint = 0;").unwrap();
    writer.execute_batch("UPDATE messages SET timestamp = timestamp + 1000000000 WHERE timestamp >= 900000000").unwrap();
    let copies = tempfile::tempdir().unwrap();
    let (whole, lone) = (copies.path().join("whole 100%.db3"), copies.path().join("lone.db3"));
    std::fs::copy(&path, &whole).unwrap();
    std::fs::copy(&path, &lone).unwrap();
    std::fs::copy(folder.path().join("live.db3-wal"), copies.path().join("whole 100%.db3-wal")).unwrap();
    drop(writer);
    let recording = open(&whole).unwrap();
    assert!(!recording.warnings.iter().any(|w| w.contains("write-ahead")), "{:?}", recording.warnings);
    // The late log times of the last two rows make the stamps look unreliable, so rows are on log time.
    assert_eq!(recording.time().last(), Some(&1.95));
    let recording = open(&lone).unwrap();
    assert!(
        recording.warnings.iter().any(|w| w.contains("write-ahead mode and its -wal file is not beside it")),
        "{:?}",
        recording.warnings
    );
    assert_eq!(recording.time().last(), Some(&0.95));
}
