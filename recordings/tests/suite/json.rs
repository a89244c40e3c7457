//! frc-characterization and SysId JSON.

use crate::common::{map, mapping, open_bytes, open_shared, open_text, refusal, shared};
use proptest::prelude::*;

/// A log of the four tests, `rows` each, made row by row from (test sign, seconds, row number).
fn log(settings: &str, rows: usize, row: impl Fn(f64, f64, usize) -> Vec<f64>) -> String {
    let tests = ["fast-backward", "fast-forward", "slow-backward", "slow-forward"].iter().zip([3, 2, 1, 0]).map(|(name, order)| {
        let sign = if name.ends_with("forward") { 1.0 } else { -1.0 };
        let rows = (0..rows).map(|k| {
            let t = 100.0 + f64::from(order) * 10.0 + k as f64 * 0.02;
            let cells = row(sign, t, k).iter().map(|x| format!("{x:?}")).collect::<Vec<_>>().join(", ");
            format!("[{cells}]")
        });
        format!("\"{name}\": [{}]", rows.collect::<Vec<_>>().join(",\n"))
    });
    format!("{{{settings}{}}}", tests.collect::<Vec<_>>().join(",\n"))
}

fn drive_row(sign: f64, t: f64, k: usize) -> Vec<f64> {
    let speed = sign * k as f64 * 0.1;
    // The right motor is mounted mirrored: its voltage is logged with the wrong sign.
    vec![t, sign * k as f64, -sign * k as f64, 2.0 * speed, 3.0 * speed, speed, 0.5 * speed, 0.25, -0.5]
}

const DRIVE: &str = "\"sysid\": true, \"test\": \"Drivetrain\", \"units\": \"Feet\", \"unitsPerRotation\": 2.0, ";

#[test]
fn a_sysid_drive_is_read_in_si_units_and_order_of_time() {
    let read = open_text(&log(DRIVE, 5, drive_row)).unwrap();
    assert_eq!(read.source.format, "SysId JSON");
    let labels: Vec<_> = read.segments().iter().map(|s| s.label.as_str()).collect();
    assert_eq!(labels, ["slow-forward", "slow-backward", "fast-forward", "fast-backward"]);
    assert_eq!((read.time()[0], read.rows()), (0.0, 20));
    assert!((read.time()[5] - 10.0).abs() < 1e-9);
    let feet = 2.0 * 0.3048;
    for (name, factor) in [("vel_left", feet), ("vel_right", 0.5 * feet), ("pos_left", 2.0 * feet), ("pos_right", 3.0 * feet)] {
        let values = read.column(name).unwrap();
        assert!((values[4] - 0.4 * factor).abs() < 1e-12 && (values[9] + 0.4 * factor).abs() < 1e-12, "{name}: {values:?}");
    }
    for name in ["u_left", "u_right"] {
        assert_eq!(read.column(name).unwrap()[..10], [0.0, 1.0, 2.0, 3.0, 4.0, -0.0, -1.0, -2.0, -3.0, -4.0], "{name}");
    }
    assert_eq!((read.column("gyro_angle").unwrap()[3], read.column("gyro_rate").unwrap()[3]), (0.25, -0.5));
    assert_eq!(read.warnings, ["`u_right` turned in sign: 16 row(s) had another sign than the velocity"]);
}

#[test]
fn a_mechanism_has_one_voltage_and_its_own_units() {
    let row = |sign: f64, t: f64, k: usize| vec![t, sign * k as f64, sign * 0.5, sign * k as f64 * 0.25];
    let settings = "\"sysid\": true, \"test\": \"Simple\", \"units\": \"Rotations\", \"unitsPerRotation\": \"1.0\", ";
    let read = open_text(&log(settings, 4, row)).unwrap();
    let columns: Vec<_> = read.columns().iter().map(|c| (c.name.as_str(), c.unit.as_str())).collect();
    assert_eq!(columns, [("u", "V"), ("pos", "rad"), ("vel", "rad/s")]);
    assert!((read.column("vel").unwrap()[2] - std::f64::consts::PI).abs() < 1e-12);
}

#[test]
fn what_is_ambiguous_is_refused() {
    let frc = |_: f64, t: f64, k: usize| vec![t, 12.0, 0.0, 1.0, 1.0, 0.0, 0.0, k as f64, k as f64, 0.0];
    let of_length = |length: usize| log("", 2, move |_, t, k| (0..length).map(|i| if i == 0 { t } else { k as f64 }).collect());
    let sysid = |length: usize| log(DRIVE, 2, move |_, t, k| (0..length).map(|i| if i == 0 { t } else { k as f64 }).collect());
    let cases = [
        (of_length(9), "rows of 9: without the key `sysid` these may be"),
        (of_length(4), "rows of 4: without the key `sysid`"),
        (of_length(7), "rows of 7: frc-characterization logs have rows of 10"),
        (sysid(10), "rows of 10: SysId logs have rows of 9 (a drive) or 4"),
        (sysid(3), "rows of 3: SysId logs"),
        (log(&DRIVE.replace("Feet", "Radians"), 3, drive_row), "key `units`: is \"Radians\"; it must be Meters, Feet or Inches"),
        (log(&DRIVE.replace("Feet", "Cubits"), 3, drive_row), "key `units`: is \"Cubits\"; it must be Meters"),
        (log(&DRIVE.replace("2.0", "0"), 3, drive_row), "key `unitsPerRotation`: is 0; it must be a number other than zero"),
        (log("\"sysid\": true, \"units\": \"Feet\", ", 3, drive_row), "key `unitsPerRotation`: is missing"),
        (log("\"test\": \"Elevator\", ", 2, frc), "rows of 10: the test is `Elevator`, of a mechanism and not of a drive"),
        (log("", 2, frc).replace("12.0", "null"), "line 1, column 31: invalid type: null, expected f64"),
        (log("", 2, frc).replace("12.0", "NaN"), "line 1, column"),
        ("{\"slow-forward\": []}".to_owned(), "no test holds a row"),
        ("[[0, 1, 2, 3, 4, 5, 6, 7, 8]]".to_owned(), "not bare rows"),
        ("{\"a\": [1]}".to_owned(), "JSON or similar, without the keys"),
        (log("", 3, |s, t, k| frc(s, t - 0.1 * k as f64, k)), "test `slow-forward`, row 2: time goes back"),
        (log("", 3, |s, t, _| frc(s, t, 0)), "no motion: `vel_left` and `vel_right` never change"),
    ];
    for (text, expected) in cases {
        let found = refusal(&text);
        assert!(found.contains(expected), "{found}\n  not {expected}");
    }
}

