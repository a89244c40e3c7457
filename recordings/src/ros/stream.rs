//! Reading binary records forward, with the position for messages and without trust in any length.

use std::io::{self, Read};

/// Counts the bytes that pass.
pub(crate) struct Counted<R> {
    /// Where they come from.
    pub(crate) inner: R,
    /// Bytes read so far.
    pub(crate) at: u64,
}

impl<R: Read> Counted<R> {
    pub(crate) fn new(inner: R) -> Self {
        Self { inner, at: 0 }
    }
}

impl<R: Read> Read for Counted<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.inner.read(buffer)?;
        self.at += read as u64;
        Ok(read)
    }
}

/// Most bytes that are allocated before they were seen to exist.
const TRUSTED: u64 = 64 * 1024;

/// Replaces `buffer` by the next `length` bytes; false if the data end before. A claimed length is believed only as the
/// bytes arrive.
pub(crate) fn fill(reader: &mut impl Read, buffer: &mut Vec<u8>, length: u64) -> io::Result<bool> {
    buffer.clear();
    if length > TRUSTED {
        return Ok(reader.take(length).read_to_end(buffer)? as u64 == length);
    }
    buffer.resize(length as usize, 0);
    whole(reader.read_exact(buffer))
}

/// The next `N` bytes, or none if the data end before.
pub(crate) fn array<const N: usize>(reader: &mut impl Read) -> io::Result<Option<[u8; N]>> {
    let mut bytes = [0; N];
    Ok(whole(reader.read_exact(&mut bytes))?.then_some(bytes))
}

fn whole(outcome: io::Result<()>) -> io::Result<bool> {
    match outcome {
        Ok(()) => Ok(true),
        Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => Ok(false),
        Err(e) => Err(e),
    }
}

/// Passes over `length` bytes; false if the data end before.
pub(crate) fn skip(reader: &mut impl Read, length: u64) -> io::Result<bool> {
    Ok(io::copy(&mut reader.take(length), &mut io::sink())? == length)
}

/// Little-endian fields of a record that is in memory.
pub(crate) struct Fields<'a>(pub(crate) &'a [u8]);

impl<'a> Fields<'a> {
    /// The next `length` bytes, or none beyond the end.
    pub(crate) fn bytes(&mut self, length: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(taken)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (taken, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*taken)
    }

    pub(crate) fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub(crate) fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub(crate) fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// A text after its length in 32 bits.
    pub(crate) fn text(&mut self) -> Option<&'a str> {
        let length = self.u32()?;
        std::str::from_utf8(self.bytes(length as usize)?).ok()
    }
}
