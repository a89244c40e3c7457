//! `recursive` against the batch solution, with forgetting, over breaks and on data that show nothing.

use crate::common::{PIONEER, pioneer_reference, record, times, vw_pd};
use wheelwright_core::regression::{Form, Settings};
use wheelwright_core::simulation::{Readout, Simulator};
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
        let found = Recursive { window, refine: false, ..Recursive::default() }.solve(&problem).unwrap();
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
    let (expected, found) =
        (batch(10).solve(&problem).unwrap(), Recursive { refine: false, ..Recursive::default() }.solve(&problem).unwrap());
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
        let mut estimator = Recursive { memory_s, refine: false, ..Recursive::default() }.start(&*model, &model.map()).unwrap();
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

/// Numbers that are near enough to normal: a linear congruential generator and the sum of twelve.
struct Normal(u64);

impl Normal {
    fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }
}

/// AR(1) noise of this deviation on every output.
fn noisy(data: &wheelwright_core::Dataset, deviation: f64, coefficient: f64, seed: u64) -> wheelwright_core::Dataset {
    let (mut data, mut normal) = (data.clone(), Normal(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15)));
    for column in data.stretches.iter_mut().flat_map(|s| &mut s.outputs) {
        let mut error = deviation * normal.next();
        for value in column {
            *value += error;
            error = coefficient * error + deviation * (1.0 - coefficient * coefficient).sqrt() * normal.next();
        }
    }
    data
}

#[test]
fn without_noise_the_free_run_finds_the_truth() {
    let (model, data) = (vw_pd(), drive());
    let solution = Recursive::default().solve(&Problem::new(&*model, &data)).unwrap();
    for (found, truth) in solution.theta.iter().zip(PIONEER) {
        assert!((found - truth).abs() < 1e-6, "{found} for {truth}");
    }
    assert!(solution.ci95.is_some());
}

#[test]
fn intervals_cover_and_the_bias_of_the_regression_is_gone() {
    let (model, data) = (vw_pd(), drive());
    for coefficient in [0.0, 0.7] {
        let (mut covered, mut stated, mut errors, mut biased) = (0, 0, 0.0, 0.0);
        for seed in 1..=40 {
            let data = noisy(&data, 0.01, coefficient, seed);
            let problem = Problem::new(&*model, &data);
            let solution = Recursive::default().solve(&problem).unwrap();
            let Some(ci95) = solution.ci95 else { continue };
            stated += 1;
            covered += ci95.iter().zip(PIONEER).filter(|((low, high), truth)| low <= truth && truth <= high).count();
            errors += solution.theta[0] - PIONEER[0];
            biased += Recursive { refine: false, ..Recursive::default() }.solve(&problem).unwrap().theta[0] - PIONEER[0];
        }
        assert!(stated >= 38, "{stated} of 40 stated");
        let share = covered as f64 / (6 * stated) as f64;
        assert!((0.91..=0.99).contains(&share), "AR {coefficient}: {share} covered");
        // Noise that is alike over a window biases the regression less, by no more than the scatter of 40 seeds.
        assert!(coefficient > 0.0 || errors.abs() < 0.3 * biased.abs(), "{errors} against {biased}");
    }
}

#[test]
fn breaks_between_stretches_are_no_samples() {
    let model = vw_pd();
    let mut data = noisy(&drive(), 0.005, 0.0, 3);
    let whole = data.stretches[0].clone();
    data.stretches = [0..400, 500..511, 700..1500].map(|rows| whole.slice(rows)).to_vec();
    let solution = Recursive::default().solve(&Problem::new(&*model, &data)).unwrap();
    let std = solution.std.unwrap();
    for ((found, truth), std) in solution.theta.iter().zip(PIONEER).zip(std) {
        assert!((found - truth).abs() < 4.0 * std, "{found} ± {std} for {truth}");
    }
}

#[test]
fn what_the_model_lacks_takes_the_intervals_away() {
    let model = vw_pd();
    let mut data = noisy(&drive(), 0.005, 0.0, 3);
    // Wheels that lose their grip for 15 s at a time.
    data.stretches[0].outputs[0].iter_mut().enumerate().filter(|(k, _)| k % 300 >= 150).for_each(|(_, v)| *v *= 0.6);
    let solution = Recursive::default().solve(&Problem::new(&*model, &data)).unwrap();
    assert!(solution.ci95.is_none() && solution.steps.iter().any(|s| s.starts_with("no intervals")), "{:?}", solution.steps);
}

