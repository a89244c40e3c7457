//! How the rows of a regression are made: the choices, with the corrected pipeline as the default.

use serde::{Deserialize, Serialize};

use crate::signal::Padding;
use crate::solver::SolveError;

/// Which held input belongs to the output measured at t_k, if the input u_k holds from t_k to t_k+1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pairing {
    /// (u_k−1 + u_k) / 2: right for outputs measured at an instant.
    #[default]
    Mid,
    /// u_k−1: right for outputs that are means over the period before, such as differences of encoder counts.
    Previous,
    /// u_k: what a plain log suggests, half a period early.
    Same,
}

/// Whether products such as v ω are formed from raw or from filtered samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Products {
    /// Products of raw samples, then filtered: exact, because the filter then acts on whole terms of the equation.
    #[default]
    BeforeFilter,
    /// Products of filtered samples: a filter does not commute with a product.
    AfterFilter,
}

/// How the accelerations are got rid of or at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Form {
    /// Central differences at each sample.
    #[default]
    Derivative,
    /// The equation integrated over a sliding window, held inputs exactly and outputs by the trapezoid rule: accelerations
    /// become differences of outputs, stamps may be uneven, and the window is the only filter.
    Integral,
}

/// How rows are made. The default is the corrected pipeline: everything filtered alike, midpoint pairing, ends trimmed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Order of the Butterworth low-pass filter, run forward and backward; 0 for no filter. Default 2.
    pub order: usize,
    /// Its cut-off \[Hz\]. Default 1 Hz, or a quarter of the sampling rate if that is less.
    pub cutoff_hz: Option<f64>,
    /// Padding rule of the filter: `scipy` (default), `matlab` or `none`.
    pub padding: Padding,
    /// `before-filter` (default) or `after-filter`.
    pub products: Products,
    /// Filter the response as the columns are. Default true; false biases every parameter with dynamics in its column.
    pub filter_response: bool,
    /// `mid` (default), `previous` or `same`.
    pub pairing: Pairing,
    /// `derivative` (default) or `integral`.
    pub form: Form,
    /// Window of the integral form in samples. Default 10.
    pub integral_samples: usize,
    /// Time dropped at both ends of each stretch \[s\]. Default: until the filter's impulse response has decayed to a
    /// thousandth, which is what the ends of the data still disturb. Not used by the integral form, which has no ends.
    pub trim_s: Option<f64>,
    /// Stretches with a step that deviates from the period by more than this share are resampled to an even grid before
    /// they are filtered. Default 0.02.
    pub max_jitter: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            order: 2,
            cutoff_hz: None,
            padding: Padding::Scipy,
            products: Products::BeforeFilter,
            filter_response: true,
            pairing: Pairing::Mid,
            form: Form::Derivative,
            integral_samples: 10,
            trim_s: None,
            max_jitter: 0.02,
        }
    }
}

impl Settings {
    /// Refuses numbers that mean nothing, before any data is touched.
    ///
    /// # Errors
    /// [`SolveError::Setting`] with the key.
    pub fn check(&self) -> Result<(), SolveError> {
        let wrong = |key: &str, reason: String| Err(SolveError::Setting { key: key.to_owned(), reason });
        match (self.cutoff_hz, self.trim_s) {
            (Some(f), _) if !(f > 0.0 && f.is_finite()) => wrong("cutoff_hz", format!("{f} must be a positive number of Hz")),
            (_, Some(t)) if !(t >= 0.0 && t.is_finite()) => wrong("trim_s", format!("{t} must be a number of seconds, 0 or more")),
            _ if self.max_jitter.is_nan() || self.max_jitter < 0.0 => wrong("max_jitter", format!("{} must be 0 or more", self.max_jitter)),
            _ if self.form == Form::Integral && self.integral_samples == 0 => wrong("integral_samples", "must be at least 1".to_owned()),
            _ => Ok(()),
        }
    }
}
