//! Emulators: servers that speak a robot's protocol in front of any robot that can be simulated, so that every driver can
//! be tried, and tested, without hardware.
//!
//! One idea: the protocol of a robot is a value that takes bytes and gives bytes ([`Protocol`]); `server` connects it to
//! sockets, terminals and the clock. The protocols keep the traps of the real robots. A ROS 2 robot takes and gives messages,
//! which DDS carries, and has a loop of its own.

mod body;
mod khepera;
mod pioneer;
mod ros2;
mod server;

use serde::{Deserialize, Serialize};
use wheelwright_core::robot::{Live, RobotError};

pub use khepera::{KheperaEmulator, KheperaServer};
pub use pioneer::{Fault, FaultKind, PioneerEmulator, PioneerServer};
pub use ros2::Ros2Server;
pub use server::{Command, Emulator, State};

use crate::wire::Clock;

/// What to emulate: `[emulator]`, where `type` picks the protocol.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "kebab-case")]
pub enum EmulatorConfig {
    /// A Pioneer's microcontroller.
    Pioneer(PioneerServer),
    /// A Khepera's serial server.
    Khepera(KheperaServer),
    /// A ROS 2 robot.
    Ros2(Ros2Server),
}

impl EmulatorConfig {
    /// Starts serving with a robot behind the protocol.
    ///
    /// # Errors
    /// [`RobotError::Config`] for a setting that cannot be, [`RobotError::Connection`] if the address cannot be served.
    pub fn start(&self, robot: Live) -> Result<Emulator, RobotError> {
        match self {
            Self::Pioneer(server) => Emulator::start(&server.place()?, server.clock, Box::new(PioneerEmulator::new(server, robot)?)),
            Self::Khepera(server) => Emulator::start(&server.place()?, server.clock, Box::new(KheperaEmulator::new(server, robot)?)),
            Self::Ros2(server) => server.start(robot),
        }
    }
}

/// A protocol's side of a robot: bytes in, bytes out, and time that passes.
pub trait Protocol: Send {
    /// Takes bytes from the client and appends the answers.
    ///
    /// # Errors
    /// [`RobotError`] of the robot behind it.
    fn receive(&mut self, bytes: &[u8], answers: &mut Vec<u8>) -> Result<(), RobotError>;

    /// Lets one period of the robot pass and appends what the robot sends by itself.
    ///
    /// # Errors
    /// [`RobotError`] of the robot behind it.
    fn pass(&mut self, answers: &mut Vec<u8>) -> Result<(), RobotError>;

    /// Period of the robot \[s\].
    fn period(&self) -> f64;

    /// What the robot is doing.
    fn state(&self) -> State;

    /// The line to the client is to be cut; asked after every call, true once.
    fn cuts_line(&mut self) -> bool {
        false
    }
}