#[test]
fn forgetting_states_the_errors_of_what_it_remembers() {
    let model = vw_pd();
    let (mut covered, mut stated, mut wider) = (0, 0, 0.0);
    for seed in 1..=20 {
        let data = noisy(&drive(), 0.005, 0.0, seed);
        let problem = Problem::new(&*model, &data);
        let faithful = Recursive::default().solve(&problem).unwrap();
        let forgetful = Recursive { memory_s: Some(20.0), ..Recursive::default() }.solve(&problem).unwrap();
        let (Some(a), Some(b), Some(ci95)) = (faithful.std, forgetful.std, forgetful.ci95) else { continue };
        stated += 1;
        wider += b[3] / a[3];
        covered += ci95.iter().zip(PIONEER).filter(|((low, high), truth)| low <= truth && truth <= high).count();
    }
    let share = covered as f64 / (6 * stated) as f64;
    assert!(stated >= 18 && (0.85..=1.0).contains(&share), "{share} of {stated}");
    // 150 s count as 40 s of the same weight: 1.9 times the error.
    assert!((1.3..3.5).contains(&(wider / f64::from(stated))), "{}", wider / f64::from(stated));
}

/// What a driver records that differences the counts of two encoders: each wheel's way in whole ticks, from a start anywhere in one.
fn counted(data: &wheelwright_core::Dataset, tick: f64, half_track: f64, seed: u64) -> wheelwright_core::Dataset {
    let model = vw_pd();
    let mut simulator = Simulator::new(&*model, &PIONEER).unwrap().with_readout(Readout::IntervalMean);
    let mut data = data.clone();
    for (s, stretch) in data.stretches.iter_mut().enumerate() {
        let mut mean = vec![Vec::new(); 2];
        simulator.run(stretch, &[0.0, 0.0], &mut mean).unwrap();
        // Golden ratios of the seed: phases spread evenly over all seeds.
        let mut way = [0.618_033_988_749_895, 0.754_877_666_246_693].map(|g| tick * (g * (seed + 7 * s as u64) as f64).fract());
        for (k, (v, omega)) in mean[0].iter().zip(&mean[1]).enumerate().skip(1) {
            let dt = stretch.time[k] - stretch.time[k - 1];
            let ticks = [-1.0, 1.0].map(|side| v + side * half_track * omega);
            let mut rolled = [0.0; 2];
            for i in 0..2 {
                let before = (way[i] / tick).floor();
                way[i] += ticks[i] * dt;
                rolled[i] = ((way[i] / tick).floor() - before) * tick / dt;
            }
            stretch.outputs[0][k] = 0.5 * (rolled[0] + rolled[1]);
            stretch.outputs[1][k] = (rolled[1] - rolled[0]) / (2.0 * half_track);
        }
    }
    data
}

/// Intervals over 200 starts of the counts.
#[test]
fn differenced_encoders_are_recognised_and_their_intervals_cover() {
    let (model, data) = (vw_pd(), record(PIONEER, times(0.05, 1500), pioneer_reference, 0.01));
    let (mut covered, mut stated, mut recognised, seeds) = ([0; 6], 0, 0, 200);
    for seed in 1..=seeds {
        let data = counted(&data, 2e-4, 0.17, seed);
        let solution = Recursive::default().solve(&Problem::new(&*model, &data)).unwrap();
        recognised += i32::from(solution.warnings.iter().any(|w| w.contains("encoder counts")));
        let Some(ci95) = solution.ci95 else { continue };
        stated += 1;
        for ((covered, (low, high)), truth) in covered.iter_mut().zip(ci95).zip(PIONEER) {
            *covered += i32::from(low <= truth && truth <= high);
        }
    }
    println!("recognised {recognised}, stated {stated} of {seeds}, covered {covered:?}");
    assert!(recognised >= 190, "{recognised} of {seeds} recognised");
    assert!(stated >= seeds as i32 * 9 / 10, "{stated} of {seeds} stated");
    assert!(covered.iter().all(|c| f64::from(*c) >= 0.90 * f64::from(stated)), "{covered:?} of {stated}");
}

#[test]
fn a_gyroscope_is_not_taken_for_an_encoder() {
    let (model, data) = (vw_pd(), drive());
    for (coefficient, seed) in [(0.0, 1), (0.0, 2), (0.7, 3), (-0.2, 4)] {
        let solution = Recursive::default().solve(&Problem::new(&*model, &noisy(&data, 0.005, coefficient, seed))).unwrap();
        assert!(solution.warnings.is_empty(), "AR {coefficient}: {:?}", solution.warnings);
    }
}
