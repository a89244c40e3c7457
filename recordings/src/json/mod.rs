//! The JSON logs of FIRST Robotics teams: frc-characterization (2018 to 2020) and SysId (2021 to 2023).
//!
//! Both hold tests (`slow-forward`, ...) of rows without column names; the key `sysid` and the row's length say which is
//! which. Every test becomes a segment, in the order of time, and time counts from the first row.

mod document;
mod signs;

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use serde_json::Value;
use wheelwright_core::recording::{ReadError, ReadOptions, Recording, RecordingReader, Segment, list};

use crate::columns::{Plan, Values};
use document::{Log, Test};

/// Texts of which a log holds at least one near its beginning.
const KEYS: [&str; 6] =
    ["\"slow-forward\"", "\"slow-backward\"", "\"fast-forward\"", "\"fast-backward\"", "\"sysid\"", "\"unitsPerRotation\""];

const FRC: [&str; 10] = ["t", "battery", "duty_cmd", "u_left", "u_right", "pos_left", "pos_right", "vel_left", "vel_right", "gyro_angle"];
const DRIVE: [&str; 9] = ["t", "u_left", "u_right", "pos_left", "pos_right", "vel_left", "vel_right", "gyro_angle", "gyro_rate"];
const MECHANISM: [&str; 4] = ["t", "u", "pos", "vel"];

/// Reads frc-characterization and SysId JSON.
pub(crate) struct Json;

/// What the rows of a log are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Shape {
    /// Rows of 10: a drive, with battery and commanded duty cycle.
    Frc,
    /// Rows of 9: a drive.
    SysIdDrive,
    /// Rows of 4: one motor and what it turns or lifts.
    SysIdMechanism,
}

impl RecordingReader for Json {
    fn format(&self) -> &'static str {
        "json"
    }

    fn recognises(&self, _path: &Path, head: &[u8]) -> bool {
        let Some(text) = crate::detect::text(head) else { return false };
        let text = text.trim_start();
        let bare_rows = text.strip_prefix('[').is_some_and(|rest| rest.trim_start().starts_with('['));
        bare_rows || (text.starts_with('{') && KEYS.iter().any(|key| text.contains(key)))
    }

    fn read(&self, path: &Path, options: &ReadOptions) -> Result<Recording, ReadError> {
        let mut log = Log::read(BufReader::new(File::open(path)?))?;
        log.tests.retain(|test| !test.rows.is_empty());
        let shape = Shape::of(&log)?;
        let unit = Unit::of(&log, shape)?;
        log.tests.sort_by(|a, b| a.rows[0][0].total_cmp(&b.rows[0][0]));
        let mut columns = columns(&log.tests, shape.names().len());
        let warnings = convert(&mut columns, &log, shape, &unit);
        let mut recording = assemble(columns, &log.tests, shape, &unit, path, options)?;
        let cut = log.cut.map(|at| format!("{at}: the file ends in the middle of a row or test; what stands before is read"));
        recording.warnings.extend(cut.into_iter().chain(warnings));
        Ok(recording)
    }
}

impl Shape {
    fn of(log: &Log) -> Result<Self, ReadError> {
        let length = row_length(&log.tests)?;
        let refuse = |reason: &str| Err(ReadError::Unsupported { what: format!("rows of {length}"), reason: reason.to_owned() });
        match (log.setting("sysid").is_some(), length) {
            (true, 9) => Ok(Self::SysIdDrive),
            (true, 4) => Ok(Self::SysIdMechanism),
            (true, _) => refuse("SysId logs have rows of 9 (a drive) or 4 (a mechanism)"),
            (false, 10) => match log.setting("test").and_then(Value::as_str) {
                Some(test) if !test.starts_with("Drive") => {
                    refuse(&format!("the test is `{test}`, of a mechanism and not of a drive; convert the log with SysId to rows of 4"))
                }
                _ => Ok(Self::Frc),
            },
            (false, 9) => refuse(
                "without the key `sysid` these may be SysId rows or a 2018 dump with battery and speed first; add \"sysid\": true if they are t, u_left, u_right, pos_left, pos_right, vel_left, vel_right, gyro_angle, gyro_rate",
            ),
            (false, 4) => refuse(
                "without the key `sysid` their columns would be a guess; add \"sysid\": true if they are t, voltage, position, velocity",
            ),
            (false, _) => refuse("frc-characterization logs have rows of 10, SysId logs the key `sysid` and rows of 9 or 4"),
        }
    }

    fn names(self) -> &'static [&'static str] {
        match self {
            Self::Frc => &FRC,
            Self::SysIdDrive => &DRIVE,
            Self::SysIdMechanism => &MECHANISM,
        }
    }

    fn format(self) -> &'static str {
        match self {
            Self::Frc => "frc-characterization JSON",
            Self::SysIdDrive | Self::SysIdMechanism => "SysId JSON",
        }
    }
}

/// The one length of all rows.
fn row_length(tests: &[Test]) -> Result<usize, ReadError> {
    let Some(first) = tests.first() else {
        let reason = "no test holds a row; a log has tests such as `slow-forward`".to_owned();
        return Err(ReadError::Malformed { position: "tests".to_owned(), reason });
    };
    let length = first.rows[0].len();
    for test in tests {
        if let Some(row) = test.rows.iter().position(|row| row.len() != length) {
            let found = test.rows[row].len();
            let reason = format!("{found} numbers where the first row has {length}: rows of unequal length cannot be told apart");
            return Err(ReadError::Malformed { position: place(test, row), reason });
        }
    }
    Ok(length)
}

