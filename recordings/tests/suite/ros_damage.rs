//! Damaged and hostile bags: cut at any byte, with bytes flipped, or made of noise, they end in an error or a warning, never
//! in a panic, a hang or a large allocation. And: what is written is read back.

use crate::ros_files;

use std::path::Path;

use proptest::prelude::*;
use ros_files::{bag1, db3, drive, recording};
use wheelwright_core::recording::{Column, ReadOptions, Recording, Source};

fn open(path: &Path) -> Result<Recording, String> {
    wheelwright_recordings::open(path, &ReadOptions::default()).map_err(|e| e.to_string())
}

fn open_bytes(name: &str, bytes: &[u8]) -> Result<Recording, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    open(&path)
}

fn mcap(rows: usize) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    wheelwright_recordings::write_mcap(&path, &recording(rows)).unwrap();
    std::fs::read(path).unwrap()
}

/// The MCAP file with chunks as they are, by the writer of the `mcap` crate.
fn plain_mcap(rows: usize) -> Vec<u8> {
    ros_files::mcap(&drive(rows), None)
}

#[test]
fn what_is_written_is_read_back() {
    let written = recording(50);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    wheelwright_recordings::write_mcap(&path, &written).unwrap();
    let read = open(&path).unwrap();
    assert_eq!(read.time(), written.time());
    for name in ["v", "omega", "v_ref", "omega_ref", "x", "y"] {
        assert_eq!(read.column(name).unwrap(), written.column(name).unwrap(), "{name}");
    }
    for (found, expected) in read.column("phi").unwrap().iter().zip(written.column("phi").unwrap()) {
        assert!((found - expected).abs() < 1e-14, "{found} {expected}");
    }
    assert_eq!(read.clock.offset_s, Some(0.0));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left");
    std::fs::write(folder.path().join("plain"), b"").unwrap();
    let permissions = |p: &Path| std::fs::metadata(p).unwrap().permissions();
    assert_eq!(permissions(&path), permissions(&folder.path().join("plain")));
}

#[test]
fn what_an_mcap_file_cannot_hold_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let column = |name: &str| Column::new(name, vec![0.0, 1.0, 2.0, 3.0]);
    let build = |time: [f64; 4], names: [&str; 2]| {
        let labels = ["a", "a", "b", "b"].map(str::to_owned);
        Recording::new(Source::default(), time.to_vec(), names.map(column).to_vec(), Some(&labels)).unwrap()
    };
    let refused = |recording: &Recording| wheelwright_recordings::write_mcap(&path, recording).unwrap_err().to_string();
    let error = refused(&build([0.0, 1.0, 0.5, 1.5], ["v", "omega"]));
    assert!(error.contains("segment `b` begins at 0.5 s, not after the 1 s"), "{error}");
    let error = refused(&build([0.0, 1e-10, 2.0, 3.0], ["v", "omega"]));
    assert!(error.contains("rows 1 and 2 fall on one nanosecond"), "{error}");
    let error = refused(&build([0.0, 1.0, 2.0, 3e9], ["v", "omega"]));
    assert!(error.contains("time 3000000000 s cannot be a ROS stamp"), "{error}");
    let error = refused(&build([0.0, 1.0, 2.0, 3.0], ["u_left", "u_right"]));
    assert!(error.contains("no column `v`"), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    // Times before zero are shifted by whole seconds; odometry alone is written alone.
    wheelwright_recordings::write_mcap(&path, &build([-0.25, 0.5, 1.0, 1.5], ["v", "omega"])).unwrap();
    let read = open(&path).unwrap();
    assert_eq!(read.time(), [0.75, 1.5, 2.0, 2.5]);
    assert_eq!(read.streams.len(), 1);
}

#[test]
fn every_container_of_the_tests_is_whole_to_begin_with() {
    let expected = recording(40);
    for (name, bytes) in [
        ("mcap", plain_mcap(40)),
        ("zstd", mcap(40)),
        ("bag", bag1(&drive(40), "none")),
        ("lz4", bag1(&drive(40), "lz4")),
        ("bz2", bag1(&drive(40), "bz2")),
        ("db3", db3(&drive(40))),
    ] {
        let read = open_bytes(name, &bytes).unwrap();
        assert_eq!(read.time(), expected.time(), "{name}");
        assert_eq!(read.column("v").unwrap(), expected.column("v").unwrap(), "{name}");
        assert_eq!(read.column("v_ref").unwrap(), expected.column("v_ref").unwrap(), "{name}");
        assert!(read.warnings.is_empty(), "{name}: {:?}", read.warnings);
    }
}

