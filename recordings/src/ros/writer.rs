//! Writes a recording as MCAP: Twist on `/cmd_vel`, Odometry on `/odom`, as a ROS 2 recorder would.
//!
//! A row's command holds from the row's time on, so it is logged at that time, and the odometry with it: reading the file
//! back gives the same rows.

use std::collections::BTreeMap;
use std::io::{BufWriter, Seek, Write};
use std::path::Path;

use mcap::records::MessageHeader;
use thiserror::Error;
use wheelwright_core::recording::{Recording, RecordingError};

use super::definitions;
use crate::beside::file_beside;

/// Why a recording was not written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WriteError {
    /// The operating system refused.
    #[error("{0}")]
    Io(#[from] std::io::Error),
    /// The MCAP writer refused.
    #[error("MCAP: {0}")]
    Mcap(#[from] mcap::McapError),
    /// The recording has neither `v` and `omega` nor `v_ref` and `omega_ref`.
    #[error(transparent)]
    Columns(#[from] RecordingError),
    /// Segments overlap in time, which messages of one topic cannot.
    #[error(
        "segment `{segment}` begins at {start} s, not after the {end} s at which the one before ends: an MCAP file has one clock; write CSV, or one file a segment"
    )]
    Overlap {
        /// Label of the later segment.
        segment: String,
        /// Its first time \[s\].
        start: f64,
        /// Last time of the segment before \[s\].
        end: f64,
    },
    /// A time that a ROS stamp cannot hold.
    #[error("time {time} s cannot be a ROS stamp, which holds 0 s to 2147483647 s")]
    Time {
        /// The time \[s\].
        time: f64,
    },
    /// Two rows fall on one nanosecond.
    #[error("rows {row} and {next} fall on one nanosecond, the resolution of ROS stamps", next = row + 1)]
    TooDense {
        /// Data row from 1 of the first of the two.
        row: usize,
    },
}

/// Writes `v_ref`, `omega_ref` as `geometry_msgs/msg/Twist` on `/cmd_vel` and `v`, `omega`, `x`, `y`, `phi` as
/// `nav_msgs/msg/Odometry` on `/odom`, where the recording has them; a missing pose is written as zero. Other columns and
/// the labels of segments have no place in these messages and are left out.
///
/// Header stamps and log times are the row's time rounded to a nanosecond, counted from the epoch 0, so reading gives back
/// times of up to nine decimals exactly. If the first row is before zero, whole seconds are added to all times.
///
/// The file appears under its name only when it is complete.
///
/// # Errors
/// [`WriteError`]; in that case there is no new file.
pub fn write_mcap(path: &Path, recording: &Recording) -> Result<(), WriteError> {
    let stamps = stamps(recording)?;
    let command = pair(recording, "v_ref", "omega_ref");
    let motion = pair(recording, "v", "omega");
    let (command, motion) = match (command, motion) {
        (Err(_), Err(missing)) => return Err(missing.into()),
        (command, motion) => (command.ok(), motion.ok()),
    };
    let file = file_beside(path)?;
    let options = mcap::WriteOptions::new().profile("ros2").compression(Some(mcap::Compression::Zstd));
    let mut writer = options.create(BufWriter::new(file))?;
    let mut topics = Topics::declare(&mut writer, command.is_some(), motion.is_some())?;
    let pose = Pose::of(recording);
    let mut message = Vec::new();
    for (row, stamp) in stamps.iter().enumerate() {
        if let Some((v, omega)) = command {
            twist(&mut message, v[row], omega[row]);
            topics.write(&mut writer, topics.command, *stamp, &message)?;
        }
        if let Some((v, omega)) = motion {
            odometry(&mut message, *stamp, pose.at(row), (v[row], omega[row]));
            topics.write(&mut writer, topics.odometry, *stamp, &message)?;
        }
    }
    writer.finish()?;
    let file = writer.into_inner().into_inner().map_err(std::io::IntoInnerError::into_error)?;
    file.as_file().sync_all()?;
    file.persist(path).map_err(|e| e.error)?;
    Ok(())
}

fn pair<'a>(recording: &'a Recording, first: &str, second: &str) -> Result<(&'a [f64], &'a [f64]), RecordingError> {
    Ok((recording.column(first)?, recording.column(second)?))
}

/// Row times \[ns\], checked to be stamps in one order.
fn stamps(recording: &Recording) -> Result<Vec<u64>, WriteError> {
    let time = recording.time();
    for segments in recording.segments().windows(2) {
        let (end, start) = (time[segments[0].rows.end - 1], time[segments[1].rows.start]);
        if start <= end {
            return Err(WriteError::Overlap { segment: segments[1].label.clone(), start, end });
        }
    }
    let shift = (-time[0]).max(0.0).ceil();
    let stamps = time.iter().map(|t| stamp(t + shift)).collect::<Result<Vec<u64>, _>>()?;
    match stamps.windows(2).position(|w| w[1] <= w[0]) {
        Some(row) => Err(WriteError::TooDense { row: row + 1 }),
        None => Ok(stamps),
    }
}

