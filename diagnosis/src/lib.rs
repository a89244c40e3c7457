//! Diagnosis: where a simulation and a recording differ, what physics was left out, and the proof of it.
//!
//! One idea: every candidate explanation is simulated freely, refitted jointly with the base model's parameters, and judged by
//! what it gains beyond what chance would, on the data at hand and on data kept away from it.

pub mod adequacy;
mod answer;
mod beside;
mod clock;
pub mod comparison;
mod decide;
mod diagnose;
pub mod effects;
pub mod experiment;
pub mod finding;
pub mod fit;
#[cfg(test)]
mod fixture;
mod gauge;
mod holdout;
mod judge;
mod leeway;
pub mod locate;
pub mod noise;
mod question;
mod race;
mod radius;
pub mod residuals;
mod round;
mod screen;
mod select;
mod spans;
mod track;
mod turns;
mod unrounded;
mod untestable;
mod walk;

pub use diagnose::diagnose;
pub use finding::{Diagnosis, Verdict};
pub use fit::Fitted;
pub use question::{DiagnosisError, Question};
pub use residuals::{Flag, Residuals, Series};
