//! Free-run simulation: a model driven by recorded inputs from an initial state, never corrected by the measurement.
//!
//! The equations x' = L x + N(x, u) are stepped with the exponential Runge-Kutta method ETD4RK of Cox and Matthews
//! (J. Comput. Phys. 176, 2002): exact for the linear part under held inputs, fourth order in N. Steps are fixed between
//! samples; an adaptive integrator would make results depend on tolerances and hide kinks.

use nalgebra::DMatrix;

use crate::dataset::Stretch;
use crate::model::{ModelError, RegressorModel};

/// Largest product of step and fastest rate of the linear part, unless asked otherwise.
const STEP_RATE: f64 = 0.25;
/// Sub-steps between two samples never exceed this, however stiff the parameters an optimizer tries.
const MAX_SUBSTEPS: usize = 64;

/// A model with its parameters, ready to be run. Buffers are allocated once; running allocates nothing.
#[derive(Debug)]
pub struct Simulator<'a> {
    model: &'a dyn RegressorModel,
    theta: Vec<f64>,
    linear: Vec<f64>,
    diagonal: bool,
    rate: f64,
    step_rate: f64,
    weights: Weights,
    stages: Stages,
    input: Vec<f64>,
}

/// Coefficient matrices of one step length, row-major.
#[derive(Debug, Default)]
struct Weights {
    step: f64,
    full: Vec<f64>,
    half: Vec<f64>,
    half_integral: Vec<f64>,
    first: Vec<f64>,
    middle: Vec<f64>,
    last: Vec<f64>,
}

#[derive(Debug, Default)]
struct Stages {
    state: Vec<f64>,
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
        let n = model.outputs().len();
        let linear = linear_part(model, theta)?;
        let diagonal = (0..n * n).all(|k| k / n == k % n || linear[k] == 0.0);
        let rate = (0..n).map(|i| (0..n).map(|j| linear[i * n + j].abs()).sum::<f64>()).fold(0.0, f64::max);
        let buffer = || vec![0.0; n];
        let stages =
            Stages { state: buffer(), a: buffer(), b: buffer(), c: buffer(), n0: buffer(), na: buffer(), nb: buffer(), nc: buffer() };
        let square = || vec![0.0; n * n];
        let weights = Weights {
            step: f64::NAN,
            full: square(),
            half: square(),
            half_integral: square(),
            first: square(),
            middle: square(),
            last: square(),
        };
        let input = vec![0.0; model.inputs().len()];
        Ok(Self { model, theta: theta.to_vec(), linear, diagonal, rate, step_rate: STEP_RATE, weights, stages, input })
    }

    /// Bounds step × fastest rate of the linear part; the error falls with its fourth power.
    #[must_use]
    pub fn with_step_rate(mut self, step_rate: f64) -> Self {
        self.step_rate = step_rate;
        self
    }

    /// Runs over a stretch from `initial`; `simulated` gets one vector an output, as long as the stretch.
    ///
    /// # Errors
    /// [`ModelError::Diverged`] with the time; values up to it are in `simulated`.
    pub fn run(&mut self, stretch: &Stretch, initial: &[f64], simulated: &mut [Vec<f64>]) -> Result<(), ModelError> {
        for out in simulated.iter_mut() {
            out.clear();
            out.reserve(stretch.len());
        }
        self.stages.state.copy_from_slice(initial);
        for k in 0..stretch.len() {
            for (out, x) in simulated.iter_mut().zip(&self.stages.state) {
                out.push(*x);
            }
            if k + 1 == stretch.len() {
                break;
            }
            for (held, column) in self.input.iter_mut().zip(&stretch.inputs) {
                *held = column[k];
            }
            self.advance(stretch.time[k + 1] - stretch.time[k])?;
            if self.stages.state.iter().any(|x| !x.is_finite()) {
                return Err(ModelError::Diverged { model: self.model.name().to_owned(), time: stretch.time[k + 1] });
            }
        }
        Ok(())
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

    /// Advances the state by `dt` with the held input.
    fn advance(&mut self, dt: f64) -> Result<(), ModelError> {
        let substeps = ((dt * self.rate / self.step_rate).ceil() as usize).clamp(1, MAX_SUBSTEPS);
        let step = dt / substeps as f64;
        // Stamps that differ in their last bits are one step length: the weights differ by less than rounding.
        if (step - self.weights.step).abs() > 1e-12 * step || self.weights.step.is_nan() {
            self.weights.set(step, &self.linear, self.diagonal);
        }
        for _ in 0..substeps {
            self.step()?;
        }
        Ok(())
    }

    fn step(&mut self) -> Result<(), ModelError> {
        let Self { model, theta, linear, weights: w, stages: s, input, .. } = self;
        let forcing = |x: &[f64], out: &mut [f64]| nonlinear(*model, theta, linear, input, x, out);
        let n = s.state.len();
        forcing(&s.state, &mut s.n0)?;
        for i in 0..n {
            s.a[i] = dot(&w.half, i, &s.state) + dot(&w.half_integral, i, &s.n0);
        }
        forcing(&s.a, &mut s.na)?;
        for i in 0..n {
            s.b[i] = dot(&w.half, i, &s.state) + dot(&w.half_integral, i, &s.na);
        }
        forcing(&s.b, &mut s.nb)?;
        for i in 0..n {
            let lead: f64 = (0..n).map(|j| w.half_integral[i * n + j] * (2.0 * s.nb[j] - s.n0[j])).sum();
            s.c[i] = dot(&w.half, i, &s.a) + lead;
        }
        forcing(&s.c, &mut s.nc)?;
        for i in 0..n {
            let middle: f64 = (0..n).map(|j| w.middle[i * n + j] * (s.na[j] + s.nb[j])).sum();
            s.a[i] = dot(&w.full, i, &s.state) + dot(&w.first, i, &s.n0) + middle + dot(&w.last, i, &s.nc);
        }
        std::mem::swap(&mut s.state, &mut s.a);
        Ok(())
    }
}

