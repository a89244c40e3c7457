//! The zero-order hold: what held inputs do to a regression on samples, and its undoing.
//!
//! Sampled every T_s under an input that is held in between, the linear part M x' + K x = u of a model obeys exactly
//! u_k = K [(I − A)⁻¹ (x_k+1 − x_k) + x_k] with A = exp(−H), H = T_s M⁻¹ K. A regression that pairs x with the input
//! delayed by m periods (½ for the midpoint) therefore finds, for slow motion,
//!
//! M_app = M φ1(−H)⁻¹ − m T_s K,   φ1(Z) = (e^Z − I) Z⁻¹,
//!
//! which for m = ½ is (T_s/2) K coth(H/2): of one channel, θ1 = θ4 T_s / (2 artanh(θ4 T_s / (2 θ1_app))).

use nalgebra::DMatrix;
use wheelwright_core::model::{ParameterMap, RegressorModel, Sample};
use wheelwright_core::regression::{Form, Pairing, Settings};

/// Newton steps before the inversion is given up.
const STEPS: usize = 60;

/// The law for one model, one sampling period and one pairing, in the free parameters z.
#[derive(Debug, Clone)]
pub struct Hold {
    period: f64,
    delay: f64,
    /// M = mass[0] + Σ z_i mass[i + 1].
    mass: Vec<DMatrix<f64>>,
    /// K likewise.
    stiffness: Vec<DMatrix<f64>>,
    /// Free parameters that M depends on.
    moving: Vec<usize>,
    /// Pseudo-inverse that takes an entry-wise change of M to changes of those.
    share: DMatrix<f64>,
}

impl Hold {
    /// Linearises a model about rest. `None` where there is nothing to undo: the outputs are means over the period
    /// before (`previous`), the equations are not as many as the outputs, or no free parameter multiplies an acceleration.
    pub fn new(model: &dyn RegressorModel, map: &ParameterMap, settings: &Settings, period: f64) -> Option<Self> {
        let delay = match (settings.form, settings.pairing) {
            (Form::Integral, _) | (_, Pairing::Mid) => 0.5,
            (_, Pairing::Same) => 0.0,
            (_, Pairing::Previous) => return None,
        };
        if model.equations() != model.outputs().len() {
            return None;
        }
        let (mass, stiffness) = linear_part(model);
        let (mass, stiffness) = (in_free(&mass, map), in_free(&stiffness, map));
        let moving: Vec<usize> = (0..map.free.len()).filter(|&i| mass[i + 1].amax() > 0.0).collect();
        let entries = mass[0].len();
        let columns = DMatrix::from_fn(entries, moving.len(), |k, i| mass[moving[i] + 1].as_slice()[k]);
        let share = columns.pseudo_inverse(1e-12).ok().filter(|_| !moving.is_empty())?;
        Some(Self { period, delay, mass, stiffness, moving, share })
    }

    /// z as the regression sees it; `None` where M is singular.
    pub fn apparent(&self, free: &[f64]) -> Option<Vec<f64>> {
        let (m, k) = (at(&self.mass, free), at(&self.stiffness, free));
        let n = m.nrows();
        let h = m.clone().lu().solve(&k)? * self.period;
        let mut augmented = DMatrix::zeros(2 * n, 2 * n);
        augmented.view_mut((0, 0), (n, n)).copy_from(&-h);
        augmented.view_mut((0, n), (n, n)).fill_with_identity();
        let phi = augmented.exp().view((0, n), (n, n)).into_owned();
        // M φ⁻¹ − M − m T_s K, entry by entry.
        let change = &m * phi.try_inverse()? - &m - k * (self.delay * self.period);
        let shift = &self.share * DMatrix::from_column_slice(change.len(), 1, change.as_slice());
        let mut apparent = free.to_vec();
        for (&i, s) in self.moving.iter().zip(shift.iter()) {
            apparent[i] += s;
        }
        apparent.iter().all(|z| z.is_finite()).then_some(apparent)
    }

