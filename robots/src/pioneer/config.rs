//! `type = "pioneer"`: where the robot is and how it is to be driven.

use serde::{Deserialize, Serialize};
use wheelwright_core::profile::Limits;
use wheelwright_core::robot::{Robot, RobotConfig, RobotError};

use super::Pioneer;
use super::conversion::Conversion;
use crate::wire::{Clock, Endpoint, check_limits, check_time, config};

/// A Pioneer or a relative of it, over TCP or a serial line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PioneerConfig {
    /// `host:port` of a simulator, a wireless adapter or a serial bridge.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tcp: Option<String>,
    /// Serial device.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// Bits a second of the serial line.
    pub baud: u32,
    /// Which commands carry the velocities.
    pub command: CommandKind,
    /// Control period \[s\], a multiple of the robot's cycle; the cycle itself if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub period: Option<f64>,
    /// Clamps of this driver and of the firmware. `v_dot` and `omega_dot` set the firmware's ramp.
    #[serde(skip_serializing_if = "Limits::is_empty")]
    pub limits: Limits,
    /// Where the angular velocity comes from.
    pub omega: OmegaSource,
    /// Ask for encoder packets and report the wheels' paths.
    pub encoders: bool,
    /// Subclass whose factors hold, if the robot's own name is not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub subclass: Option<String>,
    /// Factors for a robot that is like none of the known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub conversion: Option<Conversion>,
    /// Silence after which the robot is given up \[s\]; it is told to stand after two cycles.
    pub timeout: f64,
    /// How time passes.
    pub clock: Clock,
}

impl Default for PioneerConfig {
    fn default() -> Self {
        Self {
            tcp: None,
            serial: None,
            baud: 9600,
            command: CommandKind::Vel,
            period: None,
            limits: Limits::default(),
            omega: OmegaSource::Rotvel,
            encoders: false,
            subclass: None,
            conversion: None,
            timeout: 1.0,
            clock: Clock::Real,
        }
    }
}

/// Which commands carry the velocities.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CommandKind {
    /// VEL and RVEL: 1 mm/s and 1 °/s.
    Vel,
    /// VEL2: 20 mm/s on each side.
    Vel2,
}

/// Where the angular velocity comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OmegaSource {
    /// The packet's ROTVEL, 0.1 °/s; the wheels where the firmware has none.
    Rotvel,
    /// The wheels' speeds and DiffConvFactor.
    Wheels,
}

/// Speeds that no robot of the family exceeds; firmware and configuration may only lower them.
pub(super) const FASTEST: [f64; 2] = [1.4, 5.2];

#[typetag::serde(name = "pioneer")]
impl RobotConfig for PioneerConfig {
    fn about(&self) -> String {
        "Pioneer, AmigoBot, PeopleBot: ARCOS, AROS or P2OS over TCP or a serial line".to_owned()
    }

    fn connect(&self, _seed: u64) -> Result<Box<dyn Robot>, RobotError> {
        self.check()?;
        Ok(Box::new(Pioneer::connect(self)?))
    }
}

impl PioneerConfig {
    /// Where the robot is.
    pub(super) fn endpoint(&self) -> Result<Endpoint, RobotError> {
        Endpoint::new(self.tcp.as_deref(), self.serial.as_deref(), self.baud)
    }

    fn check(&self) -> Result<(), RobotError> {
        self.endpoint()?;
        check_limits(&self.limits)?;
        check_time("timeout", self.timeout)?;
        self.period.map_or(Ok(()), |period| check_time("period", period))?;
        if self.limits.wheel_speed.is_some() {
            return Err(config("limits.wheel_speed", "is not known to the robot's firmware: limit v and omega"));
        }
        self.conversion.map_or(Ok(()), |conversion| conversion.check())
    }
}
