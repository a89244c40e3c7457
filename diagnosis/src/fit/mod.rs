//! Joint free-run fits: base parameters, effects' parameters and the initial outputs of every stretch at once.

pub(crate) mod algebra;
pub(crate) mod base;
pub(crate) mod layout;
pub(crate) mod profile;
pub(crate) mod search;
pub(crate) mod setting;
pub(crate) mod span;
pub(crate) mod whitening;

use nalgebra::DMatrix;
use wheelwright_core::Effect;

use crate::residuals::Series;

/// A model with effects, fitted.
#[derive(Debug, Clone)]
pub struct Fitted<'a> {
    /// Its effects, in the order in which they were added; empty for the base.
    pub effects: Vec<&'a dyn Effect>,
    /// Free parameters z of the base model, θ = T z + c; empty if θ is held fixed.
    pub free: Vec<f64>,
    /// Parameters θ.
    pub theta: Vec<f64>,
    /// Values of each effect's parameters.
    pub values: Vec<Vec<f64>>,
    /// Fitted initial outputs of each stretch.
    pub initial: Vec<Vec<f64>>,
    /// Free run from these.
    pub simulated: Series,
    /// Twice the log-likelihood, up to a constant that is the same for all fits under one noise model.
    pub likelihood: f64,
    /// Effective number of parameters: numerical rank of the whitened Jacobian, initial outputs taken out.
    pub rank: usize,
    /// Information of (z, all effects' parameters in order): JᵀJ of the whitened Jacobian, initial outputs taken out.
    pub information: DMatrix<f64>,
    /// Covariance of the same; infinite diagonal where the data show nothing.
    pub covariance: DMatrix<f64>,
}

#[cfg(test)]
mod tests;
