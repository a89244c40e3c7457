//! Damaged files of every format that holds its lengths in itself: cut at many places, bytes turned, or nothing but noise.
//! Whatever the bytes, a reader answers with a recording or an error, and does not take memory that the file cannot fill.

use crate::common::open_bytes;
use proptest::prelude::*;
use wheelwright_core::recording::{ReadError, ReadOptions, Recording};

const PARQUET: &[u8] = include_bytes!("../data/pyarrow.parquet");

/// Peak memory that reading a file of some kilobytes may add \[kB\].
const MODERATE: u64 = 200_000;

fn csv() -> Vec<u8> {
    let rows =
        (0..60).map(|k| format!("{},part {},{},\"a, {k}\",{}\n", f64::from(k) * 0.05, k / 20, 0.1 * f64::from(k % 7), 1e-3 * f64::from(k)));
    format!("# damaged on purpose\nt,segment,v,note,extra\n{}", rows.collect::<String>()).into_bytes()
}

fn json() -> Vec<u8> {
    let row = |k: i32, sign: f64| {
        let v = sign * f64::from(k);
        format!("[{}, 12.5, 0.5, {v}, {v}, {v}, {v}, {v}, {v}, 0.25]", f64::from(k) * 0.02 + if sign > 0.0 { 0.0 } else { 5.0 })
    };
    let rows = |sign: f64| (0..30).map(|k| row(k, sign)).collect::<Vec<_>>().join(",\n");
    format!("{{\"slow-forward\": [{}], \"slow-backward\": [{}]}}", rows(1.0), rows(-1.0)).into_bytes()
}

fn wpilog() -> Vec<u8> {
    let mut bytes = b"WPILOG\x00\x01\x00\x00\x00\x00".to_vec();
    let mut record = |entry: u8, stamp: u32, payload: &[u8]| {
        bytes.extend([3 << 4, entry, u8::try_from(payload.len()).unwrap()]);
        bytes.extend(stamp.to_le_bytes());
        bytes.extend(payload);
    };
    for (entry, name) in [(1u8, "left-velocity"), (2, "right-velocity"), (3, "left-voltage"), (4, "right-voltage")] {
        let mut payload = vec![0, entry, 0, 0, 0];
        for text in [name, "double", ""] {
            payload.extend(u32::try_from(text.len()).unwrap().to_le_bytes());
            payload.extend(text.bytes());
        }
        record(0, 1, &payload);
    }
    for k in 0..40u32 {
        for entry in 1..=4 {
            record(entry, 20_000 * k, &f64::from(k).to_le_bytes());
        }
    }
    bytes
}

fn formats() -> [(&'static str, Vec<u8>); 4] {
    [("csv", csv()), ("json", json()), ("wpilog", wpilog()), ("parquet", PARQUET.to_vec())]
}

/// A recording keeps its promises, and an error says something.
fn check(result: Result<Recording, ReadError>, of: &str) {
    match result {
        Ok(read) => {
            assert!(read.rows() >= 2, "{of}");
            assert!(read.columns().iter().all(|c| c.values.len() == read.rows() && c.values.iter().all(|v| v.is_finite())), "{of}");
        }
        Err(error) => assert!(error.to_string().len() > 10, "{of}: {error}"),
    }
}

/// Peak memory of this process \[kB\], where the system tells.
fn peak() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?.trim().trim_end_matches(" kB").parse().ok()
}

#[test]
fn whole_files_are_read() {
    for (name, bytes) in formats() {
        let read = open_bytes(&bytes, &ReadOptions::default()).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(read.rows() >= 40, "{name}");
    }
}

#[test]
fn files_cut_anywhere_are_read_as_far_as_whole_or_refused() {
    for (name, bytes) in formats() {
        let mut rows = 0;
        for cut in (0..bytes.len()).step_by(bytes.len() / 200) {
            let result = open_bytes(&bytes[..cut], &ReadOptions::default());
            if let Ok(read) = &result {
                assert!(read.rows() >= rows, "{name}: {} rows at {cut} bytes after {rows} at fewer", read.rows());
                rows = read.rows();
            }
            check(result, &format!("{name} cut at {cut}"));
        }
        let salvaged = name != "parquet";
        assert_eq!(rows > 30, salvaged, "{name}: {rows} rows of a file cut short");
    }
}

#[test]
fn false_lengths_take_no_memory() {
    let before = peak();
    let huge = u32::MAX.to_le_bytes();
    for (name, bytes) in formats() {
        for at in (0..bytes.len().saturating_sub(4)).step_by(bytes.len() / 60) {
            let mut claims = bytes.clone();
            claims[at..at + 4].copy_from_slice(&huge);
            check(open_bytes(&claims, &ReadOptions::default()), &format!("{name} with a false length at {at}"));
        }
    }
    if let (Some(before), Some(after)) = (before, peak()) {
        assert!(after - before < MODERATE, "{} kB more at the peak", after - before);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn turned_bytes_are_read_or_refused(turned in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        for (name, mut bytes) in formats() {
            for (at, byte) in &turned {
                let at = at.index(bytes.len());
                bytes[at] = *byte;
            }
            check(open_bytes(&bytes, &ReadOptions::default()), name);
        }
    }

    #[test]
    fn noise_is_read_or_refused(noise in proptest::collection::vec(any::<u8>(), 0..400), text in "[ -~\n\t]{0,200}") {
        let heads: [&[u8]; 6] = [b"", b"t,v\n", b"t;v\n0;", b"{\"slow-forward\": [[", b"WPILOG\x00\x01\x00\x00\x00\x00", b"PAR1"];
        for head in heads {
            check(open_bytes(&[head, &noise].concat(), &ReadOptions::default()), "noise");
            check(open_bytes(&[head, text.as_bytes()].concat(), &ReadOptions::default()), "text");
        }
        check(open_bytes(&[b"PAR1", &noise[..], b"PAR1"].concat(), &ReadOptions::default()), "noise");
    }
}
