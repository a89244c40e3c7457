//! Noise ceiling: the free-run fit that no model of these commands is expected to exceed on held-out data.
//!
//! A recording is what the robot does in answer to its commands, plus what no command explains. The second part, white or
//! coloured, bounds every free run: fit ≤ 100 (1 − ‖e‖/‖y − mean y‖). To estimate ‖e‖, a model far more flexible than any of physics
//! is fitted: a sparse combination of filtered commands and filtered nonlinear functions of commands and of simulated
//! outputs, chosen and weighted under the noise's own colour. What it leaves, corrected for what it took of the noise in the data
//! fitted and for what its own errors add to the held-out data, is the estimate of e. `docs/evidence.md` says what this assumes.

mod features;
mod narx;
mod selection;
#[cfg(test)]
mod tests;

use std::cell::OnceCell;

use nalgebra::DMatrix;
use serde::Serialize;

use crate::dataset::Dataset;
use crate::gram::add_square;
use crate::model::RegressorModel;
use crate::noise::Autoregression;
use crate::simulation::Simulator;
use crate::solver::SolveError;
use features::Library;
use selection::{Chosen, Penalty, choose};

/// Fewer training samples than this carry no flexible model.
const FEWEST: usize = 100;
/// More training samples than this only cost time: the noise level is then known to a hundredth.
const MOST: usize = 6000;
/// Percent of fit between the model and its ceiling from which on the flexible model is tried with its own simulation as reference too.
const WORTH_A_SECOND: f64 = 1.0;

/// Ceiling of one output. All fits are free runs on the held-out data, in percent.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OutputCeiling {
    /// Output.
    pub output: String,
    /// Estimate of the best fit that any model could reach; `None` if the output never changes in the held-out data.
    pub fit: Option<f64>,
    /// From what a model was seen to reach to the 95 % upper bound of the estimate.
    pub range: Option<(f64, f64)>,
    /// The ceiling if only the unforeseeable part of the residual were noise, and its memory were dynamics yet to be found.
    pub innovations: Option<f64>,
    /// What the flexible model itself reaches.
    pub flexible: Option<f64>,
    /// What the identified model reaches, where the flexible model reaches less: then the ceiling rests on the identified model.
    pub flexible_below: Option<f64>,
    /// What a short NARX model reaches; `None` also if its free run diverges.
    pub narx: Option<f64>,
    /// Standard deviation of what no command explains, in the output's unit.
    pub noise: f64,
    /// Terms of the flexible model.
    pub terms: usize,
    /// The result in a sentence.
    pub statement: String,
}

/// Estimates the ceiling of each output. The base model lends its simulation as a reference; where it diverges, or is worse on the
/// training data, the flexible model's own takes its place. With nothing held out the fits are on the training data.
///
/// # Errors
/// [`SolveError::TooFewSamples`] below 100 training samples.
pub fn estimate(model: &dyn RegressorModel, theta: &[f64], train: &Dataset, held_out: &Dataset) -> Result<Vec<OutputCeiling>, SolveError> {
    let fitted = train.shortened(MOST);
    if fitted.samples() < FEWEST {
        let (samples, parameters) = (fitted.samples(), model.parameters().len());
        let what = "holding out".to_owned();
        return Err(SolveError::TooFewSamples { samples, parameters, what, needed_s: (FEWEST as f64 * train.period()).ceil() });
    }
    let held_out = if held_out.stretches.is_empty() { train } else { held_out };
    let library = Library::new(&fitted);
    let base = simulate(model, theta, &fitted).zip(simulate(model, theta, held_out));
    let narx = narx::yardstick(&fitted, held_out);
    let own = |i: usize| base.as_ref().and_then(|(_, held)| fit_percent(&pairs(held_out, held, i)));
    let under = |parts: [Part<'_>; 2]| -> Vec<Judged> { (0..train.outputs.len()).map(|i| ceiling(&parts, i, narx[i], own(i))).collect() };
    let Some((first, second)) = &base else {
        return Ok(under(with_own_reference(&library, &fitted, held_out)).into_iter().map(|j| j.ceiling).collect());
    };
    let mut found = under([Part::new(&library, &fitted, Some(first)), Part::new(&library, held_out, Some(second))]);
    // A base model that is far from the robot is a poor reference; one that leaves nothing to gain needs no second opinion.
    let gains = |(i, judged): (usize, &Judged)| judged.ceiling.fit.zip(own(i)).is_some_and(|(fit, own)| fit > own + WORTH_A_SECOND);
    if found.iter().enumerate().any(gains) || found.iter().any(|j| j.ceiling.flexible_below.is_some()) {
        let others = under(with_own_reference(&library, &fitted, held_out));
        for (judged, other) in found.iter_mut().zip(others) {
            if other.expected_error < judged.expected_error {
                *judged = other;
            }
        }
    }
    Ok(found.into_iter().map(|j| j.ceiling).collect())
}

/// A ceiling with the squared error that its flexible model is expected to have on new data, from the training data alone.
#[derive(Debug)]
struct Judged {
    ceiling: OutputCeiling,
    expected_error: f64,
}

/// A data set with the columns of its flexible model.
#[derive(Debug)]
struct Part<'a> {
    data: &'a Dataset,
    columns: Vec<DMatrix<f64>>,
    /// Rows at the start of each stretch that say nothing on the noise.
    skip: Vec<usize>,
    /// Products of all columns and all outputs where noise is white: the same whichever output is explained.
    plain: OnceCell<DMatrix<f64>>,
}