pub(super) fn stamp(time: f64) -> Result<u64, WriteError> {
    if !(0.0..=2_147_483_647.0).contains(&time) {
        return Err(WriteError::Time { time });
    }
    // Seconds and fraction apart: their product with 1e9 would not be exact for times of day.
    Ok(time.trunc() as u64 * 1_000_000_000 + (time.fract() * 1e9).round() as u64)
}

/// The two channels and their counters.
#[derive(Debug)]
pub(super) struct Topics {
    pub(super) command: u16,
    pub(super) odometry: u16,
    sent: BTreeMap<u16, u32>,
}

impl Topics {
    pub(super) fn declare<W: Write + Seek>(writer: &mut mcap::Writer<W>, command: bool, odometry: bool) -> Result<Self, WriteError> {
        let mut declare = |wanted: bool, topic: &str, kind: &str, definition: &str| -> Result<u16, WriteError> {
            if !wanted {
                return Ok(u16::MAX);
            }
            let schema = writer.add_schema(kind, "ros2msg", definition.as_bytes())?;
            // Players need a quality of service; an empty list stands for the default one.
            let metadata = BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())]);
            Ok(writer.add_channel(schema, topic, "cdr", &metadata)?)
        };
        let command = declare(command, "/cmd_vel", "geometry_msgs/msg/Twist", definitions::TWIST)?;
        let odometry = declare(odometry, "/odom", "nav_msgs/msg/Odometry", definitions::ODOMETRY)?;
        Ok(Self { command, odometry, sent: BTreeMap::new() })
    }

    pub(super) fn write<W: Write + Seek>(
        &mut self,
        writer: &mut mcap::Writer<W>,
        channel_id: u16,
        stamp: u64,
        message: &[u8],
    ) -> Result<(), WriteError> {
        let sent = self.sent.entry(channel_id).or_default();
        let header = MessageHeader { channel_id, sequence: *sent, log_time: stamp, publish_time: stamp };
        *sent = sent.wrapping_add(1);
        writer.write_to_known_channel(&header, message)?;
        Ok(())
    }
}

/// Pose columns, zero where absent.
struct Pose<'a> {
    x: Option<&'a [f64]>,
    y: Option<&'a [f64]>,
    phi: Option<&'a [f64]>,
}

impl<'a> Pose<'a> {
    fn of(recording: &'a Recording) -> Self {
        let column = |name: &str| recording.column(name).ok();
        Self { x: column("x"), y: column("y"), phi: column("phi") }
    }

    fn at(&self, row: usize) -> [f64; 3] {
        [self.x, self.y, self.phi].map(|column| column.map_or(0.0, |values| values[row]))
    }
}

/// Little-endian XCDR1.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

fn doubles(message: &mut Vec<u8>, values: &[f64]) {
    for value in values {
        message.extend_from_slice(&value.to_le_bytes());
    }
}

pub(super) fn twist(message: &mut Vec<u8>, v: f64, omega: f64) {
    message.clear();
    message.extend_from_slice(&ENCAPSULATION);
    doubles(message, &[v, 0.0, 0.0, 0.0, 0.0, omega]);
}

fn text(message: &mut Vec<u8>, text: &str) {
    while !message.len().is_multiple_of(4) {
        message.push(0);
    }
    message.extend_from_slice(&(text.len() as u32 + 1).to_le_bytes());
    message.extend_from_slice(text.as_bytes());
    message.push(0);
}

pub(super) fn odometry(message: &mut Vec<u8>, stamp: u64, [x, y, phi]: [f64; 3], (v, omega): (f64, f64)) {
    message.clear();
    message.extend_from_slice(&ENCAPSULATION);
    message.extend_from_slice(&((stamp / 1_000_000_000) as u32).to_le_bytes());
    message.extend_from_slice(&((stamp % 1_000_000_000) as u32).to_le_bytes());
    text(message, "odom");
    text(message, "base_link");
    while !(message.len() - ENCAPSULATION.len()).is_multiple_of(8) {
        message.push(0);
    }
    doubles(message, &[x, y, 0.0, 0.0, 0.0, (phi / 2.0).sin(), (phi / 2.0).cos()]);
    doubles(message, &[0.0; 36]);
    doubles(message, &[v, 0.0, 0.0, 0.0, 0.0, omega]);
    doubles(message, &[0.0; 36]);
}
