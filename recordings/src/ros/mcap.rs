//! MCAP: typed records, most of them in compressed chunks.
//!
//! The records are read forward, from a file or from a decompressor, in constant memory and without the index, so that a
//! file cut short by a crash or a full disk gives all that is whole. The `mcap` crate's reader is not used, because a record
//! that claims to be longer than its uncompressed chunk underflows in its linear reader (0.26), and because it wants the
//! whole file mapped. Record layout: <https://mcap.dev/spec>.

use std::collections::BTreeMap;
use std::io::{self, BufReader, Read};

use wheelwright_core::recording::ReadError;

use super::collect::{Collector, malformed};
use super::stream::{Counted, Fields, array, fill, skip};

/// How every MCAP file begins; the zero is the version.
pub(crate) const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";

const SCHEMA: u8 = 0x03;
const CHANNEL: u8 = 0x04;
const MESSAGE: u8 = 0x05;
const CHUNK: u8 = 0x06;
const DATA_END: u8 = 0x0f;
const FOOTER: u8 = 0x02;
/// Types from here on are not of this version of the format...
const FIRST_UNKNOWN: u8 = 0x10;
/// ...and from here on a program's own.
const FIRST_PRIVATE: u8 = 0x80;

/// Longest schema or channel record that is believed.
const LONGEST_DEFINITION: u64 = 16 << 20;
const MESSAGE_HEADER: u64 = 2 + 4 + 8 + 8;

/// Reads all messages into the collector; what is cut off or damaged is said in its warnings.
///
/// # Errors
/// `Io`; `Malformed` where even the framing is lost; `Unsupported` for an unknown chunk compression.
pub(crate) fn scan(reader: impl Read, collector: &mut Collector) -> Result<(), ReadError> {
    let mut reader = BufReader::with_capacity(1 << 16, Counted::new(reader));
    if array(&mut reader)? != Some(MAGIC) {
        return Err(malformed("byte 0", "not the beginning of an MCAP file of version 0"));
    }
    let mut records = Records { collector, schemas: BTreeMap::new(), channels: BTreeMap::new(), buffer: Vec::new(), unknown: 0 };
    loop {
        let start = position(&reader);
        match records.next(&mut reader, Level::File)? {
            Step::Record => {}
            Step::End => break,
            Step::Cut => {
                records.collector.warnings.push(format!(
                    "the file ends inside the record at byte {start}: it was cut off, what is whole was read; `mcap recover` repairs it"
                ));
                break;
            }
            Step::Damaged(what) => {
                return Err(malformed(format!("byte {start}"), format!("{what}; `mcap recover` keeps what can be saved")));
            }
        }
    }
    if records.unknown > 0 {
        let warning = format!("{} record(s) of an unknown type were passed over: a newer format, or a damaged file", records.unknown);
        records.collector.warnings.push(warning);
    }
    Ok(())
}

fn position<R: Read>(reader: &BufReader<Counted<R>>) -> u64 {
    reader.get_ref().at - reader.buffer().len() as u64
}

/// Where a record stands.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Level {
    File,
    Chunk,
}

enum Step {
    /// A record was read or passed over.
    Record,
    /// The data section is over.
    End,
    /// The data end inside a record.
    Cut,
    /// A record contradicts itself.
    Damaged(String),
}

struct Records<'a> {
    collector: &'a mut Collector,
    /// Schema name by number.
    schemas: BTreeMap<u16, String>,
    /// Topic index by channel number.
    channels: BTreeMap<u16, usize>,
    buffer: Vec<u8>,
    /// Records of types that this version of the format does not have.
    unknown: u64,
}

