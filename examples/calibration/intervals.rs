//! Ways to an interval, to be compared by how often they cover: all about the fit in which every sample counts alike.
//!
//! With J the sensitivities of parameters and starts, G = (JᵀJ)⁻¹Jᵀ and e the error of the fit, an estimate is off by G × noise.
//! What the noise is, is taken from e in three ways:
//!
//! * *white*: variance s², no colour: s² (JᵀJ)⁻¹;
//! * *HAC*: G Ω Gᵀ with the long-run covariance of sensitivity × error by Bartlett's kernel (Newey and West, Econometrica 55, 1987), the
//!   bandwidth by the AR(1) rule of Andrews (Econometrica 59, 1991);
//! * *block bootstrap*: e cut into overlapping blocks of n^(1/3) rows (Künsch, Annals of Statistics 17, 1989; the order of length after
//!   Hall, Horowitz and Jing, Biometrika 82, 1995), drawn with replacement, both outputs together; G × drawn is one replicate of the
//!   estimate's error, refitted to first order. The basic interval from the quantiles of 999.

use nalgebra::{DMatrix, DVector};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use wheelwright_core::simulation::{DIFFERENCE, Direction, Readout, Simulator};
use wheelwright_core::{RegressorModel, Stretch};

use super::Theta;

/// Ways compared, in the order of [`Plain::intervals`].
pub(super) const WAYS: [&str; 3] = ["white", "HAC", "block bootstrap"];
/// Normal quantile for 95 %.
const QUANTILE: f64 = 1.959_964;
/// Replicates of the bootstrap.
const REPLICATES: usize = 999;
/// Gauss-Newton steps that find the start and settle the fit of a solver that has already converged.
const STEPS: usize = 4;

type Intervals = [(f64, f64); 6];

/// A fit in which every sample of an output counts alike, linearised.
pub(super) struct Plain {
    theta: Theta,
    rows: usize,
    jacobian: DMatrix<f64>,
    error: DVector<f64>,
    /// G; the parameters first, then the starts.
    gain: DMatrix<f64>,
}

impl Plain {
    /// From a solver's θ; `None` if it cannot be simulated.
    pub(super) fn new(model: &dyn RegressorModel, recording: &Stretch, readout: Readout, mut theta: Theta) -> Option<Self> {
        let mut start: Vec<f64> = recording.outputs.iter().map(|c| c[0]).collect();
        let mut plain = Self::at(model, recording, readout, theta, &start)?;
        for _ in 0..STEPS {
            let step = -(&plain.gain * &plain.error);
            theta.iter_mut().zip(step.iter()).for_each(|(t, s)| *t += s);
            start.iter_mut().zip(step.iter().skip(theta.len())).for_each(|(x, s)| *x += s);
            plain = Self::at(model, recording, readout, theta, &start)?;
        }
        Some(plain)
    }

    fn at(model: &dyn RegressorModel, recording: &Stretch, readout: Readout, theta: Theta, start: &[f64]) -> Option<Self> {
        let step = theta[0].min(theta[1]).abs() / 20.0;
        let mut simulator = Simulator::new(model, &theta).ok()?.with_readout(readout).with_max_step(step);
        let direction = |i: usize| Direction {
            along: (0..6).map(|k| f64::from(u8::from(k == i))).collect(),
            step: DIFFERENCE * theta[i].abs().max(0.01),
        };
        let found = simulator.sensitivities(recording, start, &(0..6).map(direction).collect::<Vec<_>>()).ok()?;
        let mut run = vec![Vec::new(); start.len()];
        simulator.run(recording, start, &mut run).ok()?;
        for (simulated, measured) in run.iter_mut().zip(&recording.outputs) {
            simulated.iter_mut().zip(measured).for_each(|(s, m)| *s -= m);
        }
        let rows = recording.len();
        let compared = |column: &[Vec<f64>]| -> Vec<Vec<f64>> {
            if readout == Readout::IntervalMean { distances(column, &recording.time) } else { column.to_vec() }
        };
        let errors = compared(&run);
        let weights: Vec<f64> = errors.iter().map(|e| (rows as f64 / e.iter().map(|x| x * x).sum::<f64>()).sqrt()).collect();
        let stacked = |column: &[Vec<f64>]| {
            let values: Vec<f64> = column.iter().zip(&weights).flat_map(|(c, w)| c.iter().map(move |x| w * x)).collect();
            DVector::from_vec(values)
        };
        let columns: Vec<DVector<f64>> = found.parameters.iter().chain(&found.initial).map(|c| stacked(&compared(c))).collect();
        let jacobian = DMatrix::from_columns(&columns);
        let qr = jacobian.clone().qr();
        let gain = qr.r().solve_upper_triangular(&qr.q().transpose())?;
        Some(Self { theta, rows, jacobian, error: stacked(&errors), gain })
    }

