//! Sampling rate against the time constants of the robot.

use serde::Serialize;

use crate::dataset::Dataset;
use crate::local::linear_part;
use crate::model::RegressorModel;

/// Fewer samples than this in the fastest time constant are too few: one step response is over between two or three of them.
const FEWEST: f64 = 3.0;
/// Samples in the fastest time constant that serve every estimate.
const ENOUGH: f64 = 10.0;
/// More than this add nothing where the noise of neighbouring samples is alike.
const PLENTY: f64 = 50.0;
/// Share of independent samples below which the noise of neighbours counts as alike.
const ALIKE: f64 = 0.25;

/// What the sampling rate is for this robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Rate {
    /// Fewer than three samples in the fastest time constant.
    TooSlow,
    /// Enough.
    Adequate,
    /// More than fifty samples in the fastest time constant, and noise so alike in neighbouring samples that they add nothing.
    Needless,
}

/// The sampling rate judged.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sampling {
    /// Rate of the recording \[Hz\].
    pub rate_hz: f64,
    /// Fastest time constant of the model's linear part \[s\].
    pub fastest_s: f64,
    /// The verdict.
    pub rate: Rate,
    /// A rate that serves \[Hz\]: ten samples in the fastest time constant.
    pub recommended_hz: f64,
    /// The same in a sentence.
    pub statement: String,
}

/// Judges the rate; `independent` is the share of independent samples in the noise. `None` if the model has no decaying mode.
pub(super) fn judge(model: &dyn RegressorModel, theta: &[f64], data: &Dataset, independent: f64) -> Option<Sampling> {
    let rates = linear_part(model, theta)?.complex_eigenvalues();
    let fastest_s =
        1.0 / rates.iter().map(|l| -l.re).filter(|r| *r > 0.0).fold(None, |m: Option<f64>, r| Some(m.map_or(r, |m| m.max(r))))?;
    let period = data.period();
    let (rate_hz, inside) = (1.0 / period, fastest_s / period);
    let recommended_hz = two_digits(ENOUGH / fastest_s);
    let rate = match inside {
        n if n < FEWEST => Rate::TooSlow,
        n if n > PLENTY && independent < ALIKE => Rate::Needless,
        _ => Rate::Adequate,
    };
    let facts = format!("{rate_hz:.3} Hz gives {inside:.1} samples in the fastest time constant ({fastest_s:.3} s)");
    let statement = match rate {
        Rate::TooSlow => {
            format!("sampling is too slow: {facts}; record at {recommended_hz} Hz, at least {} Hz", two_digits(FEWEST / fastest_s))
        }
        Rate::Adequate => format!("sampling is fast enough: {facts}"),
        Rate::Needless => {
            format!(
                "sampling is needlessly fast: {facts} and the noise of neighbouring samples is alike; {recommended_hz} Hz would tell as much"
            )
        }
    };
    Some(Sampling { rate_hz, fastest_s, rate, recommended_hz, statement })
}

/// Rounded up to two digits.
fn two_digits(x: f64) -> f64 {
    let unit = 10.0_f64.powi(x.log10().floor() as i32 - 1);
    ((x / unit).ceil() * unit * 1e9).round() / 1e9
}