    /// z whose apparent value is given, by Newton's method from above; `None` where no z is, because a time constant lies
    /// below what this sampling period can show (θ4 T_s ≥ 2 θ1_app).
    pub fn invert(&self, apparent: &[f64]) -> Option<Vec<f64>> {
        let mut free = apparent.to_vec();
        for _ in 0..STEPS {
            let seen = self.apparent(&free)?;
            let miss = DMatrix::from_fn(self.moving.len(), 1, |r, _| seen[self.moving[r]] - apparent[self.moving[r]]);
            let slope = self.slope(&free, &self.moving)?;
            let slope = DMatrix::from_fn(self.moving.len(), self.moving.len(), |r, c| slope[(self.moving[r], c)]);
            let step = slope.lu().solve(&miss)?;
            let mut settled = true;
            for (&i, s) in self.moving.iter().zip(step.iter()) {
                free[i] -= s;
                settled &= s.abs() <= 1e-13 * free[i].abs();
            }
            if settled {
                return Some(free);
            }
        }
        None
    }

    /// ∂z_app/∂z for chosen columns, by central differences.
    pub(crate) fn slope(&self, free: &[f64], columns: &[usize]) -> Option<DMatrix<f64>> {
        let mut slope = DMatrix::zeros(free.len(), columns.len());
        let mut moved = free.to_vec();
        for (c, &j) in columns.iter().enumerate() {
            let step = 1e-6 * free[j].abs().max(1e-3);
            moved[j] = free[j] + step;
            let up = self.apparent(&moved)?;
            moved[j] = free[j] - step;
            let down = self.apparent(&moved)?;
            moved[j] = free[j];
            for r in 0..free.len() {
                slope[(r, c)] = (up[r] - down[r]) / (2.0 * step);
            }
        }
        Some(slope)
    }

    /// Names of the free parameters that the hold shifts, for messages.
    pub fn names(&self, map: &ParameterMap) -> String {
        self.moving.iter().map(|&i| map.free[i].as_str()).collect::<Vec<_>>().join(", ")
    }
}

/// M and K of each parameter, and of the response (last), as derivatives of Φ and −y with respect to accelerations and
/// outputs about rest; central differences over one unit, so that terms of second degree drop out.
fn linear_part(model: &dyn RegressorModel) -> (Vec<DMatrix<f64>>, Vec<DMatrix<f64>>) {
    let (n, p) = (model.outputs().len(), model.parameters().len());
    let (inputs, mut x) = (vec![0.0; model.inputs().len()], vec![0.0; 2 * n]);
    let (mut phi, mut y) = (vec![0.0; n * p], vec![0.0; n]);
    let (mut mass, mut stiffness) = (vec![DMatrix::zeros(n, n); p + 1], vec![DMatrix::zeros(n, n); p + 1]);
    for j in 0..2 * n {
        for sign in [1.0, -1.0] {
            x[j] = sign;
            let (outputs, accelerations) = x.split_at(n);
            model.regressor(Sample { inputs: &inputs, outputs, accelerations }, &mut phi, &mut y);
            let matrices = if j < n { &mut stiffness } else { &mut mass };
            for e in 0..n {
                for i in 0..p {
                    matrices[i][(e, j % n)] += 0.5 * sign * phi[e * p + i];
                }
                matrices[p][(e, j % n)] -= 0.5 * sign * y[e];
            }
        }
        x[j] = 0.0;
    }
    (mass, stiffness)
}

/// Matrices of each parameter θ turned into those of 1 and each free z.
fn in_free(of_theta: &[DMatrix<f64>], map: &ParameterMap) -> Vec<DMatrix<f64>> {
    let (p, z) = (map.offset.len(), map.free.len());
    let mut constant = of_theta[p].clone();
    for (matrix, c) in of_theta.iter().zip(&map.offset) {
        constant += matrix * *c;
    }
    let free = (0..z).map(|j| {
        let terms = (0..p).map(|i| &of_theta[i] * map.matrix[i * z + j]);
        terms.fold(DMatrix::zeros(constant.nrows(), constant.ncols()), |sum, term| sum + term)
    });
    let free: Vec<_> = free.collect();
    std::iter::once(constant).chain(free).collect()
}

fn at(matrices: &[DMatrix<f64>], free: &[f64]) -> DMatrix<f64> {
    let mut sum = matrices[0].clone();
    for (matrix, z) in matrices[1..].iter().zip(free) {
        sum += matrix * *z;
    }
    sum
}
