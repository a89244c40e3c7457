//! Signal conditioning against SciPy and NumPy.

use proptest::prelude::*;
use wheelwright_core::Stretch;
use wheelwright_core::signal::{Butterworth, Padding, SignalError, ZeroPhase, gradient, resample, spacing};

/// Reference values kept outside the repository; `None` (and a plain word about it) where they are not there.
fn golden() -> Option<serde_json::Value> {
    let shared = std::env::var("WHEELWRIGHT_SHARED").unwrap_or_else(|_| concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared").to_owned());
    let path = std::path::Path::new(&shared).join("thesis/golden.json");
    let Ok(text) = std::fs::read_to_string(&path) else {
        eprintln!("SKIPPED: {} is not there", path.display());
        return None;
    };
    Some(serde_json::from_str(&text).unwrap())
}

fn numbers(value: &serde_json::Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

fn close(found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (k, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((a - b).abs() <= tolerance, "value {k}: {a} is not {b} to {tolerance:e}");
    }
}

fn filtered(order: usize, cutoff: f64, rate: f64, padding: Padding, x: &[f64]) -> Vec<f64> {
    let mut y = x.to_vec();
    ZeroPhase::new(Butterworth::low_pass(order, cutoff, rate).unwrap(), padding).apply(&mut [&mut y]).unwrap();
    y
}

#[test]
fn coefficients_are_those_of_the_reference_file() {
    let Some(golden) = golden() else { return };
    let designs = golden["butter"].as_object().unwrap();
    assert_eq!(designs.len(), 9);
    for (name, design) in designs {
        let (order, rate) = name.strip_prefix('n').unwrap().split_once("_fs").unwrap();
        // The name rounds the rate of 1 / 0.3 s.
        let rate: f64 = if rate.starts_with("3.3333") { 1.0 / 0.3 } else { rate.split('_').next().unwrap().parse().unwrap() };
        let (b, a) = Butterworth::low_pass(order.parse().unwrap(), 0.5, rate).unwrap().transfer_function();
        close(&b, &numbers(&design["b"]), 1e-14);
        close(&a, &numbers(&design["a"]), 1e-13);
    }
}

#[test]
fn zero_phase_filter_is_that_of_the_reference_file() {
    let Some(golden) = golden() else { return };
    let case = &golden["filtfilt_n2_fs10_fc.5"];
    let x = numbers(&case["x"]);
    close(&filtered(2, 0.5, 10.0, Padding::Scipy, &x), &numbers(&case["y_scipy_padlen9"]), 1e-12);
    close(&filtered(2, 0.5, 10.0, Padding::Matlab, &x), &numbers(&case["y_matlab_padlen6"]), 1e-12);
}

// from scipy.signal import butter; butter(3, 2.0, fs=25)
#[test]
fn coefficients_are_those_of_scipy() {
    let (b, a) = Butterworth::low_pass(3, 2.0, 25.0).unwrap().transfer_function();
    close(&b, &[0.01018257673643694, 0.03054773020931082, 0.03054773020931082, 0.01018257673643694], 1e-15);
    close(&a, &[1.0, -2.003797477370017, 1.4470540194893793, -0.361795928227867], 1e-14);
}

// i = np.arange(60); x = np.sin(0.3*i) + 0.2*((7*i)%5) - 0.05*i
// y = scipy.signal.sosfiltfilt(butter(n, 2.0, fs=25, output='sos'), x); y[[0, 1, 29, 58, 59]]
#[test]
fn zero_phase_filter_is_that_of_scipy_for_odd_and_even_orders() {
    let x: Vec<f64> = (0..60).map(|i| (0.3 * f64::from(i)).sin() + 0.2 * f64::from((7 * i) % 5) - 0.05 * f64::from(i)).collect();
    let expected = [
        (1, [-0.007552107607782105, 0.3423982928815318, -0.5691175776178492, -3.2250624149191713, -3.2381002208685645]),
        (3, [-0.014448853377752466, 0.3580331019953653, -0.4137713618983888, -3.2508640826960584, -3.276503362619186]),
        (5, [-0.007794575299998691, 0.37322518992455456, -0.3895066866369336, -3.247471778182854, -3.250484798826831]),
        (8, [0.00239107196860993, 0.38100153814464466, -0.3886076790266267, -3.228593273259062, -3.219287313489819]),
    ];
    for (order, values) in expected {
        let y = filtered(order, 2.0, 25.0, Padding::Scipy, &x);
        close(&[0, 1, 29, 58, 59].map(|k: usize| y[k]), &values, 1e-12);
    }
}

// N = 1_000_000; i = np.arange(N); x = ((i*7919) % 1000)/1000 + np.sin(i*0.002)
// sosfiltfilt(butter(4, .5, fs=1000, output='sos'), x)
#[test]
fn a_million_samples_at_a_low_cut_off_stay_within_1e_10_of_scipy() {
    let x: Vec<f64> = (0..1_000_000_u64).map(|i| ((i * 7919) % 1000) as f64 / 1000.0 + (i as f64 * 0.002).sin()).collect();
    let y = filtered(4, 0.5, 1000.0, Padding::Scipy, &x);
    let at = [0, 1, 500, 123_456, 500_000, 999_998, 999_999];
    let expected = [
        0.11049851130517377,
        0.1128217074094515,
        1.1856810264935953,
        1.430608923794807,
        1.3046526430165306,
        0.6819832891993032,
        0.6819832896491016,
    ];
    close(&at.map(|k: usize| y[k]), &expected, 1e-10);
}

#[test]
fn settling_time_is_when_the_impulse_response_is_down_to_a_thousandth() {
    for (order, cutoff, rate) in [(1, 0.5, 10.0), (2, 1.0, 50.0), (2, 0.5, 1000.0), (4, 1.0, 20.0)] {
        let filter = Butterworth::low_pass(order, cutoff, rate).unwrap();
        let settled = filter.settling();
        let n = 20 * settled;
        let mut x = vec![0.0; 2 * n + 1];
        x[n] = 1.0;
        ZeroPhase::new(filter, Padding::Scipy).apply(&mut [&mut x]).unwrap();
        let peak = x.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        // Two passes multiply the decay by a term that grows linearly; it stays below one per cent.
        assert!(x[n + settled..].iter().all(|v| v.abs() < 1e-2 * peak), "order {order}");
        assert!(x[n + settled / 4..].iter().any(|v| v.abs() > 1e-3 * peak), "order {order}: the rule wastes data");
    }
}

#[test]
fn what_cannot_be_filtered_is_refused_with_its_numbers() {
    assert_eq!(Butterworth::low_pass(2, 5.0, 10.0), Err(SignalError::CutOff { cutoff_hz: 5.0, rate_hz: 10.0 }));
    assert!(Butterworth::low_pass(2, 0.0, 10.0).is_err());
    assert!(Butterworth::low_pass(2, f64::NAN, 10.0).is_err());
    assert_eq!(Butterworth::low_pass(0, 1.0, 10.0), Err(SignalError::Order { order: 0, max: 32 }));
    let message = Butterworth::low_pass(2, 6.0, 10.0).unwrap_err().to_string();
    assert_eq!(message, "cut-off of 6 Hz at 10.000000 samples/s: it must lie above 0 and below half the sampling rate, 5.000000 Hz");
    let filter = ZeroPhase::new(Butterworth::low_pass(2, 1.0, 10.0).unwrap(), Padding::Scipy);
    assert_eq!(filter.apply(&mut [&mut [0.0; 9]]), Err(SignalError::TooShort { samples: 9, padding: 9 }));
    assert_eq!(filter.apply(&mut [&mut [0.0; 10]]), Ok(()));
    assert_eq!(filter.apply(&mut [&mut [0.0; 12], &mut [0.0; 11]]), Err(SignalError::Ragged { expected: 12, found: 11 }));
}

// numpy.gradient([1, 2, 0, 5, 4], [0, .1, .25, .3, .7])
#[test]
fn differences_are_those_of_numpy() {
    let d = gradient(&[0.0, 0.1, 0.25, 0.3, 0.7], &[1.0, 2.0, 0.0, 5.0, 4.0]);
    close(&d, &[10.0, 0.6666666666666661, 71.66666666666669, 88.61111111111113, -2.5], 1e-12);
    assert_eq!(gradient(&[0.0, 0.5], &[1.0, 2.0]), vec![2.0, 2.0]);
    assert!(gradient(&[0.0], &[1.0]).is_empty());
}

fn uneven(n: usize) -> Stretch {
    let time: Vec<f64> = (0..n).map(|k| 0.1 * k as f64 + 0.02 * ((k * k) as f64).sin()).collect();
    let line = time.iter().map(|t| 3.0 - 2.0 * t).collect();
    let held = (0..n).map(|k| ((k * 7) % 5) as f64).collect();
    Stretch { label: "a".to_owned(), time, inputs: vec![held], outputs: vec![line] }
}

#[test]
fn resampling_keeps_lines_and_the_integral_of_a_held_input() {
    let stretch = uneven(200);
    assert!(spacing(&stretch.time).unwrap().jitter > 0.2);
    let even = resample(&stretch, 0.07);
    assert!(spacing(&even.time).unwrap().jitter < 1e-9);
    let last = even.len() - 1;
    assert!(even.time[last] <= stretch.time[199] && even.time[last] > stretch.time[199] - 0.07);
    for (t, x) in even.time.iter().zip(&even.outputs[0]) {
        assert!((x - (3.0 - 2.0 * t)).abs() < 1e-12);
    }
    let end = even.time[last];
    let original: f64 = (0..199).map(|k| stretch.inputs[0][k] * (stretch.time[k + 1].min(end) - stretch.time[k].min(end))).sum();
    let kept: f64 = even.inputs[0][..last].iter().map(|u| u * 0.07).sum();
    assert!((original - kept).abs() < 1e-9, "{original} {kept}");
}

#[test]
fn resampling_an_even_stretch_changes_nothing() {
    let time: Vec<f64> = (0..50).map(|k| 0.02 * f64::from(k)).collect();
    let x: Vec<f64> = time.iter().map(|t| t.sin()).collect();
    let stretch = Stretch { label: String::new(), time: time.clone(), inputs: vec![x.clone()], outputs: vec![x] };
    let again = resample(&stretch, 0.02);
    close(&again.time, &time, 1e-12);
    close(&again.inputs[0], &stretch.inputs[0], 1e-12);
    close(&again.outputs[0], &stretch.outputs[0], 1e-12);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_constant_passes_unchanged(order in 1_usize..9, share in 0.01_f64..0.45, level in -10.0_f64..10.0) {
        let y = filtered(order, share, 1.0, Padding::Scipy, &[level; 80]);
        for value in y {
            prop_assert!((value - level).abs() <= 1e-9 * level.abs(), "{} {}", value, level);
        }
    }

    #[test]
    fn a_column_does_not_see_its_neighbours(columns in prop::collection::vec(prop::collection::vec(-1.0_f64..1.0, 40), 1..7)) {
        let filter = ZeroPhase::new(Butterworth::low_pass(3, 0.1, 1.0).unwrap(), Padding::Scipy);
        let mut together = columns.clone();
        filter.apply(&mut together.iter_mut().map(Vec::as_mut_slice).collect::<Vec<_>>()).unwrap();
        for (column, expected) in columns.iter().zip(&together) {
            prop_assert_eq!(&filtered(3, 0.1, 1.0, Padding::Scipy, column), expected);
        }
    }

    #[test]
    fn filtering_is_symmetric_in_time(x in prop::collection::vec(-1.0_f64..1.0, 60..90)) {
        // Forward-backward filtering of the reversed signal differs only by the edges.
        let forward = filtered(2, 0.2, 1.0, Padding::Scipy, &x);
        let mut reversed = filtered(2, 0.2, 1.0, Padding::Scipy, &x.iter().rev().copied().collect::<Vec<_>>());
        reversed.reverse();
        for k in 25..x.len() - 25 {
            prop_assert!((forward[k] - reversed[k]).abs() < 1e-4);
        }
    }
}
