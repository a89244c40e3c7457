//! What every container hands its messages to: one list a topic, of the few numbers that are wanted.
//!
//! A container only has to say which topics there are and to pass each message's log time and bytes. Messages of types
//! that are not read are counted and never held, so memory grows with the drive data alone, not with images or scans.

use std::io::{self, Read};

use wheelwright_core::recording::{ReadError, ReadOptions, Stream};

use super::message::{Kind, Motion};
use super::stream::{fill, skip};
use super::wire::{Encoding, WireError};

/// No message of the types that are read comes near this many bytes; longer ones are not loaded.
pub(crate) const LONGEST_MESSAGE: u64 = 1 << 20;

const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// One decoded message.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Message {
    /// When the recorder received it \[ns\].
    pub(crate) log: i64,
    /// What it says.
    pub(crate) motion: Motion,
}

/// One topic, as far as it was read.
#[derive(Debug)]
pub(crate) struct Topic {
    /// Name, as the file spells it.
    pub(crate) name: String,
    /// Type name, as the file spells it.
    pub(crate) kind: String,
    /// Encoding name, as the file spells it.
    pub(crate) encoding: String,
    /// Messages seen.
    pub(crate) count: u64,
    /// Messages of a type that is read, in the order of the file.
    pub(crate) messages: Vec<Message>,
    /// The first message that does not decode, by its number from 1.
    pub(crate) fault: Option<(u64, WireError)>,
    /// Definition other than the standard one, as its MD5.
    pub(crate) foreign_md5: Option<String>,
    how: Option<(Kind, Encoding)>,
}

impl Topic {
    /// Kind of its messages, if they are of a type that is read, whatever their encoding.
    pub(crate) fn message_kind(&self) -> Option<Kind> {
        Kind::of(&self.kind)
    }
}

/// Topics and messages of a recording while it is scanned.
#[derive(Default)]
pub(crate) struct Collector {
    topics: Vec<Topic>,
    /// What the user should know about the file.
    pub(crate) warnings: Vec<String>,
    only: Option<Vec<String>>,
}

/// Where every list stood; see [`Collector::rollback`].
pub(crate) struct Mark(Vec<(u64, usize)>);

impl Collector {
    /// Keeps messages of the topics that `options` name for both roles; of every topic of a type that is read, as long as
    /// a role is left to be found.
    pub(crate) fn new(options: &ReadOptions) -> Self {
        let named = |role: &str| options.topics.iter().rev().find(|(r, _)| r == role).map(|(_, topic)| topic.clone());
        let only = named("cmd").zip(named("odom")).map(|(cmd, odom)| vec![cmd, odom]);
        Self { only, ..Self::default() }
    }

    /// Registers a topic, or finds it again; the index is for the other calls.
    pub(crate) fn topic(&mut self, name: &str, kind: &str, encoding: &str) -> usize {
        let known = self.topics.iter().position(|t| t.name == name && t.kind == kind && t.encoding == encoding);
        known.unwrap_or_else(|| {
            let wanted = self.only.as_ref().is_none_or(|only| only.iter().any(|o| same_topic(o, name)));
            let how = if wanted { Kind::of(kind).zip(Encoding::named(encoding)) } else { None };
            self.topics.push(Topic {
                name: name.to_owned(),
                kind: kind.to_owned(),
                encoding: encoding.to_owned(),
                count: 0,
                messages: Vec::new(),
                fault: None,
                foreign_md5: None,
                how,
            });
            self.topics.len() - 1
        })
    }

    /// Notes a ROS 1 definition's checksum; `*` stands for any.
    pub(crate) fn definition(&mut self, topic: usize, md5: &str) {
        let topic = &mut self.topics[topic];
        if topic.message_kind().is_some_and(|kind| md5 != "*" && md5 != kind.ros1_md5()) {
            topic.foreign_md5 = Some(md5.to_owned());
        }
    }

    /// True if the bytes of the topic's messages are to be loaded.
    pub(crate) fn wants(&self, topic: usize) -> bool {
        self.topics[topic].how.is_some()
    }

    /// Counts a message whose bytes are not needed.
    pub(crate) fn pass(&mut self, topic: usize) {
        self.topics[topic].count += 1;
    }

