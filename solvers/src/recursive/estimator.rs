//! The estimator: samples in, θ out.

use wheelwright_core::model::{ParameterMap, RegressorModel, Sample};

use super::free_run::FreeRun;
use super::givens::Givens;
use super::{Recursive, half_width};

/// Where an estimate comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stage {
    /// The samples so far do not determine θ.
    Unknown,
    /// From the regression alone: biased by the noise in its columns, no intervals.
    Regression,
    /// From the free run that follows the regression, with standard errors.
    FreeRun {
        /// Half the width of a 95 % interval in standard errors.
        half_width: f64,
    },
}

/// The estimator: feed it samples, ask it for θ.
#[derive(Debug)]
pub struct Estimator<'a> {
    model: &'a dyn RegressorModel,
    map: ParameterMap,
    memory_s: Option<f64>,
    /// Integrals of [Φ T, y − Φ c] over the last intervals, a ring.
    intervals: Vec<f64>,
    filled: usize,
    next: usize,
    last: Option<f64>,
    held: Vec<f64>,
    before: Vec<f64>,
    slopes: Vec<f64>,
    phi: Vec<f64>,
    y: Vec<f64>,
    /// One row over the window, and the triangle of all rows before it.
    row: Vec<f64>,
    triangle: Givens,
    rows: f64,
    free: Vec<f64>,
    scratch: Vec<f64>,
    known: bool,
    innovation: Vec<f64>,
    free_run: Option<FreeRun<'a>>,
}

impl<'a> Estimator<'a> {
    pub(super) fn new(settings: &Recursive, model: &'a dyn RegressorModel, map: &ParameterMap) -> Self {
        let (equations, parameters, free) = (model.equations(), model.parameters().len(), map.free.len());
        // Only as many equations as outputs can be simulated.
        let refine = settings.refine && equations == model.outputs().len();
        Self {
            model,
            map: map.clone(),
            memory_s: settings.memory_s,
            intervals: vec![0.0; settings.window * equations * (free + 1)],
            filled: 0,
            next: 0,
            last: None,
            held: vec![0.0; model.inputs().len()],
            before: vec![0.0; model.outputs().len()],
            slopes: vec![0.0; model.outputs().len()],
            phi: vec![0.0; equations * parameters],
            y: vec![0.0; equations],
            row: vec![0.0; free + 1],
            triangle: Givens::new(free),
            rows: 0.0,
            free: vec![0.0; free],
            scratch: vec![0.0; 2 * free],
            known: false,
            innovation: vec![0.0; equations],
            free_run: refine.then(|| FreeRun::new(model, map, settings)),
        }
    }

    /// Takes a sample: outputs measured at `time` \[s\] and the inputs held from then on. True if a window was full and
    /// its rows were taken in. A time that does not advance starts a new stretch.
    pub fn push(&mut self, time: f64, inputs: &[f64], outputs: &[f64]) -> bool {
        let interval = self.last.map(|last| time - last).filter(|dt| *dt > 0.0);
        match interval {
            Some(interval) => self.integrate(interval, outputs),
            None => self.filled = 0,
        }
        let full = self.filled * self.row_length() == self.intervals.len();
        if let (true, Some(interval)) = (full, interval) {
            self.take_in(interval);
        }
        self.follow(interval, outputs);
        self.last = Some(time);
        self.held.copy_from_slice(inputs);
        self.before.copy_from_slice(outputs);
        full
    }

    /// Forgets the last sample, not what was learned: the next one starts a new stretch.
    pub fn new_stretch(&mut self) {
        self.last = None;
    }

    /// Writes the θ of the regression; false while the samples do not determine it.
    pub fn theta(&mut self, theta: &mut [f64]) -> bool {
        let z = self.free.len();
        let known = self.triangle.solve(&mut self.free);
        for (i, t) in theta.iter_mut().enumerate() {
            *t = self.map.offset[i] + (0..z).map(|j| self.map.matrix[i * z + j] * self.free[j]).sum::<f64>();
        }
        known
    }

    /// Writes the best θ there is and its standard errors: not a number for a parameter that is fixed, and for all of them unless
    /// the estimate comes from the free run.
    pub fn estimate(&mut self, theta: &mut [f64], std: &mut [f64]) -> Stage {
        if let Some(freedom) = self.free_run.as_mut().and_then(|f| f.estimate(theta, std)) {
            return Stage::FreeRun { half_width: half_width(freedom) };
        }
        std.fill(f64::NAN);
        if self.theta(theta) { Stage::Regression } else { Stage::Unknown }
    }

    /// How much each equation's response over the last window differed from what the rows before it predicted, per
    /// second; zero until they determined θ.
    pub fn innovation(&self) -> &[f64] {
        &self.innovation
    }

