//! Robots whose noise is known, with and without physics that the base model lacks.

use super::*;
use crate::dataset::Stretch;
use crate::identifiability::tests::{THETA, TwoAxes};
use crate::identification::identify;
use crate::noise::tests::Normal;
use crate::solver::{Problem, Solution, Solver, Status};

/// What the robot has beyond its model.
#[derive(Debug, Clone, Copy)]
struct Extra {
    coulomb: f64,
    delay_s: f64,
}

const NOTHING: Extra = Extra { coulomb: 0.0, delay_s: 0.0 };

/// Steps and sines with reversals.
fn command(t: f64) -> [f64; 2] {
    let step = |period: f64, phase: f64| [0.5, -0.4, 0.2, 0.6, -0.5, -0.1, 0.3][((t / period + phase) as usize * 5) % 7];
    [step(2.3, 0.0) + 0.15 * (1.3 * t).sin(), 1.6 * step(1.9, 3.0) + 0.4 * (1.9 * t).sin()]
}

/// A drive of `seconds` at 20 Hz, stepped at half a millisecond by Euler's rule, and the noise in it.
fn drive(extra: Extra, seconds: usize, noise: f64, rho: f64, seed: u64) -> (Dataset, Vec<Vec<f64>>) {
    let (fine, each) = (5e-4, 100);
    let mut x = [0.0_f64; 2];
    let rows = seconds * 20;
    let mut outputs = vec![Vec::new(); 2];
    for k in 0..rows * each {
        let t = k as f64 * fine;
        if k % each == 0 {
            outputs.iter_mut().zip(x).for_each(|(o, x)| o.push(x));
        }
        let given = ((t - extra.delay_s).max(0.0) / 0.05 + 1e-9).floor() * 0.05;
        let u = command(given);
        let friction = |x: f64| extra.coulomb * (x / 0.005).tanh();
        let dv = (u[0] + THETA[2] * x[1] * x[1] - THETA[3] * x[0] - friction(x[0])) / THETA[0];
        let dw = (u[1] - THETA[4] * x[0] * x[1] - THETA[5] * x[1] - 2.0 * friction(x[1])) / THETA[1];
        x[0] += fine * dv;
        x[1] += fine * dw;
    }
    let mut normal = Normal::new(seed);
    let e: Vec<Vec<f64>> = [noise, 2.0 * noise].iter().map(|s| normal.coloured(rows, *s, rho)).collect();
    outputs.iter_mut().zip(&e).for_each(|(o, e)| o.iter_mut().zip(e).for_each(|(o, e)| *o += e));
    let time: Vec<f64> = (0..rows).map(|k| k as f64 * 0.05).collect();
    let inputs = (0..2).map(|i| time.iter().map(|t| command(*t)[i]).collect()).collect();
    let model = TwoAxes::new();
    let stretches = vec![Stretch { label: String::new(), time, inputs, outputs }];
    (Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches }, e)
}

/// The quick free-run fit of this crate as a solver.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
struct Quick;

#[typetag::serde(name = "quick-for-tests")]
impl Solver for Quick {
    fn name(&self) -> &str {
        "quick"
    }

    fn about(&self) -> String {
        String::new()
    }

    fn solve(&self, problem: &Problem<'_>) -> Result<Solution, SolveError> {
        let (_, point, _) = crate::local::quick_fit(problem.model, &problem.map, problem.data, Vec::new())?;
        let theta = problem.map.theta(&point.z);
        let (steps, warnings) = (Vec::new(), Vec::new());
        let status = Status::Solved;
        Ok(Solution {
            theta,
            std: None,
            ci95: None,
            covariance: None,
            status,
            condition: 1.0,
            at_bound: Vec::new(),
            steps,
            warnings,
            regression: None,
        })
    }
}

/// Truth, estimate and the base model's own fit on the held-out end, by output.
fn compare(extra: Extra, noise: f64, rho: f64, seed: u64) -> Vec<(f64, OutputCeiling, f64)> {
    let (data, e) = drive(extra, 100, noise, rho, seed);
    let (train, held_out) = data.hold_out(0.3);
    let model = TwoAxes::new();
    let base = identify(&Problem::new(&model, &train), &Quick, &held_out).unwrap();
    let found = estimate(&model, &base.solution.theta, &train, &held_out).unwrap();
    let first = train.samples();
    let fits = base.held_out.unwrap().fit;
    let truth = |i: usize| {
        let y = &held_out.stretches[0].outputs[i];
        fit_percent(&y.iter().zip(&e[i][first..]).map(|(y, e)| (*y, y - e)).collect::<Vec<_>>()).unwrap()
    };
    found.into_iter().enumerate().map(|(i, c)| (truth(i), c, fits[i].unwrap())).collect()
}