impl Records<'_> {
    fn next<R: Read>(&mut self, reader: &mut R, level: Level) -> Result<Step, ReadError> {
        let Some([opcode, length @ ..]) = array::<9>(reader)? else {
            return Ok(Step::Cut);
        };
        let length = u64::from_le_bytes(length);
        match (opcode, level) {
            (MESSAGE, _) => self.message(reader, length),
            (SCHEMA | CHANNEL, _) if length > LONGEST_DEFINITION => {
                Ok(Step::Damaged(format!("a definition that claims to be {length} bytes long")))
            }
            (SCHEMA, _) => self.definition(reader, length, Self::schema),
            (CHANNEL, _) => self.definition(reader, length, Self::channel),
            (CHUNK, Level::File) => self.chunk(reader, length),
            (DATA_END | FOOTER, Level::File) => Ok(Step::End),
            (0, _) => Ok(Step::Damaged("a record of type 0".to_owned())),
            _ => {
                self.unknown += u64::from((FIRST_UNKNOWN..FIRST_PRIVATE).contains(&opcode));
                passed(skip(reader, length)?)
            }
        }
    }

    fn definition<R: Read>(&mut self, reader: &mut R, length: u64, read: fn(&mut Self, &[u8]) -> Option<()>) -> Result<Step, ReadError> {
        let mut record = std::mem::take(&mut self.buffer);
        let whole = fill(reader, &mut record, length)?;
        let read = if whole { read(self, &record) } else { None };
        self.buffer = record;
        Ok(match (whole, read) {
            (false, _) => Step::Cut,
            (true, Some(())) => Step::Record,
            (true, None) => Step::Damaged("a schema or channel whose fields do not fit its length".to_owned()),
        })
    }

    fn schema(&mut self, record: &[u8]) -> Option<()> {
        let mut fields = Fields(record);
        let (id, name) = (fields.u16()?, fields.text()?);
        self.schemas.insert(id, name.to_owned());
        Some(())
    }

    fn channel(&mut self, record: &[u8]) -> Option<()> {
        let mut fields = Fields(record);
        let (id, schema, topic, encoding) = (fields.u16()?, fields.u16()?, fields.text()?, fields.text()?);
        let kind = self.schemas.get(&schema).map_or("", String::as_str);
        self.channels.insert(id, self.collector.topic(topic, kind, encoding));
        Some(())
    }

    fn message<R: Read>(&mut self, reader: &mut R, length: u64) -> Result<Step, ReadError> {
        let Some(data) = length.checked_sub(MESSAGE_HEADER) else {
            return Ok(Step::Damaged(format!("a message of {length} bytes, less than its own header")));
        };
        let Some(header) = array::<{ MESSAGE_HEADER as usize }>(reader)? else {
            return Ok(Step::Cut);
        };
        let mut fields = Fields(&header);
        let (Some(channel), Some(_sequence), Some(log)) = (fields.u16(), fields.u32(), fields.u64()) else {
            return Ok(Step::Cut);
        };
        let Some(&topic) = self.channels.get(&channel) else {
            return Ok(Step::Damaged(format!("a message of channel {channel}, which was not declared")));
        };
        let whole = self.collector.read_message(reader, topic, log, data, &mut self.buffer)?;
        Ok(if whole { Step::Record } else { Step::Cut })
    }

    fn chunk<R: Read>(&mut self, reader: &mut R, length: u64) -> Result<Step, ReadError> {
        const FIXED: u64 = 8 + 8 + 8 + 4 + 4;
        let Some(head) = array::<{ FIXED as usize }>(reader)? else {
            return Ok(Step::Cut);
        };
        let mut fields = Fields(&head[16..]);
        let (Some(size), Some(crc), Some(name)) = (fields.u64(), fields.u32(), fields.u32()) else {
            return Ok(Step::Cut);
        };
        if name > 64 {
            return Ok(Step::Damaged(format!("a chunk whose compression has a name of {name} bytes")));
        }
        if !fill(reader, &mut self.buffer, u64::from(name))? {
            return Ok(Step::Cut);
        }
        let compression = String::from_utf8_lossy(&self.buffer).into_owned();
        let Some(compressed) = array(reader)?.map(u64::from_le_bytes) else {
            return Ok(Step::Cut);
        };
        let Some(padding) = length.checked_sub(FIXED + u64::from(name) + 8).and_then(|rest| rest.checked_sub(compressed)) else {
            return Ok(Step::Damaged(format!("a chunk of {length} bytes that claims to hold {compressed}")));
        };
        let mut data = reader.take(compressed);
        let mark = self.collector.mark();
        let outcome = self.chunk_records(&mut data, &compression, size, crc)?;
        let cut = !skip(&mut data, u64::MAX).is_ok_and(|_| data.limit() == 0);
        if cut {
            return Ok(Step::Cut);
        }
        if let Err(what) = outcome {
            self.collector.rollback(&mark);
            self.collector.warnings.push(format!("a damaged chunk was left out: {what}"));
        }
        passed(skip(reader, padding)?)
    }

    /// Reads the records of a chunk; the inner error says how it is damaged.
    fn chunk_records(&mut self, data: &mut dyn Read, compression: &str, size: u64, crc: u32) -> Result<Result<(), String>, ReadError> {
        let plain: Box<dyn Read + '_> = match compression {
            "" => Box::new(data),
            "zstd" => Box::new(zstd::stream::read::Decoder::new(data)?),
            "lz4" => Box::new(lz4_flex::frame::FrameDecoder::new(data)),
            other => {
                return Err(ReadError::Unsupported {
                    what: format!("chunk compression `{other}`"),
                    reason: "zstd, lz4 and none are read; rewrite the file with `mcap compress`".to_owned(),
                });
            }
        };
        let summed = Summed { inner: plain.take(size), sum: crc32fast::Hasher::new() };
        let mut counted = BufReader::with_capacity(1 << 16, Counted::new(summed));
        loop {
            if position(&counted) == size {
                break;
            }
            let step = match self.next(&mut counted, Level::Chunk) {
                Ok(step) => step,
                Err(ReadError::Io(e)) => return Ok(Err(e.to_string())),
                Err(e) => return Err(e),
            };
            match step {
                Step::Record | Step::End => {}
                Step::Cut => return Ok(Err("it ends inside a record".to_owned())),
                Step::Damaged(what) => return Ok(Err(what)),
            }
        }
        let found = counted.into_inner().inner.sum.finalize();
        if crc != 0 && found != crc {
            return Ok(Err(format!("its checksum is {found:08x} instead of {crc:08x}")));
        }
        Ok(Ok(()))
    }
}

fn passed(whole: bool) -> Result<Step, ReadError> {
    Ok(if whole { Step::Record } else { Step::Cut })
}

/// Sums up the bytes that pass, by MCAP's checksum.
struct Summed<R> {
    inner: R,
    sum: crc32fast::Hasher,
}

impl<R: Read> Read for Summed<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.inner.read(buffer)?;
        self.sum.update(&buffer[..read]);
        Ok(read)
    }
}
