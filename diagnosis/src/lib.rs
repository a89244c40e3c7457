//! Diagnosis: where a simulation and a recording differ, what physics was left out, and the proof of it.
//!
//! One idea: every candidate explanation is simulated freely, refitted jointly with the base model's parameters, and judged by
//! what it gains beyond what chance would, on the data at hand and on data kept away from it.

pub mod effects;
pub mod finding;
