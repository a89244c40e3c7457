//! Linear regression: rows of Φ θ = y from a model and a data set, conditioned so that least squares is right.
//!
//! Φ and y are evaluated on raw samples, with raw central differences for the accelerations; then every column and the
//! response go through the same zero-phase filter. Filtering is linear and the accelerations enter Φ with constant
//! coefficients, so it commutes with Φ θ: θ is untouched, noise beyond the cut-off is gone. Nothing here knows how many
//! equations, parameters or channels a model has. Each stretch is conditioned by itself.

mod settings;

use std::ops::Range;

use crate::dataset::{Dataset, Stretch};
use crate::model::{ModelError, RegressorModel, Sample};
use crate::signal::{self, Butterworth, SignalError, ZeroPhase};
use crate::solver::SolveError;

pub use settings::{Form, Pairing, Products, Settings};

/// Cut-off where none is asked for \[Hz\]: above what drives a robot, below most of what its encoders add.
const CUTOFF_HZ: f64 = 1.0;
/// Share of the sampling rate that this cut-off does not exceed.
const CUTOFF_SHARE: f64 = 0.25;
/// Rows evaluated at a time: what Φ of so many rows takes stays in the first-level cache.
const BLOCK: usize = 128;
/// Rows conditioned at a time, at least. A long stretch is worked through in parts, so that memory stays flat.
const PART: usize = 8192;
/// Settling times of the filter by which parts overlap: its response has then decayed to 1e-18, below rounding.
const OVERLAP: usize = 6;

/// Rows of one equation over one stretch, column by column.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EquationRows {
    /// Columns of Φ, one a parameter; an empty one is zero throughout.
    pub columns: Vec<Vec<f64>>,
    /// The response y.
    pub response: Vec<f64>,
}

/// Rows of all equations over one stretch or a part of it.
#[derive(Debug, Clone, PartialEq)]
pub struct StretchRows {
    /// Index of the stretch in the data set.
    pub stretch: usize,
    /// Time of each row \[s\]; for the integral form the start of its window.
    pub time: Vec<f64>,
    /// One entry an equation.
    pub equations: Vec<EquationRows>,
}

impl StretchRows {
    /// Appends the part that follows.
    fn extend(&mut self, part: Self) {
        let before = self.time.len();
        self.time.extend(part.time);
        for (equation, more) in self.equations.iter_mut().zip(part.equations) {
            equation.response.extend(more.response);
            for (column, more) in equation.columns.iter_mut().zip(more.columns) {
                if !(column.is_empty() && more.is_empty()) {
                    column.resize(before, 0.0);
                    column.extend(more);
                    column.resize(self.time.len(), 0.0);
                }
            }
        }
    }
}

/// What was done on the way to the rows.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Preparation {
    /// Rows of each equation over all stretches.
    pub rows: usize,
    /// Sampling period \[s\]: root mean square over the rows, which is how it enters the sampling error.
    pub period: f64,
    /// A sentence a step, for a report.
    pub steps: Vec<String>,
    /// What a user should know.
    pub warnings: Vec<String>,
}

/// Makes the rows of each stretch in turn and hands them to `each`, a long stretch in several parts.
///
/// Parts are filtered with an overlap in which the filter forgets where it started, so the rows are those of the whole
/// stretch to rounding. Stretches too short for the filter and the trimming are left out with a warning.
///
/// # Errors
/// [`SolveError::Setting`] or [`SolveError::Signal`] for settings that do not fit the data, [`SolveError::TooFewSamples`]
/// if no stretch is long enough, [`SolveError::Model`] if the model's regressor is not finite.
pub fn visit(
    model: &dyn RegressorModel,
    data: &Dataset,
    settings: &Settings,
    each: &mut dyn FnMut(StretchRows),
) -> Result<Preparation, SolveError> {
    settings.check()?;
    let mut work = Work::new(model, data, settings);
    for (index, stretch) in data.stretches.iter().enumerate() {
        work.rows(index, stretch, each)?;
    }
    work.finish(data)
}

