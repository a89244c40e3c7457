//! `[simulation]`: the closed loop of the thesis' section 4.1, integrated as one system.

use toml::Table;
use wheelwright_controllers::AdaptiveConfig;
use wheelwright_controllers::continuous::Continuous;
use wheelwright_core::config::{self as core_config, ConfigError};
use wheelwright_core::controller::Subject;
use wheelwright_core::recording::{Column, Recording, Source};
use wheelwright_core::trajectory::course;

use super::knowledge::check_theta;
use super::run::{Outcome, TrackRun};
use super::section::SimulationSection;
use crate::error::Error;

/// Rows kept of a simulation at most, about.
const ROWS: f64 = 20_000.0;

/// Reads a controller's table as one that can be integrated: `adaptive`, or `inverse-dynamics`, which is `adaptive` that does
/// not adapt.
///
/// # Errors
/// [`ConfigError`] relative to the table.
pub fn integrable(mut table: Table) -> Result<AdaptiveConfig, ConfigError> {
    match core_config::take_type(&mut table)?.as_str() {
        "adaptive" => core_config::plain(table),
        "inverse-dynamics" => {
            table.insert("gamma".to_owned(), 0.0.into());
            core_config::plain(table)
        }
        other => {
            Err(ConfigError::new("type", format!("\"{other}\" cannot be integrated with [simulation]; adaptive and inverse-dynamics can")))
        }
    }
}

/// Runs a simulation.
///
/// # Errors
/// [`Error`] for a setting that cannot be, or a motion that diverges.
pub fn simulate(run: &TrackRun<'_>, controller: &AdaptiveConfig, section: &SimulationSection) -> Result<Outcome, Error> {
    check_theta(&section.theta, &*run.subject.model).map_err(|reason| Error::setting("simulation.theta", reason))?;
    if !(section.step.is_finite() && section.step > 0.0) {
        return Err(Error::setting("simulation.step", format!("must be a positive number of seconds, not {}", section.step)));
    }
    let (trajectory, pace, duration) = run.sized()?;
    let trajectory = run.section.start.lay(trajectory, [0.0; 3]);
    let subject = Subject { period: section.step, course: course(&trajectory, duration), ..run.subject.clone() };
    let mut start = Continuous::perfect_start(&trajectory);
    let [ahead, left, turned] = section.offset;
    let (sin, cos) = start[2].sin_cos();
    start = [start[0] + ahead * cos - left * sin, start[1] + ahead * sin + left * cos, start[2] + turned, start[3], start[4]];
    if !section.moving {
        (start[3], start[4]) = (0.0, 0.0);
    }
    let mut simulation = Continuous::new(controller, &subject, &section.theta, &trajectory, start).map_err(Error::Control)?;
    let keep = (duration / section.step / ROWS).ceil().max(1.0) as usize;
    let log = simulation.run(duration, section.step, keep).map_err(|e| Error::Identify(e.into()))?;
    let parameters: Vec<String> = subject.model.parameters().iter().map(|p| p.name.clone()).collect();
    let pick = |i: usize| log.pose.iter().map(|p| p[i]).collect::<Vec<f64>>();
    let columns = ["x", "y", "phi"].into_iter().enumerate().map(|(i, name)| Column::new(name, pick(i))).collect();
    let recording = Recording::new(Source::default(), log.time.clone(), columns, None).map_err(|e| Error::content("simulation", e))?;
    let tracked = wheelwright_core::tracking::Tracked { log, outcome: Ok(recording) };
    Ok(Outcome::new(tracked, &parameters, Vec::new(), duration, 0.0, pace))
}
