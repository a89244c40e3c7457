//! Commands to the robot, and their arguments.

use super::packet::{Packet, encode};

/// Command numbers (AriaCoda `ArCommands.h`; Pioneer 3 Operations Manual).
pub mod number {
    #![allow(missing_docs)]
    pub const PULSE: u8 = 0;
    pub const SYNC0: u8 = 0;
    pub const OPEN: u8 = 1;
    pub const SYNC1: u8 = 1;
    pub const CLOSE: u8 = 2;
    pub const SYNC2: u8 = 2;
    pub const ENABLE: u8 = 4;
    pub const SETA: u8 = 5;
    pub const SETV: u8 = 6;
    pub const SETO: u8 = 7;
    pub const ROTATE: u8 = 9;
    pub const SETRV: u8 = 10;
    pub const VEL: u8 = 11;
    pub const CONFIG: u8 = 18;
    pub const ENCODER: u8 = 19;
    pub const RVEL: u8 = 21;
    pub const SETRA: u8 = 23;
    pub const SONAR: u8 = 28;
    pub const STOP: u8 = 29;
    pub const VEL2: u8 = 32;
    pub const ESTOP: u8 = 55;
    /// Lets one server cycle pass in an emulator with a stepped clock; no real robot knows it.
    pub const STEP: u8 = 238;
}

const POSITIVE: u8 = 0x3B;
const NEGATIVE: u8 = 0x1B;
const TEXT: u8 = 0x2B;

/// A command without an argument.
pub fn plain(command: u8) -> Vec<u8> {
    encode(command, &[])
}

/// A command with an integer: a sign byte and the magnitude, which ends at 65535.
pub fn integer(command: u8, value: i32) -> Vec<u8> {
    let sign = if value < 0 { NEGATIVE } else { POSITIVE };
    let [low, high] = u16::try_from(value.unsigned_abs()).unwrap_or(u16::MAX).to_le_bytes();
    encode(command, &[sign, low, high])
}

/// VEL2: the right wheels in the low byte, the left ones in the high byte, in units of the robot's Vel2Divisor.
pub fn vel2(left: i8, right: i8) -> Vec<u8> {
    encode(number::VEL2, &[POSITIVE, right.to_le_bytes()[0], left.to_le_bytes()[0]])
}

/// Argument of a client's packet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Argument {
    /// Nothing, or nothing that can be read.
    None,
    /// A signed integer.
    Integer(i32),
    /// A text.
    Text(Vec<u8>),
}

impl Argument {
    /// Reads the argument of a packet.
    pub fn of(packet: &Packet) -> Self {
        match packet.data.as_slice() {
            [POSITIVE, low, high, ..] => Self::Integer(i32::from(u16::from_le_bytes([*low, *high]))),
            [NEGATIVE, low, high, ..] => Self::Integer(-i32::from(u16::from_le_bytes([*low, *high]))),
            [TEXT, length, text @ ..] if text.len() >= usize::from(*length) => Self::Text(text[..usize::from(*length)].to_vec()),
            _ => Self::None,
        }
    }

    /// The integer, if it is one.
    pub fn integer(&self) -> Option<i32> {
        if let Self::Integer(value) = self { Some(*value) } else { None }
    }

    /// Two signed bytes, low and high. A client may send the same sixteen bits as a negative integer.
    pub fn bytes(&self) -> Option<[i8; 2]> {
        let [low, high, ..] = self.integer()?.to_le_bytes();
        Some([i8::from_le_bytes([low]), i8::from_le_bytes([high])])
    }
}
