//! Rows rotated into a triangle one by one: the square-root form of recursive least squares.
//!
//! R z = q holds all rows [a, b] taken in so far, each perhaps faded since. A row is rotated in by Givens rotations, which need no
//! inverse and no normal equations; what no z explains stays behind in one last number.

/// A diagonal element of the triangle this much smaller than its column shows nothing.
const RANK: f64 = 1e-10;

/// The triangle [R q; 0 ρ] of rows of `unknowns` coefficients and a response.
#[derive(Debug, Clone)]
pub(super) struct Givens {
    /// Row-major, of side unknowns + 1.
    triangle: Vec<f64>,
    unknowns: usize,
}

impl Givens {
    pub(super) fn new(unknowns: usize) -> Self {
        Self { triangle: vec![0.0; (unknowns + 1) * (unknowns + 1)], unknowns }
    }

    pub(super) fn clear(&mut self) {
        self.triangle.fill(0.0);
    }

    /// Scales all rows taken in so far.
    pub(super) fn fade(&mut self, factor: f64) {
        self.triangle.iter_mut().for_each(|r| *r *= factor);
    }

    /// Takes in a row [coefficients, response], which is left zero.
    pub(super) fn rotate(&mut self, row: &mut [f64]) {
        let n = row.len();
        for k in 0..n {
            let (head, tail) = (self.triangle[k * n + k], row[k]);
            if tail == 0.0 {
                continue;
            }
            let length = head.hypot(tail);
            let (c, s) = (head / length, tail / length);
            for (above, below) in self.triangle[k * n + k..(k + 1) * n].iter_mut().zip(&mut row[k..]) {
                (*above, *below) = (c * *above + s * *below, c * *below - s * *above);
            }
        }
    }

    /// Solves for the unknowns; false, and `z` as it was, if the rows do not determine them.
    pub(super) fn solve(&self, z: &mut [f64]) -> bool {
        let determined = (0..self.unknowns).all(|k| self.shown(k));
        if determined {
            for k in (0..self.unknowns).rev() {
                let known: f64 = (k + 1..self.unknowns).map(|j| self.at(k, j) * z[j]).sum();
                z[k] = (self.at(k, self.unknowns) - known) / self.at(k, k);
            }
        }
        determined
    }

    /// Sum of the squares that no z explains.
    pub(super) fn residual(&self) -> f64 {
        self.at(self.unknowns, self.unknowns).powi(2)
    }

    /// aᵀ(RᵀR)⁻¹a: the variance of aᵀz for rows with errors of unit variance. `scratch` holds as many numbers as unknowns.
    pub(super) fn variance(&self, a: impl Fn(usize) -> f64, scratch: &mut [f64]) -> f64 {
        for k in 0..self.unknowns {
            let known: f64 = (0..k).map(|i| self.at(i, k) * scratch[i]).sum();
            scratch[k] = (a(k) - known) / self.at(k, k);
        }
        scratch[..self.unknowns].iter().map(|u| u * u).sum()
    }

    /// True if the rows show unknown `k` apart from those before it.
    pub(super) fn shown(&self, k: usize) -> bool {
        self.at(k, k).abs() > RANK * self.length(k)
    }

    /// Condition of R with its columns scaled to norm one.
    pub(super) fn condition(&self) -> f64 {
        let lengths: Vec<f64> = (0..self.unknowns).map(|k| self.length(k)).collect();
        let entry = |i: usize, j: usize| if i <= j && lengths[j] > 0.0 { self.at(i, j) / lengths[j] } else { 0.0 };
        let values = nalgebra::DMatrix::from_fn(self.unknowns, self.unknowns, entry).singular_values();
        if values.is_empty() { 1.0 } else { values.max() / values.min() }
    }

    /// Norm of column `k`.
    fn length(&self, k: usize) -> f64 {
        (0..=k).map(|i| self.at(i, k).powi(2)).sum::<f64>().sqrt()
    }

    fn at(&self, i: usize, j: usize) -> f64 {
        self.triangle[i * (self.unknowns + 1) + j]
    }
}
