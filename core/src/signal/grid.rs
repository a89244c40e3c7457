//! Time stamps: how even they are, and the even grid that a filter needs.

use crate::dataset::Stretch;
use crate::recording::median;

/// Steps that differ by less than this share are one step length, told apart only by the rounding of the stamps.
const SAME: f64 = 1e-3;

/// Spacing of time stamps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spacing {
    /// Typical step \[s\]: the mean where all are alike, else the median.
    pub period: f64,
    /// Largest deviation of a step from the period, as a share of it.
    pub jitter: f64,
}

/// Measures the spacing of at least two stamps; `None` for fewer.
pub fn spacing(time: &[f64]) -> Option<Spacing> {
    let steps = || time.windows(2).map(|w| w[1] - w[0]);
    let (low, high) = steps().fold((f64::INFINITY, 0.0_f64), |(low, high), s| (low.min(s), high.max(s)));
    if time.len() < 2 {
        return None;
    }
    let period = if high - low < SAME * high {
        (time[time.len() - 1] - time[0]) / (time.len() - 1) as f64
    } else {
        median(&mut steps().collect::<Vec<_>>())
    };
    Some(Spacing { period, jitter: (high - period).max(period - low) / period })
}

/// The stretch on an even grid of `period` from its first sample on; the part of a period left at the end is dropped.
///
/// Outputs are interpolated linearly. An input stays what it physically is, a held command: its value on the grid is
/// the mean of the held value over the period that follows, so that its integral is kept.
#[must_use]
pub fn resample(stretch: &Stretch, period: f64) -> Stretch {
    let time = &stretch.time;
    let (Some(&first), Some(&last)) = (time.first(), time.last()) else { return stretch.clone() };
    // A last sample that misses the grid by rounding is on it.
    let count = ((last - first) / period + 1e-6).floor() as usize + 1;
    let grid: Vec<f64> = (0..count).map(|k| first + k as f64 * period).collect();
    let outputs = stretch.outputs.iter().map(|x| interpolate(time, x, &grid)).collect();
    let inputs = stretch.inputs.iter().map(|u| held_means(time, u, &grid, period)).collect();
    Stretch { label: stretch.label.clone(), time: grid, inputs, outputs }
}

/// Linear interpolation at increasing times within the range of `time`.
fn interpolate(time: &[f64], x: &[f64], grid: &[f64]) -> Vec<f64> {
    let mut k = 0;
    let mut at = |t: f64| {
        while k + 2 < time.len() && time[k + 1] <= t {
            k += 1;
        }
        let Some(next) = time.get(k + 1) else { return x[k] };
        let share = ((t - time[k]) / (next - time[k])).clamp(0.0, 1.0);
        x[k] + share * (x[k + 1] - x[k])
    };
    grid.iter().map(|&t| at(t)).collect()
}

/// Mean over [t, t + period] of a value held from each time to the next, and after the last.
fn held_means(time: &[f64], u: &[f64], grid: &[f64], period: f64) -> Vec<f64> {
    let mut k = 0;
    let mut mean = |start: f64| {
        while k + 1 < time.len() && time[k + 1] <= start {
            k += 1;
        }
        let end = start + period;
        let (mut from, mut sum, mut j) = (start, 0.0, k);
        while j + 1 < time.len() && time[j + 1] < end {
            sum += u[j] * (time[j + 1] - from);
            from = time[j + 1];
            j += 1;
        }
        (sum + u[j] * (end - from)) / period
    };
    grid.iter().map(|&t| mean(t)).collect()
}
