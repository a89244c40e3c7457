//! Which columns a response needs: forward selection on their Gram matrix.

use nalgebra::{DMatrix, DVector};

/// A column whose part that is new beside those chosen is this small a share of it (squared) is not new.
const NEW: f64 = 1e-6;
/// Most columns chosen.
const MOST: usize = 40;

/// Columns chosen with their coefficients.
#[derive(Debug, Clone)]
pub(super) struct Chosen {
    pub(super) columns: Vec<usize>,
    pub(super) coefficients: DVector<f64>,
    /// Inverse of the Gram matrix of the chosen columns.
    pub(super) inverse: DMatrix<f64>,
}

/// What a column costs in units of twice the log-likelihood.
#[derive(Debug, Clone, Copy)]
pub(super) enum Penalty {
    /// 2: generous, leaves nothing that matters.
    Akaike,
    /// ln N and twice the logarithm of how many columns there are to choose from (Chen and Chen, Biometrika 95, 2008): strict.
    ExtendedBayes,
}

/// Adds the column that lowers the squared error most for as long as it gains more than it costs.
///
/// `gram` is that of the columns with the response last; `samples` counts independent rows.
pub(super) fn choose(gram: &DMatrix<f64>, samples: f64, penalty: Penalty) -> Chosen {
    let p = gram.nrows() - 1;
    let scale: Vec<f64> = gram.diagonal().iter().map(|d| if *d > 0.0 { 1.0 / d.sqrt() } else { 0.0 }).collect();
    let mut swept = DMatrix::from_fn(p + 1, p + 1, |i, j| gram[(i, j)] * scale[i] * scale[j]);
    let penalty = match penalty {
        Penalty::Akaike => 2.0,
        Penalty::ExtendedBayes => samples.max(2.0).ln() + 2.0 * (p as f64).ln(),
    };
    let most = MOST.min((samples / 10.0) as usize);
    let mut columns = Vec::new();
    while columns.len() < most {
        let free = (0..p).filter(|j| !columns.contains(j) && swept[(*j, *j)] > NEW);
        let gain = |j: usize| swept[(j, p)].powi(2) / swept[(j, j)];
        let Some(best) = free.max_by(|a, b| gain(*a).total_cmp(&gain(*b))) else { break };
        let rest = swept[(p, p)] - gain(best);
        if rest > 0.0 && samples * (swept[(p, p)] / rest).ln() < penalty {
            break;
        }
        columns.push(best);
        // What the others and the response have in common with the chosen column goes.
        let pivot = swept[(best, best)];
        let row = swept.row(best).clone_owned();
        swept.ger(-1.0 / pivot, &row.transpose(), &row.transpose(), 1.0);
        if rest <= 1e-14 {
            break;
        }
    }
    let part =
        DMatrix::from_fn(columns.len(), columns.len(), |i, j| gram[(columns[i], columns[j])] * scale[columns[i]] * scale[columns[j]]);
    let ridge = DMatrix::identity(columns.len(), columns.len()) * 1e-12;
    let unscaled =
        |m: DMatrix<f64>| DMatrix::from_fn(columns.len(), columns.len(), |i, j| m[(i, j)] * scale[columns[i]] * scale[columns[j]]);
    let inverse = (part + ridge).cholesky().map_or_else(|| DMatrix::zeros(columns.len(), columns.len()), |c| unscaled(c.inverse()));
    let right = DVector::from_fn(columns.len(), |i, _| gram[(columns[i], p)]);
    Chosen { coefficients: &inverse * right, inverse, columns }
}