    /// Notes that a message of a wanted topic is too long to be loaded.
    pub(crate) fn too_long(&mut self, topic: usize, length: u64) {
        self.pass(topic);
        let topic = &mut self.topics[topic];
        topic.fault.get_or_insert((topic.count, WireError::Huge(length)));
    }

    /// Takes the next `length` bytes of a container as a message, or passes over one that is not wanted or too long; false if
    /// the data end before. `buffer` is room to work in.
    pub(crate) fn read_message(
        &mut self,
        reader: &mut impl Read,
        topic: usize,
        log: u64,
        length: u64,
        buffer: &mut Vec<u8>,
    ) -> io::Result<bool> {
        let wanted = self.wants(topic);
        if wanted && length <= LONGEST_MESSAGE {
            let whole = fill(reader, buffer, length)?;
            if whole {
                self.message(topic, log, buffer);
            }
            return Ok(whole);
        }
        if !skip(reader, length)? {
            return Ok(false);
        }
        if wanted {
            self.too_long(topic, length);
        } else {
            self.pass(topic);
        }
        Ok(true)
    }

    /// Takes a message. One that does not decode is an error only if its topic is chosen in the end.
    pub(crate) fn message(&mut self, topic: usize, log: u64, bytes: &[u8]) {
        self.pass(topic);
        let topic = &mut self.topics[topic];
        let Some((kind, encoding)) = topic.how else {
            return;
        };
        let log_time = || i64::try_from(log).map_err(|_| WireError::LogTime(log));
        match log_time().and_then(|log| Ok(Message { log, motion: decode(kind, encoding, bytes)? })) {
            Ok(message) => topic.messages.push(message),
            Err(error) => {
                topic.fault.get_or_insert((topic.count, error));
            }
        }
    }

    /// The present end of every list.
    pub(crate) fn mark(&self) -> Mark {
        Mark(self.topics.iter().map(|t| (t.count, t.messages.len())).collect())
    }

    /// Forgets the messages since `mark`: their chunk turned out to be damaged.
    pub(crate) fn rollback(&mut self, mark: &Mark) {
        let start = (0, 0);
        for (index, topic) in self.topics.iter_mut().enumerate() {
            let (count, length) = *mark.0.get(index).unwrap_or(&start);
            topic.count = count;
            topic.messages.truncate(length);
            topic.fault.take_if(|fault| fault.0 > count);
        }
    }

    /// True once a wanted message was read.
    pub(crate) fn has_messages(&self) -> bool {
        self.topics.iter().any(|t| !t.messages.is_empty())
    }

    /// The topics, at the end of the scan.
    pub(crate) fn into_topics(self) -> (Vec<Topic>, Vec<String>) {
        (self.topics, self.warnings)
    }
}

/// Topic names are the same with and without the leading slash, which some recorders leave out.
pub(crate) fn same_topic(a: &str, b: &str) -> bool {
    a.strip_prefix('/').unwrap_or(a) == b.strip_prefix('/').unwrap_or(b)
}

/// Decodes a message, which rosbag2 may have compressed by itself (`compression_mode: message`). No message that is read
/// can begin like a zstd frame: CDR begins with a zero byte, and the wanted ROS 1 types are too short to have one
/// compressed.
fn decode(kind: Kind, encoding: Encoding, bytes: &[u8]) -> Result<Motion, WireError> {
    if encoding != Encoding::Cdr || !bytes.starts_with(&ZSTD_MAGIC) {
        return kind.decode(encoding, bytes);
    }
    let failed = |e: std::io::Error| WireError::Zstd(e.to_string());
    let mut message = Vec::new();
    let frame = zstd::stream::read::Decoder::with_buffer(bytes).map_err(failed)?;
    frame.take(LONGEST_MESSAGE).read_to_end(&mut message).map_err(failed)?;
    kind.decode(encoding, &message)
}

/// The topics as a recording lists them; `used` by name and type.
pub(crate) fn streams(topics: &[Topic], used: &[(&str, &str)]) -> Vec<Stream> {
    let used = |t: &Topic| used.contains(&(t.name.as_str(), t.kind.as_str()));
    topics.iter().map(|t| Stream { name: t.name.clone(), kind: t.kind.clone(), count: t.count, used: used(t) }).collect()
}

/// An error at a byte of a file.
pub(crate) fn malformed(position: impl std::fmt::Display, reason: impl std::fmt::Display) -> ReadError {
    ReadError::Malformed { position: position.to_string(), reason: reason.to_string() }
}
