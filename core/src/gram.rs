//! Sums of products of long columns.

use nalgebra::DMatrix;

/// Columns of a block of a product.
const BLOCK: usize = 48;

/// Adds XᵀX to the upper half of a matrix, block by block: products of whole blocks are what a processor is quick at.
pub fn add_square(x: &DMatrix<f64>, upper: &mut DMatrix<f64>) {
    let (p, transposed) = (x.ncols(), x.transpose());
    for start in (0..p).step_by(BLOCK) {
        let end = (start + BLOCK).min(p);
        upper.view_mut((0, start), (end, end - start)).gemm(1.0, &transposed.rows_range(..end), &x.columns_range(start..end), 1.0);
    }
}