fn place(test: &Test, row: usize) -> String {
    format!("test `{}`, row {}", test.name, row + 1)
}

/// How positions become metres or radians.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Unit {
    /// SI units in one rotation of the output.
    factor: f64,
    /// Unit of position.
    position: &'static str,
    /// Unit of velocity.
    velocity: &'static str,
    /// False if the file does not say.
    stated: bool,
}

impl Unit {
    fn of(log: &Log, shape: Shape) -> Result<Self, ReadError> {
        let (units, per_rotation) = (log.setting("units"), log.setting("unitsPerRotation"));
        if shape == Shape::Frc && units.is_none() && per_rotation.is_none() {
            return Ok(Self { factor: 1.0, position: "m", velocity: "m/s", stated: false });
        }
        let units = units.and_then(Value::as_str).unwrap_or_default();
        let (si, position, velocity) = match units.to_ascii_lowercase().as_str() {
            "meters" => (1.0, "m", "m/s"),
            "feet" => (0.3048, "m", "m/s"),
            "inches" => (0.0254, "m", "m/s"),
            "radians" => (1.0, "rad", "rad/s"),
            "degrees" => (std::f64::consts::PI / 180.0, "rad", "rad/s"),
            "rotations" => (std::f64::consts::TAU, "rad", "rad/s"),
            _ => return Err(bad_setting("units", log, "Meters, Feet, Inches, Radians, Degrees or Rotations")),
        };
        if shape != Shape::SysIdMechanism && position == "rad" {
            return Err(bad_setting(
                "units",
                log,
                "Meters, Feet or Inches: a drive's wheel speeds in radians say nothing about metres; set unitsPerRotation to the wheel's circumference",
            ));
        }
        // Hand-written exporters store the number as text.
        let number = per_rotation.and_then(|v| v.as_f64().or_else(|| v.as_str()?.parse().ok()));
        match number.filter(|n| n.is_finite() && *n != 0.0) {
            Some(n) => Ok(Self { factor: si * n, position, velocity, stated: true }),
            None => Err(bad_setting("unitsPerRotation", log, "a number other than zero")),
        }
    }
}

fn bad_setting(name: &str, log: &Log, wanted: &str) -> ReadError {
    let found = log.setting(name).map_or_else(|| "is missing".to_owned(), |value| format!("is {value}"));
    ReadError::Malformed { position: format!("key `{name}`"), reason: format!("{found}; it must be {wanted}") }
}

fn columns(tests: &[Test], count: usize) -> Vec<Vec<f64>> {
    (0..count).map(|column| tests.iter().flat_map(|test| test.rows.iter().map(move |row| row[column])).collect()).collect()
}

/// Turns the file's numbers into SI units and forward-positive signs; returns what a user should know about it.
fn convert(columns: &mut [Vec<f64>], log: &Log, shape: Shape, unit: &Unit) -> Vec<String> {
    let start = columns[0][0];
    columns[0].iter_mut().for_each(|t| *t -= start);
    for (name, values) in shape.names().iter().zip(columns.iter_mut()) {
        if name.starts_with("pos") || name.starts_with("vel") {
            values.iter_mut().for_each(|v| *v *= unit.factor);
        }
    }
    let mut warnings = Vec::new();
    if shape == Shape::Frc {
        warnings.extend(signs::make_forward_positive(columns, &log.tests, shape.names()));
    } else {
        for (voltage, velocity) in [("u_left", "vel_left"), ("u_right", "vel_right"), ("u", "vel")] {
            warnings.extend(signs::copy_from_velocity(columns, shape.names(), voltage, velocity));
        }
    }
    if !unit.stated {
        warnings.push("the file does not say its unit of length: positions and velocities are taken as metres and m/s; map them with a scale if they are feet (0.3048)".to_owned());
    }
    warnings
}

fn assemble(
    columns: Vec<Vec<f64>>,
    tests: &[Test],
    shape: Shape,
    unit: &Unit,
    path: &Path,
    options: &ReadOptions,
) -> Result<Recording, ReadError> {
    let names = shape.names();
    let plan = Plan::new(names.iter().map(|&n| n.to_owned()).collect(), options)?;
    let units = names.iter().map(|name| match *name {
        "u" => "V",
        "pos" => unit.position,
        "vel" => unit.velocity,
        _ => "",
    });
    let values = columns.into_iter().zip(units);
    let values = values.map(|(numbers, unit)| Values { numbers, kind: "number".to_owned(), unit: unit.to_owned(), left_out: None });
    let mut segments: Vec<Segment> = Vec::with_capacity(tests.len());
    for test in tests {
        let start = segments.last().map_or(0, |s| s.rows.end);
        segments.push(Segment { label: test.name.clone(), rows: start..start + test.rows.len() });
    }
    let rows_of = segments.clone();
    let locate = move |row: usize| match rows_of.iter().find(|s| s.rows.contains(&(row - 1))) {
        Some(segment) => format!("test `{}`, row {}", segment.label, row - segment.rows.start),
        None => format!("row {row}"),
    };
    plan.assemble(values.collect(), segments, path, shape.format(), &locate)
}

/// The sides whose signs were turned, as a warning.
fn turned(names: &[&str], why: &str) -> Option<String> {
    (!names.is_empty()).then(|| format!("{} turned in sign: {why}", list(names.iter().copied())))
}
