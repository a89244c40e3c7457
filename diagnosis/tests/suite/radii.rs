//! Radii that the wheels' own rates tell, before anything is searched for.

use wheelwright_core::Stretch;
use wheelwright_core::effect::Effect;
use wheelwright_diagnosis::effects::{Speeds, WheelRadiusMismatch};
use wheelwright_diagnosis::{Question, Verdict, diagnose};

use super::recorded::{NOISE, TRACK, library, model, names, record_with};

const RADIUS: f64 = 0.1;
const MISMATCH: f64 = -0.07;

/// The wheels' rates of a robot whose own motion is recorded.
fn rates(stretch: &Stretch) -> [Vec<f64>; 2] {
    [-1.0, 1.0].map(|side| {
        let speeds = stretch.outputs[0].iter().zip(&stretch.outputs[1]).map(|(v, w)| v + side * 0.5 * TRACK * w);
        speeds.map(|speed| speed / (RADIUS * (1.0 + side * 0.5 * MISMATCH))).collect()
    })
}

#[test]
fn what_radii_do_that_are_known_is_no_noise() {
    let radii = WheelRadiusMismatch { speeds: Speeds::Ground, ..WheelRadiusMismatch::default() };
    let hidden: (&dyn Effect, &[f64]) = (&radii, &[MISMATCH, 1.0]);
    let [data, held] =
        [(31, false), (32, true)].map(|(seed, reverses)| record_with(0.3 * NOISE, TRACK, seed, 1600, reverses, &[hidden], 0.0));
    let (model, mut library) = (model(), library());
    library.push(Box::new(WheelRadiusMismatch::default()));
    let question = Question {
        held_out: Some(&held),
        track_width: Some(TRACK),
        wheel_radius: Some(RADIUS),
        training_wheel_rates: Some(data.stretches.iter().map(rates).collect()),
        ..Question::new(&*model, &data, &library)
    };
    let found = diagnose(&question).unwrap();
    assert_eq!(names(&found), ["wheel_radius_mismatch"], "{}", found.headline);
    let grown: Vec<f64> = found.noise.iter().zip([1.0, 2.0]).map(|(noise, true_size)| noise / (0.3 * NOISE * true_size)).collect();
    assert!(grown.iter().all(|g| (g - 1.0).abs() < 0.1), "what is left is the noise: {grown:?}");
    assert_eq!(found.verdict, Verdict::Explained, "{:?}", found.warnings);
}
