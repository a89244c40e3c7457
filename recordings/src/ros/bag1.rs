//! ROS 1 bags, version 2.0: records of `name=value` headers and data, messages in compressed chunks.
//!
//! Read forward without the index, which a recorder writes last: an interrupted recording (`.bag.active`) is read as far
//! as it goes. Record layout: <https://wiki.ros.org/Bags/Format/2.0>.

use std::collections::BTreeMap;
use std::io::{self, BufReader, Read};

use wheelwright_core::recording::ReadError;

use super::collect::{Collector, malformed};
use super::stream::{Counted, Fields, array, fill, skip};

/// The first line of every bag of this version.
pub(crate) const MAGIC: [u8; 13] = *b"#ROSBAG V2.0\n";

const MESSAGE: u8 = 2;
const BAG_HEADER: u8 = 3;
const CHUNK: u8 = 5;
const CONNECTION: u8 = 7;

/// Longest record header or connection record that is believed.
const LONGEST_HEADER: u64 = 16 << 20;

/// Reads all messages into the collector; what is cut off or damaged is said in its warnings.
///
/// # Errors
/// `Io`; `Malformed` where the framing is lost; `Unsupported` for an unknown chunk compression or an encrypted bag.
pub(crate) fn scan(reader: impl Read, collector: &mut Collector) -> Result<(), ReadError> {
    let mut reader = BufReader::with_capacity(1 << 16, Counted::new(reader));
    if array(&mut reader)? != Some(MAGIC) {
        return Err(malformed("byte 0", "not the beginning of a ROS 1 bag of version 2.0; `rosbag fix` converts older ones"));
    }
    let mut bag = Bag { collector, connections: BTreeMap::new(), buffer: Vec::new() };
    let mut unindexed = false;
    loop {
        let start = position(&reader);
        match bag.next(&mut reader)? {
            Step::Record => {}
            Step::Header { indexed } => unindexed = !indexed,
            Step::End => break,
            Step::Cut => {
                bag.collector
                    .warnings
                    .push(format!("the bag ends inside the record at byte {start}: it was cut off, what is whole was read"));
                return Ok(());
            }
            Step::Damaged(what) => return Err(malformed(format!("byte {start}"), what)),
        }
    }
    if unindexed {
        let warning = "the bag has no index: its recording was interrupted; what is whole was read (`rosbag reindex` repairs it)";
        bag.collector.warnings.push(warning.to_owned());
    }
    Ok(())
}

fn position<R: Read>(reader: &BufReader<Counted<R>>) -> u64 {
    reader.get_ref().at - reader.buffer().len() as u64
}

enum Step {
    Record,
    /// The bag header.
    Header {
        indexed: bool,
    },
    /// The data end between two records.
    End,
    /// The data end inside a record.
    Cut,
    /// A record contradicts itself.
    Damaged(String),
}

/// The header fields that are used.
#[derive(Default)]
struct Header {
    op: Option<u8>,
    connection: Option<u32>,
    time: Option<u64>,
    compression: Option<String>,
    topic: Option<String>,
    index: Option<u64>,
    encrypted: bool,
}

impl Header {
    /// None if a field runs over the end or lacks its `=`.
    fn parse(bytes: &[u8]) -> Option<Self> {
        let mut header = Self::default();
        let mut fields = Fields(bytes);
        while !fields.0.is_empty() {
            let length = fields.u32()?;
            let field = fields.bytes(length as usize)?;
            let equals = field.iter().position(|b| *b == b'=')?;
            let (name, value) = (&field[..equals], &field[equals + 1..]);
            let mut number = Fields(value);
            let text = || String::from_utf8_lossy(value).into_owned();
            match name {
                b"op" => header.op = value.first().copied(),
                b"conn" => header.connection = number.u32(),
                b"time" => header.time = number.u32().zip(number.u32()).map(|(s, ns)| u64::from(s) * 1_000_000_000 + u64::from(ns)),
                b"compression" => header.compression = Some(text()),
                b"topic" => header.topic = Some(text()),
                b"index_pos" => header.index = number.u64(),
                b"encryptor" => header.encrypted = !value.is_empty(),
                _ => {}
            }
        }
        Some(header)
    }
}

struct Bag<'a> {
    collector: &'a mut Collector,
    /// Topic index by connection number.
    connections: BTreeMap<u32, usize>,
    buffer: Vec<u8>,
}

