//! Small bags made for tests, one builder a container, sharing one list of messages.
#![allow(dead_code, unreachable_pub, reason = "shared by test programs, each of which uses a part")]

use std::collections::BTreeMap;

use wheelwright_core::recording::{Column, Recording, Source};

/// One message: topic, type as ROS 2 spells it, log time in ns, the fields as little-endian CDR without encapsulation.
#[derive(Clone)]
pub struct Sent {
    pub topic: &'static str,
    pub kind: &'static str,
    pub log: i64,
    pub stamp: Option<i64>,
    pub v: f64,
    pub omega: f64,
    pub pose: [f64; 3],
}

impl Sent {
    pub fn cmd(log: i64, v: f64, omega: f64) -> Self {
        Self { topic: "/cmd_vel", kind: "geometry_msgs/msg/Twist", log, stamp: None, v, omega, pose: [0.0; 3] }
    }

    pub fn odom(log: i64, stamp: i64, v: f64, omega: f64) -> Self {
        Self { topic: "/odom", kind: "nav_msgs/msg/Odometry", log, stamp: Some(stamp), v, omega, pose: [log as f64 * 1e-9, 0.0, 0.0] }
    }

    /// The message as ROS 2 serializes it, in the given byte order.
    pub fn cdr(&self, big: bool) -> Vec<u8> {
        let mut body = Vec::new();
        let int = |body: &mut Vec<u8>, n: u32| {
            pad(body, 4);
            body.extend(if big { n.to_be_bytes() } else { n.to_le_bytes() });
        };
        let real = |body: &mut Vec<u8>, values: &[f64]| {
            pad(body, 8);
            for value in values {
                body.extend(if big { value.to_be_bytes() } else { value.to_le_bytes() });
            }
        };
        if let Some(stamp) = self.stamp {
            int(&mut body, stamp.div_euclid(1_000_000_000) as u32);
            int(&mut body, stamp.rem_euclid(1_000_000_000) as u32);
            int(&mut body, 5);
            body.extend(b"odom\0");
        }
        if self.kind.ends_with("Odometry") {
            int(&mut body, 10);
            body.extend(b"base_link\0");
            real(&mut body, &self.pose_fields());
            real(&mut body, &[0.5; 36]);
        }
        real(&mut body, &[self.v, 0.0, 0.0, 0.0, 0.0, self.omega]);
        if self.kind.ends_with("Odometry") {
            real(&mut body, &[0.25; 36]);
        }
        [&[0, u8::from(!big), 0, 0], body.as_slice()].concat()
    }

    /// The message as ROS 1 serializes it.
    pub fn ros1(&self) -> Vec<u8> {
        let mut body = Vec::new();
        let text = |body: &mut Vec<u8>, text: &str| {
            body.extend((text.len() as u32).to_le_bytes());
            body.extend(text.as_bytes());
        };
        if let Some(stamp) = self.stamp {
            body.extend(7u32.to_le_bytes());
            body.extend(time(stamp));
            text(&mut body, "odom");
        }
        let real = |body: &mut Vec<u8>, values: &[f64]| values.iter().for_each(|v| body.extend(v.to_le_bytes()));
        if self.kind.ends_with("Odometry") {
            text(&mut body, "base_link");
            real(&mut body, &self.pose_fields());
            real(&mut body, &[0.5; 36]);
        }
        real(&mut body, &[self.v, 0.0, 0.0, 0.0, 0.0, self.omega]);
        if self.kind.ends_with("Odometry") {
            real(&mut body, &[0.25; 36]);
        }
        body
    }

    fn pose_fields(&self) -> [f64; 7] {
        let [x, y, phi] = self.pose;
        [x, y, 0.0, 0.0, 0.0, (phi / 2.0).sin(), (phi / 2.0).cos()]
    }
}

fn pad(body: &mut Vec<u8>, to: usize) {
    while !body.len().is_multiple_of(to) {
        body.push(0);
    }
}

fn time(ns: i64) -> [u8; 8] {
    let (s, ns) = ((ns / 1_000_000_000) as u32, (ns % 1_000_000_000) as u32);
    let mut bytes = [0; 8];
    bytes[..4].copy_from_slice(&s.to_le_bytes());
    bytes[4..].copy_from_slice(&ns.to_le_bytes());
    bytes
}

/// A drive of so many rows at 20 Hz: commands at the very times of the odometry.
pub fn recording(rows: usize) -> Recording {
    let time: Vec<f64> = (0..rows).map(|k| (k as f64 * 50.0) / 1000.0).collect();
    let column = |name: &str, value: fn(f64) -> f64| Column::new(name, (0..rows).map(|k| value(k as f64)).collect());
    let columns = vec![
        column("v", |k| 0.3 * (0.02 * k).sin()),
        column("omega", |k| 0.8 * (0.045 * k).sin()),
        column("x", |k| 0.01 * k),
        column("y", |k| -0.002 * k),
        column("phi", |k| 0.2 * k),
        column("v_ref", |k| 0.3 * (0.02 * (k + 1.0)).sin()),
        column("omega_ref", |k| 0.8 * (0.045 * (k + 1.0)).sin()),
    ];
    Recording::new(Source::default(), time, columns, None).unwrap()
}

