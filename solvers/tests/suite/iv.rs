//! `iv` on recordings of robots whose parameters are known, beside `ols`, which noise biases.

use crate::common;

use common::{KHEPERA, PIONEER, khepera_reference, pioneer_reference, record, recordings, times, vw_pd};
use wheelwright_core::config::{names, tagged};
use wheelwright_core::simulation::{Readout, Simulator};
use wheelwright_core::solver::{Problem, SolveError, Solver, Status};
use wheelwright_core::{Dataset, ModelConfig};
use wheelwright_models::{WheelPdConfig, WheelVoltageConfig};
use wheelwright_solvers::{InstrumentalVariables, NoiseModel, Ols, Velocity};

fn iv() -> InstrumentalVariables {
    InstrumentalVariables::default()
}

/// A reproducible sequence of zero mean and unit variance, uniform.
fn noise(seed: u64) -> impl FnMut() -> f64 {
    // Neighbouring seeds of such a generator give neighbouring sequences.
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0x0123_4567_89AB_CDEF;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        12.0_f64.sqrt() * ((state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5)
    }
}

fn disturb(data: &mut Dataset, deviations: [f64; 2], seed: u64) {
    let mut random = noise(seed);
    for stretch in &mut data.stretches {
        for (column, deviation) in stretch.outputs.iter_mut().zip(deviations) {
            column.iter_mut().for_each(|x| *x += deviation * random());
        }
    }
}

fn jittered(period: f64, samples: usize) -> Vec<f64> {
    (0..samples).map(|k| period * (k as f64 + 0.3 * (1.7 * k as f64).sin())).collect()
}

fn close(found: &[f64], truth: &[f64], tolerance: f64, what: &str) {
    for (i, (f, t)) in found.iter().zip(truth).enumerate() {
        assert!((f - t).abs() < tolerance, "{what}: theta{} = {f}, not {t}", i + 1);
    }
}

#[test]
fn it_is_registered_and_refuses_unknown_keys() {
    assert!(names::<Box<dyn Solver>>().contains(&"iv".to_owned()));
    let configured: Box<dyn Solver> = tagged(toml::from_str("type = 'iv'\nvelocity = 'difference'").unwrap()).unwrap();
    assert_eq!(configured.name(), "iv");
    let wrong = tagged::<Box<dyn Solver>>(toml::from_str("type = 'iv'\ninstruments = 3").unwrap()).unwrap_err();
    assert!(wrong.to_string().contains("unknown field `instruments`"), "{wrong}");
}

#[test]
fn without_noise_it_is_exact_at_every_rate() {
    let model = vw_pd();
    for (name, theta, data) in recordings() {
        let solution = iv().solve(&Problem::new(&*model, &data)).unwrap();
        assert_eq!(solution.status, Status::Solved, "{name}: {:?}", solution.warnings);
        close(&solution.theta, &theta, 1e-6, name);
    }
}

#[test]
fn without_noise_it_is_exact_with_uneven_stamps_and_several_stretches() {
    let model = vw_pd();
    let mut data = record(PIONEER, jittered(0.1, 600), pioneer_reference, 0.005);
    // The second stretch begins in motion, the third has seven samples.
    let whole = data.stretches.remove(0);
    data.stretches = vec![whole.slice(0..200), whole.slice(230..500), whole.slice(540..547)];
    let solution = iv().solve(&Problem::new(&*model, &data)).unwrap();
    assert_eq!(solution.status, Status::Solved);
    close(&solution.theta, &PIONEER, 1e-6, "jitter");
}

#[test]
fn velocities_differenced_from_counts_are_taken_as_means() {
    let model = vw_pd();
    let mut data = record(KHEPERA, jittered(0.02, 2000), khepera_reference, 0.005);
    let mut simulator = Simulator::new(&*model, &KHEPERA).unwrap().with_readout(Readout::IntervalMean).with_max_step(1e-3);
    data.stretches[0].outputs = simulator.run_measured(&data.stretches[0]).unwrap();
    let problem = Problem::new(&*model, &data);
    let solution = InstrumentalVariables { velocity: Velocity::Difference, ..iv() }.solve(&problem).unwrap();
    assert_eq!(solution.status, Status::Solved, "{:?}", solution.warnings);
    close(&solution.theta, &KHEPERA, 1e-6, "means");
    let mistaken = iv().solve(&problem).unwrap();
    (0..2).for_each(|i| assert!((0.008..0.012).contains(&(mistaken.theta[i] - KHEPERA[i])), "half a sample: {:?}", mistaken.theta));
}