impl<'a> Part<'a> {
    fn new(library: &Library, data: &'a Dataset, reference: Option<&[Vec<Vec<f64>>]>) -> Self {
        let skip = data.stretches.iter().map(|s| library.unsettled(s)).collect();
        Self { data, columns: library.of(data, reference), skip, plain: OnceCell::new() }
    }

    fn samples(&self) -> usize {
        self.data.samples() - self.skip.iter().sum::<usize>()
    }

    /// Gram matrix of columns and output where noise is white.
    fn plain_gram(&self, output: usize) -> DMatrix<f64> {
        let outputs: Vec<usize> = (0..self.data.outputs.len()).collect();
        let all = self.plain.get_or_init(|| self.products(&outputs, |_| 0));
        let p = all.ncols() - outputs.len();
        let picked: Vec<usize> = (0..p).chain(std::iter::once(p + output)).collect();
        all.select_columns(&picked).select_rows(&picked)
    }

    /// Gram matrix of columns and output under the noise's colour.
    fn gram(&self, output: usize, ar: &Autoregression) -> DMatrix<f64> {
        self.products(&[output], |rows| {
            ar.whiten_all(rows);
            ar.coefficients.len()
        })
    }

    /// Products of columns and outputs, changed before; `change` says how many rows it leaves without sense.
    fn products(&self, outputs: &[usize], change: impl Fn(&mut DMatrix<f64>) -> usize) -> DMatrix<f64> {
        let p = self.columns.first().map_or(0, DMatrix::ncols);
        let mut gram = DMatrix::zeros(p + outputs.len(), p + outputs.len());
        for ((stretch, columns), skip) in self.data.stretches.iter().zip(&self.columns).zip(&self.skip) {
            let mut rows = columns.clone().insert_columns(p, outputs.len(), 0.0);
            for (k, output) in outputs.iter().enumerate() {
                rows.column_mut(p + k).copy_from_slice(&stretch.outputs[*output]);
            }
            let senseless = change(&mut rows);
            add_square(&rows.rows_range(senseless.max(*skip).min(rows.nrows())..).into_owned(), &mut gram);
        }
        gram.fill_lower_triangle_with_upper_triangle();
        gram
    }

    fn predicted(&self, chosen: &Chosen) -> Vec<Vec<f64>> {
        let of = |c: &DMatrix<f64>| (c.select_columns(&chosen.columns) * &chosen.coefficients).as_slice().to_vec();
        self.columns.iter().map(of).collect()
    }

    /// What the chosen columns leave, by stretch.
    fn left(&self, output: usize, chosen: &Chosen) -> Vec<Vec<f64>> {
        let each = self.data.stretches.iter().zip(self.predicted(chosen)).zip(&self.skip);
        each.map(|((s, run), skip)| s.outputs[output].iter().zip(run).skip(*skip).map(|(y, x)| y - x).collect()).collect()
    }

