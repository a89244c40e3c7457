//! WPILib data logs.

use crate::common::{map, mapping, open_bytes, open_shared, shared};
use proptest::prelude::*;
use wheelwright_core::recording::ReadOptions;

/// Writes logs as the format's description says, with the shortest lengths.
struct Log(Vec<u8>);

impl Log {
    fn new() -> Self {
        Self([b"WPILOG\x00\x01".as_slice(), &3u32.to_le_bytes(), b"abc"].concat())
    }

    fn record(mut self, entry: u8, stamp: u64, payload: &[u8]) -> Self {
        // One byte of entry, two of size, four of time.
        self.0.extend([(3 << 4) | (1 << 2), entry]);
        self.0.extend(u16::try_from(payload.len()).unwrap().to_le_bytes());
        self.0.extend(u32::try_from(stamp).unwrap().to_le_bytes());
        self.0.extend(payload);
        self
    }

    fn start(self, entry: u8, name: &str, kind: &str, metadata: &str) -> Self {
        let mut payload = vec![0, entry, 0, 0, 0];
        for text in [name, kind, metadata] {
            payload.extend((text.len() as u32).to_le_bytes());
            payload.extend(text.bytes());
        }
        self.record(0, 0, &payload)
    }

    fn number(self, entry: u8, stamp: u64, value: f64) -> Self {
        self.record(entry, stamp, &value.to_le_bytes())
    }

    fn read(&self, options: &ReadOptions) -> Result<wheelwright_core::Recording, wheelwright_core::recording::ReadError> {
        open_bytes(&self.0, options)
    }
}

/// Two wheels at 20 ms, voltages 7 ms after them.
fn drive(names: [&str; 4]) -> Log {
    let mut log = Log::new();
    for (entry, name) in names.iter().enumerate() {
        log = log.start(entry as u8 + 1, name, "double", "");
    }
    for k in 0..10u64 {
        let stamp = 1_000_000 + 20_000 * k;
        log = log.number(1, stamp, k as f64).number(2, stamp + 1_500, -(k as f64));
        log = log.number(3, stamp + 7_000, 10.0 + k as f64).number(4, stamp + 7_000, 20.0 + k as f64);
    }
    log
}

const NAMES: [&str; 4] = ["left-velocity", "right-velocity", "left-voltage", "right-voltage"];

#[test]
fn entries_are_held_on_the_clock_of_the_velocity() {
    let read = drive(NAMES).read(&ReadOptions::default()).unwrap();
    assert_eq!((read.source.format.as_str(), read.clock.source.as_str()), ("wpilog", "log time"));
    // The first row stands before any voltage.
    assert_eq!((read.rows(), read.time()[0]), (9, 1.02));
    assert_eq!(read.column("vel_left").unwrap(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]);
    // 1.5 ms later is the same loop of 20 ms, 7 ms later is not.
    assert_eq!(read.column("vel_right").unwrap()[..2], [-1.0, -2.0]);
    assert_eq!(read.column("u_left").unwrap()[..2], [10.0, 11.0]);
    assert_eq!(read.column("u_right").unwrap()[8], 28.0);
    assert!(read.warnings.iter().any(|w| w.starts_with("no SysId state entry")), "{:?}", read.warnings);
    assert!(read.warnings.iter().any(|w| w.starts_with("1 row(s) stand before")), "{:?}", read.warnings);
    assert!(read.warnings.iter().any(|w| w.starts_with("no entry for `pos_left` and `pos_right`")), "{:?}", read.warnings);
}

