//! Before the drive: how well a planned drive will tell each parameter, and after which time.
//!
//! The free run from rest is simulated, and its sensitivities over the expected noise sum up, sample by sample, to the information
//! about the parameters: Σ JᵀJ/σ². Its inverse is the covariance that an efficient fit reaches (Cramér and Rao), here of white noise.

use nalgebra::DMatrix;

use crate::dataset::Dataset;
use crate::local::{FreeRun, about, plausible};
use crate::model::{ParameterMap, RegressorModel};
use crate::simulation::Simulator;
use crate::solver::SolveError;

/// What a planned drive will tell.
#[derive(Debug, Clone, PartialEq)]
pub struct Foresight {
    /// Times looked at, since the start \[s\].
    pub time: Vec<f64>,
    /// Standard error of each parameter that a fit of the drive up to each of those times will have; infinite where it is not
    /// determined, zero where a constraint gives it.
    pub std: Vec<Vec<f64>>,
    /// Value of each parameter at which its term alone would take the largest command.
    pub plausible: Vec<f64>,
    /// Simulated outputs, one column an output.
    pub outputs: Vec<Vec<f64>>,
}

/// Foresees a drive from rest: `data` holds its commands in one stretch, whose outputs are not looked at, `sigma` the noise
/// expected on each output. The drive is judged at `looks` times, evenly spaced.
///
/// # Errors
/// [`SolveError`] if the model cannot be simulated with those parameters.
pub fn foresee(
    model: &dyn RegressorModel,
    map: &ParameterMap,
    theta: &[f64],
    mut data: Dataset,
    sigma: &[f64],
    looks: usize,
) -> Result<Foresight, SolveError> {
    data.stretches.truncate(1);
    let Some(stretch) = data.stretches.first_mut().filter(|s| s.len() >= 2) else {
        return Err(SolveError::TooFewSamples { samples: 0, parameters: theta.len(), what: "planning".to_owned(), needed_s: 1.0 });
    };
    let rest = vec![0.0; model.outputs().len()];
    let mut outputs = vec![Vec::new(); rest.len()];
    Simulator::new(model, theta)?.run(stretch, &rest, &mut outputs)?;
    stretch.outputs.clone_from(&outputs);
    let time: Vec<f64> = stretch.time.iter().map(|t| t - stretch.time[0]).collect();
    let (run, point, _): (FreeRun<'_>, _, _) = about(model, map, theta, &data)?;
    let local = run.linearise(&point, sigma)?;
    let columns = &local.blocks[0].columns;
    let rows = time.len();
    let looks = looks.clamp(1, rows - 1);
    let ends: Vec<usize> = (1..=looks).map(|k| k * rows / looks).collect();
    let mut information = DMatrix::zeros(map.free.len(), map.free.len());
    let (mut from, mut std) = (0, Vec::with_capacity(looks));
    for end in &ends {
        for output in 0..columns.nrows() / rows {
            let part = columns.rows(output * rows + from, end - from);
            information += part.transpose() * part;
        }
        from = *end;
        std.push(standard_errors(&information, map));
    }
    let plausible = plausible(model, &data, theta);
    Ok(Foresight { time: ends.iter().map(|end| time[end - 1]).collect(), std, plausible, outputs })
}

/// √diag(T I⁻¹ Tᵀ), the information scaled to a unit diagonal first.
fn standard_errors(information: &DMatrix<f64>, map: &ParameterMap) -> Vec<f64> {
    let (free, parameters) = (map.free.len(), map.offset.len());
    let scale: Vec<f64> = information.diagonal().iter().map(|d| d.sqrt()).collect();
    let scaled = DMatrix::from_fn(free, free, |i, j| {
        if scale[i] > 0.0 && scale[j] > 0.0 { information[(i, j)] / (scale[i] * scale[j]) } else { f64::from(u8::from(i == j)) }
    });
    let inverse = scaled.cholesky().map(|c| c.inverse());
    let variance = |p: usize| {
        let row = &map.matrix[p * free..(p + 1) * free];
        if row.iter().all(|t| *t == 0.0) {
            return 0.0;
        }
        let Some(inverse) = &inverse else { return f64::INFINITY };
        if row.iter().zip(&scale).any(|(t, s)| *t != 0.0 && *s == 0.0) {
            return f64::INFINITY;
        }
        let weighted: Vec<f64> = row.iter().zip(&scale).map(|(t, s)| if *t == 0.0 { 0.0 } else { t / s }).collect();
        (0..free).map(|i| (0..free).map(|j| weighted[i] * inverse[(i, j)] * weighted[j]).sum::<f64>()).sum()
    };
    (0..parameters).map(|p| variance(p).sqrt()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identifiability::assess;
    use crate::identifiability::tests::{THETA, TwoAxes, driven, thesis};

    #[test]
    fn what_is_foreseen_is_what_a_recording_of_that_drive_promises() {
        let model = TwoAxes::new();
        let data = driven(thesis, 60.0, 20.0, 0.005, 3);
        let promised = assess(&model, &model.map(), Some(&THETA), &data).unwrap();
        let foreseen = foresee(&model, &model.map(), &THETA, data, &[0.005, 0.005], 6).unwrap();
        for (j, judgement) in promised.parameters.iter().enumerate() {
            let (a, b) = (foreseen.std[5][j], judgement.predicted_std.unwrap());
            // The recording's start is one more unknown, and its noise is estimated.
            assert!((a / b - 1.0).abs() < 0.1, "theta{}: {a} {b}", j + 1);
        }
        assert!((foreseen.time[5] - 60.0).abs() < 0.1 && foreseen.time.len() == 6);
        assert!(foreseen.std.windows(2).all(|w| w[1].iter().zip(&w[0]).all(|(later, earlier)| later <= earlier)));
    }

    #[test]
    fn a_drive_that_never_turns_leaves_the_turning_unknown() {
        let model = TwoAxes::new();
        let data = driven(|t| [thesis(t)[0], 0.0], 30.0, 20.0, 0.0, 3);
        let foreseen = foresee(&model, &model.map(), &THETA, data, &[0.005, 0.005], 1).unwrap();
        assert!(foreseen.std[0][1].is_infinite() && foreseen.std[0][5].is_infinite(), "{:?}", foreseen.std);
    }

    #[test]
    fn a_fixed_parameter_is_known() {
        let model = TwoAxes::new();
        let mut map = model.map();
        map.impose(&[(4, 1.0)], THETA[4]).unwrap();
        let foreseen = foresee(&model, &map, &THETA, driven(thesis, 30.0, 20.0, 0.0, 3), &[0.005, 0.005], 1).unwrap();
        assert_eq!(foreseen.std[0][4], 0.0);
        assert!(foreseen.std[0][3] > 0.0 && foreseen.std[0][3].is_finite());
    }
}
