//! Built-in robots of Wheelwright.
//!
//! [`simulator`] is a robot that exists only as forces and voltages; it knows nothing of the models that are fitted to
//! its recordings, which is what makes them a fair test. [`profiles`] holds what is known about real robots.

pub mod profiles;
pub mod simulator;

pub use simulator::{PlantConstants, SimulatedRobot, SimulatorConfig};
