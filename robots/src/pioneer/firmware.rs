//! The configuration packet: limits, accelerations, gains and periods that the firmware works with.
//!
//! Order of the fields: AriaCoda `ArRobotConfigPacketReader.cpp`; Pioneer 3 Operations Manual, CONFIGpac.

use super::packet::Packet;

/// Type of a configuration packet.
pub const CONFIG: u8 = 0x20;

/// What the firmware says of its settings. 0 stands for what it does not know.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Firmware {
    /// Type, subtype and serial number.
    pub robot: [String; 3],
    /// Highest settable angular velocity \[°/s\].
    pub rotation_top: u16,
    /// Highest settable velocity \[mm/s\].
    pub translation_top: u16,
    /// Highest settable angular acceleration \[°/s²\].
    pub rotation_acceleration_top: u16,
    /// Highest settable acceleration \[mm/s²\].
    pub translation_acceleration_top: u16,
    /// Name given by the owner.
    pub name: String,
    /// Time between two information packets \[ms\].
    pub cycle: u8,
    /// Silence after which the robot stops \[ms\].
    pub watchdog: u16,
    /// Angular velocity limit \[°/s\].
    pub rotation_limit: u16,
    /// Velocity limit \[mm/s\].
    pub translation_limit: u16,
    /// Angular acceleration and deceleration of the set point's ramp \[°/s²\].
    pub rotation_ramp: [u16; 2],
    /// Gains of the rotation loop: Kp, Kv, Ki.
    pub rotation_gains: [u16; 3],
    /// Acceleration and deceleration of the set point's ramp \[mm/s²\].
    pub translation_ramp: [u16; 2],
    /// Gains of the translation loop: Kp, Kv, Ki.
    pub translation_gains: [u16; 3],
    /// Encoder ticks a millimetre.
    pub ticks_per_mm: u16,
    /// Version of the firmware.
    pub version: String,
}

impl Firmware {
    /// Reads a packet; `None` if it is another one or ends before the ramps. What an older firmware leaves out stays 0.
    pub fn decode(packet: &Packet) -> Option<Self> {
        if packet.kind != CONFIG {
            return None;
        }
        let mut fields = Fields(&packet.data);
        let robot = [fields.text()?, fields.text()?, fields.text()?];
        fields.skip(1)?;
        let tops = fields.words::<4>()?;
        fields.skip(2)?;
        let name = fields.text()?;
        let cycle = fields.byte()?;
        // Host and auxiliary baud rates, gripper, front and rear sonar, low battery, counts a revolution.
        fields.skip(2 + 2 + 2 + 1 + 2 + 2)?;
        let watchdog = fields.word()?;
        // P2 packets, stall value and count, joystick speeds.
        fields.skip(1 + 4 * 2)?;
        let [rotation_limit, translation_limit, rotation_up, rotation_down] = fields.words()?;
        let rotation_gains = fields.words()?;
        let translation_ramp = fields.words()?;
        let translation_gains = fields.words().unwrap_or_default();
        // Bumpers, charger, sonar cycle, auto baud, gyro, drift factor, two baud rates.
        let ticks_per_mm = fields.skip(6 + 2 + 2).and_then(|()| fields.word()).unwrap_or_default();
        let version = fields.skip(2).and_then(|()| fields.text()).unwrap_or_default();
        Some(Self {
            robot,
            rotation_top: tops[0],
            translation_top: tops[1],
            rotation_acceleration_top: tops[2],
            translation_acceleration_top: tops[3],
            name,
            cycle,
            watchdog,
            rotation_limit,
            translation_limit,
            rotation_ramp: [rotation_up, rotation_down],
            rotation_gains,
            translation_ramp,
            translation_gains,
            ticks_per_mm,
            version,
        })
    }

    /// The packet, with everything not held here 0.
    pub fn encode(&self) -> Packet {
        let mut data = Vec::new();
        let text = |data: &mut Vec<u8>, text: &str| {
            data.extend(text.bytes().filter(|b| *b != 0));
            data.push(0);
        };
        let words = |data: &mut Vec<u8>, words: &[u16]| words.iter().for_each(|w| data.extend_from_slice(&w.to_le_bytes()));
        let zeros = |data: &mut Vec<u8>, count: usize| data.resize(data.len() + count, 0);
        self.robot.iter().for_each(|t| text(&mut data, t));
        zeros(&mut data, 1);
        let tops = [self.rotation_top, self.translation_top, self.rotation_acceleration_top, self.translation_acceleration_top];
        words(&mut data, &tops);
        zeros(&mut data, 2);
        text(&mut data, &self.name);
        data.push(self.cycle);
        zeros(&mut data, 11);
        words(&mut data, &[self.watchdog]);
        zeros(&mut data, 9);
        words(&mut data, &[self.rotation_limit, self.translation_limit]);
        words(&mut data, &self.rotation_ramp);
        words(&mut data, &self.rotation_gains);
        words(&mut data, &self.translation_ramp);
        words(&mut data, &self.translation_gains);
        zeros(&mut data, 10);
        words(&mut data, &[self.ticks_per_mm, 0]);
        text(&mut data, &self.version);
        // Gyro factors and delays.
        zeros(&mut data, 14);
        Packet { kind: CONFIG, data }
    }
}

/// Fields one after the other.
struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn byte(&mut self) -> Option<u8> {
        let (first, rest) = self.0.split_first()?;
        self.0 = rest;
        Some(*first)
    }

    fn word(&mut self) -> Option<u16> {
        Some(u16::from_le_bytes([self.byte()?, self.byte()?]))
    }

    fn words<const N: usize>(&mut self) -> Option<[u16; N]> {
        let mut words = [0; N];
        for word in &mut words {
            *word = self.word()?;
        }
        Some(words)
    }

    fn text(&mut self) -> Option<String> {
        let end = self.0.iter().position(|b| *b == 0)?;
        let text = String::from_utf8_lossy(&self.0[..end]).into_owned();
        self.0 = &self.0[end + 1..];
        Some(text)
    }

    fn skip(&mut self, count: usize) -> Option<()> {
        self.0 = self.0.get(count..)?;
        Some(())
    }
}
