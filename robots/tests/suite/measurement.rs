//! What the simulated robot measures, what it refuses and how it stops.

use crate::common::*;
use std::f64::consts::TAU;
use wheelwright_core::robot::{Robot, RobotError};

const V: usize = 0;
const OMEGA: usize = 1;
const LEFT: usize = 5;
const RIGHT: usize = 6;

fn pioneer(extra: &str) -> Box<dyn Robot> {
    seeded(extra, 1)
}

fn seeded(extra: &str, seed: u64) -> Box<dyn Robot> {
    let config = config(&format!("robot = 'pioneer-3dx'\n{extra}"));
    Box::new(config.build(seed).unwrap())
}

fn bits(run: &Run) -> Vec<u64> {
    run.time.iter().chain(run.measured.iter().flatten()).map(|x| x.to_bits()).collect()
}

const NOISY: &str = "fidelity = 'typical'\njitter = 0.2\nsensors = { v_noise = 0.01, omega_noise = 0.02, noise_correlation = 0.5 }";

#[test]
fn a_seed_fixes_every_bit() {
    let of = |seed| bits(&run(&mut *seeded(NOISY, seed), 300, pioneer_excitation));
    assert_eq!(of(7), of(7));
    assert_ne!(of(7), of(8));
}

#[test]
fn one_source_of_noise_does_not_change_another() {
    let of = |sensors: &str| run(&mut *pioneer(&format!("sensors = {{ {sensors} }}")), 50, |_| [0.0; 2]);
    let (alone, both) = (of("v_noise = 0.01"), of("v_noise = 0.01, omega_noise = 0.02, wheel_noise = 0.0"));
    assert_eq!(alone.column(V), both.column(V));
    assert!(alone.column(OMEGA).iter().all(|w| *w == 0.0) && both.column(OMEGA).iter().any(|w| *w != 0.0));
}

/// Mean, standard deviation and correlation from one sample to the next.
fn statistics(x: &[f64]) -> (f64, f64, f64) {
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    let variance = x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
    let lag = x.windows(2).map(|w| (w[0] - mean) * (w[1] - mean)).sum::<f64>() / n;
    (mean, variance.sqrt(), lag / variance)
}

#[test]
fn noise_has_the_configured_deviation_and_correlation() {
    let steps = 20_000;
    for rho in [0.0, 0.6] {
        let sensors = format!("sensors = {{ v_noise = 0.01, omega_noise = 0.02, noise_correlation = {rho} }}");
        let run = run(&mut *pioneer(&sensors), steps, |_| [0.0; 2]);
        let n = steps as f64;
        for (channel, sigma) in [(V, 0.01), (OMEGA, 0.02)] {
            let (mean, deviation, lag) = statistics(&run.column(channel));
            // Four standard errors of each estimate under the configured process.
            assert!(mean.abs() < 4.0 * sigma * ((1.0 + rho) / (1.0 - rho) / n).sqrt(), "{mean}");
            let spread = ((1.0 + rho * rho) / (1.0 - rho * rho) / (2.0 * n)).sqrt();
            assert!((deviation / sigma - 1.0).abs() < 4.0 * spread, "{deviation}");
            assert!((lag - rho).abs() < 4.0 * ((1.0 - rho * rho) / n).sqrt(), "{lag}");
        }
    }
}

#[test]
fn wheel_noise_reaches_the_body_through_the_wheels() {
    let run = run(&mut *pioneer("sensors = { wheel_noise = 0.1 }"), 20_000, |_| [0.0; 2]);
    let (_, left, _) = statistics(&run.column(LEFT));
    let (_, right, _) = statistics(&run.column(RIGHT));
    let (_, v, _) = statistics(&run.column(V));
    let (_, omega, _) = statistics(&run.column(OMEGA));
    for (found, expected) in [(left, 0.1), (right, 0.1), (v, 0.1 * 0.0975 / 2.0_f64.sqrt()), (omega, 0.1 * 0.0975 * 2.0_f64.sqrt() / 0.34)]
    {
        assert!((found / expected - 1.0).abs() < 0.02, "{found} {expected}");
    }
    let together = run.column(LEFT).iter().zip(run.column(RIGHT)).map(|(l, r)| l * r).sum::<f64>() / run.time.len() as f64;
    assert!(together.abs() < 4.0 * 0.01 / (run.time.len() as f64).sqrt(), "the sides are independent: {together}");
}

