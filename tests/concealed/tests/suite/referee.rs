//! The referee's numbers: refit, visibility, places, and what counts as the same.

use wheelwright_concealed::draw::stream;
use wheelwright_concealed::firmware::Command;
use wheelwright_concealed::hidden::equivalents::{Circumstances, acceptable};
use wheelwright_concealed::hidden::forms::FORMS;
use wheelwright_concealed::hidden::{EFFECTS, combine, effect};
use wheelwright_concealed::make::case::make;
use wheelwright_concealed::make::plan::{recipes, set};
use wheelwright_concealed::referee::detect::{Scene, jitter_ratio, left_over, left_without, percent, regions, times};
use wheelwright_concealed::referee::lumped::{Lumped, Speeds, Weights, fit, run};
use wheelwright_concealed::sensors::noise::Character;

const PLAIN: Lumped = [0.25, 0.2, 0.01, 1.05, 0.3, 1.02, 1.0, 1.0];

fn drive() -> Vec<Command> {
    (0..1200)
        .map(|k| {
            let t = 0.05 * f64::from(k);
            let step = if ((t / 3.0) as usize).is_multiple_of(2) { 1.0 } else { -0.4 };
            Command { t, v: 0.4 * step + 0.1 * (2.0 * t).sin(), omega: 0.7 * (0.9 * t).sin() - 0.3 * step }
        })
        .collect()
}

fn weights() -> Weights {
    Weights { sigma: vec![0.01, 0.02, 0.01, 0.01], memory: 0.0 }
}

#[test]
fn a_refit_finds_the_robot_again() {
    let commands = drive();
    let seen = run(&PLAIN, &commands, None);
    let (found, left) = fit([0.1, 0.4, 0.0, 1.0, 0.0, 1.0, 1.0, 1.0], &commands, &seen, None, &weights());
    assert!(left < 1e-6, "{left}");
    for (a, b) in found.iter().zip(&PLAIN) {
        assert!((a - b).abs() < 1e-6, "{found:?}");
    }
}

#[test]
fn visibility_is_the_ratio_that_noise_gives_on_average() {
    // A constant 0.003 m/s on the forward speed after half the time. Twice the log-likelihood ratio between the truth and the refit without it,
    // for data with noise, is on average the visibility less the six numbers that the refit may bend to the noise.
    let commands = drive();
    let mut seen = run(&PLAIN, &commands, None);
    seen.channels[0].iter_mut().skip(600).for_each(|v| *v += 0.003);
    let weights = weights();
    let scene = Scene { commands: &commands, seen: &seen, weights: &weights, half_track: None };
    let expected = left_over(&scene, PLAIN).ratio;
    let draws = 40;
    let mean: f64 = (0..draws)
        .map(|k| {
            let mut noisy = seen.clone();
            let rng = &mut stream(k, &[4]);
            Character::White.add(&mut noisy.channels[0], 0.01, rng);
            Character::White.add(&mut noisy.channels[1], 0.02, rng);
            let cost = |a: &Speeds, b: &Speeds| -> f64 {
                let one = |c: usize, s: f64| a.channels[c].iter().zip(&b.channels[c]).map(|(x, y)| ((x - y) / s).powi(2)).sum::<f64>();
                one(0, 0.01) + one(1, 0.02)
            };
            let (_, without) = fit(PLAIN, &commands, &noisy, None, &weights);
            without - cost(&noisy, &seen)
        })
        .sum::<f64>()
        / draws as f64;
    // The ratio scatters with a standard deviation of about twice its root.
    let scatter = 3.0 * (4.0 * expected + 12.0).sqrt() / (draws as f64).sqrt();
    assert!((mean - (expected - 6.0)).abs() < scatter, "{mean}, expected {expected} - 6 within {scatter}");
}

#[test]
fn one_of_two_counts_by_what_neither_the_robot_nor_the_other_can_take_over() {
    let commands = drive();
    let weights = weights();
    let base = run(&PLAIN, &commands, None);
    let plus = |f: &dyn Fn(f64) -> f64, size: f64| {
        let mut s = base.clone();
        s.channels[0].iter_mut().zip(&commands).for_each(|(v, c)| *v += size * f(c.t));
        s
    };
    let ripple = |t: f64| (9.0 * t).sin();
    let seen = plus(&ripple, 0.01);
    let scene = Scene { commands: &commands, seen: &seen, weights: &weights, half_track: None };
    let alone = left_without(&scene, &PLAIN, &base, &[]);
    assert!((alone / 600.0 - 1.0).abs() < 0.05, "half of 1200 rows, at one standard deviation: {alone}");
    let same = left_without(&scene, &PLAIN, &base, &[plus(&ripple, 0.001)]);
    assert!(same < 1e-6, "the other effect does the same: {same}");
    let another = left_without(&scene, &PLAIN, &base, &[plus(&|t| (5.0 * t).cos(), 0.001)]);
    assert!((another / alone - 1.0).abs() < 0.02, "the other effect does something else: {another}");
}

