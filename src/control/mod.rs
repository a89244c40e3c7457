//! Control from configurations: a robot follows a trajectory (`track`), a controller goes from one robot to another
//! (`migrate`).

pub mod files;
pub mod knowledge;
pub mod migration;
pub mod plan;
pub mod run;
pub mod section;
pub mod simulation;

pub use knowledge::Knowledge;
pub use plan::ControlPlan;
pub use run::{Outcome, TrackRun};
pub use section::{MigrateSection, SimulationSection, SourceSection, TrackSection};