/// The rows of all stretches, for what needs them together.
///
/// # Errors
/// As [`visit`].
pub fn build(model: &dyn RegressorModel, data: &Dataset, settings: &Settings) -> Result<(Vec<StretchRows>, Preparation), SolveError> {
    let mut all: Vec<StretchRows> = Vec::new();
    let preparation = visit(model, data, settings, &mut |rows| match all.last_mut() {
        Some(last) if last.stretch == rows.stretch => last.extend(rows),
        _ => all.push(rows),
    })?;
    Ok((all, preparation))
}

/// A filter designed for one sampling period, and the samples that go at each end.
#[derive(Debug, Clone)]
struct Conditioner {
    period: f64,
    cutoff_hz: f64,
    filter: Option<ZeroPhase>,
    trim: usize,
}

struct Work<'a> {
    model: &'a dyn RegressorModel,
    settings: &'a Settings,
    conditioner: Option<Conditioner>,
    rows: usize,
    period_squares: f64,
    stretches: usize,
    resampled: usize,
    worst_jitter: f64,
    dropped: Vec<String>,
    needed_s: f64,
}

impl<'a> Work<'a> {
    fn new(model: &'a dyn RegressorModel, data: &Dataset, settings: &'a Settings) -> Self {
        let stretches = data.stretches.len();
        let (rows, resampled, needed_s) = (0, 0, 0.0);
        let dropped = Vec::new();
        Self { model, settings, conditioner: None, rows, period_squares: 0.0, stretches, resampled, worst_jitter: 0.0, dropped, needed_s }
    }

    /// Hands out the rows of one stretch, in parts; none if it is too short.
    fn rows(&mut self, index: usize, stretch: &Stretch, each: &mut dyn FnMut(StretchRows)) -> Result<(), SolveError> {
        let Some(spacing) = signal::spacing(&stretch.time) else { return Ok(()) };
        let period = spacing.period;
        let conditioner = self.conditioner(period)?;
        let integral = self.settings.form == Form::Integral;
        let least = if integral {
            self.settings.integral_samples + 1
        } else {
            (2 * conditioner.trim + 2).max(conditioner.filter.as_ref().map_or(2, ZeroPhase::min_samples))
        };
        self.needed_s = self.needed_s.max(least as f64 * period);
        let even = integral || spacing.jitter <= self.settings.max_jitter;
        let gridded = (!even).then(|| signal::resample(stretch, period));
        let on_grid = gridded.as_ref().unwrap_or(stretch);
        if on_grid.len() < least {
            self.dropped.push(stretch.label.clone());
            return Ok(());
        }
        self.worst_jitter = self.worst_jitter.max(spacing.jitter);
        self.resampled += usize::from(!even);
        for part in parts(on_grid.len(), &conditioner, integral.then_some(self.settings.integral_samples)) {
            let samples = on_grid.slice(part.samples.clone());
            let kept = part.kept.start - part.samples.start..part.kept.end - part.samples.start;
            let (time, equations) =
                if integral { self.integral(&samples)? } else { self.derivative(&samples, conditioner.filter.as_ref(), kept)? };
            self.rows += time.len();
            self.period_squares += period * period * time.len() as f64;
            each(StretchRows { stretch: index, time, equations });
        }
        Ok(())
    }

