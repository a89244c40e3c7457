//! Built-in trajectories: figure-eight (with dither), circle, line, waypoints.

mod dither;
mod figure_eight;
mod jet;
mod round;
mod spline;
mod time_law;
mod waypoints;

pub use dither::{Direction, Dither, Formulas};
pub use figure_eight::FigureEight;
pub(crate) use jet::wrap;
pub use round::{Circle, Line};
pub use waypoints::Waypoints;

use wheelwright_core::trajectory::TrajectoryError;

/// Refuses a value that is not a positive number.
fn positive(key: &str, value: f64) -> Result<(), TrajectoryError> {
    if value.is_finite() && value > 0.0 {
        Ok(())
    } else {
        Err(TrajectoryError::config(key, format!("must be a positive number, not {value}")))
    }
}

/// Refuses a value that is not a number other than zero.
fn nonzero(key: &str, value: f64) -> Result<(), TrajectoryError> {
    if value.is_finite() && value != 0.0 {
        return Ok(());
    }
    Err(TrajectoryError::config(key, format!("must be a number other than zero, not {value}")))
}
