//! Rhythm: something comes again and again at even times, whatever the robot does. A fan, a swell, a load that swings, a timer in the firmware: no command
//! causes it, and its slow swing may well pass for coloured noise.
//!
//! The innovations' periodogram over time, as over wheel angle (`orders.rs`), of the longest stretch: gaps that come at even times would make lines of any.

use crate::comparison::Comparison;

use super::sweep::{powers, stands_out, strongest};

/// Periods that a stretch must hold.
const FEWEST: f64 = 3.0;
/// Highest frequency \[Hz\]: what is faster shakes, and an autoregression of a few samples has it as a resonance.
const FASTEST: f64 = 2.0;
/// Frequencies to either side that count as neighbourhood: what is pushed along a heading that turns makes two lines, and more than those.
const REACH: usize = 40;

/// A line of the residual in time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rhythm {
    /// How often it comes \[Hz\].
    pub frequency: f64,
    /// Power: twice a log-likelihood ratio, of two degrees of freedom by chance.
    pub power: f64,
}

/// The strongest line, if there is one.
pub(super) fn find(comparison: &Comparison<'_>) -> Option<Rhythm> {
    let ranges = comparison.ranges().into_iter().zip(&comparison.data.stretches);
    let (rows, stretch) = ranges.max_by_key(|(rows, _)| rows.len())?;
    let whole = comparison.scene.scales.period * rows.len() as f64;
    let (first, step) = (FEWEST / whole, 1.0 / whole);
    let count = ((FASTEST - first) / step) as usize;
    let innovations: Vec<Vec<f64>> = (0..comparison.outputs()).map(|i| comparison.innovations(i)[rows.clone()].to_vec()).collect();
    let power = powers(&innovations, &stretch.time, None, [first, step], count);
    let (at, largest) = strongest(&power, innovations.len() * count)?;
    stands_out(&power, at, REACH).then_some(Rhythm { frequency: first + step * at as f64, power: largest })
}
