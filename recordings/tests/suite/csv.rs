//! CSV as users have it: every dialect that is read, every fault that is refused, and the real recordings.

use crate::common::{map, mapping, open_bytes, open_shared, open_text, refusal, shared};
use proptest::prelude::*;
use wheelwright_core::recording::{Column, ReadOptions, Recording, Source};
use wheelwright_recordings::write_csv;

#[test]
fn dialects_read_alike() {
    let texts = [
        "t,v_ref,v\n0,1,0\n0.05,1,0.5\n0.1,1,0.75\n",
        "t;v_ref;v\r\n0;1;0\r\n0.05;1;0.5\r\n0.1;1;0.75\r\n",
        "t\tv_ref\tv\n0\t1\t0\n0.05\t1\t0.5\n0.1\t1\t0.75",
        "\u{feff}# logger 3\n\nt,v_ref,v\n0,1,0\n# a remark, in between\n\n0.05,1,0.5\n0.1,1,0.75\n\n\n",
        "\"t\",\"v_ref\",v\n\"0\",\"1\",0\n 0.05 , +1 ,5e-1\n0.1,1.0,\"0.75\"\n",
    ];
    let first = open_text(texts[0]).unwrap();
    assert_eq!(first.source.format, "csv");
    assert_eq!(first.clock.source, "column");
    for text in texts {
        let read = open_text(text).unwrap_or_else(|e| panic!("{text:?}: {e}"));
        assert_eq!(read.time(), [0.0, 0.05, 0.1], "{text:?}");
        assert_eq!(read.columns(), first.columns(), "{text:?}");
        assert_eq!(read.warnings, [""; 0], "{text:?}");
    }
}

#[test]
fn segments_by_any_of_three_names() {
    for name in ["segment", "test", "run"] {
        let text = format!("t,{name},v\n0,a,0\n1,a,1\n0,\"b, c\",2\n1,\"b, c\",3\n");
        let read = open_text(&text).unwrap();
        let found: Vec<_> = read.segments().iter().map(|s| (s.label.as_str(), s.rows.clone())).collect();
        assert_eq!(found, [("a", 0..2), ("b, c", 2..4)]);
    }
    let read = open_text("t,segment,test,v\n0,a,7,0\n1,a,8,1\n").unwrap();
    assert_eq!((read.segments().len(), read.column("test").unwrap()), (1, &[7.0, 8.0][..]));
    let options = mapping(vec![map("segment", "trial", 1.0, 0.0)]);
    assert_eq!(open_bytes(b"t,trial,v\n0,slow,0\n1,slower,1\n2,slower,0\n", &options).unwrap().segments().len(), 2);
}

#[test]
fn unknown_columns_are_kept_if_they_are_numbers() {
    let read = open_text("t,v,throttle,note,load,late\n0,0,0.1,hello,1,\n1,1,0.2,\"a,b\",nan,2\n2,0,0.3,,3,3\n").unwrap();
    assert_eq!(read.column("throttle").unwrap(), [0.1, 0.2, 0.3]);
    assert_eq!(read.columns().len(), 2);
    let streams: Vec<_> = read.streams.iter().map(|s| (s.name.as_str(), s.kind.as_str(), s.count, s.used)).collect();
    let expected = [
        ("t", "number", 3, true),
        ("v", "number", 3, true),
        ("throttle", "number", 3, true),
        ("note", "text", 3, false),
        ("load", "number", 3, false),
        ("late", "number", 3, false),
    ];
    assert_eq!(streams, expected);
    assert_eq!(read.warnings.len(), 2, "{:?}", read.warnings);
    assert!(read.warnings[0].starts_with("line 3, column `load`: nan is not a finite number"), "{:?}", read.warnings);
    assert!(read.warnings[1].starts_with("line 2, column `late`: the cell is empty"), "{:?}", read.warnings);
}

