//! The packet codec of ARCOS, AROS and P2OS: header, count, type, data, checksum.
//!
//! `FA FB COUNT TYPE DATA.. CHECKSUM`, where COUNT is the number of bytes that follow it and the checksum is the only
//! big-endian number (Pioneer 3 Operations Manual; AriaCoda `ArRobotPacket.cpp`).

const HEADER: [u8; 2] = [0xFA, 0xFB];
/// COUNT of the shortest packet: its type and the checksum.
const LEAST_COUNT: u8 = 3;
/// Most bytes of data that one packet holds; ARCOS takes 249, P2OS 200.
pub const MOST_DATA: usize = 200;

/// A packet without its frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Packet {
    /// Command number of a client's packet, packet type of a server's.
    pub kind: u8,
    /// What follows the type, without the checksum.
    pub data: Vec<u8>,
}

/// Frames a packet. Data beyond [`MOST_DATA`] is left out, as no robot would take it.
pub fn encode(kind: u8, data: &[u8]) -> Vec<u8> {
    let data = &data[..data.len().min(MOST_DATA)];
    let mut packet = Vec::with_capacity(data.len() + 6);
    packet.extend_from_slice(&HEADER);
    packet.push(data.len() as u8 + LEAST_COUNT);
    packet.push(kind);
    packet.extend_from_slice(data);
    let sum = checksum(&packet[3..]);
    packet.extend_from_slice(&sum.to_be_bytes());
    packet
}

/// Sum of the big-endian words modulo 2^16; a byte left over is xored into the low byte.
pub fn checksum(bytes: &[u8]) -> u16 {
    let words = bytes.chunks_exact(2);
    let left = words.remainder().first().copied().unwrap_or(0);
    words.fold(0_u16, |sum, word| sum.wrapping_add(u16::from_be_bytes([word[0], word[1]]))) ^ u16::from(left)
}

/// Finds packets in a stream of bytes, whatever else is in it.
///
/// After a wrong checksum only the header is skipped, so that a packet hidden in a false one is still found.
#[derive(Debug, Clone, Default)]
pub struct Decoder {
    buffer: Vec<u8>,
    rejected: u64,
    skipped: u64,
}

impl Decoder {
    /// Takes bytes from the line.
    pub fn push(&mut self, bytes: &[u8]) {
        self.buffer.extend_from_slice(bytes);
    }

    /// The next whole packet with a right checksum.
    pub fn next_packet(&mut self) -> Option<Packet> {
        loop {
            self.skip_to_header();
            let &[_, _, count, ..] = self.buffer.as_slice() else { return None };
            let end = 3 + usize::from(count);
            if count < LEAST_COUNT {
                self.reject();
                continue;
            }
            let packet = self.buffer.get(3..end)?;
            let (body, sum) = packet.split_at(packet.len() - 2);
            if checksum(body).to_be_bytes() != sum {
                self.reject();
                continue;
            }
            let packet = Packet { kind: body[0], data: body[1..].to_vec() };
            self.buffer.drain(..end);
            return Some(packet);
        }
    }

    /// Frames rejected for a wrong checksum or count, and bytes that belonged to no frame.
    pub fn damage(&self) -> u64 {
        self.rejected + self.skipped
    }

    /// Forgets what has come of the next packet.
    pub fn clear(&mut self) {
        self.buffer.clear();
    }

    fn reject(&mut self) {
        self.rejected += 1;
        self.buffer.drain(..HEADER.len());
    }

    /// Drops everything before the next header, or before what may become one.
    fn skip_to_header(&mut self) {
        let found = self.buffer.windows(2).position(|pair| pair == HEADER);
        let begun = usize::from(self.buffer.last() == Some(&HEADER[0]));
        let skip = found.unwrap_or(self.buffer.len() - begun);
        self.skipped += skip as u64;
        self.buffer.drain(..skip);
    }
}