    /// XᵀX of the chosen columns.
    fn energy(&self, chosen: &Chosen) -> DMatrix<f64> {
        let mut gram = DMatrix::zeros(chosen.columns.len(), chosen.columns.len());
        for (columns, skip) in self.columns.iter().zip(&self.skip) {
            let x = columns.rows_range(*skip..).select_columns(&chosen.columns);
            gram += x.tr_mul(&x);
        }
        gram
    }
}

/// Outputs of each stretch, simulated from its first sample; `None` if any cannot be.
fn simulate(model: &dyn RegressorModel, theta: &[f64], data: &Dataset) -> Option<Vec<Vec<Vec<f64>>>> {
    let mut simulator = Simulator::new(model, theta).ok()?;
    data.stretches.iter().map(|s| simulator.run_measured(s).ok()).collect()
}

/// Parts whose reference is the simulation of a flexible model that has none.
fn with_own_reference<'a>(library: &Library, train: &'a Dataset, held_out: &'a Dataset) -> [Part<'a>; 2] {
    let parts = [train, held_out].map(|d| Part::new(library, d, None));
    let fits: Vec<Fit> = (0..train.outputs.len()).map(|i| Fit::of(&parts[0], i)).collect();
    parts.map(|part| {
        let by_output: Vec<Vec<Vec<f64>>> = fits.iter().map(|f| part.predicted(&f.chosen)).collect();
        let reference: Vec<Vec<Vec<f64>>> =
            (0..part.data.stretches.len()).map(|s| by_output.iter().map(|runs| runs[s].clone()).collect()).collect();
        Part::new(library, part.data, Some(&reference))
    })
}

/// The flexible model of one output.
#[derive(Debug)]
struct Fit {
    chosen: Chosen,
    ar: Autoregression,
}

impl Fit {
    /// Saturates the model first: what a generous choice leaves has the noise's colour, while a residual with dynamics still in
    /// it would pass them off as colour. Then chooses strictly under that colour.
    fn of(part: &Part<'_>, output: usize) -> Self {
        let samples = part.samples() as f64;
        let saturated = choose(&part.plain_gram(output), samples, Penalty::Akaike);
        let chosen = choose(&part.gram(output, &colour(&part.left(output, &saturated))), samples, Penalty::ExtendedBayes);
        let ar = colour(&part.left(output, &chosen));
        Self { chosen, ar }
    }

    /// σw² tr((XwᵀXw)⁻¹ XᵀX): the noise energy that the fit took out of its own data, and that its errors add to other data.
    fn disturbance(&self, part: &Part<'_>, samples: usize) -> f64 {
        let freedom = 1.0 - self.chosen.columns.len() as f64 / samples as f64;
        self.ar.innovation / freedom * (&self.chosen.inverse * part.energy(&self.chosen)).trace()
    }
}

fn colour(residuals: &[Vec<f64>]) -> Autoregression {
    Autoregression::fit(&residuals.iter().map(Vec::as_slice).collect::<Vec<_>>())
}