#[test]
fn unequal_rows_are_refused_at_their_place() {
    let text = log(DRIVE, 3, |sign, t, k| if t > 129.0 && k == 1 { vec![t, 1.0] } else { drive_row(sign, t, k) });
    assert!(refusal(&text).contains("test `fast-backward`, row 2: 2 numbers where the first row has 9"), "{}", refusal(&text));
}

#[test]
fn a_log_cut_short_gives_its_whole_rows() {
    let text = log(DRIVE, 50, drive_row);
    let cut = &text[..text.len() * 2 / 3];
    let read = open_text(cut).unwrap();
    assert!((120..150).contains(&read.rows()), "{}", read.rows());
    assert!(read.warnings[0].contains("the file ends in the middle"), "{:?}", read.warnings);
}

#[test]
fn mappings_apply_to_the_named_columns() {
    let options = mapping(vec![map("vel_left", "vel_left", 0.3048, 0.0), map("vel_right", "vel_right", 0.3048, 0.0)]);
    let text = log(DRIVE, 5, drive_row);
    let (plain, scaled) = (open_text(&text).unwrap(), open_bytes(text.as_bytes(), &options).unwrap());
    assert!((scaled.column("vel_left").unwrap()[4] / plain.column("vel_left").unwrap()[4] - 0.3048).abs() < 1e-12);
}

#[test]
fn a_characterization_log_with_units_is_scaled_and_turned() {
    let frc = |s: f64, t: f64, k: usize| vec![t, 12.0, 0.5, s, -s, -s, s, -s * k as f64, s * k as f64, 0.0];
    let plain = open_text(&log("", 4, frc)).unwrap();
    assert_eq!(plain.column("vel_left").unwrap()[..8], [0.0, 1.0, 2.0, 3.0, 0.0, -1.0, -2.0, -3.0]);
    assert_eq!((plain.column("u_right").unwrap()[1], plain.column("pos_left").unwrap()[1]), (1.0, 1.0));
    assert!(plain.warnings[0].starts_with("`pos_left`, `vel_left` and `u_right` turned in sign"), "{:?}", plain.warnings);
    assert!(plain.warnings[1].starts_with("the file does not say its unit of length"), "{:?}", plain.warnings);
    let scaled = open_text(&log("\"test\": \"Drivetrain\", \"units\": \"Inches\", \"unitsPerRotation\": 10, ", 4, frc)).unwrap();
    assert!((scaled.column("vel_left").unwrap()[3] - 0.762).abs() < 1e-12);
    assert_eq!(scaled.warnings.len(), 1, "{:?}", scaled.warnings);
}

/// The CSV of these recordings is rounded to five decimals, so equal numbers are at most half a unit of the fifth apart.
#[test]
fn raw_logs_equal_the_csv_made_from_them() {
    let Some(shared) = shared() else { return };
    for (raw, csv) in [("CarterIsChaotic20200214-1926", "carter"), ("Piperservant20200206-1721", "piperservant")] {
        let json = open_shared(&shared, &format!("recordings/frc5024/raw/{raw}.json"));
        let csv = open_shared(&shared, &format!("recordings/frc5024/{csv}.csv"));
        assert_eq!(json.source.format, "frc-characterization JSON");
        assert_eq!(json.segments(), csv.segments());
        let names = |r: &wheelwright_core::Recording| r.columns().iter().map(|c| c.name.clone()).collect::<Vec<_>>();
        assert_eq!(names(&json), names(&csv));
        let close = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 5.001e-6);
        assert!(close(json.time(), csv.time()), "{raw}: time");
        for (a, b) in json.columns().iter().zip(csv.columns()) {
            assert!(close(&a.values, &b.values), "{raw}: {}", a.name);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn no_damage_panics(cut in 0usize..4000, at in 0usize..4000, byte in any::<u8>()) {
        let mut bytes = log(DRIVE, 12, drive_row).into_bytes();
        let _ = open_bytes(&bytes[..cut.min(bytes.len())], &Default::default());
        let at = at % bytes.len();
        bytes[at] = byte;
        let _ = open_bytes(&bytes, &Default::default());
    }
}
