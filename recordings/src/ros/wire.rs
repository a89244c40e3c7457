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

    /// Passes over `N` of them.
    pub(crate) fn skip_f64s<const N: usize>(&mut self) -> Result<(), WireError> {
        self.f64()?;
        let rest = (N - 1) * size_of::<f64>();
        if rest > self.bytes.len() - self.at {
            return Err(WireError::Short { at: self.at, needed: rest, len: self.bytes.len() });
        }
        self.at += rest;
        Ok(())
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

#[cfg(test)]
mod tests {
    use super::super::message::{Kind, Pose};
    use super::*;
    use proptest::prelude::*;

    /// `rosbags.typesys.get_typestore(Stores.ROS2_HUMBLE).serialize_cdr(TwistStamped(...), little_endian=False)` with stamp
    /// 3.000000007 s, frame `ab`, linear.x 1.5, angular.z -0.25.
    const STAMPED_BIG_ENDIAN: &str = "00000000000000030000000700000003616200003ff80000000000000000000000000000000000000000000000000000000000000000000000000000bfd0000000000000";

    fn bytes(hex: &str) -> Vec<u8> {
        (0..hex.len()).step_by(2).map(|i| u8::from_str_radix(&hex[i..i + 2], 16).unwrap()).collect()
    }

    #[test]
    fn big_endian_messages_of_another_writer_are_read() {
        let motion = Kind::TwistStamped.decode(Encoding::Cdr, &bytes(STAMPED_BIG_ENDIAN)).unwrap();
        assert_eq!((motion.stamp, motion.v, motion.omega), (Some(3_000_000_007), 1.5, -0.25));
        assert_eq!(motion.pose, Pose::default());
    }

    #[test]
    fn other_encapsulations_are_refused_by_name() {
        for (second, name) in [(3, "parameter list"), (6, "XCDR2"), (11, "XCDR2"), (77, "unknown")] {
            let error = Kind::Twist.decode(Encoding::Cdr, &[0, second, 0, 0, 1, 2, 3, 4]).unwrap_err().to_string();
            assert!(error.contains(&format!("encapsulation 00 {second:02x} ({name}) is not read")), "{error}");
        }
    }

    #[test]
    fn messages_cut_at_any_byte_and_longer_ones_are_refused() {
        let whole = bytes(STAMPED_BIG_ENDIAN);
        for cut in 0..whole.len() {
            assert!(matches!(Kind::TwistStamped.decode(Encoding::Cdr, &whole[..cut]), Err(WireError::Short { .. })), "{cut}");
        }
        let longer = [whole, vec![0; 8]].concat();
        assert_eq!(Kind::TwistStamped.decode(Encoding::Cdr, &longer), Err(WireError::LeftOver { left: 8 }));
        assert_eq!(Kind::Twist.decode(Encoding::Ros1, &[0; 49]), Err(WireError::LeftOver { left: 1 }));
    }

    #[test]
    fn a_text_that_claims_to_be_huge_is_refused() {
        let mut message = bytes(STAMPED_BIG_ENDIAN);
        message[12..16].copy_from_slice(&u32::MAX.to_be_bytes());
        let error = Kind::TwistStamped.decode(Encoding::Cdr, &message).unwrap_err();
        assert!(matches!(error, WireError::Short { needed: 0xffff_ffff, .. }), "{error}");
    }

    proptest! {
        #[test]
        fn no_bytes_panic(first in 0u8..2, second in 0u8..3, rest in prop::collection::vec(any::<u8>(), 0..900)) {
            let message = [&[first, second, 0, 0], rest.as_slice()].concat();
            for kind in [Kind::Twist, Kind::TwistStamped, Kind::Odometry] {
                let _any = kind.decode(Encoding::Cdr, &message);
                let _any = kind.decode(Encoding::Ros1, &message);
            }
        }
    }
}