fn ceiling(parts: &[Part<'_>; 2], output: usize, narx: Option<f64>, base: Option<f64>) -> Judged {
    let [train, held_out] = parts;
    let fit = Fit::of(train, output);
    let samples = [train.samples(), held_out.samples()];
    let left = |part: &Part<'_>| part.left(output, &fit.chosen).iter().flatten().map(|e| e * e).sum::<f64>();
    let predicted = held_out.predicted(&fit.chosen);
    let measured = held_out.data.stretches.iter().zip(&predicted);
    let held: Vec<(f64, f64)> = measured.flat_map(|(s, run)| s.outputs[output].iter().copied().zip(run.iter().copied())).collect();
    let spread = spread(&held);
    let percent = |variance: f64| (spread > 0.0).then(|| 100.0 * (1.0 - (variance * held.len() as f64 / spread).sqrt()));
    let flexible = fit_percent(&held);
    let reached = [flexible, narx, base].into_iter().flatten().fold(f64::NEG_INFINITY, f64::max);
    let taken = fit.disturbance(train, samples[0]);
    let fitted = left(train);
    let independent = |n: usize| fit.ar.effective_samples_of_variance(n);
    let relative = (2.0 / independent(samples[0] + samples[1]) + 2.0 / independent(samples[1])).sqrt();
    let level = Level {
        samples,
        fitted: fitted + taken.min(fitted),
        left: left(held_out),
        added: fit.disturbance(held_out, samples[0]),
        bound: samples[1] as f64 / held.len() as f64 * spread * (1.0 - 0.01 * reached).powi(2),
        relative,
    };
    let variance = level.variance();
    let expected = percent(variance).map(|c| c.max(reached));
    let highest = percent(variance * (1.0 - 1.96 * relative).max(0.0)).map(|c| c.max(reached));
    let mut found = OutputCeiling {
        output: train.data.outputs[output].name.to_string(),
        fit: expected,
        range: highest.map(|h| (reached, h)),
        innovations: percent(fit.ar.innovation).map(|c| c.max(reached)),
        flexible,
        flexible_below: flexible.zip(base).and_then(|(f, b)| (f < b - 0.05).then_some(b)),
        narx,
        noise: variance.sqrt(),
        terms: fit.chosen.columns.len(),
        statement: String::new(),
    };
    found.statement = statement(&found);
    Judged { ceiling: found, expected_error: fitted + 2.0 * taken }
}

/// What the flexible model left, from which the noise level follows. Squared errors are summed over samples.
#[derive(Debug, Clone, Copy)]
struct Level {
    /// Training samples, held-out samples.
    samples: [usize; 2],
    /// Left of the training data, with what the fit took of their noise put back.
    fitted: f64,
    /// Left of the held-out data.
    left: f64,
    /// Of it, what errors of the flexible model are expected to add.
    added: f64,
    /// What the best model left of the held-out data: no noise is larger.
    bound: f64,
    /// Standard error of the noise variance, as a share of it.
    relative: f64,
}

impl Level {
    fn variance(&self) -> f64 {
        let [n, held] = self.samples.map(|n| n as f64);
        // Where its own errors make up much of what it leaves, the flexible model does not carry over, and the training data speak.
        if self.added > 0.5 * self.left {
            return (self.fitted / n).min(self.bound / held);
        }
        let other = (self.left - self.added).min(self.bound);
        let (pooled, own) = ((self.fitted + other) / (n + held), other / held);
        // Held-out data that are quieter than chance allows have a noise of their own.
        if own < pooled * (1.0 - 1.96 * self.relative) { own } else { pooled }
    }
}

fn statement(found: &OutputCeiling) -> String {
    let (Some(fit), Some((low, high))) = (found.fit, found.range) else {
        return format!("{} never changes in the held-out data: there is no fit to bound", found.output);
    };
    let yardstick = found
        .narx
        .map_or_else(|| "the free run of a short NARX model diverges".to_owned(), |n| format!("a short NARX model reaches {n:.1} %"));
    let below = found.flexible.zip(found.flexible_below).map_or_else(String::new, |(flexible, own)| {
        format!("; the flexible model behind this reaches {flexible:.1} % itself, less than the identified model's {own:.1} %, so that the bound may be too low")
    });
    format!(
        "{}: no model of these commands is expected to exceed {fit:.1} % on the held-out data (seen {low:.1} %, at most {high:.1} %); {yardstick}{below}",
        found.output
    )
}

fn pairs(data: &Dataset, simulated: &[Vec<Vec<f64>>], output: usize) -> Vec<(f64, f64)> {
    let each = data.stretches.iter().zip(simulated);
    each.flat_map(|(s, run)| s.outputs[output].iter().copied().zip(run[output].iter().copied())).collect()
}

/// Σ (y − mean y)² of measured values, first of each pair.
fn spread(pairs: &[(f64, f64)]) -> f64 {
    let mean = pairs.iter().map(|(y, _)| y).sum::<f64>() / pairs.len().max(1) as f64;
    pairs.iter().map(|(y, _)| (y - mean).powi(2)).sum()
}

/// Fit in percent as validation defines it; `None` where nothing is measured or it never changes.
fn fit_percent(pairs: &[(f64, f64)]) -> Option<f64> {
    let error: f64 = pairs.iter().map(|(y, x)| (y - x).powi(2)).sum();
    let spread = spread(pairs);
    (spread > 0.0).then(|| 100.0 * (1.0 - (error / spread).sqrt()))
}
