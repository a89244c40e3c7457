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

    /// Takes in a row [coefficients, response], which is left zero. Returns by how much the response differs from what the rows before
    /// it foretell; not a number of meaning while they do not determine the unknowns.
    ///
    /// What is left of the response when all coefficients are gone is that difference times the product of the cosines.
    pub(super) fn rotate(&mut self, row: &mut [f64]) -> f64 {
        let n = self.unknowns + 1;
        let (mut cosines, mut left) = (1.0, 0.0);
        for k in 0..n {
            if k + 1 == n {
                left = row[k];
            }
            let (head, tail) = (self.triangle[k * n + k], row[k]);
            if tail == 0.0 {
                continue;
            }
            let inverse = length(head, tail).recip();
            let (c, s) = (head * inverse, tail * inverse);
            cosines *= if k + 1 < n { c } else { 1.0 };
            for (above, below) in self.triangle[k * n + k..(k + 1) * n].iter_mut().zip(&mut row[k..]) {
                (*above, *below) = (c * *above + s * *below, c * *below - s * *above);
            }
        }
        left / cosines
    }

    /// True if the rows determine the unknowns.
    pub(super) fn determined(&self) -> bool {
        (0..self.unknowns).all(|k| self.shown(k))
    }

    /// Solves for the unknowns; false, and `z` as it was, if the rows do not determine them.
    pub(super) fn solve(&self, z: &mut [f64]) -> bool {
        let determined = self.determined();
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
        self.at(k, k).powi(2) > RANK * RANK * self.square(k)
    }

    /// Condition of R with its columns scaled to norm one.
    pub(super) fn condition(&self) -> f64 {
        let lengths: Vec<f64> = (0..self.unknowns).map(|k| self.square(k).sqrt()).collect();
        let entry = |i: usize, j: usize| if i <= j && lengths[j] > 0.0 { self.at(i, j) / lengths[j] } else { 0.0 };
        let values = nalgebra::DMatrix::from_fn(self.unknowns, self.unknowns, entry).singular_values();
        if values.is_empty() { 1.0 } else { values.max() / values.min() }
    }

    /// Square of the norm of the column of unknown `k`.
    fn square(&self, k: usize) -> f64 {
        (0..=k).map(|i| self.at(i, k).powi(2)).sum()
    }

    fn at(&self, i: usize, j: usize) -> f64 {
        self.triangle[i * (self.unknowns + 1) + j]
    }
}

/// √(a² + b²), by the slow way only where squares leave the range of numbers.
fn length(a: f64, b: f64) -> f64 {
    let square = a * a + b * b;
    if square.is_normal() { square.sqrt() } else { a.hypot(b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows that have nothing regular about them.
    fn row(k: u32) -> [f64; 4] {
        [1.0, 2.0, 3.0, 5.0].map(|c: f64| (c.sqrt() * f64::from(k * k)).sin())
    }

    #[test]
    fn a_row_tells_by_how_much_it_differs_from_what_those_before_it_foretell() {
        let mut triangle = Givens::new(3);
        let mut z = [0.0; 3];
        for k in 1..100 {
            let (known, row) = (triangle.solve(&mut z), row(k));
            let foretold: f64 = row.iter().zip(z).map(|(a, z)| a * z).sum();
            let found = triangle.rotate(&mut row.clone());
            assert_eq!(known, k > 3);
            assert!(!known || (found - (row[3] - foretold)).abs() < 1e-12, "row {k}: {found} for {}", row[3] - foretold);
        }
    }

    #[test]
    fn numbers_whose_squares_leave_the_range_are_rotated_all_the_same() {
        for size in [1e-200, 1e200] {
            let (mut triangle, mut z) = (Givens::new(1), [0.0]);
            triangle.rotate(&mut [3.0 * size, 6.0 * size]);
            triangle.rotate(&mut [4.0 * size, 8.0 * size]);
            assert!((triangle.at(0, 0) / size - 5.0).abs() < 1e-12, "{triangle:?}");
            z[0] = triangle.at(0, 1) / triangle.at(0, 0);
            assert!((z[0] - 2.0).abs() < 1e-12, "{z:?}");
        }
    }
}
