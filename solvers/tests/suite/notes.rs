//! The tables of section 4.2 of the notes on the thesis, row by row: what numpy and scipy gave there, other noise, the same robots.
//! Errors of θ1 and θ2 in percent, of the others absolute.

use wheelwright_core::Dataset;
use wheelwright_core::regression::{Pairing, Products, Settings};
use wheelwright_core::simulation::{Readout, Simulator};
use wheelwright_core::solver::{Problem, Solver};
use wheelwright_solvers::{InstrumentalVariables, Ols, OutputError, Thesis, Velocity};

use crate::common::{KHEPERA, PIONEER, pioneer_reference, record, recordings, vw_pd};
use crate::reference::{errors, normal};

fn solved(solver: &dyn Solver, data: &Dataset, truth: &[f64; 6]) -> [f64; 6] {
    let model = vw_pd();
    errors(&solver.solve(&Problem::new(&*model, data)).unwrap().theta, truth)
}

fn khepera() -> Dataset {
    let [(_, _, khepera), ..] = recordings();
    khepera
}

/// The thesis' pipeline, of which each choice can be undone.
fn thesis(order: usize, cutoff_hz: f64, trim_s: f64) -> Settings {
    Settings {
        order,
        cutoff_hz: Some(cutoff_hz),
        products: Products::AfterFilter,
        filter_response: false,
        pairing: Pairing::Same,
        trim_s: Some(trim_s),
        ..Settings::default()
    }
}

fn plain(conditioning: Settings) -> Ols {
    Ols { conditioning, undo_hold: false }
}

fn corrected(cutoff_hz: f64, undo_hold: bool) -> Ols {
    Ols { conditioning: Settings { cutoff_hz: Some(cutoff_hz), trim_s: Some(5.0), ..Settings::default() }, undo_hold }
}

fn unfiltered() -> Ols {
    plain(Settings { order: 0, trim_s: Some(0.0), pairing: Pairing::Same, ..Settings::default() })
}

/// Errors as printed: percent to half of one, the others to half of their last digit.
fn row(name: &str, found: [f64; 6], printed: &[(usize, f64, f64)]) {
    for &(parameter, value, half_digit) in printed {
        let error = found[parameter - 1];
        assert!((error - value).abs() <= half_digit, "{name}, theta{parameter}: {error} for {value}");
    }
}

#[test]
fn the_whole_theta_of_the_thesis_pipeline() {
    let found = solved(&Thesis::default(), &khepera(), &KHEPERA);
    let printed = [(1, 112.0, 0.5), (2, 63.0, 0.5), (3, 0.0009, 5e-5), (4, 0.029, 5e-4), (5, -0.019, 5e-4), (6, 0.005, 5e-4)];
    row("untrimmed", found, &printed);
}

#[test]
fn each_cause_of_its_bias_has_its_share() {
    let data = khepera();
    let of = |settings: &Settings| solved(&plain(settings.clone()), &data, &KHEPERA);
    let mut settings = thesis(2, 0.5, 5.0);
    let trimmed = of(&settings);
    row("ends trimmed", trimmed, &[(1, 62.0, 0.5), (2, 23.0, 0.5), (4, 0.026, 5e-4)]);
    settings.filter_response = true;
    settings.products = Products::BeforeFilter;
    let filtered = of(&settings);
    row("share of the unfiltered reference", std::array::from_fn(|i| trimmed[i] - filtered[i]), &[(1, 11.0, 0.6), (2, 4.0, 0.5)]);
    row("reference filtered", filtered, &[(4, 0.0, 5e-4)]);
    settings.pairing = Pairing::Mid;
    let paired = of(&settings);
    row("share of the pairing", std::array::from_fn(|i| filtered[i] - paired[i]), &[(1, 44.0, 0.5), (2, 18.0, 0.5)]);
    row("paired at the middle", paired, &[(1, 6.4, 0.05), (2, 1.1, 0.05)]);
    let inverted = solved(&Ols { conditioning: settings, undo_hold: true }, &data, &KHEPERA);
    row("hold undone", inverted, &[(1, 0.0, 0.05), (2, 0.0, 0.05)]);
    // In closed form: θ4 Ts/(1 − a), predicted 0.0343 and 0.0674, measured 0.0343 and 0.0675 s.
    for (i, gain, predicted, measured) in [(0, 3, 0.0343, 0.0343), (1, 5, 0.0674, 0.0675)] {
        let closed = KHEPERA[gain] * 0.02 / (1.0 - (-KHEPERA[gain] / KHEPERA[i] * 0.02_f64).exp());
        let apparent = KHEPERA[i] * (1.0 + filtered[i] / 100.0);
        assert!((closed - predicted).abs() < 5e-5 && (apparent - measured).abs() < 5.1e-5, "{closed} {apparent}");
    }
}

