//! What differs between the generations of the robot: units, prefixes, dimensions.

use serde::{Deserialize, Serialize};

/// Generation of a Khepera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Generation {
    /// Khepera III with motor firmware before 3.0: gear 43.2:1.
    #[serde(rename = "khepera-3-old")]
    ThreeOld,
    /// Khepera III with motor firmware 3.0 or later: gear 65.6:1.
    #[serde(rename = "khepera-3")]
    Three,
    /// Khepera IV.
    #[serde(rename = "khepera-4")]
    Four,
}

/// Units and words of a generation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dialect {
    /// Speed units a m/s.
    pub speed: f64,
    /// Metres a pulse of the encoders.
    pub pulse: f64,
    /// Distance between the wheels \[m\].
    pub track: f64,
    /// Radius of the wheels \[m\].
    pub radius: f64,
    /// Arguments of 32 bits bear an `l` before them.
    pub prefixes: bool,
    /// Highest speed that the motors' controllers hold \[units\].
    pub fastest: i32,
    /// Lowest speed that they hold \[units\].
    pub slowest: i32,
}

impl Generation {
    /// The generation by the robot's answer to `B`: version and revision. `None` if it is none of the known.
    pub fn of_version(version: &str) -> Option<Self> {
        let version = version.trim();
        match version.parse::<u32>() {
            Ok(1 | 2) => Some(Self::ThreeOld),
            Ok(3) => Some(Self::Three),
            Err(_) if version.len() == 1 && version.chars().all(|c| c.is_ascii_uppercase()) => Some(Self::Four),
            _ => None,
        }
    }

    /// Units and words. Sources: K-Team's example code and `kh3server.c`; Khepera III manual 2.2, p. 14 to 16;
    /// `kb_khepera4.h`.
    pub fn dialect(self) -> Dialect {
        let three = Dialect {
            speed: 144_010.0,
            // 128.8 mm a turn of the wheel; 16 lines, four edges, gear 43.2.
            pulse: 0.1288 / 2764.8,
            track: 0.0884,
            radius: 0.0205,
            prefixes: true,
            fastest: 43_000,
            slowest: 2000,
        };
        match self {
            Self::ThreeOld => three,
            Self::Three => Dialect { speed: 218_720.0, pulse: 0.1288 / 4198.4, ..three },
            Self::Four => Dialect {
                speed: 1.0 / 0.678_1e-3,
                pulse: 0.006_781e-3,
                track: 0.1054,
                // 42 mm wheels.
                radius: 0.021,
                prefixes: false,
                fastest: 1200,
                slowest: 0,
            },
        }
    }

    /// Version and revision as the robot answers to `B`.
    pub fn version(self) -> &'static str {
        match self {
            Self::ThreeOld => "2,0",
            Self::Three => "3,0",
            Self::Four => "A,1",
        }
    }
}

impl Dialect {
    /// An argument of 32 bits.
    pub fn long(&self, value: i32) -> String {
        if self.prefixes { format!("l{value}") } else { value.to_string() }
    }
}
