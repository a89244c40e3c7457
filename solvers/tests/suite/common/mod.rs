//! Noise-free recordings of the thesis' two robots, and models to try solvers on.

#![allow(dead_code, unreachable_pub, clippy::unwrap_used)]

use std::f64::consts::PI;

use wheelwright_core::model::{ModelConfig, RegressorModel};
use wheelwright_core::{Dataset, Stretch};
use wheelwright_models::VwPdConfig;

/// θ of the Khepera III and of the Pioneer 3-DX, Laut (2011), sections 4.4.1 and 4.4.2.
pub const KHEPERA: [f64; 6] = [0.0228, 0.0568, -0.0001, 1.0030, 0.0732, 0.9981];
pub const PIONEER: [f64; 6] = [0.2183, 0.1918, -0.0050, 0.9993, -0.0279, 1.0142];

pub fn vw_pd() -> Box<dyn RegressorModel> {
    VwPdConfig::default().build().unwrap()
}

pub fn khepera_reference(t: f64) -> [f64; 2] {
    let v = 0.1 + 0.05 * ((2.0 * t).sin() + t.sin() + (t / 3.0).sin() + (t / 11.0).sin());
    let w = 1.5 + 0.5 * (1.5 * t).sin() + 0.5 * t.sin() + 0.25 * (t / 2.0).sin() + 0.25 * (t / 5.0).sin();
    [v, w]
}

pub fn pioneer_reference(t: f64) -> [f64; 2] {
    let v = 0.4 + 0.1 * ((2.0 * t).sin() + t.sin() + (t / 3.0).sin() + (t / 11.0).sin());
    let w = 0.75 + 0.25 * ((1.5 * t).sin() + t.sin() + (t / 2.0).sin() + (t / 5.0).sin());
    [v, w]
}

/// Times that add up the period, as the reference file's did.
pub fn times(period: f64, samples: usize) -> Vec<f64> {
    let mut t = 0.0;
    let next = |_| {
        let now = t;
        t += period;
        now
    };
    (0..samples).map(next).collect()
}

/// Classical Runge-Kutta from rest under held references, at most `step` a sub-step. Deliberately not the library's
/// simulator, and with the rounding of the reference file's number of sub-steps.
pub fn record(theta: [f64; 6], time: Vec<f64>, reference: impl Fn(f64) -> [f64; 2], step: f64) -> Dataset {
    let f = |x: [f64; 2], u: [f64; 2]| {
        let [v, w] = x;
        [(u[0] - theta[3] * v + theta[2] * w * w) / theta[0], (u[1] - theta[5] * w - theta[4] * v * w) / theta[1]]
    };
    let inputs: Vec<[f64; 2]> = time.iter().map(|&t| reference(t)).collect();
    let mut x = [0.0; 2];
    let mut outputs = vec![x];
    for k in 0..time.len() - 1 {
        let dt = time[k + 1] - time[k];
        let n = (dt / step).ceil();
        let (h, u) = (dt / n, inputs[k]);
        for _ in 0..n as usize {
            let move_by = |slope: [f64; 2], by: f64| [x[0] + by * slope[0], x[1] + by * slope[1]];
            let k1 = f(x, u);
            let k2 = f(move_by(k1, h / 2.0), u);
            let k3 = f(move_by(k2, h / 2.0), u);
            let k4 = f(move_by(k3, h), u);
            for i in 0..2 {
                x[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
            }
        }
        outputs.push(x);
    }
    dataset(&*vw_pd(), time, &inputs, &outputs)
}

/// One stretch from rows.
pub fn dataset<const U: usize, const X: usize>(
    model: &dyn RegressorModel,
    time: Vec<f64>,
    inputs: &[[f64; U]],
    outputs: &[[f64; X]],
) -> Dataset {
    let stretch = Stretch {
        label: "1".to_owned(),
        time,
        inputs: (0..U).map(|i| inputs.iter().map(|u| u[i]).collect()).collect(),
        outputs: (0..X).map(|i| outputs.iter().map(|x| x[i]).collect()).collect(),
    };
    Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![stretch] }
}

/// The three noise-free recordings: name in the reference file, θ, data.
pub fn recordings() -> [(&'static str, [f64; 6], Dataset); 3] {
    [
        ("khep_Ts0.02", KHEPERA, record(KHEPERA, times(0.02, 6001), khepera_reference, 0.005)),
        ("pion_Ts0.1", PIONEER, record(PIONEER, times(0.1, 1501), pioneer_reference, 0.02)),
        ("pion_Ts0.3", PIONEER, record(PIONEER, times(0.3, 501), pioneer_reference, 0.02)),
    ]
}

/// A sum of sines with no common period.
pub fn sines(t: f64, phase: f64) -> f64 {
    [0.3, 0.7, 1.1, 1.9].iter().map(|w| (w * PI * 0.5 * t + phase * w).sin()).sum::<f64>()
}