    /// The filter for a sampling period, kept from stretch to stretch while the period stays the same.
    fn conditioner(&mut self, period: f64) -> Result<Conditioner, SignalError> {
        if let Some(known) = &self.conditioner
            && (known.period - period).abs() <= 1e-9 * period
        {
            return Ok(known.clone());
        }
        let rate = 1.0 / period;
        let cutoff_hz = self.settings.cutoff_hz.unwrap_or(CUTOFF_HZ.min(CUTOFF_SHARE * rate));
        let filter = match (self.settings.form, self.settings.order) {
            (Form::Integral, _) | (_, 0) => None,
            (Form::Derivative, order) => Some(ZeroPhase::new(Butterworth::low_pass(order, cutoff_hz, rate)?, self.settings.padding)),
        };
        let settled = filter.as_ref().map_or(0, |f| f.filter().settling());
        let trim = self.settings.trim_s.map_or(settled, |t| (t / period + 1e-9).floor() as usize);
        let made = Conditioner { period, cutoff_hz, filter, trim };
        self.conditioner = Some(made.clone());
        Ok(made)
    }

    /// Rows at samples, with differences for the accelerations.
    fn derivative(
        &self,
        stretch: &Stretch,
        filter: Option<&ZeroPhase>,
        kept: Range<usize>,
    ) -> Result<(Vec<f64>, Vec<EquationRows>), SolveError> {
        let mut inputs = stretch.inputs.iter().map(|u| paired(u, self.settings.pairing)).collect::<Vec<_>>();
        let mut outputs = stretch.outputs.clone();
        let after = self.settings.products == Products::AfterFilter;
        if let (true, Some(filter)) = (after, filter) {
            apply(filter, outputs.iter_mut())?;
            if self.settings.filter_response {
                apply(filter, inputs.iter_mut())?;
            }
        }
        let accelerations: Vec<Vec<f64>> = outputs.iter().map(|x| signal::gradient(&stretch.time, x)).collect();
        let mut equations = self.evaluate(&inputs, &outputs, &accelerations)?;
        if let (false, Some(filter)) = (after, filter) {
            let responses = self.settings.filter_response;
            let columns = equations.iter_mut().flat_map(|e| e.columns.iter_mut().chain(responses.then_some(&mut e.response)));
            apply(filter, columns.filter(|c| !c.is_empty()))?;
        }
        for column in equations.iter_mut().flat_map(|e| e.columns.iter_mut().chain([&mut e.response])).filter(|c| !c.is_empty()) {
            column.truncate(kept.end);
            column.drain(..kept.start);
        }
        Ok((stretch.time[kept].to_vec(), equations))
    }

    /// Rows over sliding windows: each interval between two samples contributes the mean of Φ at its ends, with the input
    /// held and the acceleration that joins the two outputs.
    fn integral(&self, stretch: &Stretch) -> Result<(Vec<f64>, Vec<EquationRows>), SolveError> {
        let n = stretch.len() - 1;
        let steps: Vec<f64> = stretch.time.windows(2).map(|w| w[1] - w[0]).collect();
        let slopes: Vec<Vec<f64>> =
            stretch.outputs.iter().map(|x| x.windows(2).zip(&steps).map(|(w, dt)| (w[1] - w[0]) / dt).collect()).collect();
        let side = |columns: &[Vec<f64>], from: usize| -> Vec<Vec<f64>> { columns.iter().map(|c| c[from..from + n].to_vec()).collect() };
        let inputs = side(&stretch.inputs, 0);
        let mut equations = self.evaluate(&inputs, &side(&stretch.outputs, 0), &slopes)?;
        let ends = self.evaluate(&inputs, &side(&stretch.outputs, 1), &slopes)?;
        let window = self.settings.integral_samples;
        for (equation, end) in equations.iter_mut().zip(&ends) {
            let columns = equation.columns.iter_mut().zip(&end.columns).chain([(&mut equation.response, &end.response)]);
            for (start, end) in columns {
                *start = windowed(start, end, &steps, window);
            }
        }
        Ok((stretch.time[..=n - window].to_vec(), equations))
    }

