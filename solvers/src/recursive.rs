//! `recursive`: least squares sample by sample, for running on the robot.
//!
//! Rows are those of the integral form of the regression: the equation integrated over a sliding window, inputs held,
//! outputs by the trapezoid rule. Each row is rotated into one triangle R with R z = q by Givens rotations, the
//! square-root form of recursive least squares: it needs no inverse and no normal equations, cannot lose its
//! definiteness, and after any number of samples holds the batch solution. Memory is fixed when the estimator is made,
//! and a sample allocates nothing. With forgetting, R fades by e^{−Δt / (2 memory)} before each row.

use serde::{Deserialize, Serialize};
use wheelwright_core::model::{ParameterMap, RegressorModel, Sample};
use wheelwright_core::solver::{Problem, Solution, SolveError, Solver, Status};

use crate::output_error::not_identifiable;

/// A diagonal element of the triangle this much smaller than its column shows nothing.
const RANK: f64 = 1e-10;

/// Settings of the `recursive` solver.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Recursive {
    /// Window of the integral in samples. Default 10.
    pub window: usize,
    /// Time after which a row counts 1/e of a new one \[s\]; no forgetting by default.
    pub memory_s: Option<f64>,
}

impl Default for Recursive {
    fn default() -> Self {
        Self { window: 10, memory_s: None }
    }
}

/// The estimator: feed it samples, ask it for θ.
#[derive(Debug)]
pub struct Estimator<'a> {
    model: &'a dyn RegressorModel,
    map: ParameterMap,
    memory_s: Option<f64>,
    /// Integrals of [Φ y] over the last intervals, a ring.
    intervals: Vec<f64>,
    filled: usize,
    next: usize,
    last: Option<f64>,
    held: Vec<f64>,
    before: Vec<f64>,
    slopes: Vec<f64>,
    phi: Vec<f64>,
    y: Vec<f64>,
    /// One row [Φ T, y − Φ c] over the window, and the triangle of all rows before it, row-major.
    row: Vec<f64>,
    triangle: Vec<f64>,
    free: Vec<f64>,
    known: bool,
    innovation: Vec<f64>,
}

impl Recursive {
    /// An estimator for a model, parameters tied or fixed by `map`.
    ///
    /// # Errors
    /// [`SolveError::Setting`].
    pub fn start<'a>(&self, model: &'a dyn RegressorModel, map: &ParameterMap) -> Result<Estimator<'a>, SolveError> {
        let wrong = |key: &str, reason: &str| Err(SolveError::Setting { key: key.to_owned(), reason: reason.to_owned() });
        if self.window == 0 {
            return wrong("window", "0 samples: at least one interval is needed");
        }
        if self.memory_s.is_some_and(|m| !(m > 0.0 && m.is_finite())) {
            return wrong("memory_s", "must be a positive time in seconds; leave it out for no forgetting");
        }
        let (equations, parameters, free) = (model.equations(), model.parameters().len(), map.free.len());
        Ok(Estimator {
            model,
            map: map.clone(),
            memory_s: self.memory_s,
            intervals: vec![0.0; self.window * equations * (parameters + 1)],
            filled: 0,
            next: 0,
            last: None,
            held: vec![0.0; model.inputs().len()],
            before: vec![0.0; model.outputs().len()],
            slopes: vec![0.0; model.outputs().len()],
            phi: vec![0.0; equations * parameters],
            y: vec![0.0; equations],
            row: vec![0.0; free + 1],
            triangle: vec![0.0; (free + 1) * (free + 1)],
            free: vec![0.0; free],
            known: false,
            innovation: vec![0.0; equations],
        })
    }
}