#[test]
fn faults_are_refused_at_their_place() {
    let cases = [
        ("time,v\n0,0\n1,1\n", "no column `t`; the file has `time` and `v`. Map another name with --map t=COLUMN"),
        ("t,v\n0,0\n1,\n2,1\n", "line 3, column `v`: the cell is empty"),
        ("t,v\n0,0\n1,NaN\n2,1\n", "line 3, column `v`: NaN is not a finite number"),
        ("t,v\n0,0\n1,-inf\n2,1\n", "line 3, column `v`: -inf is not a finite number"),
        ("t,v\n0,0\n1,nan", "line 3, column `v`: nan is not a finite number"),
        ("t,v\n0,0\n1,1e999\n", "line 3, column `v`: 1e999 is not a finite number"),
        ("t,v\n0,0\n1,fast\n", "line 3, column `v`: `fast` is not a number"),
        ("t,v\n0,0\n\n# so\n1,0x1\n", "line 5, column `v`: `0x1` is not a number"),
        ("t;v\n0;0\n0,5;1\n", "line 3, column `t`: `0,5` has a decimal comma; export the file with a decimal point"),
        ("t,v\n0,0\n0,5,1,0\n", "line 3: 4 field(s) where the header names 2; if numbers have decimal commas"),
        ("t,v\n0,0\n1\n2,1\n", "line 3: 1 field(s) where the header names 2"),
        ("t,v\n0,0\n1,1,1\n", "line 3: 3 field(s) where the header names 2"),
        ("t,v\n0,0\n0.2,1\n0.1,2\n", "line 4: time goes back from 0.2 s to 0.1 s"),
        ("t,v\n# x\n0,0\n1,1\n1,1\n1,1\n2,0\n", "line 4: 3 consecutive rows carry the same time stamp 1 s"),
        ("t,v\n0,1\n1,1\n2,1\n", "no motion: `v` never change"),
        ("t,v\n0,1\n", "1 data row(s): at least two are needed"),
        ("t,v\n", "0 data row(s)"),
        ("t,v", "0 data row(s)"),
        ("t,v,v\n0,1,1\n1,2,2\n", "header, column `v`: two columns have this name"),
        ("t,segment,v\n0,a,1\n1,,2\n", "line 3, column `segment`: the cell is empty"),
        ("t,v\n0,\"1\n1,2\n2,3\n", "line 2: a quote is opened and never closed"),
        ("0,1\n1,2\n", "numbers without a header"),
        ("", "0 bytes"),
    ];
    for (text, expected) in cases {
        let found = refusal(text);
        assert!(found.contains(expected), "{text:?}\n  gives {found}\n  not   {expected}");
    }
}

#[test]
fn a_file_cut_in_its_last_line_gives_what_is_whole() {
    for tail in ["2", "2,", "2,-", "2,1e", "2,\"1"] {
        let read = open_text(&format!("t,v\n0,0\n1,1\n{tail}")).unwrap();
        assert_eq!(read.rows(), 2, "{tail}");
        assert_eq!(read.warnings, ["line 4: the file ends in the middle of this line, which is left out"]);
    }
}

#[test]
fn mappings_rename_scale_and_shift() {
    let text = b"stamp_ms,twist_x,v\n1000,500,9\n1020,-250,9\n1040,0,9\n";
    let options = mapping(vec![map("t", "stamp_ms", 1e-3, -1.0), map("v", "twist_x", 1e-3, 0.0)]);
    let read = open_bytes(text, &options).unwrap();
    assert_eq!(read.column("v").unwrap(), [0.5, -0.25, 0.0]);
    assert!(read.time().iter().zip([0.0, 0.02, 0.04]).all(|(a, b)| (a - b).abs() < 1e-12));
    assert_eq!(read.columns().len(), 1, "the file's own `v` and the mapped originals are gone");
    assert!(read.warnings[0].contains("gives way to the mapping"), "{:?}", read.warnings);
}

#[test]
fn mappings_that_cannot_be_meant_are_refused() {
    let cases = [
        (vec![map("v", "twist_y", 1.0, 0.0)], "mapping v=twist_y: no column `twist_y`; did you mean `twist_x`?"),
        (vec![map("v", "twist_x", 0.0, 0.0)], "mapping v=twist_x: scale = 0"),
        (vec![map("v", "twist_x", f64::NAN, 0.0)], "scale = NaN"),
        (vec![map("v", "twist_x", 1.0, f64::INFINITY)], "offset = inf"),
        (vec![map("v", "twist_x", 1.0, 0.0), map("v", "t", 1.0, 0.0)], "`v` is mapped twice"),
        (vec![map("v", "twist_x", 1000.0, 0.0)], "line 3, column `v`: 200 m/s is faster than any wheeled robot"),
    ];
    for (maps, expected) in cases {
        let error = open_bytes(b"t,twist_x\n0,0\n1,0.2\n2,0.3\n3,0.4\n", &mapping(maps)).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}\n  not {expected}");
    }
}