/// At 50 mm/s and 1 rad/s of noise the filtered regression takes noise for motion: both lags and the coupling shrink.
#[test]
fn at_high_noise_it_stays_unbiased_where_ols_does_not() {
    let model = vw_pd();
    let clean = record(KHEPERA, times(0.02, 6001), khepera_reference, 0.005);
    let (mut errors, mut biases) = (vec![Vec::new(); 6], vec![Vec::new(); 6]);
    for seed in 0..8 {
        let mut data = clean.clone();
        disturb(&mut data, [0.05, 1.0], 77 + seed);
        let problem = Problem::new(&*model, &data);
        let found = iv().solve(&problem).unwrap();
        assert_eq!(found.status, Status::Solved, "{:?}", found.warnings);
        let ols = Ols::default().solve(&problem).unwrap();
        for i in 0..6 {
            errors[i].push(found.theta[i] - KHEPERA[i]);
            biases[i].push(ols.theta[i] - KHEPERA[i]);
        }
    }
    // Mean error in units of its own standard error: beyond 4 it is no chance.
    let significance = |e: &[f64]| {
        let mean = e.iter().sum::<f64>() / e.len() as f64;
        let variance = e.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (e.len() - 1) as f64;
        mean / (variance / e.len() as f64).sqrt()
    };
    let (ours, theirs): (Vec<f64>, Vec<f64>) = errors.iter().zip(&biases).map(|(e, b)| (significance(e), significance(b))).unzip();
    assert!(ours.iter().all(|t| t.abs() < 4.0), "{ours:.1?}");
    assert!(theirs.iter().any(|t| t.abs() > 8.0), "{theirs:.1?}");
}

#[test]
fn ties_between_equations_are_kept() {
    let (track, tied) = (0.34, [0.25, 0.2, 0.34 * 0.34 / 4.0 * 0.05, 1.02, 0.05, 1.02]);
    let model = WheelPdConfig { constrained: true, track_width: Some(track), ..WheelPdConfig::default() }.build().unwrap();
    let mut data = record(tied, times(0.05, 2000), pioneer_reference, 0.01);
    let exact = iv().solve(&Problem::new(&*model, &data)).unwrap();
    close(&exact.theta, &tied, 1e-6, "without noise");
    disturb(&mut data, [0.02, 0.05], 3);
    let solution = iv().solve(&Problem::new(&*model, &data)).unwrap();
    assert!((solution.theta[3] - solution.theta[5]).abs() < 1e-12 && solution.status == Status::Solved);
    assert!((solution.theta[2] - track * track / 4.0 * solution.theta[4]).abs() < 1e-12, "{:?}", solution.theta);
    let (std, covariance) = (solution.std.unwrap(), solution.covariance.unwrap());
    (0..6).for_each(|i| assert!((covariance[7 * i].sqrt() / std[i] - 1.0).abs() < 1e-12));
    assert!((covariance[3 * 6 + 5] / covariance[3 * 6 + 3] - 1.0).abs() < 1e-12, "tied parameters err alike");
    (0..6).for_each(|i| assert!((solution.theta[i] - tied[i]).abs() < 4.0 * std[i], "theta{}", i + 1));
}

#[test]
fn bounds_are_kept_and_named() {
    let model = vw_pd();
    let mut data = record(PIONEER, times(0.1, 1000), pioneer_reference, 0.01);
    disturb(&mut data, [0.005, 0.005], 9);
    let mut problem = Problem::new(&*model, &data);
    problem.bounds[3] = (1.01, 1.2);
    let solution = iv().solve(&problem).unwrap();
    assert_eq!((solution.at_bound.as_slice(), solution.status), ([3].as_slice(), Status::SolvedAtBound));
    assert!((solution.theta[3] - 1.01).abs() < 1e-12, "{:?}", solution.theta);
    assert!((solution.theta[1] - PIONEER[1]).abs() < 0.01, "{:?}", solution.theta);
    assert!(solution.std.unwrap()[3].is_nan());
}