    /// Φ and y at every sample, sorted into columns.
    fn evaluate(&self, inputs: &[Vec<f64>], outputs: &[Vec<f64>], accelerations: &[Vec<f64>]) -> Result<Vec<EquationRows>, SolveError> {
        let (e, p, n) = (self.model.equations(), self.model.parameters().len(), outputs.first().map_or(0, Vec::len));
        let mut equations = vec![EquationRows { columns: vec![Vec::new(); p], response: Vec::with_capacity(n) }; e];
        let (mut phi, mut y) = (vec![0.0; BLOCK * e * p], vec![0.0; BLOCK * e]);
        let mut sample = [vec![0.0; inputs.len()], vec![0.0; outputs.len()], vec![0.0; outputs.len()]];
        let read = |columns: &[Vec<f64>], k: usize, into: &mut [f64]| into.iter_mut().zip(columns).for_each(|(x, c)| *x = c[k]);
        for start in (0..n).step_by(BLOCK) {
            let count = BLOCK.min(n - start);
            for row in 0..count {
                let [u, x, a] = &mut sample;
                read(inputs, start + row, u);
                read(outputs, start + row, x);
                read(accelerations, start + row, a);
                let at = Sample { inputs: u, outputs: x, accelerations: a };
                self.model.regressor(at, &mut phi[row * e * p..(row + 1) * e * p], &mut y[row * e..(row + 1) * e]);
            }
            if phi[..count * e * p].iter().chain(&y[..count * e]).any(|x| !x.is_finite()) {
                return Err(not_finite(self.model));
            }
            for (i, equation) in equations.iter_mut().enumerate() {
                equation.response.extend(y[..count * e].iter().skip(i).step_by(e));
                for (j, column) in equation.columns.iter_mut().enumerate() {
                    let values = phi[..count * e * p].iter().skip(i * p + j).step_by(e * p);
                    append(column, values, start, n);
                }
            }
        }
        Ok(equations)
    }

    fn finish(self, data: &Dataset) -> Result<Preparation, SolveError> {
        let s = self.settings;
        if self.rows == 0 {
            let what = match (&self.conditioner, s.form) {
                (Some(c), Form::Derivative) => {
                    format!("filtering and dropping {:.2} s at both ends of {} stretch(es)", c.trim as f64 * c.period, self.stretches)
                }
                _ => format!("windows of {} samples over {} stretch(es)", s.integral_samples, self.stretches),
            };
            let parameters = self.model.parameters().len();
            return Err(SolveError::TooFewSamples { samples: 0, parameters, what, needed_s: (2.0 * self.needed_s).max(1.0).ceil() });
        }
        let period = (self.period_squares / self.rows as f64).sqrt();
        Ok(Preparation { rows: self.rows, period, steps: self.steps(data), warnings: self.warnings() })
    }

    fn steps(&self, data: &Dataset) -> Vec<String> {
        let s = self.settings;
        let mut steps = Vec::new();
        if self.resampled > 0 {
            steps.push(format!(
                "resampled {} of {} stretch(es) to an even grid: steps deviate from the period by up to {:.1} %",
                self.resampled,
                self.stretches,
                100.0 * self.worst_jitter
            ));
        }
        let names = data.inputs.iter().map(|c| c.name.as_ref()).collect::<Vec<_>>().join(", ");
        if s.form == Form::Integral {
            steps.push(format!("integrated the equations over sliding windows of {} samples, {names} held", s.integral_samples));
            return steps;
        }
        steps.push(match s.pairing {
            Pairing::Mid => format!("paired each output with the mean of {names} before and after it"),
            Pairing::Previous => format!("paired each output with {names} held over the period before it"),
            Pairing::Same => format!("paired each output with {names} of the same row"),
        });
        let Some(c) = &self.conditioner else { return steps };
        if let Some(filter) = &c.filter {
            let what = match (s.products, s.filter_response) {
                (Products::BeforeFilter, true) => "every column and the response",
                (Products::BeforeFilter, false) => "every column, not the response,",
                (Products::AfterFilter, true) => "outputs and inputs",
                (Products::AfterFilter, false) => "the outputs, not the inputs,",
            };
            let (order, cut) = (filter.filter().order(), c.cutoff_hz);
            steps.push(format!("filtered {what} with a Butterworth low-pass of order {order}, {cut} Hz, forward and backward"));
        }
        if c.trim > 0 {
            steps.push(format!("dropped {:.2} s at both ends of each stretch", c.trim as f64 * c.period));
        }
        steps
    }

