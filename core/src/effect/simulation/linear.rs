//! What a step needs of a model's linear part: its weights, kept for the step lengths that recur, and what a unit of input does.

use nalgebra::DMatrix;

use crate::effect::Motion;
use crate::model::{ModelError, RegressorModel};
use crate::simulation::{Weights, lay_out, linear_part};

/// Step lengths whose weights are kept: intervals cut by a delay have two or three that recur.
const CACHE: usize = 12;
/// Step lengths that differ by less than this share are one: stamps differ in their last bits, the more the later they are.
const SAME_STEP: f64 = 1e-9;

/// The model's linear part, what a unit of input does, and the weights of recent steps.
#[derive(Debug)]
pub(super) struct Linear {
    outputs: usize,
    matrix: Vec<f64>,
    /// Whether no output's rate depends on another output: then weights and the linear part have one entry an output.
    pub(super) diagonal: bool,
    /// The linear part, as a weight.
    pub(super) part: Vec<f64>,
    /// ∂acceleration/∂input and its inverse, row-major.
    pub(super) mobility: Vec<f64>,
    pub(super) inertia: Vec<f64>,
    /// Inputs that a unit of each output takes to be held.
    pub(super) drag: Vec<f64>,
    scratch: Weights,
    cache: Vec<StepWeights>,
    /// The one used last and the one replaced next.
    used: usize,
    next: usize,
}

/// Weights of one step length, one after the other: e^{hL/2}, (h/2) φ1(hL/2), e^{hL}, h (φ1 − 2 φ2) and 2 h φ2.
#[derive(Debug)]
struct StepWeights {
    step: f64,
    values: Vec<f64>,
    /// Those that came after it when it was used last: what recurs does so in turn.
    after: usize,
}

impl Linear {
    pub(super) fn new(n: usize, inputs: usize) -> Self {
        Self {
            outputs: n,
            matrix: vec![0.0; n * n],
            diagonal: true,
            part: vec![0.0; n * n],
            mobility: vec![0.0; n * inputs],
            inertia: vec![0.0; n * inputs],
            drag: vec![0.0; n * inputs],
            scratch: Weights::new(n),
            cache: (0..CACHE).map(|_| StepWeights { step: f64::NAN, values: vec![0.0; 5 * n * n], after: 0 }).collect(),
            used: 0,
            next: 0,
        }
    }

    /// Takes the model's parameters; what a unit of input does only if it is asked for.
    pub(super) fn set(&mut self, model: &dyn RegressorModel, theta: &[f64], driven: bool) -> Result<(), ModelError> {
        let n = self.outputs;
        self.diagonal = linear_part(model, theta, &mut self.matrix)?;
        lay_out(&self.matrix, self.diagonal, n, &mut self.part);
        self.cache.iter_mut().for_each(|w| w.step = f64::NAN);
        self.next = 0;
        if !driven {
            return Ok(());
        }
        let singular = || ModelError::Singular { model: model.name().to_owned() };
        let m = model.inputs().len();
        if m != n {
            return Err(singular());
        }
        let (mut input, rest) = (vec![0.0; m], vec![0.0; n]);
        let (mut up, mut down) = (vec![0.0; n], vec![0.0; n]);
        for j in 0..m {
            input[j] = 1.0;
            model.accelerations(theta, &input, &rest, &mut up)?;
            input[j] = -1.0;
            model.accelerations(theta, &input, &rest, &mut down)?;
            input[j] = 0.0;
            (0..n).for_each(|i| self.mobility[i * m + j] = 0.5 * (up[i] - down[i]));
        }
        let inverse = DMatrix::from_row_slice(n, n, &self.mobility).try_inverse().ok_or_else(singular)?;
        let held = -(&inverse * DMatrix::from_row_slice(n, n, &self.matrix));
        self.inertia.iter_mut().enumerate().for_each(|(k, v)| *v = inverse[(k / n, k % n)]);
        self.drag.iter_mut().enumerate().for_each(|(k, v)| *v = held[(k / n, k % n)]);
        Ok(())
    }

    /// What drive effects see of a motion.
    #[inline(always)]
    pub(super) fn motion<'m>(&'m self, u: &'m [f64], outputs: &'m [f64], held: &'m [f64]) -> Motion<'m> {
        Motion { u, outputs, inertia: &self.inertia, drag: &self.drag, held }
    }

    /// Has the weights of a step length ready for [`weights`](Self::weights).
    #[inline(always)]
    pub(super) fn prepare(&mut self, h: f64) {
        let before = &self.cache[self.used];
        if before.fits(h) {
            return;
        }
        if self.cache[before.after].fits(h) {
            self.used = before.after;
            return;
        }
        let before = self.used;
        self.find(h);
        self.cache[before].after = self.used;
    }

    /// The weights last prepared, in the order of [`StepWeights`], each of `size` numbers.
    #[inline(always)]
    pub(super) fn weights(&self, size: usize) -> [&[f64]; 5] {
        let values = &self.cache[self.used].values[..5 * size];
        std::array::from_fn(|k| &values[k * size..(k + 1) * size])
    }

    #[cold]
    fn find(&mut self, h: f64) {
        if let Some(found) = self.cache.iter().position(|w| w.fits(h)) {
            self.used = found;
            return;
        }
        self.used = self.next % CACHE;
        self.next += 1;
        let n = self.outputs;
        let weights = &mut self.cache[self.used];
        weights.step = h;
        if self.diagonal {
            weights.set_diagonal(h, &self.part[..n]);
            return;
        }
        self.scratch.set(h, &self.matrix, n, false);
        let s = &self.scratch;
        // φ1 = first + 2 middle + last and φ2 = middle + last, in the weights of the fourth-order scheme.
        for i in 0..n * n {
            let all = [s.half[i], s.half_forcing[i], s.full[i], s.first[i] - s.last[i], 2.0 * (s.middle[i] + s.last[i])];
            all.into_iter().enumerate().for_each(|(k, value)| weights.values[k * n * n + i] = value);
        }
    }
}

impl StepWeights {
    #[inline(always)]
    fn fits(&self, h: f64) -> bool {
        (self.step - h).abs() <= SAME_STEP * h
    }

    /// Weights where no output's rate depends on another output: φ1(z) = (eᶻ − 1)/z and φ2(z) = (φ1(z) − 1)/z of each z = h L_ii.
    fn set_diagonal(&mut self, h: f64, diagonal: &[f64]) {
        let n = diagonal.len();
        for (i, rate) in diagonal.iter().enumerate() {
            let z = h * rate;
            // eᶻ − 1 = (e^{z/2} − 1)(e^{z/2} + 1), and no digit is lost.
            let half = (0.5 * z).exp_m1();
            let whole = half * (half + 2.0);
            let (first, second) = phi(z, whole);
            let all = [half + 1.0, 0.5 * h * phi(0.5 * z, half).0, whole + 1.0, h * (first - 2.0 * second), 2.0 * h * second];
            all.into_iter().enumerate().for_each(|(k, value)| self.values[k * n + i] = value);
        }
    }
}

/// φ1 and φ2 of a number of which eᶻ − 1 is known; near zero by their series, where the quotients lose digits.
fn phi(z: f64, growth: f64) -> (f64, f64) {
    if z.abs() < 1e-3 {
        return (1.0 + z * (1.0 / 2.0 + z * (1.0 / 6.0 + z / 24.0)), 1.0 / 2.0 + z * (1.0 / 6.0 + z * (1.0 / 24.0 + z / 120.0)));
    }
    let first = growth / z;
    (first, (first - 1.0) / z)
}
