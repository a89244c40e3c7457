//! Channels: the named, unit-carrying signals that models, robots and recordings speak of.

use std::borrow::Cow;
use std::fmt;

/// A signal by name and unit. `core` knows no signal but by these two.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Channel {
    /// Name as a recording's column or a configuration spells it, such as `v_ref`.
    pub name: Cow<'static, str>,
    /// SI unit as printed on an axis, such as `m/s`.
    pub unit: Cow<'static, str>,
}

impl Channel {
    /// A channel known at compile time.
    pub const fn new(name: &'static str, unit: &'static str) -> Self {
        Self { name: Cow::Borrowed(name), unit: Cow::Borrowed(unit) }
    }

    /// A channel named at run time, by a configuration or a plugin.
    pub fn owned(name: impl Into<String>, unit: impl Into<String>) -> Self {
        Self { name: Cow::Owned(name.into()), unit: Cow::Owned(unit.into()) }
    }
}

impl fmt::Display for Channel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} [{}]", self.name, self.unit)
    }
}

/// Commanded forward velocity.
pub const V_REF: Channel = Channel::new("v_ref", "m/s");
/// Commanded angular velocity, counter-clockwise positive.
pub const OMEGA_REF: Channel = Channel::new("omega_ref", "rad/s");
/// Measured forward velocity of the axle's midpoint.
pub const V: Channel = Channel::new("v", "m/s");
/// Measured angular velocity, counter-clockwise positive.
pub const OMEGA: Channel = Channel::new("omega", "rad/s");
/// Position of the axle's midpoint along x.
pub const X: Channel = Channel::new("x", "m");
/// Position of the axle's midpoint along y.
pub const Y: Channel = Channel::new("y", "m");
/// Heading, counter-clockwise positive, not wrapped.
pub const PHI: Channel = Channel::new("phi", "rad");
/// Speed of the left wheel about its axle.
pub const OMEGA_LEFT: Channel = Channel::new("omega_left", "rad/s");
/// Speed of the right wheel about its axle.
pub const OMEGA_RIGHT: Channel = Channel::new("omega_right", "rad/s");
/// Voltage applied to the left motor.
pub const U_LEFT: Channel = Channel::new("u_left", "V");
/// Voltage applied to the right motor.
pub const U_RIGHT: Channel = Channel::new("u_right", "V");
/// Ground speed of the left wheels.
pub const VEL_LEFT: Channel = Channel::new("vel_left", "m/s");
/// Ground speed of the right wheels.
pub const VEL_RIGHT: Channel = Channel::new("vel_right", "m/s");

/// The SI unit of a standard column name, or an empty text for a column the contract does not name.
pub fn unit_of(name: &str) -> &'static str {
    match name {
        "t" => "s",
        "v" | "v_ref" | "vel_left" | "vel_right" => "m/s",
        "omega" | "omega_ref" | "omega_left" | "omega_right" | "gyro_rate" => "rad/s",
        "x" | "y" | "pos_left" | "pos_right" => "m",
        "phi" | "gyro_angle" | "gyro" => "rad",
        "u_left" | "u_right" | "battery" => "V",
        _ => "",
    }
}
