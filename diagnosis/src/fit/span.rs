//! Which of many long columns span the others, and what is left of a residual beside them.

use nalgebra::{DMatrix, DVector};
use wheelwright_core::gram::add_square;

use super::algebra::{add, dot};

/// Share of the square of a column that no other has, below which it is a combination of theirs.
const OWN: f64 = 1e-4;
/// Rows of which products of columns are summed at once.
const PIECE: usize = 256;

/// Columns of length one of which others are combinations, and the lower triangular factor of their products.
pub(crate) struct Span {
    columns: Vec<Vec<f64>>,
    factor: DMatrix<f64>,
}

impl Span {
    /// Chosen one after the other among columns of length one, by a Cholesky factor with pivots, until none has a share of its own or so many are.
    pub(crate) fn of(mut columns: Vec<Vec<f64>>, most: usize) -> Self {
        let (k, most) = (columns.len(), most.min(columns.len()));
        let products = products(&columns);
        let mut left = products.diagonal();
        let mut order: Vec<usize> = Vec::new();
        // One column a choice, rows in the order of all columns.
        let mut factor = DMatrix::zeros(k, most);
        while order.len() < most {
            let open = (0..k).filter(|j| !order.contains(j));
            let Some(pivot) = open.max_by(|a, b| left[*a].total_cmp(&left[*b])) else { break };
            if left[pivot] < OWN {
                break;
            }
            let before = factor.columns(0, order.len());
            let own = products.column(pivot) - before * before.row(pivot).transpose();
            let own = own / left[pivot].sqrt();
            left.zip_apply(&own, |left, own| *left -= own * own);
            factor.set_column(order.len(), &own);
            order.push(pivot);
        }
        let factor = DMatrix::from_fn(order.len(), order.len(), |i, j| if j > i { 0.0 } else { factor[(order[i], j)] });
        Self { columns: order.iter().map(|j| std::mem::take(&mut columns[*j])).collect(), factor }
    }

    /// How many columns they are.
    pub(crate) fn size(&self) -> usize {
        self.columns.len()
    }

    /// Takes what these columns can explain of a residual out of it.
    pub(crate) fn take_out_of(&self, residual: &mut [f64]) {
        let along = DVector::from_iterator(self.columns.len(), self.columns.iter().map(|c| dot(c, residual)));
        let halfway = self.factor.solve_lower_triangular(&along);
        let Some(amounts) = halfway.and_then(|halfway| self.factor.tr_solve_lower_triangular(&halfway)) else { return };
        self.columns.iter().zip(amounts.iter()).for_each(|(column, amount)| add(residual, -amount, column));
    }
}

/// Sums of products of all pairs of columns, piece by piece of their rows, each of which stays near the processor.
fn products(columns: &[Vec<f64>]) -> DMatrix<f64> {
    let (k, rows) = (columns.len(), columns.first().map_or(0, Vec::len));
    let mut sums = DMatrix::zeros(k, k);
    for start in (0..rows).step_by(PIECE) {
        let mut piece = DMatrix::zeros(PIECE.min(rows - start), k);
        piece.column_iter_mut().zip(columns).for_each(|(mut to, from)| to.copy_from_slice(&from[start..start + to.len()]));
        add_square(&piece, &mut sums);
    }
    sums.fill_lower_triangle_with_upper_triangle();
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sines of length one, of which the last repeats the first.
    fn columns() -> Vec<Vec<f64>> {
        let sine = |rate: usize| (0..700).map(|k| (0.01 * (rate * k) as f64).sin()).collect::<Vec<f64>>();
        let unit = |column: Vec<f64>| column.iter().map(|x| x / dot(&column, &column).sqrt()).collect();
        (1..300).chain([1]).map(|rate| unit(sine(rate))).collect()
    }

    #[test]
    fn products_of_pieces_are_those_of_all_pairs() {
        let columns = columns();
        let products = products(&columns);
        for (i, j) in [(0, 0), (0, 299), (299, 5), (130, 257), (257, 130)] {
            assert!((products[(i, j)] - dot(&columns[i], &columns[j])).abs() < 1e-12, "{i} {j}");
        }
    }

    #[test]
    fn a_column_that_repeats_another_adds_nothing_and_what_they_make_together_is_taken_out() {
        let mut columns = columns();
        columns.splice(3..299, []);
        let span = Span::of(columns.clone(), 10);
        assert_eq!(span.size(), 3);
        let own: Vec<f64> = (0..700).map(|k| if k == 350 { 1.0 } else { 0.0 }).collect();
        let mut residual = own.clone();
        columns.iter().zip([2.0, -1.0, 0.5, 1.0]).for_each(|(column, amount)| add(&mut residual, amount, column));
        let mut alone = own;
        span.take_out_of(&mut residual);
        span.take_out_of(&mut alone);
        assert!(residual.iter().zip(&alone).all(|(a, b)| (a - b).abs() < 1e-9));
        assert!(columns.iter().all(|column| dot(column, &residual).abs() < 1e-9));
        assert_eq!(Span::of(columns, 2).size(), 2);
        let mut nothing = vec![1.0];
        Span::of(Vec::new(), 5).take_out_of(&mut nothing);
        assert_eq!(nothing, [1.0]);
    }
}