impl Bag<'_> {
    fn next<R: Read>(&mut self, reader: &mut R) -> Result<Step, ReadError> {
        let Some(length) = length_or_end(reader)? else {
            return Ok(Step::End);
        };
        let Some(length) = length else {
            return Ok(Step::Cut);
        };
        if u64::from(length) > LONGEST_HEADER {
            return Ok(Step::Damaged(format!("a record header that claims to be {length} bytes long")));
        }
        if !fill(reader, &mut self.buffer, u64::from(length))? {
            return Ok(Step::Cut);
        }
        let Some(header) = Header::parse(&self.buffer) else {
            return Ok(Step::Damaged("a record header whose fields do not fit its length".to_owned()));
        };
        let Some(length) = array(reader)?.map(u32::from_le_bytes).map(u64::from) else {
            return Ok(Step::Cut);
        };
        match header.op {
            Some(MESSAGE) => self.message(reader, &header, length),
            Some(CONNECTION) => self.connection(reader, &header, length),
            Some(CHUNK) => self.chunk(reader, header.compression.as_deref().unwrap_or("none"), length),
            Some(BAG_HEADER) if header.encrypted => Err(ReadError::Unsupported {
                what: "an encrypted bag".to_owned(),
                reason: "decrypt it with `rosbag decrypt` first".to_owned(),
            }),
            Some(BAG_HEADER) => {
                let indexed = header.index != Some(0);
                Ok(if skip(reader, length)? { Step::Header { indexed } } else { Step::Cut })
            }
            Some(_) => passed(skip(reader, length)?),
            None => Ok(Step::Damaged("a record header without its `op` field".to_owned())),
        }
    }

    fn connection<R: Read>(&mut self, reader: &mut R, header: &Header, length: u64) -> Result<Step, ReadError> {
        if length > LONGEST_HEADER {
            return Ok(Step::Damaged(format!("a connection record that claims to be {length} bytes long")));
        }
        if !fill(reader, &mut self.buffer, length)? {
            return Ok(Step::Cut);
        }
        let (Some(number), Some(topic)) = (header.connection, header.topic.as_deref()) else {
            return Ok(Step::Damaged("a connection record without `conn` or `topic`".to_owned()));
        };
        let Some((kind, md5)) = type_of(&self.buffer) else {
            return Ok(Step::Damaged(format!("the connection record of topic `{topic}` has no readable type")));
        };
        let index = self.collector.topic(topic, &kind, "ros1");
        self.collector.definition(index, &md5);
        self.connections.insert(number, index);
        Ok(Step::Record)
    }

    fn message<R: Read>(&mut self, reader: &mut R, header: &Header, length: u64) -> Result<Step, ReadError> {
        let (Some(number), Some(time)) = (header.connection, header.time) else {
            return Ok(Step::Damaged("a message record without `conn` or `time`".to_owned()));
        };
        let Some(&topic) = self.connections.get(&number) else {
            return Ok(Step::Damaged(format!("a message of connection {number}, which was not declared")));
        };
        let whole = self.collector.read_message(reader, topic, time, length, &mut self.buffer)?;
        Ok(if whole { Step::Record } else { Step::Cut })
    }

    fn chunk<R: Read>(&mut self, reader: &mut R, compression: &str, length: u64) -> Result<Step, ReadError> {
        let mut data = reader.take(length);
        let mark = self.collector.mark();
        let outcome = self.chunk_records(&mut data, compression)?;
        let cut = !skip(&mut data, u64::MAX).is_ok_and(|_| data.limit() == 0);
        if cut {
            return Ok(Step::Cut);
        }
        if let Err(what) = outcome {
            self.collector.rollback(&mark);
            self.collector.warnings.push(format!("a damaged chunk was left out: {what}"));
        }
        Ok(Step::Record)
    }

    /// Reads the records of a chunk; the inner error says how it is damaged.
    fn chunk_records(&mut self, data: &mut dyn Read, compression: &str) -> Result<Result<(), String>, ReadError> {
        let plain: Box<dyn Read + '_> = match compression {
            "none" => Box::new(data),
            "bz2" => Box::new(bzip2::read::MultiBzDecoder::new(data)),
            "lz4" => Box::new(lz4_flex::frame::FrameDecoder::new(data)),
            other => {
                return Err(ReadError::Unsupported {
                    what: format!("chunk compression `{other}`"),
                    reason: "none, bz2 and lz4 are read; rewrite the bag with `rosbag decompress`".to_owned(),
                });
            }
        };
        let mut records = BufReader::with_capacity(1 << 16, plain);
        loop {
            match self.next(&mut records) {
                Ok(Step::Record | Step::Header { .. }) => {}
                Ok(Step::End) => return Ok(Ok(())),
                Ok(Step::Cut) => return Ok(Err("it ends inside a record".to_owned())),
                Ok(Step::Damaged(what)) => return Ok(Err(what)),
                Err(ReadError::Io(e)) => return Ok(Err(e.to_string())),
                Err(e) => return Err(e),
            }
        }
    }
}

/// A length before a record: none at the end of the data, an inner none if it is cut in two.
fn length_or_end(reader: &mut impl Read) -> io::Result<Option<Option<u32>>> {
    let mut bytes = Vec::with_capacity(4);
    reader.take(4).read_to_end(&mut bytes)?;
    Ok(match <[u8; 4]>::try_from(bytes) {
        Ok(bytes) => Some(Some(u32::from_le_bytes(bytes))),
        Err(bytes) if bytes.is_empty() => None,
        Err(_) => Some(None),
    })
}

fn passed(whole: bool) -> Result<Step, ReadError> {
    Ok(if whole { Step::Record } else { Step::Cut })
}

/// Type and MD5 of its definition, from a connection record's data, which is laid out like a header.
fn type_of(data: &[u8]) -> Option<(String, String)> {
    let mut fields = Fields(data);
    let (mut kind, mut md5) = (None, "*".to_owned());
    while !fields.0.is_empty() {
        let length = fields.u32()?;
        let field = fields.bytes(length as usize)?;
        if let Some(value) = field.strip_prefix(b"type=") {
            kind = Some(String::from_utf8_lossy(value).into_owned());
        } else if let Some(value) = field.strip_prefix(b"md5sum=") {
            md5 = String::from_utf8_lossy(value).into_owned();
        }
    }
    Some((kind?, md5))
}
