//! Where a free run begins: a quick estimate, made simulable and fitted, or parameters given.

use nalgebra::{DMatrix, DVector};

use super::{FreeRun, Point, plausible, scaled_solve};
use crate::dataset::Dataset;
use crate::identifiability::term::Term;
use crate::model::{ParameterMap, RegressorModel};
use crate::regression::{self, Form, Settings};
use crate::solver::SolveError;

/// Window of the integral regression that starts the fit \[s\].
const WINDOW_S: f64 = 1.0;

/// A quick estimate of the free parameters: regression over windows of a second, which needs no start.
///
/// # Errors
/// [`SolveError`] as [`regression::visit`].
pub(crate) fn regression_start(model: &dyn RegressorModel, map: &ParameterMap, data: &Dataset) -> Result<Vec<f64>, SolveError> {
    let window = ((WINDOW_S / data.period()).round() as usize).clamp(1, (super::typical_rows(data) / 2).max(1));
    let settings = Settings { form: Form::Integral, integral_samples: window, ..Settings::default() };
    let (equations, parameters, free) = (model.equations(), model.parameters().len(), map.free.len());
    // Every equation weighs as its response does.
    let mut gram = vec![(DMatrix::<f64>::zeros(free, free), DVector::<f64>::zeros(free), 0.0); equations];
    regression::visit(model, data, &settings, &mut |rows| {
        for (equation, (matrix, right, squares)) in rows.equations.iter().zip(&mut gram) {
            for k in 0..rows.time.len() {
                let value = |j: usize| equation.columns[j].get(k).copied().unwrap_or(0.0);
                let row = DVector::from_fn(free, |z, _| (0..parameters).map(|j| value(j) * map.matrix[j * free + z]).sum());
                let known: f64 = (0..parameters).map(|j| value(j) * map.offset[j]).sum();
                let response = equation.response.get(k).copied().unwrap_or(0.0);
                *squares += response * response;
                right.axpy(response - known, &row, 1.0);
                matrix.ger(1.0, &row, &row, 1.0);
            }
        }
    })?;
    let (mut matrix, mut right) = (DMatrix::zeros(free, free), DVector::zeros(free));
    for (m, r, squares) in gram.iter().filter(|g| g.2 > 0.0) {
        matrix += m / *squares;
        right += r / *squares;
    }
    Ok(scaled_solve(&matrix, &right).as_slice().to_vec())
}

/// A quick free-run fit without delays: [`regression_start`], made simulable, then Gauss-Newton. The free run, the point and the
/// noise of each output.
///
/// # Errors
/// [`SolveError`] if no start can be simulated.
pub(crate) fn quick_fit<'a>(
    model: &'a dyn RegressorModel,
    map: &'a ParameterMap,
    data: &'a Dataset,
    axes: Vec<Option<usize>>,
) -> Result<(FreeRun<'a>, Point, Vec<f64>), SolveError> {
    let z = rough_start(model, map, data)?;
    let mut run = FreeRun::new(model, map, data, axes);
    let (point, sigma) = run.fit(run.point(z, Vec::new()))?;
    Ok((run, point, sigma))
}

/// Free parameters by regression with which the model can be simulated.
pub(crate) fn rough_start(model: &dyn RegressorModel, map: &ParameterMap, data: &Dataset) -> Result<Vec<f64>, SolveError> {
    Ok(simulable(model, map, data, regression_start(model, map, data)?))
}

/// Replaces coefficients of accelerations that the data left at zero or below, with which nothing can be simulated, by their
/// plausible size at a time constant of ten periods.
pub(crate) fn simulable(model: &dyn RegressorModel, map: &ParameterMap, data: &Dataset, mut z: Vec<f64>) -> Vec<f64> {
    let theta = map.theta(&z);
    let runs = |z: &[f64]| {
        let free_run = FreeRun::new(model, map, data, Vec::new());
        free_run.simulate(&free_run.point(z.to_vec(), Vec::new())).is_ok()
    };
    if runs(&z) {
        return z;
    }
    let mut unusable = theta.clone();
    unusable.fill(0.0);
    let sizes = plausible(model, data, &unusable);
    let free = map.free.len();
    for (j, parameter) in model.parameters().iter().enumerate() {
        let term = Term::of(model, j);
        if term.accelerations.is_empty() || theta[j] > 0.01 * sizes[j] || parameter.bounds.0 < 0.0 {
            continue;
        }
        if let Some(i) = (0..free).find(|i| map.matrix[j * free + i] != 0.0) {
            z[i] += (sizes[j] - theta[j]) / map.matrix[j * free + i];
        }
    }
    z
}

/// The free run about given parameters, with the starts fitted: what [`quick_fit`] returns when the parameters are known.
///
/// # Errors
/// [`SolveError`] if the model cannot be simulated with them.
pub(crate) fn about<'a>(
    model: &'a dyn RegressorModel,
    map: &'a ParameterMap,
    theta: &[f64],
    data: &'a Dataset,
) -> Result<(FreeRun<'a>, Point, Vec<f64>), SolveError> {
    let z = free_values(map, theta);
    let mut run = FreeRun::new(model, map, data, Vec::new());
    run.fix_step(&z)?;
    let mut point = run.point(z, Vec::new());
    let sigma = run.noise(&point)?;
    let local = run.linearise(&point, &sigma)?;
    for (start, block) in point.starts.iter_mut().zip(&local.blocks) {
        start.iter_mut().zip(scaled_solve(&block.starts, &block.error).iter()).for_each(|(x, d)| *x += d);
    }
    let sigma = run.noise(&point)?;
    Ok((run, point, sigma))
}

/// The free values z whose θ = T z + c is nearest to the one given.
pub(crate) fn free_values(map: &ParameterMap, theta: &[f64]) -> Vec<f64> {
    let transform = DMatrix::from_row_slice(theta.len(), map.free.len(), &map.matrix);
    let right = DVector::from_fn(theta.len(), |i, _| theta[i] - map.offset[i]);
    scaled_solve(&transform, &right).as_slice().to_vec()
}
