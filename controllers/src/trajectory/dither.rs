//! Dither: a small oscillation laid over a trajectory, which keeps the adaptation excited.
//!
//! d = g sin ht cos kt e^{lt}                                                                            (A.13)
//!
//! along a unit direction U that turns with the heading φ: p = p_d + d U. Everything else follows by differentiation:
//! p' = p_d' + d'U + dU', p'' = p_d'' + d''U + 2d'U' + dU'', p''' = p_d''' + d'''U + 3d''U' + 3d'U'' + dU'''.

use serde::{Deserialize, Serialize};
use wheelwright_core::Reference;

use super::jet::{Jet, motion, omega_ddot};

/// An oscillation over a trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dither {
    /// g, amplitude at t = 0 \[m\].
    pub amplitude: f64,
    /// h, angular frequency of the sine \[rad/s\].
    pub h: f64,
    /// k, angular frequency of the cosine \[rad/s\]. Default 0.
    #[serde(default)]
    pub k: f64,
    /// l, rate at which the amplitude grows \[1/s\]; negative fades. Default 0.
    #[serde(default)]
    pub growth: f64,
    /// Which way it points. Default `longitudinal`.
    #[serde(default)]
    pub direction: Direction,
    /// Which formulas. Default `exact`.
    #[serde(default)]
    pub formulas: Formulas,
}

/// Which way a dither points, seen from the undithered heading φ.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Direction {
    /// Along the path: (cos φ, sin φ).
    #[default]
    Longitudinal,
    /// Across it, to the right: (sin φ, −cos φ).
    Lateral,
    /// As the thesis prints it: (sin φ, cos φ), which is neither.
    Thesis,
}

/// Which derivatives of a dithered trajectory are given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Formulas {
    /// The true ones.
    #[default]
    Exact,
    /// True position, heading and velocities, but the accelerations of the undithered trajectory, as appendix A.2 of the
    /// thesis has no others.
    UnditheredAcceleration,
    /// As printed: (A.26) and (A.27) without their term in the heading's acceleration, and undithered accelerations.
    Printed,
}

impl Dither {
    /// d and its first three derivatives at `t`, by a recursion on the coefficients of the four products of sine and cosine.
    fn values(&self, t: f64) -> [f64; 4] {
        let (h, k, l) = (self.h, self.k, self.growth);
        let ((sh, ch), (sk, ck)) = ((h * t).sin_cos(), (k * t).sin_cos());
        let products = [sh * ck, ch * sk, ch * ck, sh * sk];
        let growth = (l * t).exp();
        let mut factors = [self.amplitude, 0.0, 0.0, 0.0];
        std::array::from_fn(|_| {
            let value = growth * factors.iter().zip(products).map(|(f, p)| f * p).sum::<f64>();
            let [a, b, c, d] = factors;
            factors = [l * a - h * c + k * d, l * b - k * c + h * d, l * c + h * a + k * b, l * d - k * a - h * b];
            value
        })
    }

    /// U and its first three derivatives when the heading is φ and turns with ω, α, β.
    fn unit(&self, phi: f64, omega: f64, alpha: f64, beta: f64) -> [[f64; 2]; 4] {
        let (s, c) = phi.sin_cos();
        let w2 = omega * omega;
        let sine = [s, omega * c, alpha * c - w2 * s, beta * c - 3.0 * omega * alpha * s - w2 * omega * c];
        let cosine = [c, -omega * s, -alpha * s - w2 * c, -beta * s - 3.0 * omega * alpha * c + w2 * omega * s];
        std::array::from_fn(|i| match self.direction {
            Direction::Longitudinal => [cosine[i], sine[i]],
            Direction::Lateral => [sine[i], -cosine[i]],
            Direction::Thesis => [sine[i], cosine[i]],
        })
    }

    /// The dithered motion at `t`, from the undithered point's derivatives and motion.
    pub(super) fn apply(&self, t: f64, x: &Jet, y: &Jet, plain: &Reference) -> Reference {
        let d = self.values(t);
        // (A.26) and (A.27) lack the terms in α, which is the same as to set it to zero in U''.
        let alpha = if self.formulas == Formulas::Printed { 0.0 } else { plain.omega_dot };
        let u = self.unit(plain.phi, plain.omega, alpha, omega_ddot(x, y, plain));
        let dithered = |p: &Jet, i: usize| -> Jet {
            [
                p[0] + d[0] * u[0][i],
                p[1] + d[1] * u[0][i] + d[0] * u[1][i],
                p[2] + d[2] * u[0][i] + 2.0 * d[1] * u[1][i] + d[0] * u[2][i],
                p[3] + d[3] * u[0][i] + 3.0 * d[2] * u[1][i] + 3.0 * d[1] * u[2][i] + d[0] * u[3][i],
                0.0,
            ]
        };
        let moved = motion(&dithered(x, 0), &dithered(y, 1), plain.phi);
        match self.formulas {
            Formulas::Exact => moved,
            Formulas::UnditheredAcceleration | Formulas::Printed => Reference { v_dot: plain.v_dot, omega_dot: plain.omega_dot, ..moved },
        }
    }
}
