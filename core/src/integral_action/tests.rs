//! A rigid body under PID control, integrated here by classical Runge-Kutta, with and without an integral to be seen.

use super::*;
use crate::identifiability::{self, tests::TwoAxes};
use crate::noise::tests::Normal;

/// One axis of a robot: inertia, drag and motor in units of the drive's force, and the gains of its controller.
#[derive(Clone, Copy)]
struct Axis {
    inertia: f64,
    drag: f64,
    proportional: f64,
    derivative: f64,
    integral: f64,
    /// Turning rate lost a unit of v ω.
    coupling: f64,
}

impl Axis {
    /// θ of the lag and of the gain (notes on Laut 2011, section 1: everything divided by kP), and λ = kI / kP.
    fn truth(&self) -> (f64, f64, f64) {
        let p = self.proportional;
        ((self.inertia + self.derivative) / p, 1.0 + self.drag / p, self.integral / p)
    }
}

/// A command of time.
type Command = fn(f64) -> [f64; 2];

/// Khepera-like: lags of 23 and 57 ms, gains of 1.05.
fn khepera(integral: f64, drag: f64) -> [Axis; 2] {
    let axis = |lag: f64| Axis { inertia: 0.8 * lag, drag, proportional: 1.0, derivative: 0.2 * lag, integral, coupling: COUPLING };
    [axis(0.0228), axis(0.0568)]
}

/// Pioneer-like: lags of a quarter of a second.
fn pioneer(integral: f64, drag: f64) -> [Axis; 2] {
    [Axis { inertia: 0.4, drag: 2.0 * drag, proportional: 2.0, derivative: 0.12, integral: 2.0 * integral, coupling: COUPLING }; 2]
}

const COUPLING: f64 = 0.05;

/// Sines for both, as the thesis drove them.
fn sines(t: f64) -> [f64; 2] {
    [
        0.2 + 0.05 * ((2.0 * t).sin() + t.sin() + (t / 3.0).sin() + (t / 11.0).sin()),
        0.75 + 0.3 * (1.5 * t).sin() + 0.3 * t.sin() + 0.2 * (0.5 * t).sin(),
    ]
}

/// Steps every few seconds.
fn steps(t: f64) -> [f64; 2] {
    [[0.1, 0.5, 0.3, -0.2][(t / 3.0) as usize % 4], [0.8, -0.6, 0.2, -0.1, 0.5][(t / 4.0) as usize % 5]]
}

