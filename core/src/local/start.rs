//! Where a free run begins: a quick estimate, made simulable and fitted, or parameters given.

use nalgebra::{DMatrix, DVector};

use super::{FreeRun, Point, plausible, scaled_solve};
use crate::dataset::Dataset;
use crate::identifiability::term::Term;
use crate::model::{Parameter, ParameterMap, RegressorModel};
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

/// Replaces coefficients of accelerations that the data left at zero or below, with which no robot can be simulated, by their
/// plausible size at a time constant of ten periods; and if it runs away all the same, puts as few other parameters at nothing as end that.
pub(crate) fn simulable(model: &dyn RegressorModel, map: &ParameterMap, data: &Dataset, mut z: Vec<f64>) -> Vec<f64> {
    let free_run = FreeRun::new(model, map, data, Vec::new());
    let runs = |z: &[f64]| free_run.simulate(&free_run.point(z.to_vec(), Vec::new())).is_ok();
    let theta = map.theta(&z);
    // Where a coupling of outputs catches what a time constant below nothing drives away, a run stays in range, and the next step of a fit does not.
    let backwards =
        |(j, parameter): (usize, &Parameter)| theta[j] < 0.0 && parameter.bounds.0 >= 0.0 && !Term::of(model, j).accelerations.is_empty();
    if !model.parameters().iter().enumerate().any(backwards) && runs(&z) {
        return z;
    }
    let sizes = plausible(model, data, &vec![0.0; theta.len()]);
    let free = map.free.len();
    let mut moving = vec![false; free];
    for (j, parameter) in model.parameters().iter().enumerate() {
        let term = Term::of(model, j);
        let Some(i) = (0..free).find(|i| map.matrix[j * free + i] != 0.0) else { continue };
        moving[i] |= !term.accelerations.is_empty();
        if term.accelerations.is_empty() || theta[j] > 0.01 * sizes[j] || parameter.bounds.0 < 0.0 {
            continue;
        }
        z[i] += (sizes[j] - theta[j]) / map.matrix[j * free + i];
    }
    if runs(&z) { z } else { tamed(&free_run, z, &moving) }
}

/// Free parameters with one that enters no coefficient of an acceleration at nothing, or two, or all: a regression of motion that the model
/// lacks can put a coupling of outputs, or a drag, beyond stability. Without them a run is tame; of those that are, the nearest to the data.
fn tamed(free_run: &FreeRun<'_>, z: Vec<f64>, moving: &[bool]) -> Vec<f64> {
    let still: Vec<usize> = (0..z.len()).filter(|j| !moving[*j]).collect();
    let ones = still.iter().map(|j| vec![*j]);
    let twos = still.iter().enumerate().flat_map(|(k, i)| still[k + 1..].iter().map(|j| vec![*i, *j]));
    let without = |gone: Vec<usize>| -> Vec<f64> { (0..z.len()).map(|j| if gone.contains(&j) { 0.0 } else { z[j] }).collect() };
    let scales = vec![1.0; free_run.model.outputs().len()];
    let cost = |z: Vec<f64>| (free_run.cost(&free_run.point(z.clone(), Vec::new()), &scales), z);
    for fewer in [ones.collect(), twos.collect(), vec![still.clone()]] {
        let costs = fewer.into_iter().map(|gone| cost(without(gone))).filter(|(cost, _)| cost.is_finite());
        if let Some((_, tame)) = costs.min_by(|a, b| a.0.total_cmp(&b.0)) {
            return tame;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identifiability::tests::{THETA, TwoAxes, driven, thesis};

    #[test]
    fn a_start_that_runs_away_loses_as_few_parameters_as_end_that() {
        let model = TwoAxes::new();
        let (map, data) = (model.map(), driven(thesis, 60.0, 20.0, 0.005, 4));
        let run = FreeRun::new(&model, &map, &data, Vec::new());
        let runs = |z: &[f64]| run.simulate(&run.point(z.to_vec(), Vec::new())).is_ok();
        let tame = |changes: &[(usize, f64)]| {
            let mut wild = THETA.to_vec();
            changes.iter().for_each(|(j, value)| wild[*j] = *value);
            assert!(!runs(&wild), "{changes:?} was to run away");
            let tame = simulable(&model, &map, &data, wild.clone());
            assert!(runs(&tame), "{tame:?}");
            (0..wild.len()).filter(|j| tame[*j] != wild[*j]).collect::<Vec<_>>()
        };
        assert_eq!(tame(&[(3, -30.0)]), [3]);
        assert_eq!(tame(&[(3, -30.0), (5, -30.0)]), [3, 5]);
        // A time constant below nothing gets its plausible size, and what runs away with that is taken away besides.
        assert_eq!(tame(&[(0, -0.1), (4, -90.0)]), [0, 4]);
        assert_eq!(simulable(&model, &map, &data, THETA.to_vec()), THETA, "what runs stays as it is");
    }

    #[test]
    fn a_time_constant_below_nothing_is_no_start_though_it_stays_in_range() {
        let model = TwoAxes::new();
        let (map, data) = (model.map(), driven(thesis, 60.0, 20.0, 0.005, 4));
        let run = FreeRun::new(&model, &map, &data, Vec::new());
        // What turns away faster and faster pushes the robot backwards, and backwards it is held.
        let caught = [0.13, -0.1, -0.003, 1.25, 16.0, 0.4];
        assert!(run.simulate(&run.point(caught.to_vec(), Vec::new())).is_ok());
        let start = simulable(&model, &map, &data, caught.to_vec());
        assert!(start[1] > 0.01, "{start:?}");
        assert!((0..6).all(|j| j == 1 || start[j] == caught[j]), "{start:?}");
    }
}
