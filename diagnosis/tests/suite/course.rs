//! How wheels stand is known better once what took the base model away was found.

use wheelwright_core::effect::Effect;
use wheelwright_core::{Dataset, ModelConfig, RegressorModel};
use wheelwright_diagnosis::effects::{Ripple, VelocitySaturation, Wheel, WheelEccentricity};
use wheelwright_diagnosis::{Question, diagnose};
use wheelwright_models::VwPdConfig;

use super::drive::{Drive, blur};

const THETA: [f64; 6] = [0.26, 0.19, 0.01, 1.02, 0.05, 1.05];
const HALF_TRACK: f64 = 0.17;
const RADIUS: f64 = 0.09;

/// Steps of two seconds each on average, many of them beyond the limit of the wheels' commands, and a left wheel whose encoder is off its centre.
fn clipped_and_rippling(model: &dyn RegressorModel) -> Dataset {
    let drive = Drive { samples: 2000, change: 0.025, forward: 0.1..1.2, turning: -0.4..0.4, seed: 7 };
    let (mut data, mut random) = drive.driven(model, &THETA, 2.0 * HALF_TRACK, &VelocitySaturation::default(), &[0.6]);
    let [v, w] = &mut data.stretches[0].outputs[..] else { panic!("two outputs") };
    let mut angle = 0.3;
    for (v, w) in v.iter_mut().zip(w) {
        let (left, right) = (*v - HALF_TRACK * *w, *v + HALF_TRACK * *w);
        angle += 0.05 * left / RADIUS;
        let left = left * (1.0 + 0.015 * f64::cos(angle));
        (*v, *w) = (0.5 * (left + right), (right - left) / (2.0 * HALF_TRACK));
    }
    blur(&mut data, [0.004, 0.01], &mut random);
    data
}

#[test]
fn a_wheel_off_its_axle_shows_once_a_limit_was_found() {
    let model = VwPdConfig::default().build().unwrap();
    let data = clipped_and_rippling(&*model);
    let mut library: Vec<Box<dyn Effect>> = vec![Box::new(VelocitySaturation::default())];
    let off = |wheel| WheelEccentricity { wheel: Some(wheel), ripple: Ripple::Reading };
    library.extend([Wheel::Left, Wheel::Right].map(|wheel| Box::new(off(wheel)) as Box<dyn Effect>));
    let mut question = Question::new(&*model, &data, &library);
    (question.track_width, question.wheel_radius) = (Some(2.0 * HALF_TRACK), Some(1.01 * RADIUS));
    question.experiment = false;
    let answer = diagnose(&question).unwrap();
    let names: Vec<&str> = answer.effects.iter().chain(&answer.partial).map(|e| &*e.name).collect();
    assert_eq!(names, ["velocity_saturation", "wheel_eccentricity"]);
    let ripple = &answer.effects[1].values;
    assert!((ripple[0].hypot(ripple[1]) - 0.015).abs() < 0.003, "{ripple:?}");
}