#[test]
fn jitter_shows_where_the_signal_has_slopes_of_two_kinds() {
    let ramp: Vec<f64> = (0..500).map(f64::from).collect();
    assert!(jitter_ratio(&ramp, 0.05, 0.1, 0.01).abs() < 1e-9, "an even slope makes an even scatter");
    let bend: Vec<f64> = (0..500).map(|k| if k < 250 { 0.0 } else { f64::from(k - 250) * 0.05 }).collect();
    // Half the rows at sigma, half at sigma with jitter of one sigma on top: N ln(1.5) - N/2 ln(2).
    let wanted = 499.0 * 1.5f64.ln() - 249.5 * 2f64.ln();
    assert!((jitter_ratio(&bend, 0.05, 0.1, 0.1) / wanted - 1.0).abs() < 0.01);
}

#[test]
fn times_and_regions_are_where_the_difference_is() {
    let commands = drive();
    let mut difference = vec![vec![0.0; 1200]; 2];
    difference[0].iter_mut().skip(400).take(60).for_each(|d| *d = 0.05);
    assert_eq!(times(&commands, &difference, &[0.01, 0.02]), Some(vec![[20.0, 23.0]]));
    assert_eq!(times(&commands, &vec![vec![1.0; 1200]; 2], &[0.01, 0.02]), None, "always is not at times");
    let values: Vec<f64> = (0..1200).map(|k| f64::from(k) / 1199.0).collect();
    let found = regions("v", &values, &difference, &[0.01, 0.02]);
    assert_eq!(found.len(), 1);
    assert!(found[0].from <= 0.334 && found[0].to >= 0.383 && found[0].to - found[0].from < 0.13, "{found:?}");
    assert!((percent(&[1.0, 2.0, 3.0], &[1.0, 2.0, 3.0]) - 100.0).abs() < 1e-12);
    assert!(percent(&[1.0, 2.0, 3.0], &[2.0, 2.0, 2.0]).abs() < 1e-12);
}

fn circumstances() -> Circumstances {
    Circumstances { reverses: true, crawls: 1.0, bandwidth: f64::INFINITY, time: 0.2, late: 0.1, wheels: false, coarseness: 5.0 }
}

#[test]
fn what_is_the_same_depends_on_the_drive() {
    let same = |name: &str, form: Option<&str>, c: Circumstances| -> Vec<String> {
        acceptable(&[(name, form)], &c).into_iter().map(|set| set.join("+")).collect()
    };
    let rich = circumstances();
    assert_eq!(same("coulomb_friction", None, rich), ["rolling_resistance"]);
    let onward = Circumstances { reverses: false, ..rich };
    assert_eq!(same("coulomb_friction", None, onward), ["rolling_resistance", "direction_asymmetry", "stribeck_friction"]);
    assert!(same("stribeck_friction", None, onward).is_empty(), "while it crawls, breakaway shows");
    assert_eq!(same("stribeck_friction", None, Circumstances { crawls: 0.0, ..onward }).len(), 3);
    assert_eq!(same("command_delay", None, rich), ["sensor_delay"]);
    assert!(same("command_delay", None, Circumstances { wheels: true, ..rich }).is_empty(), "wheels are not late");
    let slow = Circumstances { bandwidth: 2.5, ..rich };
    assert_eq!(same("actuator_lag", None, slow), ["command_delay", "sensor_delay"]);
    assert!(same("actuator_lag", None, rich).is_empty());
    assert_eq!(same("dead_zone", Some("dead band, taken off larger set-points"), rich), ["coulomb_friction"]);
    assert!(same("dead_zone", None, rich).is_empty());
    assert!(same("sensor_delay", Some("one axis only"), rich).is_empty());
    assert_eq!(same("gain_asymmetry", None, rich), ["wheel_radius_mismatch"]);
    let pair = acceptable(&[("coulomb_friction", None), ("command_delay", None)], &rich);
    assert_eq!(pair.len(), 3, "each, the other, and both: {pair:?}");
}

#[test]
fn every_form_belongs_to_an_effect_and_parts_are_not_shared() {
    assert!(FORMS.iter().all(|f| effect(f.effect).is_some()));
    let (friction, load, rolling) = (&EFFECTS[0], effect("payload_change").unwrap(), effect("rolling_resistance").unwrap());
    assert!(combine(friction, load) && !combine(friction, rolling) && !combine(load, effect("battery_sag").unwrap()));
}

#[test]
fn pairs_tell_how_visible_each_is() {
    for (name, recipe) in recipes(set("pairs").unwrap(), 21, 4) {
        let entry = make(&name, &recipe).entry;
        let each = entry.detectability_each.unwrap();
        assert_eq!(each.len(), 2);
        assert!(each.iter().all(|ratio| *ratio >= 0.0 && ratio.is_finite()), "{each:?}");
        assert_eq!(entry.truth.len(), 2);
    }
}
