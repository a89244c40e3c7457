#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use super::*;
use crate::effects::{ActuatorLag, CommandDelay};
use crate::fixture::{Case, THETA};
use wheelwright_core::ModelConfig;
use wheelwright_core::effect::Effect;
use wheelwright_models::VwPdConfig;

fn fitted<'a>(effect: &'a dyn Effect, value: f64, information: f64) -> Fitted<'a> {
    let n = THETA.len() + 1;
    Fitted {
        effects: vec![effect],
        free: THETA.to_vec(),
        theta: THETA.to_vec(),
        values: vec![vec![value]],
        initial: Vec::new(),
        simulated: Vec::new(),
        likelihood: 0.0,
        rank: n,
        information: DMatrix::identity(n, n) * information,
        covariance: DMatrix::identity(n, n) / information,
    }
}

fn with_rivals<T>(fits: Vec<&Fitted<'_>>, limits: Limits, seed: u64, f: impl FnOnce(&Rivals<'_>) -> T) -> T {
    let model = VwPdConfig::default().build().unwrap();
    let case = Case::clean(1);
    let noise = Noise::white(&case.noise, &crate::fit::layout::Layout::of(&case.data, &case.scene));
    let rivals = Rivals {
        model: &*model,
        map: &model.map(),
        names: vec!["command_delay".to_owned(), "actuator_lag".to_owned()],
        fits,
        scene: &case.scene,
        noise: &noise,
        tolerance: 1e-4,
        limits,
        seed,
    };
    f(&rivals)
}

fn with_design<T>(limits: Limits, seed: u64, f: impl FnOnce(&Scene, Experiment) -> T) -> T {
    let (delay, lag) = (CommandDelay::default(), ActuatorLag::default());
    let (a, b) = (fitted(&delay, 0.12, 1e4), fitted(&lag, 0.12, 1e4));
    with_rivals(vec![&a, &b], limits, seed, |rivals| f(rivals.scene, design(rivals).unwrap().unwrap()))
}

#[test]
fn a_delay_and_a_lag_are_told_apart_in_seconds_and_the_same_way_each_time() {
    let first = with_design(Limits::default(), 3, |_, e| e);
    assert!(first.separates[0].2 >= DECISIVE, "{:?}", first.separates);
    assert!(*first.time.last().unwrap() < 17.0 && first.statement.contains("enough to decide"), "{}", first.statement);
    assert_eq!(first, with_design(Limits::default(), 3, |_, e| e));
}

#[test]
fn limits_are_kept_and_it_ends_at_rest() {
    let limits = Limits { v: Some(0.3), omega: Some(0.8), v_dot: Some(0.5), omega_dot: Some(2.0), wheel_speed: Some(4.0) };
    with_design(limits, 1, |scene, experiment| {
        let (v, w) = (&experiment.commands[0].1, &experiment.commands[1].1);
        let period = scene.scales.period;
        for k in 0..v.len() {
            assert!(v[k].abs() <= 0.3 + 1e-12 && w[k].abs() <= 0.8 + 1e-12);
            let before = if k == 0 { (0.0, 0.0) } else { (v[k - 1], w[k - 1]) };
            assert!((v[k] - before.0).abs() <= 0.5 * period + 1e-12 && (w[k] - before.1).abs() <= 2.0 * period + 1e-12);
        }
        assert!(v.last().unwrap().abs() < 1e-12 && w.last().unwrap().abs() < 1e-12, "must end at rest");
    });
}

#[test]
fn what_the_first_recording_settles_needs_no_experiment_of_the_same() {
    // D against a rival that may move freely is smaller than against one that is known.
    let told = |rows: std::ops::Range<usize>| {
        let rival = |response: [f64; 4]| Prediction {
            response: DVector::from_column_slice(&response[rows.clone()]),
            jacobian: DMatrix::from_element(rows.len(), 1, 1.0),
        };
        Knowledge::of(&[rival([1.0, 1.0, 1.0, 0.0]), rival([0.0; 4])])
    };
    let separation = |knowledge: &Knowledge, information: f64| {
        let (delay, lag) = (CommandDelay::default(), ActuatorLag::default());
        let known = |effect| Fitted { information: DMatrix::from_element(1, 1, information), ..fitted(effect, 0.1, 1.0) };
        let (a, b) = (known(&delay), known(&lag));
        with_rivals(vec![&a, &b], Limits::default(), 0, |rivals| knowledge.separations(rivals)[1])
    };
    let whole = told(0..4);
    // Least squares by hand: the mean 3/4 is taken off, 3 − 9/4 is left.
    let (free, known) = (separation(&whole, 0.0), separation(&whole, 1e9));
    assert!((free - 0.75).abs() < 1e-8 && (known - 3.0).abs() < 1e-6, "{free} {known}");
    // Two drives tell what one of both tells.
    let added = separation(&told(0..2).with(&told(2..4)), 0.0);
    assert!((added - free).abs() < 1e-12, "{added}");
}
