//! `type = "ros2"`: which robot on which network, and how it is to be driven.

use std::net::Ipv4Addr;

use serde::{Deserialize, Serialize};
use wheelwright_core::profile::Limits;
use wheelwright_core::robot::{Robot, RobotConfig, RobotError};

use crate::wire::{Clock, check_limits, check_time, config};

/// Topic of the commands unless told otherwise.
pub(crate) const COMMAND_TOPIC: &str = "/cmd_vel";
/// Topic of the odometry unless told otherwise.
pub(crate) const ODOMETRY_TOPIC: &str = "/odom";
/// Highest domain whose ports exist.
const LAST_DOMAIN: u16 = 232;
/// The variable by which ROS 2 programs are told their domain.
const DOMAIN_VARIABLE: &str = "ROS_DOMAIN_ID";

/// A robot that takes Twist or TwistStamped and publishes Odometry over ROS 2.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Ros2Config {
    /// Where commands go.
    pub command_topic: String,
    /// Where odometry comes from.
    pub odometry_topic: String,
    /// Which message carries commands; what the robot subscribes if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub command_type: Option<CommandType>,
    /// DDS domain; that of the environment (`ROS_DOMAIN_ID`) or 0 if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub domain: Option<u16>,
    /// Addresses of this machine that are used; all of them if empty.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub interfaces: Vec<Ipv4Addr>,
    /// Control period \[s\], a multiple of the odometry's; the odometry's own if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub period: Option<f64>,
    /// What tells the time of a measurement; the stamps, if they can, if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time: Option<TimeSource>,
    /// Clamps of this driver: `v`, `omega`.
    #[serde(skip_serializing_if = "Limits::is_empty")]
    pub limits: Limits,
    /// How long the robot is looked for \[s\].
    pub discovery: f64,
    /// Silence after which the robot is given up \[s\]; it is told to stand after two periods, or after
    /// 0.1 s if these are shorter.
    pub timeout: f64,
    /// How time passes.
    pub clock: Clock,
}

impl Default for Ros2Config {
    fn default() -> Self {
        Self {
            command_topic: COMMAND_TOPIC.to_owned(),
            odometry_topic: ODOMETRY_TOPIC.to_owned(),
            command_type: None,
            domain: None,
            interfaces: Vec::new(),
            period: None,
            time: None,
            limits: Limits::default(),
            discovery: 15.0,
            timeout: 1.0,
            clock: Clock::Real,
        }
    }
}

/// The message that carries a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CommandType {
    /// `geometry_msgs/msg/Twist`
    #[default]
    Twist,
    /// `geometry_msgs/msg/TwistStamped`
    TwistStamped,
}

/// What tells the time of a measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TimeSource {
    /// `header.stamp`, the robot's own clock.
    Stamp,
    /// When the message arrived, by this machine's clock.
    Arrival,
}

#[typetag::serde(name = "ros2")]
impl RobotConfig for Ros2Config {
    fn about(&self) -> String {
        "ROS 2 robots: Twist or TwistStamped out, Odometry in, over DDS".to_owned()
    }

    #[cfg(feature = "ros2")]
    fn connect(&self, _seed: u64) -> Result<Box<dyn Robot>, RobotError> {
        let network = self.check()?;
        Ok(Box::new(super::driver::Ros2Robot::connect(self, &network)?))
    }

    #[cfg(not(feature = "ros2"))]
    fn connect(&self, _seed: u64) -> Result<Box<dyn Robot>, RobotError> {
        self.check()?;
        Err(without_feature())
    }
}

impl Ros2Config {
    fn check(&self) -> Result<Network, RobotError> {
        check_topic("command_topic", &self.command_topic)?;
        check_topic("odometry_topic", &self.odometry_topic)?;
        check_limits(&self.limits)?;
        check_time("discovery", self.discovery)?;
        check_time("timeout", self.timeout)?;
        self.period.map_or(Ok(()), |period| check_time("period", period))?;
        if self.clock == Clock::Stepped && self.period.is_none() {
            return Err(config("period", "is needed with clock = \"stepped\": the cycle of the emulator"));
        }
        let others = [
            ("limits.v_dot", self.limits.v_dot),
            ("limits.omega_dot", self.limits.omega_dot),
            ("limits.wheel_speed", self.limits.wheel_speed),
        ];
        match others.into_iter().find(|(_, value)| value.is_some()) {
            Some((key, _)) => Err(config(key, "is not known to this driver; the drive's own [limits] have it")),
            None => Network::new(self.domain, &self.interfaces),
        }
    }
}

/// The network of a node.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Network {
    /// DDS domain.
    pub domain: u16,
    /// Addresses that are used; all of the machine's if empty.
    pub interfaces: Vec<Ipv4Addr>,
}

impl Network {
    /// The network of a configuration; the domain is that of the environment if there is none.
    pub(crate) fn new(domain: Option<u16>, interfaces: &[Ipv4Addr]) -> Result<Self, RobotError> {
        let domain = domain.map_or_else(domain_of_environment, Ok)?;
        if domain > LAST_DOMAIN {
            return Err(config("domain", format!("must be at most {LAST_DOMAIN}, not {domain}: there are no ports beyond")));
        }
        for address in interfaces {
            if let Err(error) = std::net::UdpSocket::bind((*address, 0)) {
                return Err(config("interfaces", format!("{address} is no address of this machine ({error}); `ip address` lists them")));
            }
        }
        Ok(Self { domain, interfaces: interfaces.to_vec() })
    }
}

impl std::fmt::Display for Network {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "domain {}", self.domain)?;
        if self.interfaces.is_empty() {
            return Ok(());
        }
        let addresses: Vec<_> = self.interfaces.iter().map(ToString::to_string).collect();
        write!(f, " on {}", addresses.join(", "))
    }
}

fn domain_of_environment() -> Result<u16, RobotError> {
    let Ok(text) = std::env::var(DOMAIN_VARIABLE) else { return Ok(0) };
    text.trim().parse().map_err(|_| {
        config(
            "domain",
            format!("is not given, and {DOMAIN_VARIABLE} in the environment is `{text}`, not a whole number up to {LAST_DOMAIN}"),
        )
    })
}

/// A full topic name, as `/robot/cmd_vel`.
pub(crate) fn check_topic(key: &str, topic: &str) -> Result<(), RobotError> {
    let good = |part: &str| {
        part.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
            && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
            && !part.contains("__")
    };
    if topic.strip_prefix('/').is_some_and(|rest| rest.split('/').all(good)) {
        return Ok(());
    }
    Err(config(
        key,
        format!("`{topic}` is no topic: it begins with a slash, as in /robot/cmd_vel, and has letters, digits and underscores"),
    ))
}

/// What is said where the feature was left out of the build.
#[cfg(not(feature = "ros2"))]
pub(crate) fn without_feature() -> RobotError {
    config("type", "`ros2` was left out when this program was built: build it with `cargo build --release --features ros2`")
}