#[test]
fn the_filter_and_what_it_filters_matter_as_much_as_they_should() {
    let data = khepera();
    for (order, printed) in [(1, 83.0), (2, 62.0), (3, 55.0), (4, 52.0)] {
        row(&format!("order {order}"), solved(&plain(thesis(order, 0.5, 5.0)), &data, &KHEPERA), &[(1, printed, 0.5)]);
    }
    for (cutoff_hz, printed) in [(0.25, 388.0), (0.5, 112.0), (1.0, 80.0), (2.0, 69.0), (4.0, 59.0)] {
        row(&format!("{cutoff_hz} Hz"), solved(&plain(thesis(2, cutoff_hz, 0.0)), &data, &KHEPERA), &[(1, printed, 0.5)]);
    }
    for (trim_s, pairing, after, before) in [(0.0, Pairing::Same, 0.0275, 0.012), (5.0, Pairing::Mid, 0.0007, 0.0001)] {
        let of = |products| {
            let settings = Settings { products, pairing, filter_response: true, ..thesis(2, 0.5, trim_s) };
            solved(&plain(settings), &data, &KHEPERA)[4].abs()
        };
        // Printed as the most that was seen, to the digit.
        let (late, early) = (of(Products::AfterFilter), of(Products::BeforeFilter));
        assert!(early < 0.5 * late && late < after + 5e-5 && early < before + 5e-5, "{trim_s} s: {late} {early}");
    }
}

/// Wheels measured with noise and rounding \[m/s\].
fn measured(clean: &Dataset, noise: f64, track: f64, rounding: Option<f64>, seed: u64) -> Dataset {
    let mut noisy = clean.clone();
    let rows = noisy.stretches[0].len();
    let (right, left) = (normal(1000 + seed, rows), normal(2000 + seed, rows));
    let read = |speed: f64| rounding.map_or(speed, |step| (speed / step).round() * step);
    let [v, omega] = noisy.stretches[0].outputs.as_mut_slice() else { return noisy };
    for k in 0..rows {
        let right = read(v[k] + 0.5 * track * omega[k] + noise * right[k]);
        let left = read(v[k] - 0.5 * track * omega[k] + noise * left[k]);
        (v[k], omega[k]) = (0.5 * (right + left), (right - left) / track);
    }
    noisy
}

/// Parameter, mean error and, where it is printed, standard deviation.
type Printed = (usize, f64, Option<f64>);

/// Errors over as many runs as the table has: means within three standard errors of their difference and the rounding of the table,
/// deviations such as differ by chance.
fn monte_carlo(name: &str, runs: u64, solver: &dyn Solver, truth: &[f64; 6], make: &dyn Fn(u64) -> Dataset, printed: &[Printed]) {
    let all: Vec<[f64; 6]> = (0..runs).map(|seed| solved(solver, &make(seed), truth)).collect();
    for &(parameter, mean, deviation) in printed {
        let of = |e: &[f64; 6]| e[parameter - 1];
        let found = all.iter().map(of).sum::<f64>() / runs as f64;
        let spread = (all.iter().map(|e| (of(e) - found).powi(2)).sum::<f64>() / (runs - 1) as f64).sqrt();
        let other = deviation.unwrap_or(spread);
        let chance = 3.0 * ((other.powi(2) + spread.powi(2)) / runs as f64).sqrt() + 0.5;
        assert!((found - mean).abs() < chance, "{name}, theta{parameter}: {found} ± {spread} for {mean} ± {other}");
        assert!((other / 2.5..=2.5 * other).contains(&spread), "{name}, theta{parameter}: {spread} for {other}");
    }
}

/// θ1 and θ2 with deviations, and without.
fn both(first: (f64, f64), second: (f64, f64)) -> [Printed; 2] {
    [(1, first.0, Some(first.1)), (2, second.0, Some(second.1))]
}

fn means(first: f64, second: f64) -> [Printed; 2] {
    [(1, first, None), (2, second, None)]
}

