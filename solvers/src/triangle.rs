//! Rows folded into a triangle: QR by blocks.
//!
//! [Φ y] = Q R with R square, so ‖Φ θ − y‖ = ‖R [θ; −1]‖ for every θ. R is updated block by block with Householder
//! reflections: one pass, constant memory, and none of the digits that the normal equations ΦᵀΦ throw away.

use nalgebra::DMatrix;

/// Rows folded in at a time: a block of a dozen columns stays in the first-level cache.
const BLOCK: usize = 256;

/// The triangle R of all rows seen so far.
#[derive(Debug, Clone, PartialEq)]
pub struct Triangle {
    columns: usize,
    rows: usize,
    r: Vec<f64>,
    /// Columns that were ever other than zero; the others are skipped.
    used: Vec<bool>,
}

impl Triangle {
    /// A triangle over rows of this many columns, the response included.
    pub fn new(columns: usize) -> Self {
        Self { columns, rows: 0, r: vec![0.0; columns * columns], used: vec![false; columns] }
    }

    /// Rows folded in so far.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// R, upper triangular up to the order of reflections that were not needed.
    pub fn matrix(&self) -> DMatrix<f64> {
        DMatrix::from_row_slice(self.columns, self.columns, &self.r)
    }

    /// Folds rows in, given by columns of `rows` values; an empty column is zero throughout.
    pub fn append(&mut self, columns: &[&[f64]], rows: usize) {
        self.rows += rows;
        for (used, column) in self.used.iter_mut().zip(columns) {
            *used |= !column.is_empty();
        }
        let active: Vec<usize> = (0..self.columns).filter(|&j| self.used[j]).collect();
        let mut block = vec![0.0; BLOCK * active.len()];
        for start in (0..rows).step_by(BLOCK) {
            let count = BLOCK.min(rows - start);
            for (&j, part) in active.iter().zip(block.chunks_mut(BLOCK)) {
                match columns[j].get(start..start + count) {
                    Some(values) => part[..count].copy_from_slice(values),
                    None => part[..count].fill(0.0),
                }
            }
            self.fold(&active, &mut block, count);
        }
    }

    /// Reflects a block (column-major, stride [`BLOCK`]) into R.
    fn fold(&mut self, active: &[usize], block: &mut [f64], count: usize) {
        for (i, &j) in active.iter().enumerate() {
            let (left, right) = block.split_at_mut((i + 1) * BLOCK);
            let v = &left[i * BLOCK..i * BLOCK + count];
            let tail = dot(v, v);
            if tail == 0.0 {
                continue;
            }
            let head = self.r[j * self.columns + j];
            let norm = (head * head + tail).sqrt();
            let top = if head > 0.0 { -norm } else { norm };
            let first = head - top;
            self.r[j * self.columns + j] = top;
            let scale = 2.0 / (first * first + tail);
            for (&k, column) in active[i + 1..].iter().zip(right.chunks_mut(BLOCK)) {
                let column = &mut column[..count];
                let above = &mut self.r[j * self.columns + k];
                let factor = scale * (first * *above + dot(v, column));
                *above -= factor * first;
                column.iter_mut().zip(v).for_each(|(x, y)| *x -= factor * y);
            }
        }
    }
}

/// Sum of products in eight interleaved sums, which the compiler can keep in vector registers; the order is fixed.
fn dot(x: &[f64], y: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (xs, ys) = (x.chunks_exact(8), y.chunks_exact(8));
    let rest: f64 = xs.remainder().iter().zip(ys.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in xs.zip(ys) {
        for lane in 0..8 {
            sums[lane] += a[lane] * b[lane];
        }
    }
    sums.iter().sum::<f64>() + rest
}
