//! How fast a model is, and how large its parameters could plausibly be.

use nalgebra::DMatrix;

use crate::dataset::{Dataset, Stretch};
use crate::model::{RegressorModel, Sample};

/// L, row-major: how the accelerations change with the outputs about rest; `None` where the equations leave them undetermined.
pub(crate) fn linear_part(model: &dyn RegressorModel, theta: &[f64]) -> Option<DMatrix<f64>> {
    let n = model.outputs().len();
    let inputs = vec![0.0; model.inputs().len()];
    let mut linear = DMatrix::zeros(n, n);
    for j in 0..n {
        let side = |x: f64| {
            let mut outputs = vec![0.0; n];
            outputs[j] = x;
            let mut a = vec![0.0; n];
            model.accelerations(theta, &inputs, &outputs, &mut a).ok().map(|()| a)
        };
        let (up, down) = (side(1.0)?, side(-1.0)?);
        (0..n).for_each(|i| linear[(i, j)] = 0.5 * (up[i] - down[i]));
    }
    linear.iter().all(|x| x.is_finite()).then_some(linear)
}

/// Time constant of each output by itself, −1/L_ii \[s\], kept between half a period and the duration of the data.
pub(crate) fn time_constants(model: &dyn RegressorModel, theta: &[f64], data: &Dataset) -> Vec<f64> {
    let (shortest, longest) = (0.5 * data.period(), data.duration().max(data.period()));
    let of = |rate: f64| if rate > 0.0 { (1.0 / rate).clamp(shortest, longest) } else { longest };
    match linear_part(model, theta) {
        Some(linear) => linear.diagonal().iter().map(|l| of(-l)).collect(),
        None => vec![10.0 * data.period(); model.outputs().len()],
    }
}

/// The plausible size of each parameter: that at which its term alone takes as much command as the largest in the data, when
/// every output moves as far as it does in the data, all at once, and as fast as its time constant lets it.
///
/// Unlike the root mean square of a column this does not depend on which motions were combined in the recording, so that a
/// motion that is missing cannot make a parameter look large. A channel that never moves or is not
/// measured is taken to reach one SI unit.
pub(crate) fn plausible(model: &dyn RegressorModel, data: &Dataset, theta: &[f64]) -> Vec<f64> {
    let reach = |columns: &dyn Fn(&Stretch) -> &Vec<Vec<f64>>, i: usize| {
        let largest = data.stretches.iter().flat_map(|s| columns(s)[i].iter()).fold(0.0_f64, |m, x| m.max(x.abs()));
        if largest > 0.0 { largest } else { 1.0 }
    };
    let inputs: Vec<f64> = (0..data.inputs.len()).map(|i| reach(&|s| &s.inputs, i)).collect();
    let measured = |i: usize| if i < data.outputs.len() { reach(&|s| &s.outputs, i) } else { 1.0 };
    let outputs: Vec<f64> = (0..model.outputs().len()).map(measured).collect();
    let lags = time_constants(model, theta, data);
    let (equations, parameters) = (model.equations(), theta.len());
    let (mut phi, mut y) = (vec![0.0; equations * parameters], vec![0.0; equations]);
    let (mut largest_phi, mut largest_y) = (vec![0.0_f64; equations * parameters], vec![0.0_f64; equations]);
    // All corners of the box of outputs would double with every output; alternating signs already show every product.
    for corner in 0..4_usize {
        let sign = |i: usize| if (corner >> (i % 2)) & 1 == 0 { 1.0 } else { -1.0 };
        let x: Vec<f64> = outputs.iter().enumerate().map(|(i, x)| sign(i) * x).collect();
        let a: Vec<f64> = x.iter().zip(&lags).map(|(x, t)| x / t).collect();
        model.regressor(Sample { inputs: &inputs, outputs: &x, accelerations: &a }, &mut phi, &mut y);
        largest_phi.iter_mut().zip(&phi).for_each(|(m, x)| *m = m.max(x.abs()));
        largest_y.iter_mut().zip(&y).for_each(|(m, x)| *m = m.max(x.abs()));
    }
    let of = |j: usize| {
        let sizes = (0..equations).map(|e| largest_y[e] / largest_phi[e * parameters + j]).filter(|s| s.is_finite() && *s > 0.0);
        let size = sizes.fold(f64::INFINITY, f64::min);
        if size.is_finite() { size } else { theta[j].abs().max(1.0) }
    };
    (0..parameters).map(of).collect()
}
