//! A short NARX model as yardstick: what a black box of a few lags reaches in free run.
//!
//! y_k is a polynomial of second degree in two past values of every output and input, fitted by least squares on one-step
//! predictions and simulated from the first two measured samples of each held-out stretch.

use nalgebra::{DMatrix, DVector};

use crate::dataset::{Dataset, Stretch};
use crate::local::scaled_solve;
use crate::signal;

/// Past values of each channel.
const LAGS: usize = 2;
/// A simulation beyond this many times the largest output fitted has diverged.
const DIVERGED: f64 = 10.0;
/// Steps that deviate from the period by more than this share call for an even grid, as in the regression.
const JITTER: f64 = 0.02;

/// Held-out free-run fit of each output in percent; `None` where the simulation diverges or there is nothing to compare with.
pub(super) fn yardstick(train: &Dataset, held_out: &Dataset) -> Vec<Option<f64>> {
    let outputs = train.outputs.len();
    let none = vec![None; outputs];
    let period = train.period();
    let (fitted, compared): (Vec<Stretch>, Vec<Stretch>) = (even(train, period), even(held_out, period));
    let largest = fitted.iter().flat_map(|s| s.outputs.iter().flatten()).fold(0.0_f64, |m, x| m.max(x.abs()));
    let Some(coefficients) = fit(&fitted, outputs) else { return none };
    let mut simulated = Vec::new();
    for stretch in &compared {
        match simulate(stretch, &coefficients, DIVERGED * largest) {
            Some(run) => simulated.push(run),
            None => return none,
        }
    }
    let of = |i: usize| {
        let pairs = compared.iter().zip(&simulated).flat_map(|(s, run)| s.outputs[i].iter().copied().zip(run[i].iter().copied()));
        super::fit_percent(&pairs.collect::<Vec<_>>())
    };
    (0..outputs).map(of).collect()
}

/// Stretches on an even grid that are longer than the lags.
fn even(data: &Dataset, period: f64) -> Vec<Stretch> {
    let on_grid = |s: &Stretch| {
        let uneven = signal::spacing(&s.time).is_some_and(|x| x.jitter > JITTER);
        if uneven { signal::resample(s, period) } else { s.clone() }
    };
    data.stretches.iter().map(on_grid).filter(|s| s.len() > LAGS + 1).collect()
}

/// One, the past values, and their products of two, at row k of channels with past values.
fn terms(inputs: &[Vec<f64>], outputs: &[Vec<f64>], k: usize, into: &mut Vec<f64>) {
    let past: Vec<f64> = outputs.iter().chain(inputs).flat_map(|c| (1..=LAGS).map(move |l| c[k - l])).collect();
    into.clear();
    into.push(1.0);
    into.extend_from_slice(&past);
    for (i, a) in past.iter().enumerate() {
        into.extend(past[i..].iter().map(|b| a * b));
    }
}

fn fit(stretches: &[Stretch], outputs: usize) -> Option<DMatrix<f64>> {
    let channels = outputs + stretches.first()?.inputs.len();
    let n = 1 + LAGS * channels + LAGS * channels * (LAGS * channels + 1) / 2;
    let (mut gram, mut right) = (DMatrix::zeros(n, n), DMatrix::zeros(n, outputs));
    let (mut row, mut rows) = (Vec::with_capacity(n), 0);
    for stretch in stretches {
        for k in LAGS..stretch.len() {
            terms(&stretch.inputs, &stretch.outputs, k, &mut row);
            let x = DVector::from_column_slice(&row);
            gram.ger(1.0, &x, &x, 1.0);
            (0..outputs).for_each(|i| right.column_mut(i).axpy(stretch.outputs[i][k], &x, 1.0));
            rows += 1;
        }
    }
    // Twice as many rows as terms: fewer would be reproduced, not fitted.
    if rows < 2 * n {
        return None;
    }
    let solved: Vec<DVector<f64>> = right.column_iter().map(|r| scaled_solve(&gram, &r.into_owned())).collect();
    Some(DMatrix::from_columns(&solved))
}

/// Free run; `None` once an output exceeds `limit`.
fn simulate(stretch: &Stretch, coefficients: &DMatrix<f64>, limit: f64) -> Option<Vec<Vec<f64>>> {
    let mut run: Vec<Vec<f64>> = stretch.outputs.iter().map(|c| c[..LAGS].to_vec()).collect();
    let mut row = Vec::new();
    for k in LAGS..stretch.len() {
        terms(&stretch.inputs, &run, k, &mut row);
        let next = coefficients.tr_mul(&DVector::from_column_slice(&row));
        // Also false for what is not a number.
        if !next.iter().all(|x| x.abs() <= limit) {
            return None;
        }
        run.iter_mut().zip(next.iter()).for_each(|(c, x)| c.push(*x));
    }
    Some(run)
}