#[test]
fn the_khepera_with_noise_on_its_wheels() {
    let clean = khepera();
    let with = |noise: f64| move |clean: &Dataset, seed| measured(clean, noise, 0.089, None, seed);
    let (little, much) = (|seed| with(0.003)(&clean, seed), |seed| with(0.010)(&clean, seed));
    let (exact, iv) = (OutputError::default(), InstrumentalVariables::default());
    monte_carlo("3 mm/s, raw", 24, &unfiltered(), &KHEPERA, &little, &[(1, -12.0, None), (2, -80.0, Some(0.5))]);
    monte_carlo("3 mm/s, thesis", 24, &Thesis::default(), &KHEPERA, &little, &both((112.0, 2.5), (63.0, 2.0)));
    monte_carlo("3 mm/s, corrected", 24, &corrected(1.0, false), &KHEPERA, &little, &both((5.8, 1.7), (0.7, 1.4)));
    monte_carlo("3 mm/s, inverted", 24, &corrected(1.0, true), &KHEPERA, &little, &both((0.0, 1.6), (-0.2, 2.0)));
    monte_carlo("3 mm/s, output error", 8, &exact, &KHEPERA, &little, &both((-0.8, 1.3), (-0.4, 1.6)));
    monte_carlo("10 mm/s, raw", 24, &unfiltered(), &KHEPERA, &much, &means(-82.0, -98.0));
    monte_carlo("10 mm/s, 2 Hz", 24, &corrected(2.0, false), &KHEPERA, &much, &[(2, -17.0, None)]);
    monte_carlo("10 mm/s, 5 Hz", 24, &corrected(5.0, false), &KHEPERA, &much, &[(2, -75.0, None)]);
    monte_carlo("10 mm/s, iv", 8, &iv, &KHEPERA, &much, &both((0.0, 5.0), (0.0, 7.0)));
    monte_carlo("10 mm/s, output error", 8, &exact, &KHEPERA, &much, &both((-2.7, 4.4), (-1.3, 5.1)));
}

#[test]
fn the_khepera_with_differenced_encoders() {
    let (model, mut data) = (vw_pd(), khepera());
    let mut means = vec![Vec::new(); 2];
    let mut simulator = Simulator::new(&*model, &KHEPERA).unwrap().with_readout(Readout::IntervalMean);
    simulator.run(&data.stretches[0], &[0.0, 0.0], &mut means).unwrap();
    data.stretches[0].outputs = means;
    let paired = |pairing| solved(&plain(Settings { pairing, ..corrected(1.0, false).conditioning }), &data, &KHEPERA);
    row("naive", paired(Pairing::Same), &[(1, 88.0, 0.5), (2, 36.0, 0.5)]);
    row("with the reference before", paired(Pairing::Previous), &[(1, 0.0, 0.05), (2, 0.0, 0.05)]);
    let exact = solved(&OutputError { velocity: Velocity::Difference, ..OutputError::default() }, &data, &KHEPERA);
    assert!(exact.iter().all(|e| e.abs() < 1e-4), "{exact:?}");
}

#[test]
fn the_pioneer_with_noise_and_rounding_on_its_wheels() {
    let [_, (_, _, quick), (_, _, slow)] = recordings();
    let rows = [
        ("0.1 s", &quick, means(42.0, 36.0), means(1.8, 1.7), both((0.1, 0.3), (-0.7, 0.9)), both((0.0, 0.2), (0.2, 0.6))),
        ("0.3 s", &slow, means(100.0, 102.0), means(15.0, 18.0), both((0.2, 0.7), (-2.7, 1.8)), both((-0.1, 0.5), (-0.6, 1.6))),
    ];
    for (period, clean, as_published, filtered, inverted, output_error) in rows {
        let noisy = |seed| measured(clean, 0.005, 0.33, Some(0.001), seed);
        monte_carlo(&format!("{period}, thesis"), 24, &Thesis::default(), &PIONEER, &noisy, &as_published);
        monte_carlo(&format!("{period}, corrected"), 24, &corrected(1.0, false), &PIONEER, &noisy, &filtered);
        monte_carlo(&format!("{period}, inverted"), 24, &corrected(1.0, true), &PIONEER, &noisy, &inverted);
        monte_carlo(&format!("{period}, output error"), 8, &OutputError::default(), &PIONEER, &noisy, &output_error);
    }
}

/// Periods of 0.3 s, each longer or shorter by up to 30 %; stamps logged, or taken to be even.
#[test]
fn the_pioneer_with_jitter() {
    let noisy = |seed: u64| {
        let uniform = normal(seed + 7, 1002).chunks(2).map(|x| x[1].atan2(x[0]) / std::f64::consts::PI).collect::<Vec<f64>>();
        let mut time = vec![0.0];
        uniform.iter().take(500).for_each(|u| time.push(time[time.len() - 1] + 0.3 * (1.0 + 0.3 * u)));
        measured(&record(PIONEER, time, pioneer_reference, 0.02), 0.005, 0.33, Some(0.001), seed)
    };
    let even = |seed: u64| {
        let mut data = noisy(seed);
        data.stretches[0].time.iter_mut().enumerate().for_each(|(k, t)| *t = 0.3 * k as f64);
        data
    };
    monte_carlo("thesis, stamps even", 24, &Thesis::default(), &PIONEER, &even, &means(102.0, 104.0));
    monte_carlo("output error", 8, &OutputError::default(), &PIONEER, &noisy, &means(-0.1, -0.8));
    monte_carlo("output error, stamps even", 8, &OutputError::default(), &PIONEER, &even, &means(1.7, 1.0));
}
