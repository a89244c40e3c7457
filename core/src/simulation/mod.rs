//! Free-run simulation: a model driven by recorded inputs from an initial state, never corrected by the measurement.
//!
//! The equations x' = L x + N(x, u) are stepped with the exponential Runge-Kutta method ETD4RK of Cox and Matthews
//! (J. Comput. Phys. 176, 2002): exact for the linear part under held inputs, fourth order in N. Steps are fixed between
//! samples; an adaptive integrator would make results depend on tolerances and hide kinks. How long a step may be is
//! measured beforehand, by step doubling on a part of the stretch, so that numerical error never looks like physics. A model
//! that knows its motion in closed form is not stepped at all.

mod sensitivity;
mod weights;

use crate::dataset::Stretch;
use crate::model::{Flow, ModelError, RegressorModel};
pub use sensitivity::{DIFFERENCE, Direction, Sensitivities};
pub(crate) use weights::Weights;

/// Error of the simulation relative to the largest output, which the choice of the step aims at.
const TOLERANCE: f64 = 1e-9;
/// Step lengths that differ by less than this share are one: stamps differ in their last bits, and the error is far below the above.
const SAME_STEP: f64 = 1e-10;
/// Step lengths whose weights are kept.
const KEPT: usize = 4;
/// Sub-steps between two samples never exceed this, however stiff the parameters an optimizer tries.
const MAX_SUBSTEPS: usize = 256;

/// What a recorded velocity is of the true one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Readout {
    /// The value at the time of the sample.
    #[default]
    Instantaneous,
    /// The mean since the sample before, as a driver records that differences encoder counts. The first sample of a
    /// stretch has no such mean: the value at its time stands for it.
    IntervalMean,
}

/// A model with its parameters, ready to be run. Buffers are allocated once; stepping allocates nothing.
#[derive(Debug)]
pub struct Simulator<'a> {
    model: &'a dyn RegressorModel,
    flow: Option<&'a dyn Flow>,
    theta: Vec<f64>,
    readout: Readout,
    fixed_step: Option<f64>,
    max_step: f64,
    linear: Vec<f64>,
    /// Whether no output's rate depends on another output, and the linear part in the layout that weights then have.
    diagonal: bool,
    part: Vec<f64>,
    /// Weights of the last few step lengths, and which is in use: a shifted hold takes the same few in turn.
    weights: [Weights; KEPT],
    used: usize,
    oldest: usize,
    stages: Stages,
    input: Vec<f64>,
}

#[derive(Debug)]
struct Stages {
    state: Vec<f64>,
    travelled: Vec<f64>,
    a: Vec<f64>,
    b: Vec<f64>,
    c: Vec<f64>,
    n0: Vec<f64>,
    na: Vec<f64>,
    nb: Vec<f64>,
    nc: Vec<f64>,
}

impl<'a> Simulator<'a> {
    /// Prepares a model for simulation with parameters `theta`.
    ///
    /// # Errors
    /// [`ModelError`] if the equations do not determine the accelerations.
    pub fn new(model: &'a dyn RegressorModel, theta: &[f64]) -> Result<Self, ModelError> {
        let mut simulator = Self::unset(model);
        simulator.theta = theta.to_vec();
        simulator.linearise()?;
        Ok(simulator)
    }

    /// The buffers of a simulator whose parameters come later, by [`set_theta`](Self::set_theta).
    pub fn unset(model: &'a dyn RegressorModel) -> Self {
        let n = model.outputs().len();
        let buffer = || vec![0.0; n];
        let stages = Stages {
            state: buffer(),
            travelled: buffer(),
            a: buffer(),
            b: buffer(),
            c: buffer(),
            n0: buffer(),
            na: buffer(),
            nb: buffer(),
            nc: buffer(),
        };
        Self {
            model,
            flow: model.flow(),
            theta: vec![0.0; model.parameters().len()],
            readout: Readout::default(),
            fixed_step: None,
            max_step: f64::INFINITY,
            linear: vec![0.0; n * n],
            diagonal: true,
            part: vec![0.0; n * n],
            weights: std::array::from_fn(|_| Weights::new(n)),
            used: 0,
            oldest: 0,
            stages,
            input: vec![0.0; model.inputs().len()],
        }
    }

