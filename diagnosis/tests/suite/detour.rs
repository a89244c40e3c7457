//! A time of change is found although the likelihood has a maximum for every acceleration.

use wheelwright_core::ModelConfig;
use wheelwright_core::effect::Effect;
use wheelwright_diagnosis::effects::PayloadChange;
use wheelwright_diagnosis::{Question, diagnose};
use wheelwright_models::VwPdConfig;

use super::drive::{Drive, blur};

const THETA: [f64; 6] = [0.26, 0.19, 0.01, 1.02, 0.05, 1.05];

#[test]
fn the_time_of_a_load_is_found_past_other_maxima() {
    let model = VwPdConfig::default().build().unwrap();
    for (time, seed) in [(50.3, 50), (44.9, 44), (13.1, 13)] {
        let drive = Drive { samples: 1300, change: 0.05, forward: -0.4..0.6, turning: -1.2..1.2, seed };
        let (mut data, mut random) = drive.driven(&*model, &THETA, 0.34, &PayloadChange::default(), &[time, 0.3, 0.3, 0.0]);
        blur(&mut data, [0.004, 0.012], &mut random);
        let library: Vec<Box<dyn Effect>> = vec![Box::new(PayloadChange::default())];
        let mut question = Question::new(&*model, &data, &library);
        question.track_width = Some(0.34);
        question.experiment = false;
        let answer = diagnose(&question).unwrap();
        let found = &answer.effects.first().or(answer.partial.first()).unwrap().values;
        assert!((found[0] - time).abs() < 0.3, "a load at {time} s was dated {} s", found[0]);
        assert!((found[1] - 0.3).abs() < 0.03, "{found:?}");
    }
}