    fn warnings(&self) -> Vec<String> {
        let Some(first) = self.dropped.first() else { return Vec::new() };
        vec![format!(
            "{} of {} stretch(es) shorter than the {:.2} s that filter and trimming take were not used, the first is `{first}`: a higher \
             `cutoff_hz`, a shorter `trim_s` or `form = \"integral\"` would use them",
            self.dropped.len(),
            self.stretches,
            self.needed_s
        )]
    }
}

/// A part of a stretch: the samples that are worked on, and those of them whose rows are kept.
#[derive(Debug, Clone, PartialEq)]
struct Part {
    samples: Range<usize>,
    kept: Range<usize>,
}

/// Cuts a stretch of `n` samples, or the rows of its windows, into parts.
fn parts(n: usize, conditioner: &Conditioner, window: Option<usize>) -> Vec<Part> {
    let overlap = conditioner.filter.as_ref().map_or(1, |f| OVERLAP * f.filter().settling());
    let (before, after) = window.map_or((overlap, overlap), |w| (0, w));
    let rows = window.map_or(conditioner.trim..n - conditioner.trim, |w| 0..n - w);
    let length = PART.max(4 * (before + after));
    let part = |start: usize| {
        let kept = start..(start + length).min(rows.end);
        Part { samples: start.saturating_sub(before)..(kept.end + after).min(n), kept }
    };
    rows.clone().step_by(length).map(part).collect()
}

fn not_finite(model: &dyn RegressorModel) -> SolveError {
    let reason = "its regressor returned a value that is not finite on this data".to_owned();
    SolveError::Model(ModelError::Plugin { model: model.name().to_owned(), reason })
}

/// Appends values to a column that takes no memory while it is zero; `start` rows came before, `n` come in all.
fn append<'a>(column: &mut Vec<f64>, values: impl Iterator<Item = &'a f64> + Clone, start: usize, n: usize) {
    if column.is_empty() {
        if values.clone().all(|&x| x == 0.0) {
            return;
        }
        column.reserve_exact(n);
        column.resize(start, 0.0);
    }
    column.extend(values);
}

fn apply<'c>(filter: &ZeroPhase, columns: impl Iterator<Item = &'c mut Vec<f64>>) -> Result<(), SignalError> {
    filter.apply(&mut columns.map(Vec::as_mut_slice).collect::<Vec<_>>())
}

/// The input that belongs to each sample; before the first, the first is held.
fn paired(u: &[f64], pairing: Pairing) -> Vec<f64> {
    let before = || u.first().into_iter().chain(u).copied();
    match pairing {
        Pairing::Same => u.to_vec(),
        Pairing::Previous => before().take(u.len()).collect(),
        Pairing::Mid => before().zip(u).map(|(previous, now)| 0.5 * (previous + now)).collect(),
    }
}

/// Integrals over windows of intervals, from the values at both ends of each interval; empty if all are zero.
fn windowed(start: &[f64], end: &[f64], steps: &[f64], window: usize) -> Vec<f64> {
    if start.is_empty() && end.is_empty() {
        return Vec::new();
    }
    let value = |column: &[f64], k: usize| column.get(k).copied().unwrap_or(0.0);
    let mut sums = Vec::with_capacity(steps.len() + 1);
    let mut sum = 0.0;
    sums.push(sum);
    for (k, dt) in steps.iter().enumerate() {
        sum += 0.5 * (value(start, k) + value(end, k)) * dt;
        sums.push(sum);
    }
    (0..sums.len() - window).map(|k| sums[k + window] - sums[k]).collect()
}