/// The messages of [`recording`].
pub fn drive(rows: usize) -> Vec<Sent> {
    let recording = recording(rows);
    let column = |name: &str| recording.column(name).unwrap();
    let both = |k: usize| {
        let log = k as i64 * 50_000_000;
        let cmd = Sent::cmd(log, column("v_ref")[k], column("omega_ref")[k]);
        let odom = Sent::odom(log, log, column("v")[k], column("omega")[k]);
        [cmd, Sent { pose: [column("x")[k], column("y")[k], column("phi")[k]], ..odom }]
    };
    (0..rows).flat_map(both).collect()
}

/// Topics in the order of first appearance.
fn topics(sent: &[Sent]) -> Vec<(&'static str, &'static str)> {
    let mut topics = Vec::new();
    for message in sent {
        if !topics.contains(&(message.topic, message.kind)) {
            topics.push((message.topic, message.kind));
        }
    }
    topics
}

/// An MCAP file in chunks of about ten messages.
pub fn mcap(sent: &[Sent], compression: Option<mcap::Compression>) -> Vec<u8> {
    let options = mcap::WriteOptions::new().chunk_size(Some(4096)).compression(compression);
    let mut writer = options.create(std::io::Cursor::new(Vec::new())).unwrap();
    let channels: Vec<u16> = topics(sent)
        .iter()
        .map(|(topic, kind)| {
            let schema = writer.add_schema(kind, "ros2msg", b"").unwrap();
            writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap()
        })
        .collect();
    for message in sent {
        let channel_id = channels[topics(sent).iter().position(|t| *t == (message.topic, message.kind)).unwrap()];
        let log_time = message.log as u64;
        let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time, publish_time: log_time };
        writer.write_to_known_channel(&header, &message.cdr(false)).unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

/// A rosbag2 database of schema version 2.
pub fn db3(sent: &[Sent]) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.db3");
    let connection = rusqlite::Connection::open(&path).unwrap();
    connection
        .execute_batch(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL); \
             CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, data BLOB NOT NULL); BEGIN;",
        )
        .unwrap();
    for (id, (topic, kind)) in topics(sent).iter().enumerate() {
        connection.execute("INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')", rusqlite::params![id as i64 + 1, topic, kind]).unwrap();
    }
    for message in sent {
        let id = topics(sent).iter().position(|t| *t == (message.topic, message.kind)).unwrap() as i64 + 1;
        let row = rusqlite::params![id, message.log, message.cdr(false)];
        connection.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", row).unwrap();
    }
    connection.execute_batch("COMMIT; CREATE INDEX timestamp_idx ON messages (timestamp ASC);").unwrap();
    drop(connection);
    std::fs::read(path).unwrap()
}

/// A ROS 1 bag with chunks of ten messages and without an index section, though its header claims one.
pub fn bag1(sent: &[Sent], compression: &str) -> Vec<u8> {
    let mut bag = b"#ROSBAG V2.0\n".to_vec();
    bag.extend(record(&[("op", &[3]), ("index_pos", &1u64.to_le_bytes())], &[0x20; 64]));
    let topics = topics(sent);
    let mut connections = Vec::new();
    for (number, (topic, kind)) in topics.iter().enumerate() {
        let kind = kind.replace("/msg/", "/");
        let data = fields(&[("topic", topic.as_bytes()), ("type", kind.as_bytes()), ("md5sum", b"*")]);
        connections.extend(record(&[("op", &[7]), ("conn", &(number as u32).to_le_bytes()), ("topic", topic.as_bytes())], &data));
    }
    for (number, messages) in sent.chunks(10).enumerate() {
        let mut chunk = if number == 0 { connections.clone() } else { Vec::new() };
        for message in messages {
            let connection = topics.iter().position(|t| *t == (message.topic, message.kind)).unwrap() as u32;
            chunk.extend(record(&[("op", &[2]), ("conn", &connection.to_le_bytes()), ("time", &time(message.log))], &message.ros1()));
        }
        let size = (chunk.len() as u32).to_le_bytes();
        bag.extend(record(&[("op", &[5]), ("compression", compression.as_bytes()), ("size", &size)], &compress(&chunk, compression)));
    }
    bag
}

fn compress(chunk: &[u8], compression: &str) -> Vec<u8> {
    use std::io::Write;
    match compression {
        "lz4" => {
            let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
            encoder.write_all(chunk).unwrap();
            encoder.finish().unwrap()
        }
        "bz2" => {
            let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::fast());
            encoder.write_all(chunk).unwrap();
            encoder.finish().unwrap()
        }
        _ => chunk.to_vec(),
    }
}

fn fields(fields: &[(&str, &[u8])]) -> Vec<u8> {
    let field = |(name, value): &(&str, &[u8])| {
        let length = (name.len() + 1 + value.len()) as u32;
        [&length.to_le_bytes(), name.as_bytes(), b"=", value].concat()
    };
    fields.iter().flat_map(field).collect()
}

fn record(header: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let header = fields(header);
    let (header_length, data_length) = ((header.len() as u32).to_le_bytes(), (data.len() as u32).to_le_bytes());
    [&header_length, header.as_slice(), &data_length, data].concat()
}
