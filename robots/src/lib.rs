//! Built-in robots of Wheelwright.
//!
//! [`simulator`] is a robot that exists only as forces and voltages; it knows nothing of the models that are fitted to
//! its recordings, which is what makes them a fair test. [`pioneer`], [`khepera`] and [`ros2`] drive real robots;
//! [`emulator`] puts their protocols in front of the simulator. [`profiles`] holds what is known about real robots.

pub mod emulator;
pub mod khepera;
pub mod pioneer;
pub mod profiles;
pub mod ros2;
pub mod simulator;
mod wire;

pub use emulator::{Emulator, EmulatorConfig};
pub use khepera::KheperaConfig;
pub use pioneer::PioneerConfig;
pub use ros2::Ros2Config;
pub use simulator::{PlantConstants, SimulatedRobot, SimulatorConfig};
pub use wire::Clock;