    /// The 95 % intervals of each way.
    pub(super) fn intervals(&self, seed: u64) -> [Intervals; 3] {
        let freedom = (self.error.len() - self.jacobian.ncols()) as f64;
        let variance = self.error.norm_squared() / freedom;
        let white = &self.gain * self.gain.transpose() * variance;
        let inverse = &self.gain * self.gain.transpose();
        let hac = &inverse * self.long_run() * &inverse * (self.error.len() as f64 / freedom);
        [self.about(&white), self.about(&hac), self.bootstrap(seed)]
    }

    fn about(&self, covariance: &DMatrix<f64>) -> Intervals {
        std::array::from_fn(|i| {
            let half = QUANTILE * covariance[(i, i)].sqrt();
            (self.theta[i] - half, self.theta[i] + half)
        })
    }

    /// Long-run covariance of the scores, both outputs of a row taken together.
    fn long_run(&self) -> DMatrix<f64> {
        let (rows, unknowns) = (self.rows, self.jacobian.ncols());
        let outputs = self.error.len() / rows;
        let score = |k: usize, j: usize| (0..outputs).map(|c| self.jacobian[(c * rows + k, j)] * self.error[c * rows + k]).sum();
        let scores: DMatrix<f64> = DMatrix::from_fn(rows, unknowns, score);
        let at = |lag: usize| scores.rows(lag, rows - lag).tr_mul(&scores.rows(0, rows - lag));
        let (own, next) = (at(0).diagonal(), at(1).diagonal());
        let (mut above, mut below) = (0.0, 0.0);
        for (own, next) in own.iter().zip(next.iter()) {
            let rho = (next / own).clamp(-0.97, 0.97);
            above += 4.0 * rho * rho / ((1.0 - rho).powi(6) * (1.0 + rho).powi(2));
            below += 1.0 / (1.0 - rho).powi(4);
        }
        let bandwidth = (1.1447 * (above / below * rows as f64).cbrt()).ceil() as usize;
        let mut sum = at(0);
        for lag in 1..bandwidth.min(rows) {
            let lagged = at(lag);
            sum += (1.0 - lag as f64 / bandwidth as f64) * (&lagged + lagged.transpose());
        }
        sum
    }

    fn bootstrap(&self, seed: u64) -> Intervals {
        let mut random = StdRng::seed_from_u64(seed);
        let (rows, length) = (self.rows, (self.rows as f64).cbrt().ceil() as usize);
        let outputs = self.error.len() / rows;
        // Drawn errors must have the mean and the variance of noise, which a fit leaves a little short of both.
        let scale = (self.error.len() as f64 / (self.error.len() - self.jacobian.ncols()) as f64).sqrt();
        let mean: Vec<f64> = (0..outputs).map(|c| self.error.rows(c * rows, rows).mean()).collect();
        let gain = self.gain.rows(0, 6).into_owned();
        let mut replicates: [Vec<f64>; 6] = Default::default();
        let mut drawn = DVector::zeros(self.error.len());
        for _ in 0..REPLICATES {
            for first in (0..rows).step_by(length) {
                let from = random.random_range(0..=rows - length);
                for k in 0..length.min(rows - first) {
                    (0..outputs).for_each(|c| drawn[c * rows + first + k] = scale * (self.error[c * rows + from + k] - mean[c]));
                }
            }
            let off = &gain * &drawn;
            replicates.iter_mut().zip(off.iter()).for_each(|(r, x)| r.push(*x));
        }
        std::array::from_fn(|i| {
            replicates[i].sort_by(f64::total_cmp);
            // Quantiles at 2.5 and 97.5 % of 999 are the 25th and the 975th.
            (self.theta[i] - replicates[i][974], self.theta[i] - replicates[i][24])
        })
    }
}

/// Mean velocities summed up to distances from the start.
fn distances(column: &[Vec<f64>], time: &[f64]) -> Vec<Vec<f64>> {
    let summed = |series: &Vec<f64>| {
        let mut sum = 0.0;
        let next = |k: usize| {
            sum += if k == 0 { 0.0 } else { series[k] * (time[k] - time[k - 1]) };
            sum
        };
        (0..series.len()).map(next).collect()
    };
    column.iter().map(summed).collect()
}
