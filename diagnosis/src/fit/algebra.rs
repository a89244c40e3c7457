//! Sums of products of long columns, and what follows from them.

use std::ops::Range;

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use wheelwright_core::least_squares::Factor;

/// Singular values of columns of unit length below this share of the largest are directions that the data do not tell.
const RANK: f64 = 1e-4;

/// Sum of products, in four running sums so that it is fast; the order of summation is fixed.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (a8, b8) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = a8.remainder().iter().zip(b8.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in a8.zip(b8) {
        for i in 0..8 {
            sums[i] += x[i] * y[i];
        }
    }
    sums.iter().sum::<f64>() + rest
}

/// y += factor x.
pub(crate) fn add(y: &mut [f64], factor: f64, x: &[f64]) {
    y.iter_mut().zip(x).for_each(|(y, x)| *y += factor * x);
}

/// Takes off values what they have of a column of length one.
pub(crate) fn clear(values: &mut [f64], column: &[f64]) {
    let along = dot(column, values);
    add(values, -along, column);
}

/// Orthonormal columns that span some columns, by Gram and Schmidt, each cleared of those before it in so many passes: a second one, and rounding does
/// not count. None for a column of which no more than a share is its own.
pub(crate) fn orthonormal(columns: impl Iterator<Item = Vec<f64>>, share: f64, passes: usize) -> Vec<Option<Vec<f64>>> {
    let mut basis: Vec<Option<Vec<f64>>> = Vec::new();
    for mut column in columns {
        let whole = dot(&column, &column).sqrt();
        for _ in 0..passes {
            basis.iter().flatten().for_each(|before| clear(&mut column, before));
        }
        let own = dot(&column, &column).sqrt();
        basis.push((own > share * whole).then(|| {
            column.iter_mut().for_each(|x| *x /= own);
            column
        }));
    }
    basis
}

/// Sums of products of all pairs of columns, outputs weighted.
pub(crate) fn gram(columns: &[&[f64]], parts: &[Range<usize>], weights: &[f64]) -> DMatrix<f64> {
    let n = columns.len();
    let mut gram = DMatrix::zeros(n, n);
    for i in 0..n {
        for j in 0..=i {
            let sum = parts.iter().zip(weights).map(|(p, w)| w * dot(&columns[i][p.clone()], &columns[j][p.clone()])).sum();
            gram[(i, j)] = sum;
            gram[(j, i)] = sum;
        }
    }
    gram
}

/// Eigenvalues and eigenvectors of a Gram matrix scaled to unit diagonal, and the scale; invisible columns have scale zero.
pub(crate) struct Directions {
    pub(crate) scale: Vec<f64>,
    pub(crate) values: DVector<f64>,
    pub(crate) vectors: DMatrix<f64>,
}

impl Directions {
    pub(crate) fn of(gram: &DMatrix<f64>) -> Self {
        let n = gram.nrows();
        let scale: Vec<f64> = (0..n).map(|i| gram[(i, i)].max(0.0).sqrt()).collect();
        let unit = |i: usize, j: usize| if scale[i] > 0.0 && scale[j] > 0.0 { gram[(i, j)] / (scale[i] * scale[j]) } else { 0.0 };
        let scaled = DMatrix::from_fn(n, n, unit);
        // With parameters held and no effect there is no unknown, and nalgebra does not decompose nothing.
        if n == 0 || scaled.iter().any(|x| !x.is_finite()) {
            return Self { scale: vec![0.0; n], values: DVector::zeros(n), vectors: DMatrix::identity(n, n) };
        }
        let eigen = SymmetricEigen::new(scaled);
        Self { scale, values: eigen.eigenvalues, vectors: eigen.eigenvectors }
    }

    fn shown(&self) -> impl Iterator<Item = usize> + '_ {
        let least = RANK * RANK * self.values.iter().fold(0.0_f64, |m, x| m.max(*x));
        (0..self.values.len()).filter(move |k| self.values[*k] > least)
    }

    pub(crate) fn rank(&self) -> usize {
        self.shown().count()
    }

    /// The inverse in the directions that are shown.
    pub(crate) fn inverse(&self) -> DMatrix<f64> {
        let n = self.values.len();
        let mut inverse = DMatrix::zeros(n, n);
        for k in self.shown() {
            let v = DVector::from_fn(n, |i, _| if self.scale[i] > 0.0 { self.vectors[(i, k)] / self.scale[i] } else { 0.0 });
            inverse += &v * v.transpose() / self.values[k];
        }
        inverse
    }

    /// For each unknown the share of it that lies in directions that are shown.
    pub(crate) fn visibility(&self) -> Vec<f64> {
        let shown: Vec<usize> = self.shown().collect();
        (0..self.values.len())
            .map(|i| if self.scale[i] > 0.0 { shown.iter().map(|k| self.vectors[(i, *k)].powi(2)).sum() } else { 0.0 })
            .collect()
    }
}

/// The triangular factor of a Gram matrix whose last column belongs to the negative residual.
pub(crate) fn factor(gram: &DMatrix<f64>) -> Factor {
    let n = gram.nrows();
    let d = Directions::of(gram);
    let root = DMatrix::from_fn(n, n, |k, j| d.values[k].max(0.0).sqrt() * d.vectors[(j, k)] * d.scale[j]);
    Factor::of(root)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns() -> Vec<Vec<f64>> {
        (0..3).map(|j| (0..101).map(|k| ((1.0 + 0.7 * j as f64) * 0.1 * k as f64).sin()).collect()).collect()
    }

    #[test]
    fn sums_of_products_are_sums_of_products() {
        let c = columns();
        let plain: f64 = c[0].iter().zip(&c[1]).map(|(a, b)| a * b).sum();
        assert!((dot(&c[0], &c[1]) - plain).abs() < 1e-12 * plain.abs().max(1.0));
    }

    #[test]
    fn a_repeated_column_adds_no_rank_and_leaves_its_own_share() {
        let c = columns();
        let twice: Vec<&[f64]> = vec![&c[0], &c[1], &c[0]];
        let directions = Directions::of(&gram(&twice, &[0..50, 50..101], &[1.0, 1.0]));
        assert_eq!(directions.rank(), 2);
        let seen = directions.visibility();
        assert!((seen[0] - 0.5).abs() < 1e-6 && (seen[1] - 1.0).abs() < 1e-6, "{seen:?}");
    }

    #[test]
    fn the_factor_has_the_grams_products() {
        let c = columns();
        let all: Vec<&[f64]> = c.iter().map(Vec::as_slice).collect();
        let gram = gram(&all, &[0..50, 50..101], &[2.0, 1.0]);
        let f = factor(&gram);
        let back = f.r.transpose() * &f.r;
        for i in 0..2 {
            for j in 0..2 {
                assert!((back[(i, j)] - gram[(i, j)]).abs() < 1e-9 * gram[(i, i)]);
            }
        }
        assert!((f.cost() - gram[(2, 2)]).abs() < 1e-9 * gram[(2, 2)]);
    }
}
