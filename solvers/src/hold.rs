//! The zero-order hold: what held inputs do to a regression on samples, and its undoing.
//!
//! Sampled every T_s under an input that is held in between, the linear part M x' + K x = u of a model obeys exactly
//! u_k = K [(I − A)⁻¹ (x_k+1 − x_k) + x_k] with A = exp(−H), H = T_s M⁻¹ K. A regression that pairs x with the input
//! delayed by m periods (½ for the midpoint) therefore finds, for slow motion,
//!
//! M_app = M φ1(−H)⁻¹ − m T_s K,   φ1(Z) = (e^Z − I) Z⁻¹,
//!
//! which for m = ½ is (T_s/2) K coth(H/2): of one channel, θ1 = θ4 T_s / (2 artanh(θ4 T_s / (2 θ1_app))).

//!
//! A regression in which θ_app(θ) takes the place of θ undoes the hold. It is solved by linearising θ_app about the last
//! θ, which makes it a regression with another map θ_app ≈ T' z + c'.

use nalgebra::{DMatrix, DVector};
use wheelwright_core::model::{ParameterMap, RegressorModel, Sample};
use wheelwright_core::regression::{Form, Pairing, Settings};
use wheelwright_core::solver::SolveError;

/// Linearisations before the hold is left as it is.
const STEPS: usize = 60;
/// Relative change of the free parameters at which they have settled; convergence is quadratic, so the next would be rounding.
const SETTLED: f64 = 1e-10;
/// Size of a parameter below which changes are measured against this.
const SMALL: f64 = 1e-3;

/// The law for one model, one sampling period and one pairing.
#[derive(Debug, Clone)]
pub struct Hold {
    period: f64,
    delay: f64,
    /// M = mass[p] + Σ θ_i mass[i].
    mass: Vec<DMatrix<f64>>,
    /// K likewise.
    stiffness: Vec<DMatrix<f64>>,
    /// Names of the parameters that M depends on.
    names: Vec<String>,
    /// Pseudo-inverse that takes an entry-wise change of M to changes of θ.
    share: DMatrix<f64>,
}

impl Hold {
    /// Linearises a model about rest. `None` where there is nothing to undo: the outputs are means over the period
    /// before (`previous`), the equations are not as many as the outputs, or no parameter multiplies an acceleration.
    pub fn new(model: &dyn RegressorModel, settings: &Settings, period: f64) -> Option<Self> {
        let delay = match (settings.form, settings.pairing) {
            (Form::Integral, _) | (_, Pairing::Mid) => 0.5,
            (_, Pairing::Same) => 0.0,
            (_, Pairing::Previous) => return None,
        };
        if model.equations() != model.outputs().len() {
            return None;
        }
        let (mass, stiffness) = linear_part(model);
        let parameters = model.parameters();
        let moving = parameters.iter().zip(&mass).filter(|(_, m)| m.iter().any(|x| *x != 0.0));
        let names: Vec<String> = moving.map(|(p, _)| p.name.clone()).collect();
        if names.is_empty() {
            return None;
        }
        let columns = DMatrix::from_fn(mass[0].len(), parameters.len(), |entry, i| mass[i].as_slice()[entry]);
        let share = columns.pseudo_inverse(1e-12).ok()?;
        Some(Self { period, delay, mass, stiffness, names, share })
    }

    /// θ as the regression sees it; `None` where M is singular.
    pub fn apparent(&self, theta: &[f64]) -> Option<Vec<f64>> {
        let (m, k) = (at(&self.mass, theta), at(&self.stiffness, theta));
        let n = m.nrows();
        let h = m.clone().lu().solve(&k)? * self.period;
        let mut augmented = DMatrix::zeros(2 * n, 2 * n);
        augmented.view_mut((0, 0), (n, n)).copy_from(&-h);
        augmented.view_mut((0, n), (n, n)).fill_with_identity();
        if augmented.iter().any(|x| !x.is_finite()) {
            return None;
        }
        let phi = augmented.exp().view((0, n), (n, n)).into_owned();
        let change = &m * phi.try_inverse()? - &m - k * (self.delay * self.period);
        let shift = &self.share * DVector::from_column_slice(change.as_slice());
        let apparent: Vec<f64> = theta.iter().zip(shift.iter()).map(|(t, s)| t + s).collect();
        apparent.iter().all(|t| t.is_finite()).then_some(apparent)
    }

