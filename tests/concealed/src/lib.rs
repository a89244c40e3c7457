//! A proving ground: wheeled robots simulated from forces, torques, voltages and contacts, with physics hidden in them.
//!
//! It shares no code and no equation with what diagnoses: here are a rigid body, wheels, motors, gears, a battery, firmware with messages and
//! set-points, and sensors. [`plant`] is matter, [`firmware`] the low-level computer, [`sensors`] what is recorded, [`hidden`] what can be
//! concealed, [`draw`] chance, [`referee`] what the key says, [`make`] the cases, [`files`] what is written.

pub mod draw;
pub mod error;
pub mod files;
pub mod firmware;
pub mod hidden;
pub mod make;
pub mod plant;
pub mod referee;
pub mod sensors;
