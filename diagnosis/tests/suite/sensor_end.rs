//! A speed that ends: of the robot, or of what is recorded of it.

use wheelwright_core::ModelConfig;
use wheelwright_core::effect::Effect;
use wheelwright_diagnosis::effects::{Axis, VelocitySaturation, library};
use wheelwright_diagnosis::{Question, Verdict, diagnose};
use wheelwright_models::VwPdConfig;

use super::drive::{Drive, blur};

const THETA: [f64; 6] = [0.26, 0.19, 0.01, 1.02, 0.05, 1.05];
const TRACK: f64 = 0.34;
/// Where the speed ends, and where commands do \[m/s\].
const END: f64 = 0.7;
const FASTEST: f64 = 1.0;

#[test]
fn a_sensor_that_ends_is_no_limit_of_the_robot() {
    let model = VwPdConfig::default().build().unwrap();
    let limit = VelocitySaturation { axis: Some(Axis::V), ..VelocitySaturation::default() };
    for recorded in [false, true] {
        let drive = Drive { samples: 1500, change: 0.03, forward: 0.1..FASTEST, turning: -0.6..0.6, seed: 11 };
        let end = if recorded { 10.0 } else { END };
        let (mut data, mut random) = drive.driven(&*model, &THETA, TRACK, &limit as &dyn Effect, &[end]);
        if recorded {
            data.stretches[0].outputs[0].iter_mut().for_each(|v| *v = v.min(END));
        }
        blur(&mut data, [0.008, 0.01], &mut random);
        let all = library();
        let mut question = Question::new(&*model, &data, &all);
        (question.track_width, question.experiment) = (Some(TRACK), false);
        let answer = diagnose(&question).unwrap();
        let found = answer.effects.first().or(answer.partial.first()).unwrap();
        assert_eq!((&*found.name, answer.effects.len() + answer.partial.len()), ("velocity_saturation", 1), "{}", answer.headline);
        assert!((found.values[0] - END).abs() < 0.01, "{:?}", found.values);
        assert_eq!(answer.verdict, if recorded { Verdict::Unexplained } else { Verdict::Explained }, "{}", answer.headline);
        assert_eq!(answer.headline.contains("its sensor shows no more"), recorded, "{}", answer.headline);
    }
}