    /// Simulates what a driver records that reads velocities in this way.
    #[must_use]
    pub fn with_readout(mut self, readout: Readout) -> Self {
        self.readout = readout;
        for weights in &mut self.weights {
            weights.integrates = readout == Readout::IntervalMean;
            weights.step = f64::NAN;
        }
        self
    }

    /// Bounds the step \[s\] instead of choosing it for each stretch, so that runs with slightly different parameters
    /// take the same steps and their differences are smooth. [`chosen_step`](Self::chosen_step) finds one.
    #[must_use]
    pub fn with_max_step(mut self, seconds: f64) -> Self {
        self.fixed_step = Some(seconds);
        self
    }

    /// As [`with_max_step`](Self::with_max_step), in place.
    pub fn set_max_step(&mut self, seconds: f64) {
        self.fixed_step = Some(seconds);
    }

    /// The bound of the step \[s\], if it was fixed.
    pub fn max_step(&self) -> Option<f64> {
        self.fixed_step
    }

    /// Replaces the parameters.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn set_theta(&mut self, theta: &[f64]) -> Result<(), ModelError> {
        self.theta.copy_from_slice(theta);
        self.weights.iter_mut().for_each(|w| w.step = f64::NAN);
        self.linearise()
    }

    fn linearise(&mut self) -> Result<(), ModelError> {
        self.diagonal = linear_part(self.model, &self.theta, &mut self.linear)?;
        lay_out(&self.linear, self.diagonal, self.stages.state.len(), &mut self.part);
        Ok(())
    }

    /// Runs over a stretch from `initial`; `simulated` gets one vector an output, as long as the stretch.
    ///
    /// # Errors
    /// [`ModelError::Diverged`] with the time; values up to it are in `simulated`.
    pub fn run(&mut self, stretch: &Stretch, initial: &[f64], simulated: &mut [Vec<f64>]) -> Result<(), ModelError> {
        self.max_step = match self.fixed_step {
            Some(step) => step,
            None => self.chosen_step(stretch)?,
        };
        self.begin(stretch.len(), initial, simulated);
        self.proceed(stretch, 1..stretch.len(), simulated)
    }

    /// Runs over a stretch from its measured first sample.
    ///
    /// # Errors
    /// As [`run`](Self::run).
    pub fn run_measured(&mut self, stretch: &Stretch) -> Result<Vec<Vec<f64>>, ModelError> {
        let initial: Vec<f64> = stretch.outputs.iter().map(|c| c[0]).collect();
        let mut simulated = vec![Vec::new(); initial.len()];
        self.run(stretch, &initial, &mut simulated)?;
        Ok(simulated)
    }

    /// Puts the run at a state, to go on from there with [`hold`](Self::hold).
    pub fn place(&mut self, state: &[f64]) {
        self.stages.state.copy_from_slice(state);
    }

    /// Moves the state along the line from `origin`, to `factor` times its distance.
    pub fn draw(&mut self, origin: &[f64], factor: f64) {
        self.stages.state.iter_mut().zip(origin).for_each(|(x, o)| *x = o + factor * (*x - o));
    }

    /// The state the run has come to.
    pub fn state(&self) -> &[f64] {
        &self.stages.state
    }

    /// What is recorded of an output after [`hold`](Self::hold) advanced the run by `interval` \[s\].
    pub fn recorded(&self, interval: f64, output: usize) -> f64 {
        match self.readout {
            Readout::Instantaneous => self.stages.state[output],
            Readout::IntervalMean => self.stages.travelled[output] / interval,
        }
    }

    /// Advances the run by `interval` \[s\] under held inputs, in one step unless the step is bounded; allocates nothing for up
    /// to four outputs.
    ///
    /// # Errors
    /// [`ModelError`] if the equations cannot be solved where the run has come to. A run that diverges has a state that is
    /// not finite.
    pub fn hold(&mut self, inputs: &[f64], interval: f64) -> Result<(), ModelError> {
        self.max_step = self.fixed_step.unwrap_or(f64::INFINITY);
        self.input.copy_from_slice(inputs);
        self.advance(interval)
    }

    fn begin(&mut self, capacity: usize, initial: &[f64], simulated: &mut [Vec<f64>]) {
        self.stages.state.copy_from_slice(initial);
        for (out, x) in simulated.iter_mut().zip(initial) {
            out.clear();
            out.reserve(capacity);
            out.push(*x);
        }
    }

    /// Goes on from the state at the row before `rows`.
    fn proceed(&mut self, stretch: &Stretch, rows: std::ops::Range<usize>, simulated: &mut [Vec<f64>]) -> Result<(), ModelError> {
        for k in rows {
            for (held, column) in self.input.iter_mut().zip(&stretch.inputs) {
                *held = column[k - 1];
            }
            let interval = stretch.time[k] - stretch.time[k - 1];
            let advanced = self.advance(interval);
            // The equations were solved at rest: where they no longer can be, the state has left the range of numbers.
            let lost = matches!(advanced, Err(ModelError::Singular { .. } | ModelError::Overflow { .. }));
            if lost || self.stages.state.iter().any(|x| !x.is_finite()) {
                return Err(ModelError::Diverged { model: self.model.name().to_owned(), time: stretch.time[k] });
            }
            advanced?;
            for (i, out) in simulated.iter_mut().enumerate() {
                out.push(self.recorded(interval, i));
            }
        }
        Ok(())
    }

    /// Advances the state by `interval` with the held input.
    fn advance(&mut self, interval: f64) -> Result<(), ModelError> {
        if let Some(flow) = self.flow {
            return flow.advance(&self.theta, &self.input, interval, &mut self.stages.state, &mut self.stages.travelled);
        }
        // Rounding up is a call of the mathematical library: most steps do not need it.
        let ratio = interval / self.max_step - 1e-9;
        let substeps = if ratio <= 1.0 { 1 } else { (ratio.ceil() as usize).clamp(1, MAX_SUBSTEPS) };
        let step = interval / substeps as f64;
        let fits = |w: &Weights| (step - w.step).abs() <= SAME_STEP * step;
        if !fits(&self.weights[self.used]) {
            self.used = self.weights.iter().position(fits).unwrap_or_else(|| {
                let replaced = self.oldest;
                self.weights[replaced].set(step, &self.linear, self.stages.state.len(), self.diagonal);
                self.oldest = (replaced + 1) % KEPT;
                replaced
            });
        }
        self.stages.travelled.fill(0.0);
        match (self.stages.state.len(), self.diagonal) {
            (2, true) => self.steps::<2, true>(substeps),
            (2, false) => self.steps::<2, false>(substeps),
            (_, true) => self.steps::<0, true>(substeps),
            (_, false) => self.steps::<0, false>(substeps),
        }
    }

    /// Steps of ETD4RK. Written once for any number of outputs `N`, with 0 for one that is only known when it runs: two outputs
    /// whose linear part is diagonal are then a handful of instructions.
    fn steps<const N: usize, const DIAGONAL: bool>(&mut self, count: usize) -> Result<(), ModelError> {
        let Self { model, theta, part, weights, used, stages: s, input, readout, .. } = self;
        let n = if N == 0 { s.state.len() } else { N };
        let size = if DIAGONAL { n } else { n * n };
        let (w, part) = (&weights[*used], &part[..size]);
        let (full, half, half_forcing) = (&w.full[..size], &w.half[..size], &w.half_forcing[..size]);
        let (first, middle, last) = (&w.first[..size], &w.middle[..size], &w.last[..size]);
        let (x, a, b, c) = (&mut s.state[..n], &mut s.a[..n], &mut s.b[..n], &mut s.c[..n]);
        let (n0, na, nb, nc) = (&mut s.n0[..n], &mut s.na[..n], &mut s.nb[..n], &mut s.nc[..n]);
        // N(x, u) = acceleration − L x.
        let forcing = |x: &[f64], out: &mut [f64]| -> Result<(), ModelError> {
            model.accelerations(theta, input, x, out)?;
            out.iter_mut().enumerate().for_each(|(i, out)| *out -= row::<DIAGONAL>(part, i, x));
            Ok(())
        };
        for _ in 0..count {
            forcing(x, n0)?;
            for i in 0..n {
                c[i] = row::<DIAGONAL>(half, i, x);
                a[i] = c[i] + row::<DIAGONAL>(half_forcing, i, n0);
            }
            forcing(a, na)?;
            for i in 0..n {
                b[i] = c[i] + row::<DIAGONAL>(half_forcing, i, na);
            }
            forcing(b, nb)?;
            for (i, c) in c.iter_mut().enumerate() {
                let forced = 2.0 * row::<DIAGONAL>(half_forcing, i, nb) - row::<DIAGONAL>(half_forcing, i, n0);
                *c = row::<DIAGONAL>(half, i, a) + forced;
            }
            forcing(c, nc)?;
            na.iter_mut().zip(nb.iter()).for_each(|(a, b)| *a += b);
            if *readout == Readout::IntervalMean {
                let [state, first, middle, last] = &w.integral;
                for (i, travelled) in s.travelled[..n].iter_mut().enumerate() {
                    *travelled += row::<DIAGONAL>(state, i, x)
                        + row::<DIAGONAL>(first, i, n0)
                        + row::<DIAGONAL>(middle, i, na)
                        + row::<DIAGONAL>(last, i, nc);
                }
            }
            for (i, a) in a.iter_mut().enumerate() {
                *a = row::<DIAGONAL>(full, i, x)
                    + row::<DIAGONAL>(first, i, n0)
                    + row::<DIAGONAL>(middle, i, na)
                    + row::<DIAGONAL>(last, i, nc);
            }
            x.copy_from_slice(a);
        }
        Ok(())
    }

    /// The longest step \[s\] that keeps the error of a simulation over this stretch below 1e-9 of the largest output:
    /// found by doubling the number of sub-steps on windows spread over the stretch.
    ///
    /// # Errors
    /// [`ModelError`] if the model cannot be evaluated. Windows on which it diverges are left out.
    pub fn chosen_step(&mut self, stretch: &Stretch) -> Result<f64, ModelError> {
        let windows = Windows::of(stretch);
        let mut substeps = 1;
        while substeps < MAX_SUBSTEPS {
            let (coarse, fine) = (windows.longest / substeps as f64, windows.longest / (2 * substeps) as f64);
            let error = self.difference(stretch, &windows, coarse, fine)?;
            if error <= TOLERANCE {
                return Ok(coarse);
            }
            let wanted = substeps as f64 * (error / TOLERANCE).powf(0.25);
            substeps = (wanted.ceil() as usize).clamp(substeps + 1, MAX_SUBSTEPS);
        }
        Ok(windows.longest / MAX_SUBSTEPS as f64)
    }

    /// Largest difference between two step lengths over the windows, relative to the largest output.
    fn difference(&mut self, stretch: &Stretch, windows: &Windows, coarse: f64, fine: f64) -> Result<f64, ModelError> {
        let n = self.stages.state.len();
        let mut runs = [vec![Vec::with_capacity(windows.rows + 1); n], vec![Vec::with_capacity(windows.rows + 1); n]];
        let mut initial = vec![0.0; n];
        let mut worst: f64 = 0.0;
        for &start in &windows.starts {
            initial.iter_mut().zip(&stretch.outputs).for_each(|(x, column)| *x = column[start]);
            let mut diverged = false;
            for (run, step) in runs.iter_mut().zip([coarse, fine]) {
                self.max_step = step;
                self.begin(windows.rows + 1, &initial, run);
                match self.proceed(stretch, start + 1..start + windows.rows + 1, run) {
                    Ok(()) => {}
                    Err(ModelError::Diverged { .. }) => diverged = true,
                    Err(other) => return Err(other),
                }
            }
            if diverged {
                continue;
            }
            for (a, b) in runs[0].iter().flatten().zip(runs[1].iter().flatten()) {
                worst = worst.max((a - b).abs() / windows.scale);
            }
        }
        Ok(worst)
    }
}