impl Estimator<'_> {
    /// Takes a sample: outputs measured at `time` \[s\] and the inputs held from then on. True if a window was full and
    /// its rows were taken in. A time that does not advance starts a new stretch.
    pub fn push(&mut self, time: f64, inputs: &[f64], outputs: &[f64]) -> bool {
        let interval = self.last.map(|last| time - last).filter(|dt| *dt > 0.0);
        if interval.is_none() {
            self.filled = 0;
        }
        if let Some(interval) = interval {
            self.integrate(interval, outputs);
        }
        self.last = Some(time);
        self.held.copy_from_slice(inputs);
        self.before.copy_from_slice(outputs);
        let full = self.filled * self.row_length() == self.intervals.len();
        if let (true, Some(interval)) = (full, interval) {
            self.take_in(interval);
        }
        full
    }

    /// Forgets the last sample, not what was learned: the next one starts a new stretch.
    pub fn new_stretch(&mut self) {
        self.last = None;
    }

    /// Writes θ; false while the samples do not determine it.
    pub fn theta(&self, theta: &mut [f64]) -> bool {
        let z = self.free.len();
        for (i, t) in theta.iter_mut().enumerate() {
            *t = self.map.offset[i] + (0..z).map(|j| self.map.matrix[i * z + j] * self.free[j]).sum::<f64>();
        }
        self.known
    }

    /// How much each equation's response over the last window differed from what the samples before it predicted, per
    /// second; zero until they determined θ.
    pub fn innovation(&self) -> &[f64] {
        &self.innovation
    }

    /// Numbers kept for one interval.
    fn row_length(&self) -> usize {
        self.y.len() * (self.model.parameters().len() + 1)
    }

    /// Adds the integral of [Φ y] over one interval to the ring.
    fn integrate(&mut self, interval: f64, outputs: &[f64]) {
        let (length, parameters) = (self.row_length(), self.model.parameters().len());
        for ((slope, now), before) in self.slopes.iter_mut().zip(outputs).zip(&self.before) {
            *slope = (now - before) / interval;
        }
        let kept = &mut self.intervals[self.next * length..(self.next + 1) * length];
        kept.fill(0.0);
        for outputs in [self.before.as_slice(), outputs] {
            self.model.regressor(Sample { inputs: &self.held, outputs, accelerations: &self.slopes }, &mut self.phi, &mut self.y);
            let rows = kept.chunks_exact_mut(parameters + 1).zip(self.phi.chunks_exact(parameters)).zip(&self.y);
            for ((kept, phi), y) in rows {
                kept.iter_mut().zip(phi.iter().chain([y])).for_each(|(sum, value)| *sum += 0.5 * interval * value);
            }
        }
        let window = self.intervals.len() / length;
        self.next = (self.next + 1) % window;
        self.filled = (self.filled + 1).min(window);
    }

    fn take_in(&mut self, interval: f64) {
        let (length, parameters, z) = (self.row_length(), self.model.parameters().len(), self.free.len());
        let window = self.intervals.len() / length;
        if let Some(memory) = self.memory_s {
            let fade = (-0.5 * interval / memory).exp();
            self.triangle.iter_mut().for_each(|r| *r *= fade);
        }
        for e in 0..self.y.len() {
            self.row.fill(0.0);
            for kept in self.intervals.chunks_exact(length) {
                let kept = &kept[e * (parameters + 1)..(e + 1) * (parameters + 1)];
                for (i, phi) in kept[..parameters].iter().enumerate() {
                    self.row[z] -= phi * self.map.offset[i];
                    for j in 0..z {
                        self.row[j] += phi * self.map.matrix[i * z + j];
                    }
                }
                self.row[z] += kept[parameters];
            }
            let predicted: f64 = self.row.iter().zip(&self.free).map(|(phi, f)| phi * f).sum();
            self.innovation[e] = if self.known { (self.row[z] - predicted) / (window as f64 * interval) } else { 0.0 };
            self.rotate();
        }
        self.known = self.substitute();
    }

    /// Rotates the row into the triangle, which leaves the row zero.
    fn rotate(&mut self) {
        let n = self.row.len();
        for k in 0..n {
            let (head, tail) = (self.triangle[k * n + k], self.row[k]);
            if tail == 0.0 {
                continue;
            }
            let length = head.hypot(tail);
            let (c, s) = (head / length, tail / length);
            for j in k..n {
                let (above, below) = (self.triangle[k * n + j], self.row[j]);
                self.triangle[k * n + j] = c * above + s * below;
                self.row[j] = c * below - s * above;
            }
        }
    }

    /// Solves the triangle for the free values; false if it does not determine them.
    fn substitute(&mut self) -> bool {
        let (n, z) = (self.row.len(), self.free.len());
        let determined = (0..z).all(|k| {
            let column: f64 = (0..=k).map(|i| self.triangle[i * n + k].powi(2)).sum();
            self.triangle[k * n + k].abs() > RANK * column.sqrt()
        });
        if determined {
            for k in (0..z).rev() {
                let known: f64 = (k + 1..z).map(|j| self.triangle[k * n + j] * self.free[j]).sum();
                self.free[k] = (self.triangle[k * n + z] - known) / self.triangle[k * n + k];
            }
        }
        determined
    }

    /// Free parameters without a diagonal element of their own, and the condition of the scaled triangle.
    fn rank(&self) -> (Vec<usize>, f64) {
        let (n, z) = (self.row.len(), self.free.len());
        let length = |k: usize| (0..=k).map(|i| self.triangle[i * n + k].powi(2)).sum::<f64>().sqrt();
        let hidden = (0..z).filter(|&k| self.triangle[k * n + k].abs() <= RANK * length(k)).collect();
        let entry = |i: usize, j: usize| if i <= j && length(j) > 0.0 { self.triangle[i * n + j] / length(j) } else { 0.0 };
        let scaled = nalgebra::DMatrix::from_fn(z, z, entry);
        let values = scaled.singular_values();
        (hidden, values.max() / values.min())
    }
}