/// Friction that jumps at rest: the free run has a kink wherever a wheel reverses, about which the plain iteration would go
/// round in circles at this noise.
#[test]
fn friction_is_served() {
    let model = WheelVoltageConfig { static_friction: true, symmetric: false }.build().unwrap();
    let theta = [2.5, 0.4, 0.3, 2.6, 0.45, 0.25];
    let time = times(0.02, 2000);
    let inputs: Vec<[f64; 2]> = time.iter().map(|t| [4.0 * (1.3 * t).sin() + 1.0, 4.0 * (0.9 * t).sin() - 1.0]).collect();
    let mut data = common::dataset(&*model, time, &inputs, &vec![[0.0; 2]; 2000]);
    let stretch = &mut data.stretches[0];
    let mut simulator = Simulator::new(&*model, &theta).unwrap().with_max_step(1e-3);
    stretch.outputs = simulator.run_measured(stretch).unwrap();
    for (deviation, seed) in [(0.01, 3), (0.1, 4)] {
        let mut data = data.clone();
        disturb(&mut data, [deviation; 2], seed);
        let solution = iv().solve(&Problem::new(&*model, &data)).unwrap();
        assert_eq!(solution.status, Status::Solved, "{deviation}: {:?}", solution.warnings);
        let std = solution.std.unwrap();
        for i in 0..6 {
            assert!((solution.theta[i] - theta[i]).abs() < 3.5 * std[i] && std[i] < 0.2 * deviation, "{deviation}, parameter {i}");
        }
    }
}

#[test]
fn what_the_recording_cannot_show_is_refused() {
    let model = vw_pd();
    let mut straight = record(PIONEER, times(0.1, 600), |t| [pioneer_reference(t)[0], 0.0], 0.01);
    straight.stretches[0].outputs[1].fill(0.0);
    match iv().solve(&Problem::new(&*model, &straight)) {
        Err(SolveError::NotIdentifiable { parameters, .. }) => assert!(parameters.contains(&"theta2".to_owned()), "{parameters:?}"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn an_iteration_that_is_cut_short_says_so_and_states_no_intervals() {
    let model = vw_pd();
    let mut data = record(PIONEER, times(0.3, 501), pioneer_reference, 0.02);
    disturb(&mut data, [0.02, 0.02], 4);
    let solution = InstrumentalVariables { max_iterations: 1, ..iv() }.solve(&Problem::new(&*model, &data)).unwrap();
    assert_eq!(solution.status, Status::IterationLimit);
    assert!(solution.std.is_none() && solution.ci95.is_none());
    assert!(solution.warnings.iter().any(|w| w.contains("did not settle")), "{:?}", solution.warnings);
}

/// The fixed point is Zᵀ e = 0 whatever the weights: with and without a noise model the estimates agree within errors.
#[test]
fn the_noise_model_changes_the_weights_not_the_answer() {
    let model = vw_pd();
    let mut data = record(PIONEER, times(0.1, 1500), pioneer_reference, 0.01);
    let mut random = noise(21);
    for column in &mut data.stretches[0].outputs {
        let mut coloured = 0.0;
        for x in column.iter_mut() {
            coloured = 0.8 * coloured + 0.003 * random();
            *x += coloured;
        }
    }
    let problem = Problem::new(&*model, &data);
    let [white, coloured] = [NoiseModel::White, NoiseModel::Autoregressive].map(|noise| {
        let solution = InstrumentalVariables { noise, ..iv() }.solve(&problem).unwrap();
        (solution.theta, solution.std.unwrap())
    });
    for i in 0..6 {
        assert!((white.0[i] - coloured.0[i]).abs() < 3.0 * white.1[i], "theta{}", i + 1);
        assert!(coloured.1[i] < 1.05 * white.1[i], "theta{}: {} and {}", i + 1, coloured.1[i], white.1[i]);
    }
}
