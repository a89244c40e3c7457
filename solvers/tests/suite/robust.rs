//! `robust` on recordings with outliers and dropouts, beside `output-error`.

use crate::common::{PIONEER, pioneer_reference, record, times, vw_pd};
use wheelwright_core::Dataset;
use wheelwright_core::solver::{Problem, Solver, Status};
use wheelwright_solvers::{OutputError, Robust};

/// Uniform noise of 17 mm/s width; two in a hundred samples lost (zero) and one in a hundred spoiled.
fn spoiled() -> Dataset {
    let mut data = record(PIONEER, times(0.1, 800), pioneer_reference, 0.01);
    let mut state = 5_u64;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    for value in data.stretches[0].outputs.iter_mut().flatten() {
        *value += 0.017 * uniform();
        let fate = uniform() + 0.5;
        if fate < 0.02 {
            *value = 0.0;
        } else if fate < 0.03 {
            *value += 0.5;
        }
    }
    data
}

fn worst(theta: &[f64]) -> f64 {
    theta.iter().zip(&PIONEER).map(|(f, t)| (f - t).abs()).fold(0.0, f64::max)
}

#[test]
fn outliers_hardly_move_it() {
    let model = vw_pd();
    let data = spoiled();
    let problem = Problem::new(&*model, &data);
    let robust = Robust::default().solve(&problem).unwrap();
    let plain = OutputError::default().solve(&problem).unwrap();
    assert_eq!(robust.status, Status::Solved);
    assert!(worst(&robust.theta) < 0.02, "{:?}", robust.theta);
    assert!(worst(&robust.theta) < 0.3 * worst(&plain.theta), "{:?} and {:?}", robust.theta, plain.theta);
    assert!(robust.std.is_none() && robust.warnings.len() == 2, "{:?}", robust.warnings);
}

#[test]
fn without_noise_it_is_exact_and_keeps_bounds() {
    let model = vw_pd();
    let data = record(PIONEER, times(0.1, 600), pioneer_reference, 0.005);
    let mut problem = Problem::new(&*model, &data);
    let free = Robust::default().solve(&problem).unwrap();
    assert!(worst(&free.theta) < 1e-6, "{:?}", free.theta);
    problem.bounds[3] = (1.01, 2.0);
    let bounded = Robust::default().solve(&problem).unwrap();
    assert!(bounded.theta[3] >= 1.01 - 1e-6 && bounded.theta[3] < 1.01 + 1e-6, "{:?}", bounded.theta);
}