#[test]
fn a_file_cut_anywhere_gives_what_is_whole_with_a_warning() {
    let whole = recording(40);
    for (name, bytes) in
        [("mcap", plain_mcap(40)), ("bag", bag1(&drive(40), "none")), ("lz4", bag1(&drive(40), "lz4")), ("db3", db3(&drive(40)))]
    {
        let mut read = 0;
        for cut in (0..bytes.len()).step_by(97) {
            let Ok(recording) = open_bytes(name, &bytes[..cut]) else { continue };
            read += 1;
            let rows = recording.rows();
            assert!(rows <= 40, "{name} cut at {cut}");
            assert_eq!(recording.column("v").unwrap(), &whole.column("v").unwrap()[..rows], "{name} cut at {cut}");
            assert!(rows == 40 || !recording.warnings.is_empty(), "{name} cut at {cut} of {} without a warning", bytes.len());
        }
        assert!(read > 5, "{name}: {read}");
    }
}

#[test]
fn a_flipped_byte_in_a_chunk_never_changes_a_value_unnoticed() {
    let bytes = plain_mcap(40);
    let whole = open_bytes("a", &bytes).unwrap();
    for at in (0..bytes.len()).step_by(53) {
        let mut flipped = bytes.clone();
        flipped[at] ^= 0x10;
        if let Ok(read) = open_bytes("a", &flipped) {
            let same = read.columns() == whole.columns() && read.time() == whole.time();
            assert!(same || !read.warnings.is_empty(), "byte {at} changed the data without a warning");
        }
    }
}

#[test]
fn claimed_lengths_are_not_believed() {
    let huge = 10_000_000_000u64.to_le_bytes();
    let record = |opcode: u8| [b"\x89MCAP0\r\n".as_slice(), &[opcode], &huge, &[0; 40]].concat();
    for opcode in [1, 3, 4, 5, 6, 9] {
        let error = open_bytes("a", &record(opcode)).unwrap_err();
        assert!(error.contains("byte") || error.contains("no topics"), "{opcode}: {error}");
    }
    let error = open_bytes("a", &record(3)).unwrap_err();
    assert!(error.contains("byte 8: a definition that claims to be 10000000000 bytes long"), "{error}");
    let bag = [b"#ROSBAG V2.0\n".as_slice(), &[0xff, 0xff, 0xff, 0xff], &[0; 40]].concat();
    let error = open_bytes("a", &bag).unwrap_err();
    assert!(error.contains("a record header that claims to be 4294967295 bytes long"), "{error}");
}

#[test]
fn a_record_longer_than_its_uncompressed_chunk_is_damage_not_a_panic() {
    let mut bytes = plain_mcap(3);
    // The first message record inside the chunk: opcode 5 and the length of a Twist message.
    let length = (22u64 + 52).to_le_bytes();
    let at = bytes.windows(9).position(|w| w[0] == 5 && w[1..] == length).unwrap();
    bytes[at + 1..at + 9].copy_from_slice(&100_000u64.to_le_bytes());
    let error = open_bytes("a", &bytes).unwrap_err();
    assert!(error.contains("nothing to identify from"), "{error}");
}

#[test]
fn other_databases_and_frames_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other.db");
    rusqlite::Connection::open(&path).unwrap().execute_batch("CREATE TABLE songs (name); CREATE VIEW messages AS SELECT 1;").unwrap();
    let error = open(&path).unwrap_err();
    assert!(error.contains("an SQLite database without the tables `topics` and `messages`"), "{error}");
    let frame = zstd::stream::encode_all(b"hello".as_slice(), 1).unwrap();
    assert!(open_bytes("a.zstd", &frame).unwrap_err().contains("zstd-compressed data"));
}

#[test]
fn compressed_files_are_read_also_when_cut() {
    for (name, bytes) in [("a.mcap.zstd", plain_mcap(40)), ("a.db3.zstd", db3(&drive(40))), ("a.bag.zstd", bag1(&drive(40), "none"))] {
        let frame = zstd::stream::encode_all(bytes.as_slice(), 1).unwrap();
        assert_eq!(open_bytes(name, &frame).unwrap().rows(), 40, "{name}");
        for cut in (0..frame.len()).step_by(211) {
            let _any = open_bytes(name, &frame[..cut]);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn noise_behind_a_magic_does_no_harm(kind in 0usize..5, noise in prop::collection::vec(any::<u8>(), 0..600)) {
        let magic: [&[u8]; 5] = [b"\x89MCAP0\r\n", b"#ROSBAG V2.0\n", b"SQLite format 3\0", b"\x28\xb5\x2f\xfd", b"\x89MCAP0\r\n\x06"];
        let _any = open_bytes("noise", &[magic[kind], &noise].concat());
    }

    #[test]
    fn flipped_bytes_do_no_harm(kind in 0usize..5, flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        let mut bytes = match kind {
            0 => plain_mcap(20),
            1 => bag1(&drive(20), "none"),
            2 => bag1(&drive(20), "bz2"),
            3 => db3(&drive(20)),
            _ => mcap(20),
        };
        for (index, value) in flips {
            let at = index.index(bytes.len());
            bytes[at] = value;
        }
        let _any = open_bytes("flipped", &bytes);
    }
}