#[test]
fn units_that_do_not_match_the_command_are_reported() {
    let text = "t,omega_ref,omega\n0,0.1,0\n1,0.5,20\n2,-0.5,-25\n3,0.5,25\n";
    assert!(open_text(text).unwrap().warnings[0].contains("`omega` is"), "57 deg/s are 1 rad/s");
    let text = "t,v\n0,0\n50,1\n100,0\n";
    assert!(open_text(text).unwrap().warnings[0].contains("milliseconds"));
}

#[test]
fn rows_beyond_the_read_buffer_are_read() {
    let mut text = String::from("t,segment,v,note\n");
    for k in 0..80_000 {
        let note = if k % 1000 == 0 { "\"two\nlines\"" } else { "one line of text" };
        text.push_str(&format!("{},part {},{},{note}\n", f64::from(k) * 0.05, k / 10_000, f64::from(k % 7) * 0.125));
    }
    assert!(text.len() > 2 << 20);
    let read = open_text(&text).unwrap();
    assert_eq!((read.rows(), read.segments().len()), (80_000, 8));
    assert!(read.column("v").unwrap().iter().enumerate().all(|(k, v)| *v == (k % 7) as f64 * 0.125));
    // 80 of the notes hold a line break, so the fault on row 80 000 stands 80 lines further down.
    let error = refusal(&text.replace("\n3999.95", "\nx3999.95"));
    assert!(error.starts_with("line 80081, column `t`"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn written_recordings_read_back_to_the_bit(
        values in proptest::collection::vec((-1e3f64..1e3, -90.0f64..90.0), 3..40),
        label in "[a-z ,\"#;]{1,6}",
    ) {
        let labels: Vec<String> = (0..values.len()).map(|k| if k < 2 { "first".to_owned() } else { format!("x{label}x") }).collect();
        let mut t = 0.0;
        let time: Vec<f64> = values.iter().map(|_| { t += 0.05 + t * 1e-3; t }).collect();
        let columns = vec![Column::new("v", values.iter().map(|v| v.1).collect()), Column::new("odd, name", values.iter().map(|v| v.0).collect())];
        let recording = Recording::new(Source::default(), time, columns, Some(&labels)).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.csv");
        write_csv(&path, &recording).unwrap();
        let read = wheelwright_recordings::open(&path, &ReadOptions::default()).unwrap();
        prop_assert_eq!(read.time(), recording.time());
        prop_assert_eq!(read.columns(), recording.columns());
        prop_assert_eq!(read.segments(), recording.segments());
        prop_assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left");
    }
}

#[cfg(unix)]
#[test]
fn a_written_file_is_readable_like_any_other() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let mode = |name: &str| std::fs::metadata(folder.path().join(name)).unwrap().permissions().mode();
    std::fs::write(folder.path().join("other"), "").unwrap();
    write_csv(&folder.path().join("run.csv"), &open_text("t,v\n0,0\n1,1\n").unwrap()).unwrap();
    assert_eq!(mode("run.csv"), mode("other"));
}

#[test]
fn the_real_recordings_are_read_whole() {
    let Some(shared) = shared() else { return };
    // rows, segments, columns as counted by pandas: len(df), (label != label.shift()).sum(), numeric columns without t and label.
    let cases = [
        ("dart/throttle_steps.csv", 2398, 15, 7),
        ("frc5024/carter.csv", 2571, 5, 9),
        ("frc5024/minibot.csv", 3945, 5, 9),
        ("frc5024/minibot_carpet.csv", 4478, 5, 9),
        ("frc5024/piperservant.csv", 2425, 5, 9),
        ("husky/steps.csv", 24120, 17, 16),
        ("ucar/steps.csv", 4074, 1, 9),
        ("warthog/asphalt.csv", 12000, 26, 16),
        ("warthog/ice.csv", 12000, 20, 16),
        ("warthog/sand.csv", 12000, 32, 16),
    ];
    for (name, rows, segments, columns) in cases {
        let read = open_shared(&shared.join("recordings"), name);
        assert_eq!((read.rows(), read.segments().len(), read.columns().len()), (rows, segments, columns), "{name}");
        assert_eq!(read.warnings, [""; 0], "{name}");
    }
}