#[test]
fn names_are_recognised_by_their_words_and_by_mapping() {
    let words = ["velocity-drive-left-drivetrain", "velocity-drive-right-drivetrain", "/Drive/Left Voltage", "NT:/right volts"];
    assert_eq!(drive(words).read(&ReadOptions::default()).unwrap().columns().len(), 4);
    let unclear = ["left-velocity-a", "left-velocity-b", "left-voltage", "right-voltage"];
    let error = drive(unclear).read(&ReadOptions::default()).unwrap_err().to_string();
    assert!(
        error.contains("`left-velocity-a` and `left-velocity-b` could each be `vel_left`; choose with --map vel_left=ENTRY"),
        "{error}"
    );
    let unknown = ["a", "b", "c", "d"];
    let error = drive(unknown).read(&ReadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("--map vel_left=ENTRY; the numeric entries are `a`, `b`, `c` and `d`"), "{error}");
    let options = mapping(vec![map("v", "a", 0.5, 0.0), map("u_left", "c", 1.0, -10.0)]);
    let read = drive(unknown).read(&options).unwrap();
    assert_eq!(read.column("v").unwrap()[..2], [0.5, 1.0]);
    assert_eq!(read.column("u_left").unwrap()[..2], [0.0, 1.0]);
    assert_eq!(read.streams.iter().map(|s| s.used).collect::<Vec<_>>(), [true, false, true, false]);
    for (maps, expected) in [
        (vec![map("v", "e", 1.0, 0.0)], "mapping v=e: no such entry; the numeric entries are `a`"),
        (vec![map("t", "a", 1.0, 0.0)], "mapping t=a: a log's time is its records' stamps"),
        (vec![map("segment", "a", 1.0, 0.0)], "mapping segment=a: no such string entry"),
    ] {
        let error = drive(unknown).read(&mapping(maps)).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn tests_become_segments_and_the_rest_is_dropped() {
    let mut log = drive(NAMES).start(9, "sysid-test-state-drive", "string", "");
    // The state is written again in every loop, as SysId does.
    for (stamp, state) in
        [(0, "none"), (1_030_000, "dynamic-forward"), (1_050_000, "dynamic-forward"), (1_090_000, "none"), (1_130_000, "dynamic-reverse")]
    {
        log = log.record(9, stamp, state.as_bytes());
    }
    let read = log.read(&ReadOptions::default()).unwrap();
    let found: Vec<_> = read.segments().iter().map(|s| (s.label.as_str(), s.rows.clone())).collect();
    assert_eq!(found, [("dynamic-forward", 0..3), ("dynamic-reverse", 3..6)]);
    assert_eq!(read.time(), [1.04, 1.06, 1.08, 1.14, 1.16, 1.18]);
}

#[test]
fn broken_logs_say_where() {
    let turned_back = drive(NAMES).number(1, 1_000_000, 0.0);
    let cases = [
        (turned_back.0, "entry `left-velocity`: time goes back from 1.18 s to 1 s"),
        (drive(NAMES).number(1, 1_200_000, f64::NAN).number(3, 1_200_000, 0.0).0, "row 10 at log time 1.2 s, column `vel_left`: NaN"),
        (drive(NAMES).record(1, 1_200_000, b"abc").0, "entry `left-velocity` holds 3 bytes, which is no double"),
        (drive(NAMES).record(0, 0, &[0, 1]).0, "a control record that makes no sense"),
        (b"WPILOG\x00\x02\x00\x00\x00\x00".to_vec(), "WPILOG version 2.0: version 1 is read"),
        (b"WPILOG\x00\x01\xff\xff\xff\xff".to_vec(), "byte 0: the file ends in its header"),
        (b"WPILOG".to_vec(), "byte 0: the file ends in its header"),
        (Log::new().0, "entries: none is named like `left-velocity`"),
        (drive(NAMES).0.iter().copied().take(200).collect(), "entries: none is named"),
    ];
    for (bytes, expected) in cases {
        let error = open_bytes(&bytes, &ReadOptions::default()).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}\n  not {expected}");
    }
    let still = Log::new().start(1, "left-velocity", "double", "").number(1, 0, 0.0).number(1, 20_000, 0.0);
    assert!(still.read(&ReadOptions::default()).unwrap_err().to_string().contains("no motion"));
}

#[test]
fn cut_logs_and_false_lengths_give_what_is_whole() {
    let whole = drive(NAMES);
    let cut = open_bytes(&whole.0[..whole.0.len() - 5], &ReadOptions::default()).unwrap();
    assert_eq!(cut.rows(), 9);
    assert!(cut.warnings.contains(&"the file ends in the middle of a record; what stands before is read".to_owned()), "{:?}", cut.warnings);
    // A record of an entry that nobody wants claims 4 GB.
    let mut claims = drive(NAMES).start(9, "other", "double", "").0;
    claims.extend([3 << 2, 9, 0xff, 0xff, 0xff, 0xff, 0]);
    assert_eq!(open_bytes(&claims, &ReadOptions::default()).unwrap().rows(), 9);
    claims.truncate(claims.len() - 6);
    claims.extend([1, 0xff, 0xff, 0xff, 0xff, 0]);
    let error = open_bytes(&claims, &ReadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("a record of 4294967295 bytes where a name, a state or a number is due"), "{error}");
    let mut filled = drive(NAMES).0;
    filled.extend([0; 64]);
    assert!(open_bytes(&filled, &ReadOptions::default()).unwrap().warnings.iter().any(|w| w.contains("only filling")));
}

#[test]
fn units_stated_in_the_log_are_heeded() {
    let log = Log::new().start(1, "left-velocity", "float", "Rotation per Second");
    let log = log.record(1, 0, &0f32.to_le_bytes()).record(1, 20_000, &1.5f32.to_le_bytes());
    let read = log.read(&ReadOptions::default()).unwrap();
    assert_eq!(read.column("vel_left").unwrap(), [0.0, 1.5]);
    assert!(read.warnings.iter().any(|w| w.contains("is logged in `Rotation per Second` and taken as metres")), "{:?}", read.warnings);
}

/// A log of WPILib's own writer: v(k+1) = v(k) + (0.4 u(k+1) − v(k)) 0.02 / 0.3, x(k+1) = x(k) + 0.02 v(k+1).
#[test]
fn the_log_of_the_official_writer_holds_its_stated_values() {
    let Some(shared) = shared() else { return };
    let read = open_shared(&shared, "bags/sysid.wpilog");
    let labels: Vec<_> = read.segments().iter().map(|s| (s.label.as_str(), s.rows.len())).collect();
    assert_eq!(labels, [("quasistatic-forward", 100), ("quasistatic-reverse", 100), ("dynamic-forward", 100), ("dynamic-reverse", 100)]);
    assert_eq!(read.warnings, [""; 0]);
    for segment in read.segments() {
        let sign = if segment.label.ends_with("forward") { 1.0 } else { -1.0 };
        let rows = segment.rows.clone();
        let column = |name: &str| &read.column(name).unwrap()[rows.clone()];
        let mut v = column("vel_left")[0];
        for k in 0..100 {
            let u = if segment.label.starts_with("quasi") { sign * 0.05 * k as f64 } else { sign * 4.0 };
            assert!((column("u_left")[k] - u).abs() < 1e-12, "{} {k}", segment.label);
            if k > 0 {
                v += (0.4 * u - v) * 0.02 / 0.3;
            }
            assert!((column("vel_left")[k] - v).abs() < 1e-12, "{} {k}", segment.label);
            assert_eq!(column("vel_right")[k], column("vel_left")[k]);
            assert_eq!(column("u_right")[k], column("u_left")[k]);
        }
        assert!((read.time()[rows.start + 1] - read.time()[rows.start] - 0.02).abs() < 1e-12);
    }
    assert!(read.column("gyro_angle").unwrap().iter().all(|g| *g == 0.0));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn no_damage_panics(cut in 0usize..2000, at in 0usize..2000, byte in any::<u8>(), tail in proptest::collection::vec(any::<u8>(), 0..200)) {
        let whole = drive(NAMES).0;
        let _ = open_bytes(&whole[..cut % whole.len()], &Default::default());
        let mut flipped = whole.clone();
        flipped[at % whole.len()] = byte;
        let _ = open_bytes(&flipped, &Default::default());
        let mut random = b"WPILOG\x00\x01\x00\x00\x00\x00".to_vec();
        random.extend(tail);
        let _ = open_bytes(&random, &Default::default());
    }
}