#[test]
fn encoder_differences_are_whole_counts_and_mean_speeds() {
    let ticks = 2000.0;
    let sensors = format!("sensors = {{ velocity = 'encoder-difference', ticks_per_revolution = {ticks:.1} }}");
    let coarse = run(&mut *pioneer(&sensors), 100, pioneer_excitation);
    assert_eq!(coarse.measured[0], [0.0; 7]);
    let mut broken = 0;
    for (k, step) in coarse.time.windows(2).enumerate() {
        for side in [LEFT, RIGHT] {
            let counts = coarse.measured[k + 1][side] * (step[1] - step[0]) * ticks / TAU;
            broken += usize::from((counts - counts.round()).abs() > 1e-6);
        }
    }
    assert_eq!(broken, 0);
    // Without ticks the speed is the exact mean: the turned angle over the time.
    let fine = run(&mut *pioneer("sensors = { velocity = 'encoder-difference' }"), 100, pioneer_excitation);
    let turn: f64 = fine.column(OMEGA)[1..].iter().sum::<f64>() * 0.1;
    let heading = fine.measured[100][4];
    assert!((turn - heading).abs() < 1e-12, "{turn} {heading}");
    // Counts blur each speed by at most one count a period.
    for (a, b) in coarse.measured.iter().zip(&fine.measured) {
        assert!((a[LEFT] - b[LEFT]).abs() <= TAU / ticks / 0.1 + 1e-12);
    }
}

#[test]
fn velocities_are_reported_in_multiples_of_their_resolution() {
    let run = run(&mut *pioneer("sensors = { v_resolution = 0.001, omega_resolution = 0.0175 }"), 100, pioneer_excitation);
    for row in &run.measured {
        for (value, unit) in [(row[V], 0.001), (row[OMEGA], 0.0175)] {
            assert!((value / unit - (value / unit).round()).abs() < 1e-9);
        }
    }
    assert!(run.measured.iter().any(|row| row[V] != 0.0 && row[OMEGA] != 0.0));
}

#[test]
fn odometry_on_an_arc_is_off_by_the_chord_alone() {
    let circle = |pose: &str| run(&mut *pioneer(&format!("sensors = {{ pose = '{pose}' }}")), 200, |_| [0.5, 1.5]);
    let (exact, odometry) = (circle("exact"), circle("odometry"));
    let chord = |run: &Run, k: usize| {
        let (a, b) = (run.measured[k], run.measured[k + 1]);
        ((b[2] - a[2]).hypot(b[3] - a[3]), b[4] - a[4])
    };
    for k in 100..200 {
        let (true_chord, turn) = chord(&exact, k);
        let (path, odometry_turn) = chord(&odometry, k);
        assert!((turn - odometry_turn).abs() < 1e-12);
        // Steady motion: the robot moves on a circle, of which odometry takes the arc for the chord.
        let sinc = (0.5 * turn).sin() / (0.5 * turn);
        assert!((path * sinc - true_chord).abs() < 1e-9, "{path} {true_chord}");
        assert!((path - true_chord - path * turn * turn / 24.0).abs() < 1e-3 * (path - true_chord).abs());
    }
}

#[test]
fn commands_are_clamped_inside_the_robot() {
    let steady = |extra: &str, command: [f64; 2]| *run(&mut *pioneer(extra), 100, |_| command).measured.last().unwrap();
    let limited = steady("limits = { v = 0.4, omega = 0.6 }", [9.0, -7.0]);
    let asked = steady("", [0.4, -0.6]);
    assert_eq!(limited.map(f64::to_bits), asked.map(f64::to_bits));
}

#[test]
fn wheels_saturate_one_by_one() {
    let steady = |extra: &str, command: [f64; 2]| *run(&mut *pioneer(extra), 100, |_| command).measured.last().unwrap();
    // 1 m/s with 2 rad/s asks the wheels for 6.77 and 13.74 rad/s.
    let limited = steady("limits = { wheel_speed = 10.0 }", [1.0, 2.0]);
    let (left, right) = ((1.0 - 0.17 * 2.0) / 0.0975, 10.0);
    let asked = steady("", [0.5 * 0.0975 * (left + right), 0.0975 * (right - left) / 0.34]);
    for (a, b) in limited.iter().zip(&asked) {
        assert!((a - b).abs() < 1e-9, "{limited:?} {asked:?}");
    }
    let free = steady("limits = { wheel_speed = 14.0 }", [1.0, 2.0]);
    assert_eq!(free.map(f64::to_bits), steady("", [1.0, 2.0]).map(f64::to_bits));
}