/// Row `i` of a square matrix times a vector.
fn dot(matrix: &[f64], i: usize, vector: &[f64]) -> f64 {
    let n = vector.len();
    matrix[i * n..(i + 1) * n].iter().zip(vector).map(|(a, b)| a * b).sum()
}

/// N(x, u) = acceleration − L x.
fn nonlinear(
    model: &dyn RegressorModel,
    theta: &[f64],
    linear: &[f64],
    input: &[f64],
    x: &[f64],
    out: &mut [f64],
) -> Result<(), ModelError> {
    model.accelerations(theta, input, x, out)?;
    for i in 0..x.len() {
        out[i] -= dot(linear, i, x);
    }
    Ok(())
}

/// L: how the accelerations change with the outputs about rest, by central differences over one unit. Exact for
/// equations up to second degree; any other value would cost accuracy, never consistency.
fn linear_part(model: &dyn RegressorModel, theta: &[f64]) -> Result<Vec<f64>, ModelError> {
    let n = model.outputs().len();
    let input = vec![0.0; model.inputs().len()];
    let (mut x, mut up, mut down) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let mut linear = vec![0.0; n * n];
    for j in 0..n {
        x[j] = 1.0;
        model.accelerations(theta, &input, &x, &mut up)?;
        x[j] = -1.0;
        model.accelerations(theta, &input, &x, &mut down)?;
        x[j] = 0.0;
        for i in 0..n {
            linear[i * n + j] = 0.5 * (up[i] - down[i]);
        }
    }
    if linear.iter().any(|l| !l.is_finite()) {
        return Err(ModelError::Singular { model: model.name().to_owned() });
    }
    Ok(linear)
}

impl Weights {
    /// Computes the matrices for a step length: with φ functions of Z = hL,
    /// first = h(φ1 − 3φ2 + 4φ3), middle = h(2φ2 − 4φ3), last = h(4φ3 − φ2).
    fn set(&mut self, h: f64, linear: &[f64], diagonal: bool) {
        self.step = h;
        let n = (linear.len() as f64).sqrt().round() as usize;
        if diagonal {
            for i in 0..n {
                let k = i * n + i;
                let (phi, half) = (phi_scalar(h * linear[k]), phi_scalar(0.5 * h * linear[k]));
                self.full[k] = phi[0];
                self.half[k] = half[0];
                self.half_integral[k] = 0.5 * h * half[1];
                self.first[k] = h * (phi[1] - 3.0 * phi[2] + 4.0 * phi[3]);
                self.middle[k] = h * (2.0 * phi[2] - 4.0 * phi[3]);
                self.last[k] = h * (4.0 * phi[3] - phi[2]);
            }
            return;
        }
        let z = DMatrix::from_row_slice(n, n, linear);
        let (phi, half) = (phi_matrix(&(&z * h)), phi_matrix(&(&z * (0.5 * h))));
        for i in 0..n {
            for j in 0..n {
                let k = i * n + j;
                let p = |order: usize| phi[order][(i, j)];
                self.full[k] = p(0);
                self.half[k] = half[0][(i, j)];
                self.half_integral[k] = 0.5 * h * half[1][(i, j)];
                self.first[k] = h * (p(1) - 3.0 * p(2) + 4.0 * p(3));
                self.middle[k] = h * (2.0 * p(2) - 4.0 * p(3));
                self.last[k] = h * (4.0 * p(3) - p(2));
            }
        }
    }
}

/// φ0..φ3 of a number: φ0 = e^z, φk = (φk−1 − 1/(k−1)!) / z. Near zero the recursion cancels, so the series of φ3 is
/// summed and the others follow upwards.
fn phi_scalar(z: f64) -> [f64; 4] {
    if z.abs() > 1.0 {
        let e = z.exp();
        let p1 = z.exp_m1() / z;
        let p2 = (p1 - 1.0) / z;
        return [e, p1, p2, (p2 - 0.5) / z];
    }
    let (mut term, mut p3) = (1.0 / 6.0, 0.0);
    for k in 4..24 {
        p3 += term;
        term *= z / f64::from(k);
    }
    let p2 = 0.5 + z * p3;
    let p1 = 1.0 + z * p2;
    [1.0 + z * p1, p1, p2, p3]
}

/// φ0..φ3 of a matrix, from one exponential of the augmented matrix (Al-Mohy and Higham 2011, Theorem 2.1).
fn phi_matrix(z: &DMatrix<f64>) -> [DMatrix<f64>; 4] {
    let n = z.nrows();
    let mut augmented = DMatrix::zeros(4 * n, 4 * n);
    augmented.view_mut((0, 0), (n, n)).copy_from(z);
    for block in 0..3 {
        augmented.view_mut((block * n, (block + 1) * n), (n, n)).fill_with_identity();
    }
    let exponential = augmented.exp();
    std::array::from_fn(|k| exponential.view((0, k * n), (n, n)).into_owned())
}