#[test]
fn the_ceiling_is_within_a_point_of_the_truth_under_white_and_coloured_noise() {
    for rho in [0.0, 0.9] {
        for seed in 0..5 {
            for (truth, found, base) in compare(NOTHING, 0.01, rho, seed) {
                let fit = found.fit.unwrap();
                assert!((fit - truth).abs() < 1.0, "rho {rho}, seed {seed}: {truth} {found:?}");
                assert!(fit >= base - 1e-9 && truth - base < 0.7, "{truth} {base} {found:?}");
                let (low, high) = found.range.unwrap();
                assert!(low <= fit && fit <= high, "{found:?}");
            }
        }
    }
}

#[test]
fn the_ceiling_stays_where_the_base_model_falls_short() {
    for extra in [Extra { coulomb: 0.08, delay_s: 0.0 }, Extra { coulomb: 0.0, delay_s: 0.2 }] {
        for (rho, seed) in [(0.0, 11), (0.0, 12), (0.7, 13), (0.7, 14), (0.9, 15)] {
            for (truth, found, base) in compare(extra, 0.01, rho, seed) {
                assert!((found.fit.unwrap() - truth).abs() < 1.0, "{extra:?}, rho {rho}: {truth}, base {base}, {found:?}");
                assert!(base < truth - 2.0, "{extra:?}: {truth} {base}");
                assert!(found.narx.is_some(), "{found:?}");
            }
        }
    }
}

#[test]
fn the_innovations_of_coloured_noise_alone_would_promise_too_much() {
    let (truth, found, _) = compare(NOTHING, 0.02, 0.9, 3).remove(0);
    // The innovations of such noise are √(1 − 0.81) = 0.44 of it.
    assert!(found.innovations.unwrap() > truth + 2.0, "{truth} {found:?}");
}

#[test]
fn a_base_model_that_diverges_is_done_without() {
    let (data, e) = drive(NOTHING, 100, 0.01, 0.0, 5);
    let (train, held_out) = data.hold_out(0.3);
    let mut theta = THETA;
    theta[3] = -50.0;
    let found = estimate(&TwoAxes::new(), &theta, &train, &held_out).unwrap();
    let first = train.samples();
    let y = &held_out.stretches[0].outputs[0];
    let truth = fit_percent(&y.iter().zip(&e[0][first..]).map(|(y, e)| (*y, y - e)).collect::<Vec<_>>()).unwrap();
    assert!((found[0].fit.unwrap() - truth).abs() < 1.0, "{truth} {found:?}");
}

#[test]
fn short_stretches_and_still_outputs_are_said_and_not_guessed() {
    let (data, _) = drive(NOTHING, 4, 0.01, 0.0, 6);
    let model = TwoAxes::new();
    let short = estimate(&model, &THETA, &data, &data);
    assert!(matches!(short, Err(SolveError::TooFewSamples { samples: 80, .. })), "{short:?}");
    let (mut data, _) = drive(NOTHING, 30, 0.01, 0.0, 7);
    data.stretches[0].outputs[1].fill(0.0);
    let found = estimate(&model, &THETA, &data, &data).unwrap();
    assert_eq!((found[1].fit, found[1].narx), (None, None), "{:?}", found[1]);
    assert!(found[1].statement.contains("never changes"));
}

#[test]
fn many_short_stretches_give_the_same_ceiling() {
    let (data, e) = drive(NOTHING, 120, 0.01, 0.8, 8);
    let whole = &data.stretches[0];
    let cut = (0..24).map(|k| Stretch { label: k.to_string(), ..whole.slice(k * 100..(k + 1) * 100) }).collect();
    let (train, held_out) = Dataset { stretches: cut, ..data.clone() }.hold_out(0.3);
    let found = estimate(&TwoAxes::new(), &THETA, &train, &held_out).unwrap();
    for i in 0..2 {
        let rows = held_out.stretches.iter().flat_map(|s| {
            let first = s.label.parse::<usize>().unwrap() * 100;
            s.outputs[i].iter().zip(&e[i][first..first + 100]).map(|(y, e)| (*y, y - e))
        });
        let truth = fit_percent(&rows.collect::<Vec<_>>()).unwrap();
        assert!((found[i].fit.unwrap() - truth).abs() < 1.0, "{truth} {:?}", found[i]);
    }
}

#[test]
fn a_flexible_model_that_does_not_carry_over_leaves_the_word_to_the_training_data() {
    let level = Level { samples: [700, 300], fitted: 700.0, left: 330.0, added: 30.0, bound: 400.0, relative: 0.05 };
    assert_eq!(level.variance(), 1.0);
    // Its errors explain all it leaves, and more: that is no noise of zero.
    assert_eq!(Level { left: 3000.0, added: 9000.0, ..level }.variance(), 1.0);
    assert_eq!(Level { left: 3000.0, added: 9000.0, bound: 150.0, ..level }.variance(), 0.5);
    // Held-out data that are twice as quiet are so by themselves; five per cent are chance.
    assert_eq!(Level { left: 180.0, ..level }.variance(), 0.5);
    assert_eq!(Level { left: 315.0, ..level }.variance(), 0.985);
}
