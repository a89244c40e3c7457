//! Signal conditioning: linear, zero-phase operations on one unbroken stretch of samples.
//!
//! Every operation here commutes with the linear combination Φ θ, so that filtering each column of Φ and the response
//! alike leaves θ unchanged. None looks past the ends of the slice it is given: breaks are the caller's to respect.
//!
//! The filters are our own: the maintained crates either bring another linear algebra library or pad and initialise
//! differently from `scipy.signal.sosfiltfilt`, which is what results are compared with in this field.

mod butterworth;
mod difference;
mod grid;
mod zero_phase;

use thiserror::Error;

pub use butterworth::{Butterworth, Section};
pub use difference::gradient;
pub use grid::{Spacing, resample, spacing};
pub use zero_phase::{Padding, ZeroPhase};

/// Why a signal cannot be conditioned.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum SignalError {
    /// The cut-off is not inside (0, Nyquist).
    #[error(
        "cut-off of {cutoff_hz} Hz at {rate_hz:.6} samples/s: it must lie above 0 and below half the sampling rate, {:.6} Hz",
        .rate_hz / 2.0
    )]
    CutOff {
        /// Cut-off asked for \[Hz\].
        cutoff_hz: f64,
        /// Sampling rate \[Hz\].
        rate_hz: f64,
    },
    /// A filter without a pole, or with more than double precision carries.
    #[error("a low-pass filter of order {order}: the order must be 1 to {max}")]
    Order {
        /// Order asked for.
        order: usize,
        /// Highest order designed.
        max: usize,
    },
    /// The stretch is not longer than the padding at one end.
    #[error("{samples} sample(s) are too few for the filter, which mirrors {padding} at each end: at least {} are needed", .padding + 1)]
    TooShort {
        /// Samples given.
        samples: usize,
        /// Samples mirrored at each end.
        padding: usize,
    },
    /// Columns that are filtered together differ in length.
    #[error("columns of {found} and {expected} samples cannot be filtered together")]
    Ragged {
        /// Length of the first column.
        expected: usize,
        /// Length of another.
        found: usize,
    },
}
