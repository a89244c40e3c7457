//! The records of a `.wpilog`: a byte of lengths, then entry, size, time stamp and payload, little endian.

use std::io::{self, BufRead, Read};

use wheelwright_core::recording::ReadError;

/// First bytes of every such file.
pub(super) const MAGIC: &[u8] = b"WPILOG";

/// Payloads kept are names, states and numbers; a longer one is no such thing.
const LONGEST_PAYLOAD: u64 = 1 << 20;

/// One record; its payload is read or passed over by the caller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Header {
    /// Where the record begins in the file.
    pub(super) offset: u64,
    /// Entry number; 0 is the log's own.
    pub(super) entry: u32,
    /// Payload bytes.
    pub(super) size: u64,
    /// Time \[µs\].
    pub(super) stamp: u64,
}

/// A file read record by record, never wholly into memory.
pub(super) struct Records<R> {
    input: R,
    offset: u64,
}

/// What a record's end can be.
pub(super) enum Next<T> {
    /// It is whole.
    Whole(T),
    /// The file ends before it.
    End,
    /// The file ends inside it.
    Cut,
}

impl<R: BufRead> Records<R> {
    /// Reads the file header.
    ///
    /// # Errors
    /// [`ReadError::Unsupported`] for another version, [`ReadError::Malformed`] for a file that ends in its header.
    pub(super) fn new(input: R) -> Result<Self, ReadError> {
        let mut records = Self { input, offset: 0 };
        let ends_early = || malformed(0, "the file ends in its header".to_owned());
        let Next::Whole(head) = records.take(12)? else { return Err(ends_early()) };
        if !head.starts_with(MAGIC) {
            return Err(malformed(0, "not a WPILOG file".to_owned()));
        }
        if head[7] != 1 {
            let what = format!("WPILOG version {}.{}", head[7], head[6]);
            return Err(ReadError::Unsupported {
                what,
                reason: "version 1 is read; convert the log with a current WPILib tool".to_owned(),
            });
        }
        let extra = little_endian(&head[8..12]);
        if !records.skip(extra)? {
            return Err(ends_early());
        }
        Ok(records)
    }

    /// The next record's header.
    pub(super) fn header(&mut self) -> Result<Next<Header>, ReadError> {
        if self.input.fill_buf()?.is_empty() {
            return Ok(Next::End);
        }
        let offset = self.offset;
        let Next::Whole(lengths) = self.take(1)? else { return Ok(Next::Cut) };
        let (entry, size, stamp) = (1 + (lengths[0] & 3), 1 + (lengths[0] >> 2 & 3), 1 + (lengths[0] >> 4 & 7));
        let Next::Whole(fields) = self.take(u64::from(entry + size + stamp))? else { return Ok(Next::Cut) };
        let (entry, rest) = fields.split_at(entry.into());
        let (size, stamp) = rest.split_at(size.into());
        // Four bytes at most, so the entry fits.
        let entry = u32::try_from(little_endian(entry)).unwrap_or(u32::MAX);
        Ok(Next::Whole(Header { offset, entry, size: little_endian(size), stamp: little_endian(stamp) }))
    }

    /// The payload of the record whose header was just read.
    ///
    /// # Errors
    /// [`ReadError::Malformed`] for a payload too long to be a name, a state or a number.
    pub(super) fn payload(&mut self, header: &Header) -> Result<Next<Vec<u8>>, ReadError> {
        if header.size > LONGEST_PAYLOAD {
            return Err(malformed(header.offset, format!("a record of {} bytes where a name, a state or a number is due", header.size)));
        }
        self.take(header.size)
    }

    /// Passes over bytes; false if the file ends in them.
    pub(super) fn skip(&mut self, count: u64) -> Result<bool, ReadError> {
        let skipped = io::copy(&mut self.input.by_ref().take(count), &mut io::sink())?;
        self.offset += skipped;
        Ok(skipped == count)
    }

    /// Reads bytes as they come, so that a false length reserves no memory.
    fn take(&mut self, count: u64) -> Result<Next<Vec<u8>>, ReadError> {
        let mut bytes = Vec::new();
        self.input.by_ref().take(count).read_to_end(&mut bytes)?;
        self.offset += bytes.len() as u64;
        Ok(if bytes.len() as u64 == count { Next::Whole(bytes) } else { Next::Cut })
    }
}

/// What a control record says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Control {
    /// Records of `entry` follow.
    Start { entry: u32, name: String, kind: String, metadata: String },
    /// Nothing that matters here.
    Other,
}

impl Control {
    /// Reads a control record's payload; nothing if it breaks off or is of no known kind.
    pub(super) fn parse(payload: &[u8]) -> Option<Self> {
        let (kind, rest) = payload.split_first()?;
        match kind {
            0 => {
                let (entry, rest) = rest.split_first_chunk::<4>()?;
                let (name, rest) = text(rest)?;
                let (kind, rest) = text(rest)?;
                let (metadata, _) = text(rest)?;
                Some(Self::Start { entry: u32::from_le_bytes(*entry), name, kind, metadata })
            }
            1 | 2 => Some(Self::Other),
            _ => None,
        }
    }
}

/// A text with its length in front, and what follows it.
fn text(bytes: &[u8]) -> Option<(String, &[u8])> {
    let (length, rest) = bytes.split_first_chunk::<4>()?;
    let (text, rest) = rest.split_at_checked(usize::try_from(u32::from_le_bytes(*length)).ok()?)?;
    Some((String::from_utf8_lossy(text).into_owned(), rest))
}

fn little_endian(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |value, byte| value << 8 | u64::from(*byte))
}

/// An error at a byte of the file.
pub(super) fn malformed(offset: u64, reason: String) -> ReadError {
    ReadError::Malformed { position: format!("byte {offset}"), reason }
}