#[typetag::serde(name = "recursive")]
impl Solver for Recursive {
    fn name(&self) -> &str {
        "recursive"
    }

    fn about(&self) -> String {
        "least squares sample by sample in constant memory, as it runs on the robot; forgetting optional".to_owned()
    }

    fn solve(&self, problem: &Problem<'_>) -> Result<Solution, SolveError> {
        let mut estimator = self.start(problem.model, &problem.map)?;
        let mut rows = 0;
        for stretch in &problem.data.stretches {
            estimator.new_stretch();
            let (mut inputs, mut outputs) = (vec![0.0; stretch.inputs.len()], vec![0.0; stretch.outputs.len()]);
            for (k, time) in stretch.time.iter().enumerate() {
                inputs.iter_mut().zip(&stretch.inputs).for_each(|(x, c)| *x = c[k]);
                outputs.iter_mut().zip(&stretch.outputs).for_each(|(x, c)| *x = c[k]);
                rows += usize::from(estimator.push(*time, &inputs, &outputs));
            }
        }
        if rows == 0 {
            let needed_s = (10 * self.window.max(problem.map.free.len())) as f64 * problem.data.period();
            let what = format!("filling windows of {} intervals", self.window);
            return Err(SolveError::TooFewSamples { samples: 0, parameters: problem.map.free.len(), what, needed_s });
        }
        let mut theta = vec![0.0; problem.map.offset.len()];
        let known = estimator.theta(&mut theta);
        let (hidden, condition) = estimator.rank();
        let transform = nalgebra::DMatrix::from_row_slice(theta.len(), problem.map.free.len(), &problem.map.matrix);
        if let (false, Some(error)) = (known, not_identifiable(problem, &transform, &hidden)) {
            return Err(error);
        }
        let outside = |i: &usize| !(problem.bounds[*i].0..=problem.bounds[*i].1).contains(&theta[*i]);
        let warnings = (0..theta.len()).filter(outside).map(|i| {
            let name = &problem.model.parameters()[i].name;
            format!("{name} = {:.4} is outside its bounds, which `recursive` does not keep", theta[i])
        });
        Ok(Solution {
            std: None,
            ci95: None,
            status: Status::Solved,
            condition,
            at_bound: Vec::new(),
            steps: vec![format!(
                "took {rows} samples in one by one, each as an integral over {} intervals{}",
                self.window,
                self.memory_s.map_or_else(String::new, |m| format!(", forgetting with {m} s of memory"))
            )],
            warnings: warnings.collect(),
            regression: None,
            theta,
        })
    }
}
