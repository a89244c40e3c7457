//! What is left between a recording and its simulations, as plain arrays: what every test without a library works on.

use wheelwright_core::{Dataset, RegressorModel};

use crate::finding::Alternative;
use crate::noise::Noise;

/// Values by stretch, output, row.
pub type Series = Vec<Vec<Vec<f64>>>;

/// A recording beside its simulations, and the law of the noise.
#[derive(Debug, Clone)]
pub struct Residuals<'a> {
    /// The model.
    pub model: &'a dyn RegressorModel,
    /// Recording.
    pub data: &'a Dataset,
    /// Parameters of the base fit.
    pub theta_base: Vec<f64>,
    /// Parameters of the final fit.
    pub theta_final: Vec<f64>,
    /// Free run of the base model, initial outputs fitted.
    pub base: Series,
    /// Free run of the final model; equal to `base` where no effect was found.
    pub last: Series,
    /// Recording minus `last`, without what rounding adds on average.
    pub left: Series,
    /// Step in which each output is recorded; zero where there is none.
    pub rounded: Vec<f64>,
    /// Law of the noise, estimated from what no effect of the library could explain.
    pub noise: Noise,
    /// Directions in which the final fit was free: raw responses (not whitened) of the outputs to each free parameter. A test of what is
    /// left must not count what a refit would take.
    pub jacobian: Vec<Series>,
    /// Half the track width used \[m\]; not a number without wheels.
    pub half_track: f64,
}

/// What a test without a library found in the final residual. `decide` weighs these.
#[derive(Debug, Clone, PartialEq)]
pub struct Flag {
    /// Which test: `rounded commands`, `input-driven structure`, `bursts`, `events`, `memory of the rest`, `wheel-order line`, `rhythm`,
    /// `variance against acceleration`, `value lattice`, `counts of the wheels`, `coarse readout`, `means over the interval`,
    /// `a rest that follows its past`, `values beyond the effect`.
    pub test: &'static str,
    /// Its statistic.
    pub value: f64,
    /// The value above which it speaks.
    pub threshold: f64,
    /// Share of what was to be explained that is still in the residual by this test, 0 to 1: twice a log-likelihood beside that
    /// which the named effects gained. `None` where the test speaks of noise and not of motion.
    pub left_over: Option<f64>,
    /// What it means, in a sentence.
    pub statement: String,
    /// The effect of the library whose mark this is (`timestamp_jitter`, `encoder_quantisation`), and values of its parameters.
    pub effect: Option<(String, Vec<f64>)>,
    /// Other effects that would leave the same mark.
    pub instead: Vec<Alternative>,
}
