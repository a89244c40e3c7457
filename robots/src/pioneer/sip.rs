//! The standard server information packet: what the robot says of itself every cycle.
//!
//! Offsets and meanings: Pioneer 3 Operations Manual, standard SIP; AriaCoda `ArRobot::processMotorPacket`. Older firmware
//! stops early, so every field after the sonar readings may be missing.

use super::packet::Packet;

/// Type of a packet from a robot that stands.
pub const STOPPED: u8 = 0x32;
/// Type of a packet from a robot that moves.
pub const MOVING: u8 = 0x33;
/// Types that clients take for a standard packet.
const STANDARD: std::ops::RangeInclusive<u8> = 0x30..=0x34;

/// A standard server information packet in the robot's units.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Sip {
    /// The robot moves.
    pub moving: bool,
    /// Position; wraps. Times the robot's DistConvFactor it is in mm.
    pub x: i16,
    /// Position; wraps.
    pub y: i16,
    /// Heading in 1/4096 of a turn (pion1: 1/1024); wraps.
    pub heading: i16,
    /// Speed of the left wheels; times VelConvFactor in mm/s.
    pub left: i16,
    /// Speed of the right wheels.
    pub right: i16,
    /// Battery \[0.1 V\].
    pub battery: u8,
    /// Bit 0: left wheels stalled; bit 8: right wheels.
    pub stall: u16,
    /// Set point of the heading.
    pub control: i16,
    /// Bit 0: motors are powered.
    pub flags: u16,
    /// Compass \[2°\].
    pub compass: u8,
    /// Sonar readings: number and range.
    pub sonar: Vec<(u8, u16)>,
    /// Fields that newer firmware adds.
    pub tail: Option<Tail>,
}

/// What follows the sonar readings and the digital and analogue ports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tail {
    /// Battery \[0.1 V\], also above 25.5 V.
    pub battery: i16,
    /// Charger.
    pub charge: u8,
    /// Angular velocity \[0.1 °/s\]; AROS and older have none.
    pub rotation: Option<i16>,
    /// Faults; bit 0 is the emergency stop.
    pub faults: Option<u16>,
}

/// Data bytes up to and with the flags.
const LEAST: usize = 17;

impl Sip {
    /// Reads a packet; `None` if it is another packet or ends before the flags.
    pub fn decode(packet: &Packet) -> Option<Self> {
        let data = packet.data.as_slice();
        if !STANDARD.contains(&packet.kind) || data.len() < LEAST {
            return None;
        }
        let count = data.get(18).copied().map_or(0, usize::from);
        let sonar = data.get(19..19 + 3 * count).unwrap_or_default();
        let sonar = sonar.chunks_exact(3).map(|s| (s[0], u16::from_le_bytes([s[1], s[2]]))).collect();
        Some(Self {
            moving: packet.kind == MOVING,
            x: signed(data, 0)?,
            y: signed(data, 2)?,
            heading: signed(data, 4)?,
            left: signed(data, 6)?,
            right: signed(data, 8)?,
            battery: *data.get(10)?,
            stall: unsigned(data, 11)?,
            control: signed(data, 13)?,
            flags: unsigned(data, 15)?,
            compass: data.get(17).copied().unwrap_or(0),
            sonar,
            tail: Tail::decode(data, 24 + 3 * count),
        })
    }

    /// The packet's type and data, with grip and ports at rest.
    pub fn encode(&self) -> Packet {
        let mut data = Vec::with_capacity(40 + 3 * self.sonar.len());
        for value in [self.x, self.y, self.heading, self.left, self.right] {
            data.extend_from_slice(&value.to_le_bytes());
        }
        data.push(self.battery);
        data.extend_from_slice(&self.stall.to_le_bytes());
        data.extend_from_slice(&self.control.to_le_bytes());
        data.extend_from_slice(&self.flags.to_le_bytes());
        data.push(self.compass);
        data.push(self.sonar.len() as u8);
        for (number, range) in &self.sonar {
            data.push(*number);
            data.extend_from_slice(&range.to_le_bytes());
        }
        data.extend_from_slice(&[0, 0, 0, 0xFF, 0xFF]);
        if let Some(tail) = self.tail {
            data.extend_from_slice(&tail.battery.to_le_bytes());
            data.push(tail.charge);
            data.extend_from_slice(&tail.rotation.unwrap_or(0).to_le_bytes());
            data.extend_from_slice(&tail.faults.unwrap_or(0).to_le_bytes());
            // Lateral velocity, temperature (unknown) and state of charge.
            data.extend_from_slice(&[0, 0, 0x81, 0]);
        }
        Packet { kind: if self.moving { MOVING } else { STOPPED }, data }
    }

    /// The motors are powered.
    pub fn motors_on(&self) -> bool {
        self.flags & 1 != 0
    }

    /// Battery \[V\].
    pub fn volts(&self) -> f64 {
        0.1 * self.tail.map_or_else(|| f64::from(self.battery), |tail| f64::from(tail.battery))
    }
}

impl Tail {
    fn decode(data: &[u8], at: usize) -> Option<Self> {
        Some(Self {
            battery: signed(data, at)?,
            charge: *data.get(at + 2)?,
            rotation: signed(data, at + 3),
            faults: unsigned(data, at + 5),
        })
    }
}

/// Accumulated ticks of an encoder packet, left and right.
pub fn encoder_ticks(packet: &Packet) -> Option<[i32; 2]> {
    let word = |at: usize| packet.data.get(at..at + 4).and_then(|b| b.try_into().ok()).map(i32::from_le_bytes);
    if packet.kind == ENCODER { Some([word(0)?, word(4)?]) } else { None }
}

/// Type of an encoder packet.
pub const ENCODER: u8 = 0x90;

fn signed(data: &[u8], at: usize) -> Option<i16> {
    unsigned(data, at).map(u16::cast_signed)
}

fn unsigned(data: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes([*data.get(at)?, *data.get(at + 1)?]))
}