#[test]
fn the_firmwares_ramp_bounds_the_acceleration() {
    let run = run(&mut *pioneer("limits = { v_dot = 0.3, omega_dot = 1.0 }"), 100, |t| if t < 5.0 { [0.9, 2.0] } else { [0.3, -1.0] });
    let (v, omega) = (run.column(V), run.column(OMEGA));
    // Behind the loop's lag the ramp shows at its rate over theta4 = 1.005 and theta6 = 1.0142.
    assert!(((v[25] - v[20]) / 0.5 - 0.3 / 1.005).abs() < 1e-3, "{}", (v[25] - v[20]) / 0.5);
    assert!(((omega[65] - omega[60]) / 0.5 + 1.0 / 1.0142).abs() < 2e-3, "{}", (omega[65] - omega[60]) / 0.5);
    assert!((v[48] - 0.9 / 1.005).abs() < 1e-2 && (v[100] - 0.3 / 1.005).abs() < 1e-2);
    assert!(v.windows(2).all(|w| (w[1] - w[0]).abs() <= 0.03), "never faster than the ramp");
}

#[test]
fn reading_twice_is_one_measurement() {
    let mut robot = seeded(NOISY, 3);
    let (mut first, mut second) = ([0.0; 7], [0.0; 7]);
    let t = robot.step(&[0.3, 0.2], &mut first).unwrap();
    assert_eq!(robot.measure(&mut second).unwrap(), t);
    assert_eq!(first, second);
}

#[test]
fn a_stopped_robot_takes_no_command() {
    let mut robot = pioneer("");
    let mut row = [0.0; 7];
    robot.step(&[0.3, 0.2], &mut row).unwrap();
    robot.stop().unwrap();
    robot.stop().unwrap();
    let error = robot.step(&[0.3, 0.2], &mut row).unwrap_err();
    assert!(matches!(&error, RobotError::Fault(why) if why.contains("was stopped")), "{error}");
    assert!(robot.measure(&mut row).is_ok(), "it can still be read");
}

#[test]
fn a_command_that_is_no_number_switches_the_motors_off() {
    for bad in [f64::NAN, f64::INFINITY] {
        let mut robot = pioneer("");
        let mut row = [0.0; 7];
        let error = robot.step(&[0.3, bad], &mut row).unwrap_err();
        assert!(matches!(&error, RobotError::Fault(why) if why.contains("omega_ref")), "{error}");
        assert!(robot.step(&[0.3, 0.2], &mut row).is_err());
    }
}

#[test]
fn a_motion_beyond_all_numbers_is_a_fault() {
    let mut robot = pioneer("");
    let mut row = [0.0; 7];
    let error = robot.step(&[1e300, 1e300], &mut row).unwrap_err();
    assert!(matches!(&error, RobotError::Fault(why) if why.contains("range of numbers")), "{error}");
}

#[test]
fn wrong_slices_are_the_drivers_fault() {
    let mut robot = pioneer("");
    assert!(matches!(robot.measure(&mut [0.0; 2]), Err(RobotError::Driver(_))));
    assert!(matches!(robot.step(&[0.0], &mut [0.0; 7]), Err(RobotError::Driver(_))));
}

#[test]
fn a_typical_robot_moves_as_the_ideal_one_but_for_its_ramp_and_noise() {
    type Case = (&'static str, &'static str, fn(f64) -> [f64; 2], usize, f64);
    let cases: [Case; 2] = [
        // The firmware's ramp spreads every held step over its period, which shows; it is lifted here.
        ("pioneer-3dx", "limits = { v_dot = 100.0, omega_dot = 100.0 }", pioneer_excitation, 1000, 0.051 * 0.0975),
        // The thesis' excitation at 60 %: in full it asks the wheels for more than the regulated maximum.
        ("khepera-3", "", |t| khepera_excitation(t).map(|u| 0.6 * u), 3000, 0.146 * 0.0205),
    ];
    for (name, limits, excitation, steps, wheel_noise) in cases {
        let of = |fidelity: &str, limits: &str| {
            let config = config(&format!("robot = '{name}'\nfidelity = '{fidelity}'\n{limits}"));
            run(&mut config.build(2).unwrap(), steps, excitation)
        };
        let (ideal, typical) = (of("ideal", ""), of("typical", limits));
        let difference: Vec<f64> = ideal.column(V).iter().zip(typical.column(V)).skip(steps / 10).map(|(a, b)| b - a).collect();
        let (mean, deviation, _) = statistics(&difference);
        let noise = wheel_noise / 2.0_f64.sqrt();
        let error = 4.0 / (difference.len() as f64).sqrt();
        assert!(mean.abs() < error * noise, "{name}: {mean}");
        assert!((deviation / noise - 1.0).abs() < error, "{name}: {deviation} for a noise of {noise}");
    }
}
