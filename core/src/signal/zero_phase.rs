//! Forward-backward filtering: the response of a filter without its phase.
//!
//! Odd reflection at both ends and a steady-state initial state, as `scipy.signal.sosfiltfilt` and Matlab's `filtfilt`.

use serde::{Deserialize, Serialize};

use super::{Butterworth, Section, SignalError};

/// Columns filtered side by side. A recursive filter waits for its own last output; four columns wait together.
const LANES: usize = 4;

/// How far a signal is continued at each end before it is filtered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Padding {
    /// 3 (order + 1) samples, the default of SciPy.
    #[default]
    Scipy,
    /// 3 order samples, the rule of Matlab.
    Matlab,
    /// None: the filter starts in the steady state of the first sample.
    None,
}

impl Padding {
    /// Samples mirrored at each end for a filter of this order.
    pub fn samples(self, order: usize) -> usize {
        match self {
            Self::Scipy => 3 * (order + 1),
            Self::Matlab => 3 * order,
            Self::None => 0,
        }
    }
}

/// A filter run forward and backward: zero phase, gain |H|².
#[derive(Debug, Clone, PartialEq)]
pub struct ZeroPhase {
    filter: Butterworth,
    padding: usize,
}

impl ZeroPhase {
    /// Prepares a filter.
    pub fn new(filter: Butterworth, padding: Padding) -> Self {
        let padding = padding.samples(filter.order());
        Self { filter, padding }
    }

    /// The filter that is run both ways.
    pub fn filter(&self) -> &Butterworth {
        &self.filter
    }

    /// Fewest samples that can be filtered.
    pub fn min_samples(&self) -> usize {
        self.padding + 1
    }

    /// Filters columns of one length in place. A column's result does not depend on its neighbours.
    ///
    /// # Errors
    /// [`SignalError::TooShort`], [`SignalError::Ragged`].
    pub fn apply(&self, columns: &mut [&mut [f64]]) -> Result<(), SignalError> {
        let Some(samples) = columns.first().map(|c| c.len()) else { return Ok(()) };
        if samples < self.min_samples() {
            return Err(SignalError::TooShort { samples, padding: self.padding });
        }
        if let Some(other) = columns.iter().find(|c| c.len() != samples) {
            return Err(SignalError::Ragged { expected: samples, found: other.len() });
        }
        let mut lanes = vec![[0.0; LANES]; samples + 2 * self.padding];
        for group in columns.chunks_mut(LANES) {
            for (lane, column) in group.iter().enumerate() {
                self.pad(column, lane, &mut lanes);
            }
            // The initial state belongs to the cascade, so every section starts from the first sample of the whole.
            let first = lanes[0];
            self.filter.sections().iter().for_each(|s| run(s, first, lanes.iter_mut()));
            let last = lanes[lanes.len() - 1];
            self.filter.sections().iter().for_each(|s| run(s, last, lanes.iter_mut().rev()));
            for (lane, column) in group.iter_mut().enumerate() {
                column.iter_mut().zip(&lanes[self.padding..]).for_each(|(x, y)| *x = y[lane]);
            }
        }
        Ok(())
    }

    /// Copies a column into its lane, point-reflected about its first and last sample.
    fn pad(&self, x: &[f64], lane: usize, lanes: &mut [[f64; LANES]]) {
        let (p, n) = (self.padding, x.len());
        for (row, value) in lanes[p..].iter_mut().zip(x) {
            row[lane] = *value;
        }
        for k in 1..=p {
            lanes[p - k][lane] = 2.0 * x[0] - x[k];
            lanes[p + n - 1 + k][lane] = 2.0 * x[n - 1] - x[n - 1 - k];
        }
    }
}

/// One section over all samples, transposed direct form II, from the steady state of a constant `level`.
fn run<'a>(section: &Section, level: [f64; LANES], samples: impl Iterator<Item = &'a mut [f64; LANES]>) {
    let ([b0, b1, b2], [a1, a2]) = (section.b, section.a);
    let mut slow = level.map(|x| (b2 - a2) * x);
    let mut fast = level;
    for lane in 0..LANES {
        fast[lane] = (b1 - a1) * level[lane] + slow[lane];
    }
    for sample in samples {
        for lane in 0..LANES {
            let x = sample[lane];
            let y = b0 * x + fast[lane];
            fast[lane] = b1 * x - a1 * y + slow[lane];
            slow[lane] = b2 * x - a2 * y;
            sample[lane] = y;
        }
    }
}
