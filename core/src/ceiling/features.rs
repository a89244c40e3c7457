//! What the response could be made of, computed from commands and first samples alone.
//!
//! Boyd and Chua (IEEE Trans. Circuits Syst. 32, 1985): any system whose memory fades is a polynomial of the outputs of a bank of
//! linear filters. The bank here is one of first-order lags, stepped exactly between uneven stamps; through it go the inputs
//! (also delayed), simple nonlinear functions of them, and the same functions of reference simulations, which stand for the
//! products of filtered inputs that friction, drag and coupling are made of.

use nalgebra::DMatrix;

use crate::dataset::{Dataset, Stretch};

/// Ratio of neighbouring time constants of the bank, and the shortest in sampling periods.
const RATIO: f64 = 3.0;
const SHORTEST: f64 = 1.5;
/// Longest bank.
const POLES: usize = 5;
/// Delays of inputs and references in samples.
const DELAYS: [usize; 4] = [0, 1, 3, 6];
/// Steepness of the smoothed signs, in inverse typical values.
const SIGNS: [f64; 2] = [5.0, 20.0];

/// Fewer stretches than this do not teach how a first sample decays; one that happens to begin near zero would be scaled beyond
/// sense elsewhere. A reference starts from the first sample too.
const STARTS: usize = 8;

/// The library for one data set.
#[derive(Debug)]
pub(super) struct Library {
    poles: Vec<f64>,
    inputs: Vec<f64>,
    outputs: Vec<f64>,
    starts: bool,
}

impl Library {
    pub(super) fn new(train: &Dataset) -> Self {
        let longest = train.stretches.iter().map(|s| s.time[s.len() - 1] - s.time[0]).fold(0.0, f64::max);
        let poles = (0..POLES).map(|k| SHORTEST * train.period() * RATIO.powi(k as i32)).filter(|t| *t < 0.5 * longest);
        let typical = |columns: &dyn Fn(&Stretch) -> &Vec<Vec<f64>>, i: usize| {
            let squares: f64 = train.stretches.iter().flat_map(|s| columns(s)[i].iter()).map(|x| x * x).sum();
            let rms = (squares / train.samples().max(1) as f64).sqrt();
            if rms > 0.0 { rms } else { 1.0 }
        };
        let inputs = (0..train.inputs.len()).map(|i| typical(&|s| &s.inputs, i)).collect();
        let outputs = (0..train.outputs.len()).map(|i| typical(&|s| &s.outputs, i)).collect();
        let starts = train.stretches.len() >= STARTS;
        Self { poles: poles.collect(), inputs, outputs, starts }
    }

    /// Rows at the start of a stretch on which its unknown past still tells: as long as the longest lag, at most a third of it; none
    /// where the decay of first samples is among the columns.
    pub(super) fn unsettled(&self, stretch: &Stretch) -> usize {
        let longest = self.poles.last().copied().unwrap_or(0.0);
        let rows = stretch.time.iter().take_while(|t| **t - stretch.time[0] < longest).count();
        if self.starts { 0 } else { rows.min(stretch.len() / 3) }
    }

    /// Columns over every stretch of a data set, with the outputs of a reference simulation if there is one.
    pub(super) fn of(&self, data: &Dataset, reference: Option<&[Vec<Vec<f64>>]>) -> Vec<DMatrix<f64>> {
        let over = |(i, stretch): (usize, &Stretch)| self.columns(stretch, reference.map(|r| r[i].as_slice()));
        data.stretches.iter().enumerate().map(over).collect()
    }

    /// Columns over a stretch: a constant, the bank of the inputs, the decay of the first samples if there are enough of them, and the bank of the
    /// reference, which has one vector an output.
    fn columns(&self, stretch: &Stretch, reference: Option<&[Vec<f64>]>) -> DMatrix<f64> {
        let mut columns = vec![vec![1.0; stretch.len()]];
        let inputs = scaled(&stretch.inputs, &self.inputs);
        for u in &inputs {
            for pole in &self.poles {
                let filtered = lagged(&stretch.time, u, *pole);
                columns.extend(DELAYS.iter().map(|d| later(&filtered, *d)));
            }
        }
        for signal in nonlinear(&inputs) {
            columns.extend(self.poles.iter().map(|pole| lagged(&stretch.time, &signal, *pole)));
        }
        if self.starts {
            let firsts = stretch.outputs.iter().zip(&self.outputs).chain(stretch.inputs.iter().zip(&self.inputs));
            for (column, scale) in firsts {
                let decay = |pole: &f64| stretch.time.iter().map(|t| column[0] / scale * (-(t - stretch.time[0]) / pole).exp()).collect();
                columns.extend(self.poles.iter().map(decay));
            }
        }
        if let Some(reference) = reference {
            let outputs = scaled(reference, &self.outputs);
            for x in &outputs {
                columns.extend(DELAYS.iter().map(|d| later(x, *d)));
                columns.extend(self.poles.iter().map(|pole| lagged(&stretch.time, x, *pole)));
            }
            for signal in nonlinear(&outputs) {
                columns.extend(self.poles.iter().map(|pole| lagged(&stretch.time, &signal, *pole)));
                columns.push(signal);
            }
        }
        DMatrix::from_iterator(stretch.len(), columns.len(), columns.into_iter().flatten())
    }
}

fn scaled(columns: &[Vec<f64>], scales: &[f64]) -> Vec<Vec<f64>> {
    columns.iter().zip(scales).map(|(c, s)| c.iter().map(|x| x / s).collect()).collect()
}

/// Smoothed signs, drags and products.
fn nonlinear(signals: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut made = Vec::new();
    for (i, x) in signals.iter().enumerate() {
        made.extend(SIGNS.iter().map(|k| x.iter().map(|x| (k * x).tanh()).collect()));
        made.push(x.iter().map(|x| x * x.abs()).collect());
        made.push(x.iter().map(|x| x.abs()).collect());
        for y in &signals[i..] {
            made.push(x.iter().zip(y).map(|(x, y)| x * y).collect());
        }
    }
    made
}

/// A held signal through a first-order lag, as if the first value had been held ever since.
fn lagged(time: &[f64], signal: &[f64], constant: f64) -> Vec<f64> {
    let mut state = signal.first().copied().unwrap_or(0.0);
    let mut out = Vec::with_capacity(signal.len());
    out.push(state);
    for (t, x) in time.windows(2).zip(signal) {
        state += -(-(t[1] - t[0]) / constant).exp_m1() * (x - state);
        out.push(state);
    }
    out
}

/// A column some samples later, its first value before.
fn later(column: &[f64], samples: usize) -> Vec<f64> {
    (0..column.len()).map(|k| column[k.saturating_sub(samples)]).collect()
}