    /// Why there are no intervals, if there are none.
    pub fn obstacle(&self) -> Option<&'static str> {
        match &self.free_run {
            Some(run) if run.ready() => None,
            Some(_) if !self.known => Some("the samples so far do not determine the parameters"),
            Some(run) if run.refusal().is_some() => run.refusal(),
            Some(_) => Some("the free run that gives them has not settled yet: it needs more samples in unbroken stretches"),
            None if self.y.len() != self.before.len() => Some("the model cannot be simulated, having not as many equations as outputs"),
            None => Some("the regression alone has none that cover: noise in its columns biases it by more than its scatter"),
        }
    }

    /// True if the free-run errors on every output undo each other from sample to sample, as the rounding of encoder counts does
    /// that are differenced: then [`Velocity::Difference`](crate::Velocity::Difference) is what the velocities are. Only an estimator
    /// that takes them so can tell: taken for instantaneous ones they leave the trace of half a sample, which covers it up.
    pub fn counts(&self) -> bool {
        self.free_run.as_ref().is_some_and(FreeRun::undone)
    }

    /// Free parameters that the regression cannot tell, and the condition of its scaled triangle.
    pub(super) fn rank(&self) -> (Vec<usize>, f64) {
        ((0..self.free.len()).filter(|&k| !self.triangle.shown(k)).collect(), self.triangle.condition())
    }

    /// Numbers kept for one interval.
    fn row_length(&self) -> usize {
        self.y.len() * (self.free.len() + 1)
    }

    /// Adds the integral over one interval to the ring.
    fn integrate(&mut self, interval: f64, outputs: &[f64]) {
        let (length, parameters, z) = (self.row_length(), self.map.offset.len(), self.free.len());
        for ((slope, now), before) in self.slopes.iter_mut().zip(outputs).zip(&self.before) {
            *slope = (now - before) / interval;
        }
        let kept = &mut self.intervals[self.next * length..(self.next + 1) * length];
        kept.fill(0.0);
        for outputs in [self.before.as_slice(), outputs] {
            self.model.regressor(Sample { inputs: &self.held, outputs, accelerations: &self.slopes }, &mut self.phi, &mut self.y);
            let rows = kept.chunks_exact_mut(z + 1).zip(self.phi.chunks_exact(parameters)).zip(&self.y);
            for ((kept, phi), y) in rows {
                kept[z] += 0.5 * interval * y;
                // What an equation says nothing of costs nothing.
                for (i, phi) in phi.iter().enumerate().filter(|(_, phi)| **phi != 0.0) {
                    let share = 0.5 * interval * phi;
                    kept[z] -= share * self.map.offset[i];
                    kept.iter_mut().zip(&self.map.matrix[i * z..(i + 1) * z]).for_each(|(kept, t)| *kept += share * t);
                }
            }
        }
        let window = self.intervals.len() / length;
        self.next = if self.next + 1 == window { 0 } else { self.next + 1 };
        self.filled = (self.filled + 1).min(window);
    }

    fn take_in(&mut self, interval: f64) {
        let (length, width) = (self.row_length(), self.row.len());
        let window = self.intervals.len() / length;
        if let Some(memory) = self.memory_s {
            self.triangle.fade((-0.5 * interval / memory).exp());
            self.rows *= (-interval / memory).exp();
        }
        for (e, innovation) in self.innovation.iter_mut().enumerate() {
            self.row.fill(0.0);
            for kept in self.intervals.chunks_exact(length) {
                self.row.iter_mut().zip(&kept[e * width..]).for_each(|(sum, kept)| *sum += kept);
            }
            let found = self.triangle.rotate(&mut self.row);
            *innovation = if self.known { found / (window as f64 * interval) } else { 0.0 };
            self.rows += 1.0;
        }
        // What is known stays so, unless it is forgotten.
        if !self.known || self.memory_s.is_some() {
            self.known = self.triangle.determined();
        }
    }

    /// Lets the free run go on, or start where the regression knows enough.
    fn follow(&mut self, interval: Option<f64>, outputs: &[f64]) {
        let Some(run) = &mut self.free_run else { return };
        match interval {
            Some(interval) => run.push(interval, &self.held, outputs),
            None => run.begin_stretch(outputs),
        }
        let z = self.free.len();
        if !self.known || !run.waits() || self.rows < super::FIRST_ROWS * z as f64 || !self.triangle.solve(&mut self.free) {
            return;
        }
        let variance = self.triangle.residual() / (self.rows - z as f64);
        let (deviations, scratch) = self.scratch.split_at_mut(z);
        for (k, deviation) in deviations.iter_mut().enumerate() {
            *deviation = (variance * self.triangle.variance(|j| f64::from(u8::from(j == k)), scratch)).sqrt();
        }
        run.start(&self.free, deviations, outputs);
    }
}
