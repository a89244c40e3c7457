//! Where a search may start, for whoever fits a free run of his own.

use crate::dataset::Dataset;
use crate::local;
use crate::model::{ParameterMap, RegressorModel};
use crate::solver::SolveError;

/// Free parameters by a quick regression, made such that the model can be simulated with them.
///
/// # Errors
/// [`SolveError`] if no regression can be set up on these data.
pub fn rough(model: &dyn RegressorModel, map: &ParameterMap, data: &Dataset) -> Result<Vec<f64>, SolveError> {
    local::rough_start(model, map, data)
}

/// The plausible size of each parameter θ: that at which its term alone takes as much command as the largest in the data.
pub fn plausible(model: &dyn RegressorModel, data: &Dataset, theta: &[f64]) -> Vec<f64> {
    local::plausible(model, data, theta)
}