/// Parts of a stretch on which the step is tried: about an eighth of it, at most 256 rows, in up to eight pieces.
struct Windows {
    starts: Vec<usize>,
    rows: usize,
    longest: f64,
    scale: f64,
}

impl Windows {
    fn of(stretch: &Stretch) -> Self {
        let intervals = stretch.len().saturating_sub(1);
        let total = (intervals / 8).clamp(4, 256).min(intervals);
        let pieces = (total / 16).clamp(1, 8);
        let rows = total / pieces;
        let starts: Vec<usize> = (0..pieces).map(|p| p * (intervals / pieces)).collect();
        let interval = |k: usize| stretch.time[k + 1] - stretch.time[k];
        let longest = starts.iter().flat_map(|s| (*s..s + rows).map(interval)).fold(0.0, f64::max);
        let largest = stretch.outputs.iter().flatten().fold(0.0_f64, |m, x| m.max(x.abs()));
        Self { starts, rows, longest: if longest > 0.0 { longest } else { 1.0 }, scale: if largest > 0.0 { largest } else { 1.0 } }
    }
}

/// L (row-major): how a model's accelerations change with its outputs about rest, by central differences over one unit. Exact for
/// equations up to second degree; any other value would cost accuracy, never consistency. True if L is diagonal.
///
/// # Errors
/// [`ModelError`] if the equations do not determine the accelerations, or they leave the range of numbers.
pub fn linear_part(model: &dyn RegressorModel, theta: &[f64], linear: &mut [f64]) -> Result<bool, ModelError> {
    let n = model.outputs().len();
    let needed = model.inputs().len() + 3 * n;
    let (mut stack, mut heap) = ([0.0; 32], Vec::new());
    let buffer = match stack.get_mut(..needed) {
        Some(buffer) => buffer,
        None => {
            heap.resize(needed, 0.0);
            heap.as_mut_slice()
        }
    };
    let (input, buffer) = buffer.split_at_mut(model.inputs().len());
    let (x, buffer) = buffer.split_at_mut(n);
    let (up, down) = buffer.split_at_mut(n);
    for j in 0..n {
        x[j] = 1.0;
        model.accelerations(theta, input, x, up)?;
        x[j] = -1.0;
        model.accelerations(theta, input, x, down)?;
        x[j] = 0.0;
        (0..n).for_each(|i| linear[i * n + j] = 0.5 * (up[i] - down[i]));
    }
    if linear.iter().any(|l| !l.is_finite()) {
        return Err(ModelError::Overflow { model: model.name().to_owned() });
    }
    Ok((0..n * n).all(|k| k / n == k % n || linear[k] == 0.0))
}

/// Row i of a weight times a vector; of a diagonal one there is one entry a row.
#[inline(always)]
pub(crate) fn row<const DIAGONAL: bool>(weight: &[f64], i: usize, x: &[f64]) -> f64 {
    if DIAGONAL { weight[i] * x[i] } else { square_row(weight, i, x) }
}

/// A row-major square matrix in the layout of weights: its diagonal first, where that is all that counts.
pub(crate) fn lay_out(matrix: &[f64], diagonal: bool, n: usize, part: &mut [f64]) {
    if diagonal {
        (0..n).for_each(|i| part[i] = matrix[i * n + i]);
    } else {
        part.copy_from_slice(matrix);
    }
}

/// Row i of a row-major square matrix times a vector.
#[inline(always)]
pub(crate) fn square_row(weight: &[f64], i: usize, x: &[f64]) -> f64 {
    let n = x.len();
    weight[i * n..(i + 1) * n].iter().zip(x).map(|(a, b)| a * b).sum()
}