    /// Solves a regression in θ_app(T z + c). `solve` returns the free parameters of the regression with the map it is
    /// given; `start` are those of the regression as it stands. `None` if the steps do not settle, because a time constant
    /// lies below what this sampling period can show (of one channel, θ4 T_s ≥ 2 θ1_app); there `solve` may fail as well.
    pub fn undo<F>(&self, map: &ParameterMap, start: &[f64], mut solve: F) -> Option<Vec<f64>>
    where
        F: FnMut(&ParameterMap) -> Result<Vec<f64>, SolveError>,
    {
        let mut free = start.to_vec();
        for _ in 0..STEPS {
            let next = solve(&self.linearised(map, &free)?).ok()?;
            let moved = next.iter().zip(&free).map(|(a, b)| (a - b).abs() / b.abs().max(SMALL)).fold(0.0, f64::max);
            free = next;
            if moved <= SETTLED {
                return Some(free);
            }
        }
        None
    }

    /// θ_app as an affine function of the free parameters near `free`, by central differences.
    fn linearised(&self, map: &ParameterMap, free: &[f64]) -> Option<ParameterMap> {
        let z = free.len();
        let seen = self.apparent(&map.theta(free))?;
        let mut linear = ParameterMap { free: map.free.clone(), matrix: vec![0.0; map.matrix.len()], offset: seen };
        let mut moved = free.to_vec();
        for j in 0..z {
            let step = 1e-6 * free[j].abs().max(SMALL);
            moved[j] = free[j] + step;
            let up = self.apparent(&map.theta(&moved))?;
            moved[j] = free[j] - step;
            let down = self.apparent(&map.theta(&moved))?;
            moved[j] = free[j];
            for (i, (up, down)) in up.iter().zip(&down).enumerate() {
                // What the law leaves alone is kept exactly, so that equalities and fixed values stay exact.
                let same = map.matrix[i * z + j];
                let slope = (up - down) / (2.0 * step);
                linear.matrix[i * z + j] = if (slope - same).abs() <= 1e-9 * same.abs() { same } else { slope };
            }
        }
        for i in 0..linear.offset.len() {
            linear.offset[i] -= (0..z).map(|j| linear.matrix[i * z + j] * free[j]).sum::<f64>();
        }
        Some(linear)
    }

    /// What was undone, for a report.
    pub(crate) fn undone(&self) -> String {
        format!("undid the zero-order hold of {:.4} s in {}", self.period, self.names.join(", "))
    }

    /// Why nothing was undone, for a user.
    pub(crate) fn kept(&self) -> String {
        format!(
            "the zero-order hold could not be undone: a time constant in {} is below what one sample every {:.4} s can show, so these \
             values are upper limits; record at a higher rate",
            self.names.join(", "),
            self.period
        )
    }
}

/// M and K of each parameter, and of the response (last), as derivatives of Φ and −y with respect to accelerations and
/// outputs about rest. The odd part's difference between one and two units: terms of second degree and dry friction
/// (sgn v), which is no stiffness, both drop out.
fn linear_part(model: &dyn RegressorModel) -> (Vec<DMatrix<f64>>, Vec<DMatrix<f64>>) {
    let (n, p) = (model.outputs().len(), model.parameters().len());
    let (inputs, mut x) = (vec![0.0; model.inputs().len()], vec![0.0; 2 * n]);
    let (mut phi, mut y) = (vec![0.0; n * p], vec![0.0; n]);
    let (mut mass, mut stiffness) = (vec![DMatrix::zeros(n, n); p + 1], vec![DMatrix::zeros(n, n); p + 1]);
    for j in 0..2 * n {
        for (value, weight) in [(2.0, 0.5), (-2.0, -0.5), (1.0, -0.5), (-1.0, 0.5)] {
            x[j] = value;
            let (outputs, accelerations) = x.split_at(n);
            model.regressor(Sample { inputs: &inputs, outputs, accelerations }, &mut phi, &mut y);
            let matrices = if j < n { &mut stiffness } else { &mut mass };
            for e in 0..n {
                for i in 0..p {
                    matrices[i][(e, j % n)] += weight * phi[e * p + i];
                }
                matrices[p][(e, j % n)] -= weight * y[e];
            }
        }
        x[j] = 0.0;
    }
    (mass, stiffness)
}

/// The matrix at θ; the last one is constant.
fn at(matrices: &[DMatrix<f64>], theta: &[f64]) -> DMatrix<f64> {
    let constant = matrices[theta.len()].clone();
    matrices.iter().zip(theta).fold(constant, |sum, (matrix, t)| sum + matrix * *t)
}
