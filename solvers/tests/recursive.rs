//! `recursive` against the batch solution, with forgetting, over breaks and on data that show nothing.

#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use common::{PIONEER, pioneer_reference, record, times, vw_pd};
use wheelwright_core::regression::{Form, Settings};
use wheelwright_core::solver::{Problem, SolveError, Solver};
use wheelwright_core::{ModelConfig, Stretch};
use wheelwright_models::WheelPdConfig;
use wheelwright_solvers::{Ols, Recursive};

fn drive() -> wheelwright_core::Dataset {
    record(PIONEER, times(0.1, 1500), pioneer_reference, 0.01)
}

/// Rows of the same windows, all at once.
fn batch(window: usize) -> Ols {
    Ols { conditioning: Settings { form: Form::Integral, integral_samples: window, ..Settings::default() }, undo_hold: false }
}

#[test]
fn without_forgetting_it_is_the_batch_solution() {
    let model = vw_pd();
    let mut data = drive();
    let whole = data.stretches[0].clone();
    data.stretches = [0..400, 400..411, 411..1500].map(|rows| whole.slice(rows)).to_vec();
    for window in [1, 10, 25] {
        let problem = Problem::new(&*model, &data);
        let expected = batch(window).solve(&problem).unwrap();
        let found = Recursive { window, memory_s: None }.solve(&problem).unwrap();
        for (f, e) in found.theta.iter().zip(&expected.theta) {
            assert!((f - e).abs() <= 1e-9 * e.abs().max(1e-3), "window {window}: {f} for {e}");
        }
    }
}

#[test]
fn fixed_parameters_stay_and_the_rest_is_the_batch_solution() {
    let model = vw_pd();
    let data = drive();
    let mut problem = Problem::new(&*model, &data);
    let kept = [0, 1, 2, 4, 5];
    problem.map.free = kept.iter().map(|&i| problem.map.free[i].clone()).collect();
    problem.map.matrix = (0..6).flat_map(|i| kept.iter().map(move |&j| f64::from(u8::from(i == j)))).collect();
    problem.map.offset[3] = 1.02;
    let (expected, found) = (batch(10).solve(&problem).unwrap(), Recursive::default().solve(&problem).unwrap());
    assert_eq!(found.theta[3], 1.02);
    assert!(found.theta.iter().zip(&expected.theta).all(|(f, e)| (f - e).abs() < 1e-9), "{:?} for {:?}", found.theta, expected.theta);
}

#[test]
fn ties_hold() {
    let model = WheelPdConfig { constrained: true, track_width: Some(0.089), ..WheelPdConfig::default() }.build().unwrap();
    let data = drive();
    let theta = Recursive::default().solve(&Problem::new(&*model, &data)).unwrap().theta;
    assert!(theta[3] == theta[5] && (theta[2] - 0.089 * 0.089 / 4.0 * theta[4]).abs() < 1e-15, "{theta:?}");
}

#[test]
fn forgetting_follows_a_robot_that_changes() {
    let model = vw_pd();
    let mut heavy = PIONEER;
    heavy[0] *= 2.0;
    let (before, after) = (drive(), record(heavy, times(0.1, 1500), pioneer_reference, 0.01));
    let follow = |memory_s: Option<f64>| {
        let mut estimator = Recursive { window: 10, memory_s }.start(&*model, &model.map()).unwrap();
        let mut theta = [0.0; 6];
        for Stretch { time, inputs, outputs, .. } in [&before.stretches[0], &after.stretches[0]] {
            estimator.new_stretch();
            for (k, t) in time.iter().enumerate() {
                estimator.push(*t, &[inputs[0][k], inputs[1][k]], &[outputs[0][k], outputs[1][k]]);
            }
            assert!(estimator.theta(&mut theta));
        }
        theta[0]
    };
    let alone = Recursive::default().solve(&Problem::new(&*model, &after)).unwrap().theta[0];
    let (forgetful, faithful) = (follow(Some(15.0)), follow(None));
    assert!((forgetful - alone).abs() < 0.02 * alone, "{forgetful} for {alone}");
    assert!((faithful - alone).abs() > 0.1 * alone, "{faithful} for {alone}");
}

#[test]
fn the_innovation_vanishes_once_the_robot_is_known() {
    let model = vw_pd();
    let data = drive();
    let Stretch { time, inputs, outputs, .. } = &data.stretches[0];
    let mut estimator = Recursive::default().start(&*model, &model.map()).unwrap();
    let mut late: f64 = 0.0;
    for (k, t) in time.iter().enumerate() {
        estimator.push(*t, &[inputs[0][k], inputs[1][k]], &[outputs[0][k], outputs[1][k]]);
        if k > 1000 {
            late = estimator.innovation().iter().fold(late, |m, i| m.max(i.abs()));
        }
    }
    assert!(late > 0.0 && late < 1e-3, "{late}");
}

#[test]
fn a_robot_that_stands_is_not_identifiable() {
    let model = vw_pd();
    let mut data = drive();
    data.stretches[0].outputs[1].fill(0.0);
    let error = Recursive::default().solve(&Problem::new(&*model, &data)).unwrap_err();
    let SolveError::NotIdentifiable { parameters, .. } = error else { panic!("{error}") };
    assert_eq!(parameters, ["theta2", "theta3", "theta5", "theta6"]);
    let wrong = Recursive { memory_s: Some(-1.0), ..Recursive::default() };
    assert!(matches!(wrong.solve(&Problem::new(&*model, &data)), Err(SolveError::Setting { .. })));
}
