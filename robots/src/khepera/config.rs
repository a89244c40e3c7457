//! `type = "khepera"`: where the robot is and how it is to be driven.

use serde::{Deserialize, Serialize};
use wheelwright_core::profile::Limits;
use wheelwright_core::robot::{Robot, RobotConfig, RobotError};

use super::Khepera;
use super::dialect::{Dialect, Generation};
use crate::wire::{Clock, Endpoint, check_limits, check_time, config};

/// A Khepera III or IV, over a serial line, a pseudo terminal or TCP.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct KheperaConfig {
    /// `host:port` of a serial bridge or an emulator.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tcp: Option<String>,
    /// Serial device or pseudo terminal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// Bits a second of the serial line.
    pub baud: u32,
    /// Control period \[s\].
    pub period: f64,
    /// Which robot; by its answer to `B` if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub generation: Option<Generation>,
    /// Clamps of this driver: `v`, `omega`, `wheel_speed`.
    #[serde(skip_serializing_if = "Limits::is_empty")]
    pub limits: Limits,
    /// Distance between the wheels \[m\]; the robot's nominal one if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub track_width: Option<f64>,
    /// Radius of the wheels \[m\], which scales speeds and encoders; the nominal one if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wheel_radius: Option<f64>,
    /// The left wheel counts backwards.
    pub reverse_left: bool,
    /// The right wheel counts backwards.
    pub reverse_right: bool,
    /// How long an answer is waited for \[s\].
    pub timeout: f64,
    /// How time passes.
    pub clock: Clock,
}

impl Default for KheperaConfig {
    fn default() -> Self {
        Self {
            tcp: None,
            serial: None,
            baud: 115_200,
            period: 0.02,
            generation: None,
            limits: Limits::default(),
            track_width: None,
            wheel_radius: None,
            reverse_left: false,
            reverse_right: false,
            timeout: 0.2,
            clock: Clock::Real,
        }
    }
}

#[typetag::serde(name = "khepera")]
impl RobotConfig for KheperaConfig {
    fn about(&self) -> String {
        "Khepera III and IV: K-Team's text protocol over a serial line, a pseudo terminal or TCP".to_owned()
    }

    fn connect(&self, _seed: u64) -> Result<Box<dyn Robot>, RobotError> {
        self.check()?;
        Ok(Box::new(Khepera::connect(self)?))
    }
}

impl KheperaConfig {
    /// Where the robot is.
    pub(super) fn endpoint(&self) -> Result<Endpoint, RobotError> {
        Endpoint::new(self.tcp.as_deref(), self.serial.as_deref(), self.baud)
    }

    /// The dialect with this robot's own dimensions.
    pub(super) fn adapt(&self, dialect: Dialect) -> Dialect {
        let radius = self.wheel_radius.unwrap_or(dialect.radius);
        let scale = radius / dialect.radius;
        Dialect {
            speed: dialect.speed / scale,
            pulse: dialect.pulse * scale,
            track: self.track_width.unwrap_or(dialect.track),
            radius,
            ..dialect
        }
    }

    fn check(&self) -> Result<(), RobotError> {
        self.endpoint()?;
        check_limits(&self.limits)?;
        check_time("timeout", self.timeout)?;
        check_time("period", self.period)?;
        for (key, value) in [("track_width", self.track_width), ("wheel_radius", self.wheel_radius)] {
            if let Some(value) = value.filter(|v| !v.is_finite() || *v <= 0.0) {
                return Err(config(key, format!("must be a positive number, not {value}")));
            }
        }
        for (key, value) in [("limits.v_dot", self.limits.v_dot), ("limits.omega_dot", self.limits.omega_dot)] {
            if value.is_some() {
                return Err(config(key, "cannot be set: the robot has no ramp on its speeds"));
            }
        }
        Ok(())
    }
}
