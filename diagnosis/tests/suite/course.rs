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

/// Steps of two seconds each on average, wheels' commands cut at a limit, and a left wheel whose encoder is off its centre by a share of its radius.
fn rippling(model: &dyn RegressorModel, limit: f64, off: f64) -> Dataset {
    let drive = Drive { samples: 2000, change: 0.025, forward: 0.1..1.2, turning: -0.4..0.4, seed: 7 };
    let (mut data, mut random) = drive.driven(model, &THETA, 2.0 * HALF_TRACK, &VelocitySaturation::default(), &[limit]);
    let [v, w] = &mut data.stretches[0].outputs[..] else { panic!("two outputs") };
    let mut angle = 0.3;
    for (v, w) in v.iter_mut().zip(w) {
        let (left, right) = (*v - HALF_TRACK * *w, *v + HALF_TRACK * *w);
        angle += 0.05 * left / RADIUS;
        let left = left * (1.0 + off * f64::cos(angle));
        (*v, *w) = (0.5 * (left + right), (right - left) / (2.0 * HALF_TRACK));
    }
    blur(&mut data, [0.004, 0.01], &mut random);
    data
}

fn library() -> Vec<Box<dyn Effect>> {
    let off = |wheel| Box::new(WheelEccentricity { wheel: Some(wheel), ripple: Ripple::Reading, oval: false }) as Box<dyn Effect>;
    vec![Box::new(VelocitySaturation::default()), off(Wheel::Left), off(Wheel::Right)]
}

#[test]
fn a_wheel_off_its_axle_shows_once_a_limit_was_found() {
    let model = VwPdConfig::default().build().unwrap();
    // Many of the steps are beyond the limit.
    let data = rippling(&*model, 0.6, 0.015);
    let library = library();
    let mut question = Question::new(&*model, &data, &library);
    (question.track_width, question.wheel_radius) = (Some(2.0 * HALF_TRACK), Some(1.01 * RADIUS));
    question.experiment = false;
    let answer = diagnose(&question).unwrap();
    let names: Vec<&str> = answer.effects.iter().chain(&answer.partial).map(|e| &*e.name).collect();
    assert_eq!(names, ["velocity_saturation", "wheel_eccentricity"]);
    let ripple = &answer.effects[1].values;
    assert!((ripple[0].hypot(ripple[1]) - 0.015).abs() < 0.003, "{ripple:?}");
}

#[test]
fn wheels_that_nobody_measured_are_known_by_what_returns_with_their_way() {
    let model = VwPdConfig::default().build().unwrap();
    let library = library();
    // Beside a limit the line is lost in what the base model leaves, and shows in what the limit leaves.
    for (limit, off) in [(2.0, 0.0), (2.0, 0.015), (0.6, 0.015)] {
        let data = rippling(&*model, limit, off);
        let mut question = Question::new(&*model, &data, &library);
        question.experiment = false;
        let answer = diagnose(&question).unwrap();
        let names: Vec<&str> = answer.effects.iter().chain(&answer.partial).map(|e| &*e.name).collect();
        let said = answer.warnings.iter().any(|w| w.contains("the wheels' radius is unknown"));
        if off == 0.0 {
            assert!(names.is_empty() && !said, "{names:?} {:?}", answer.warnings);
            continue;
        }
        let expected: &[&str] = if limit < 1.0 { &["velocity_saturation", "wheel_eccentricity"] } else { &["wheel_eccentricity"] };
        assert_eq!(names, expected);
        let [cosine, sine, radius] = answer.effects[names.len() - 1].values[..] else { panic!("{:?}", answer.effects) };
        assert!((cosine.hypot(sine) / off - 1.0).abs() < 0.2 && (radius / RADIUS - 1.0).abs() < 0.01 && said, "{cosine} {sine} {radius}");
    }
}