/// M x' = u − D x + coupling, u = kP (r − x) − kD x' + kI ∫(r − x) dt, the command r held for a period.
fn driven(axes: [Axis; 2], command: Command, seconds: f64, rate: f64, noise: [f64; 2], seed: u64) -> Dataset {
    let rate_of = |s: [f64; 4], r: [f64; 2]| -> [f64; 4] {
        let [v, w, qv, qw] = s;
        let one = |a: Axis, x: f64, r: f64, q: f64, coupling: f64| {
            (a.proportional * (r - x) + a.integral * q - a.drag * x + coupling) / (a.inertia + a.derivative)
        };
        [one(axes[0], v, r[0], qv, 0.0), one(axes[1], w, r[1], qw, -axes[1].proportional * axes[1].coupling * v * w), r[0] - v, r[1] - w]
    };
    let n = (seconds * rate) as usize;
    let time: Vec<f64> = (0..n).map(|k| k as f64 / rate).collect();
    let parts = (0.25 * 1000.0 / rate).ceil() as usize * 4;
    let h = 1.0 / rate / parts as f64;
    let mut s = [0.0; 4];
    let mut outputs = vec![Vec::new(), Vec::new()];
    let mut normal = Normal::new(seed);
    for t in &time {
        (0..2).for_each(|i| outputs[i].push(s[i] + noise[i] * normal.next()));
        let r = command(*t);
        for _ in 0..parts {
            let at = |d: [f64; 4], f: f64| std::array::from_fn(|i| s[i] + f * d[i]);
            let k1 = rate_of(s, r);
            let k2 = rate_of(at(k1, h / 2.0), r);
            let k3 = rate_of(at(k2, h / 2.0), r);
            let k4 = rate_of(at(k3, h), r);
            s = std::array::from_fn(|i| s[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
        }
    }
    let inputs = (0..2).map(|i| time.iter().map(|t| command(*t)[i]).collect()).collect();
    let model = TwoAxes::new();
    let stretch = crate::dataset::Stretch { label: String::new(), time, inputs, outputs };
    Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![stretch] }
}

/// θ of the plain model, and what is found about it.
fn judged(data: &Dataset) -> (Vec<f64>, IntegralAction) {
    let model = TwoAxes::new();
    let fit = identifiability::assess(&model, &model.map(), None, data).unwrap();
    let theta: Vec<f64> = fit.parameters.iter().map(|p| p.value).collect();
    let std: Vec<f64> = fit.parameters.iter().map(|p| p.predicted_std.unwrap_or(f64::NAN)).collect();
    let found = assess(&model, &model.map(), &theta, &std, data).unwrap().unwrap();
    (theta, found)
}

const KHEPERA_NOISE: [f64; 2] = [0.002, 0.048];

#[test]
fn a_slow_integral_is_seen_with_its_size() {
    for (seed, lambda) in [(1, 0.3), (2, 1.0), (3, 3.0)] {
        let axes = pioneer(lambda, 0.05);
        let data = driven(axes, steps, 80.0, 20.0, [0.005, 0.01], seed);
        let (plain, found) = judged(&data);
        let parameters = found.parameters.as_ref().unwrap();
        for (i, axis) in found.axes.iter().enumerate() {
            let (low, high) = axis.lambda_ci95.unwrap();
            assert!(axis.present && (axis.lambda.unwrap() / lambda - 1.0).abs() < 0.1, "{axis:?}");
            // Twice the interval: eight are asked.
            assert!(2.0 * low - high < lambda && lambda < 2.0 * high - low, "{axis:?}");
            let (lag, gain, _) = axes[i].truth();
            assert!((parameters[i].1 / lag - 1.0).abs() < 0.05, "{parameters:?}");
            assert!((parameters[[3, 5][i]].1 - gain).abs() < 0.02, "{parameters:?}");
            assert!((plain[[3, 5][i]] - gain).abs() > (parameters[[3, 5][i]].1 - gain).abs(), "{plain:?}");
        }
        assert!(found.hidden.is_none() && found.error_with.as_ref().unwrap()[0] < found.error_without[0]);
        assert_eq!(found.concerns().len(), 2);
    }
}

#[test]
fn a_quick_integral_without_noise_is_found_by_its_column() {
    let axes = khepera(10.0, 0.05);
    let (plain, found) = judged(&driven(axes, sines, 40.0, 50.0, [0.0, 0.0], 1));
    // A residual below any noise, and parameters that are not the robot's.
    assert!(found.error_without[0] < 1.5e-3, "{:?}", found.error_without);
    assert!(plain[0] < 0.7 * 0.0228 && (plain[3] - 1.0).abs() < 0.003, "{plain:?}");
    let parameters: Vec<f64> = found.parameters.as_ref().unwrap().iter().map(|p| p.1).collect();
    for (i, axis) in found.axes.iter().enumerate() {
        let (lag, gain, lambda) = axes[i].truth();
        assert!((axis.lambda.unwrap() / lambda - 1.0).abs() < 1e-3, "{axis:?}");
        assert!((parameters[i] / lag - 1.0).abs() < 1e-3 && (parameters[[3, 5][i]] - gain).abs() < 1e-3, "{parameters:?}");
    }
}

#[test]
fn a_quick_integral_under_noise_is_warned_of_though_nothing_shows() {
    for seed in 1..=3 {
        let (plain, found) = judged(&driven(khepera(10.0, 0.05), sines, 80.0, 50.0, KHEPERA_NOISE, seed));
        assert!(plain[0] < 0.6 * 0.0228, "the lag is not the robot's: {plain:?}");
        assert!(found.axes.iter().all(|a| !a.present), "{found:?}");
        let warning = found.hidden.as_ref().unwrap();
        assert!(warning.contains("integrates the error") && found.concerns().len() == 1, "{warning}");
    }
}

#[test]
fn without_an_integral_there_is_none_and_no_warning() {
    let drives: [(Command, [Axis; 2], f64); 4] = [
        (sines, khepera(0.0, 0.05), 50.0),
        (steps, khepera(0.0, 0.03), 50.0),
        (sines, pioneer(0.0, 0.05), 20.0),
        (steps, pioneer(0.0, 0.02), 20.0),
    ];
    for (k, (command, axes, rate)) in drives.into_iter().enumerate() {
        for seed in 1..=3 {
            let (_, found) = judged(&driven(axes, command, 50.0, rate, [0.003, 0.02], seed));
            assert!(found.axes.iter().all(|a| !a.present), "drive {k}, seed {seed}: {found:?}");
            assert_eq!(found.hidden, None, "drive {k}, seed {seed}");
        }
    }
}

#[test]
fn one_axis_that_falls_short_says_that_nothing_integrates() {
    let [mut v, w] = khepera(0.0, 0.0);
    v.drag = 0.05;
    let (_, found) = judged(&driven([v, w], sines, 50.0, 50.0, KHEPERA_NOISE, 1));
    assert_eq!(found.hidden, None, "{found:?}");
    // Without any drag the gains are one, but turning still falls short by what the coupling takes.
    let (_, found) = judged(&driven(khepera(0.0, 0.0), sines, 50.0, 50.0, KHEPERA_NOISE, 1));
    assert_eq!(found.hidden, None, "{found:?}");
}

#[test]
fn a_gain_that_is_hardly_known_warns_of_nothing() {
    let (_, found) = judged(&driven(khepera(10.0, 0.05), sines, 10.0, 50.0, [0.03, 0.3], 1));
    assert_eq!(found.hidden, None, "{found:?}");
}

#[test]
fn a_gain_short_of_one_by_less_than_half_a_percent_is_proof_enough_where_it_is_known() {
    for (noise, command) in [([0.0, 0.0], sines as Command), (KHEPERA_NOISE, sines), (KHEPERA_NOISE, steps)] {
        let (_, found) = judged(&driven(khepera(0.0, 0.003), command, 80.0, 50.0, noise, 2));
        let gain = found.axes[0].steady_gain.unwrap();
        assert!((gain - 0.997).abs() < 1e-3, "{gain}");
        assert_eq!(found.hidden, None, "{found:?}");
    }
}

#[test]
fn the_warning_says_how_long_the_robot_would_coast() {
    // Gains of one and nothing that holds the robot back: no recording of such a drive could tell.
    let [v, mut w] = khepera(0.0, 0.0);
    w.coupling = 0.0;
    let (_, found) = judged(&driven([v, w], sines, 50.0, 50.0, KHEPERA_NOISE, 1));
    let warning = found.hidden.unwrap();
    // 0.0228 s over a gain within some 4e-4 of one.
    let coasting: f64 = warning.split("at least ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!((3.0..300.0).contains(&coasting), "{warning}");
}
