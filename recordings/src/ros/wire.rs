//! Bounded reading of serialized ROS messages: CDR as ROS 2 writes it, and the packed format of ROS 1.
//!
//! Both are flat sequences of little numbers. CDR starts with a four byte encapsulation header that names the byte order
//! and aligns each number to its own size, counted from behind that header; ROS 1 is little-endian and packed. Nothing
//! here allocates, and every read is checked against the end of the message.

use thiserror::Error;

/// How the bytes of a message are laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Encoding {
    /// OMG CDR with encapsulation header: ROS 2.
    Cdr,
    /// Little-endian and packed: ROS 1.
    Ros1,
}

impl Encoding {
    /// The encoding that MCAP's `message_encoding` and rosbag2's `serialization_format` name.
    pub(crate) fn named(name: &str) -> Option<Self> {
        match name {
            "cdr" => Some(Self::Cdr),
            "ros1" => Some(Self::Ros1),
            _ => None,
        }
    }
}

/// Why the bytes of a message are not what its type says.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub(crate) enum WireError {
    /// The message ends inside a field.
    #[error("{needed} bytes are needed at byte {at}, the message has {len}: cut off, or not the standard definition of its type")]
    Short { at: usize, needed: usize, len: usize },
    /// An encapsulation other than plain XCDR1.
    #[error("encapsulation {0:02x} {1:02x} ({name}) is not read; read are 00 00 and 00 01 (plain CDR)", name = encapsulation(*.0, *.1))]
    Encapsulation(u8, u8),
    /// Bytes are left over.
    #[error("{left} bytes are left over after the last field: not the standard definition of its type")]
    LeftOver { left: usize },
    /// Nanoseconds of a stamp beyond a second.
    #[error("header stamp with {0} nanoseconds; at most 999999999 are valid")]
    Nanoseconds(u32),
    /// Larger than any message of the types that are read.
    #[error("{0} bytes, far more than a message of its type has")]
    Huge(u64),
    /// A time no 64 bit signed nanosecond count holds.
    #[error("log time {0} ns lies beyond the year 2262")]
    LogTime(u64),
    /// A compressed message that does not decompress.
    #[error("the zstd frame of the message does not decompress: {0}")]
    Zstd(String),
}

fn encapsulation(first: u8, second: u8) -> &'static str {
    match (first, second) {
        (0, 2 | 3) => "parameter list",
        (0, 6..=11) => "XCDR2",
        _ => "unknown",
    }
}

/// Reads the fields of one message in order.
pub(crate) struct Wire<'a> {
    bytes: &'a [u8],
    at: usize,
    encoding: Encoding,
    big_endian: bool,
}

impl<'a> Wire<'a> {
    /// Starts behind the encapsulation header, if the encoding has one.
    pub(crate) fn new(encoding: Encoding, message: &'a [u8]) -> Result<Self, WireError> {
        match encoding {
            Encoding::Ros1 => Ok(Self { bytes: message, at: 0, encoding, big_endian: false }),
            Encoding::Cdr => match message {
                [0, order @ (0 | 1), _, _, body @ ..] => Ok(Self { bytes: body, at: 0, encoding, big_endian: *order == 0 }),
                [first, second, _, _, ..] => Err(WireError::Encapsulation(*first, *second)),
                _ => Err(WireError::Short { at: 0, needed: 4, len: message.len() }),
            },
        }
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], WireError> {
        if self.encoding == Encoding::Cdr {
            self.at = self.at.next_multiple_of(N.max(1));
        }
        let short = WireError::Short { at: self.at, needed: N, len: self.bytes.len() };
        let found = self.bytes.get(self.at..).and_then(|rest| rest.first_chunk::<N>()).ok_or(short)?;
        self.at += N;
        Ok(*found)
    }

    /// An unsigned 32 bit number.
    pub(crate) fn u32(&mut self) -> Result<u32, WireError> {
        let bytes = self.take()?;
        Ok(if self.big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    /// A 64 bit floating point number.
    pub(crate) fn f64(&mut self) -> Result<f64, WireError> {
        let bytes = self.take()?;
        Ok(if self.big_endian { f64::from_be_bytes(bytes) } else { f64::from_le_bytes(bytes) })
    }

    /// `N` of them.
    pub(crate) fn f64s<const N: usize>(&mut self) -> Result<[f64; N], WireError> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Ok(values)
    }

    /// Passes over a text.
    pub(crate) fn skip_text(&mut self) -> Result<(), WireError> {
        let length = self.u32()? as usize;
        if length > self.bytes.len() - self.at {
            return Err(WireError::Short { at: self.at, needed: length, len: self.bytes.len() });
        }
        self.at += length;
        Ok(())
    }

    /// Passes over a `std_msgs/Header` and gives its stamp \[ns\].
    pub(crate) fn header(&mut self) -> Result<i64, WireError> {
        if self.encoding == Encoding::Ros1 {
            self.u32()?; // sequence number, dropped in ROS 2
        }
        let seconds = self.u32()?;
        let nanoseconds = self.u32()?;
        self.skip_text()?;
        if nanoseconds > 999_999_999 {
            return Err(WireError::Nanoseconds(nanoseconds));
        }
        // ROS 2 seconds are signed, those of ROS 1 are not.
        let seconds = if self.encoding == Encoding::Ros1 { i64::from(seconds) } else { i64::from(seconds.cast_signed()) };
        Ok(seconds * 1_000_000_000 + i64::from(nanoseconds))
    }

    /// Checks that the message ends here; CDR writers may pad to their alignment.
    pub(crate) fn end(self) -> Result<(), WireError> {
        let left = self.bytes.len() - self.at;
        let padding = if self.encoding == Encoding::Cdr { 7 } else { 0 };
        if left > padding { Err(WireError::LeftOver { left }) } else { Ok(()) }
    }
}
