//! A slow ramp before a quick robot: what is linear about the model without it asks for a robot that follows at once.

use wheelwright_core::ModelConfig;
use wheelwright_core::effect::Effect;
use wheelwright_diagnosis::effects::{SlewLimit, TorqueSaturation};
use wheelwright_diagnosis::{Question, diagnose};
use wheelwright_models::VwPdConfig;

use super::drive::{Drive, blur};

const THETA: [f64; 6] = [0.04, 0.03, 0.002, 1.02, 0.02, 1.05];

/// Of the first the model would have to follow at once; of the second it takes a lag of two seconds for the ramp.
#[test]
fn a_slow_ramp_is_found_before_a_quick_robot() {
    let model = VwPdConfig::default().build().unwrap();
    for (rate, seed) in [(0.2, 4), (0.115, 6)] {
        let ramp = SlewLimit { wheels: true, slowing: true, ..SlewLimit::default() };
        let drive = Drive { samples: 1300, change: 0.04, forward: -0.1..0.6, turning: -1.2..1.2, seed };
        let (mut data, mut random) = drive.driven(&*model, &THETA, 0.34, &ramp, &[rate, 2.0 * rate, 0.5]);
        blur(&mut data, [0.004, 0.012], &mut random);
        let library: Vec<Box<dyn Effect>> = vec![Box::new(TorqueSaturation::default()), Box::new(ramp)];
        let mut question = Question::new(&*model, &data, &library);
        question.track_width = Some(0.34);
        question.experiment = false;
        let answer = diagnose(&question).unwrap();
        let names: Vec<&str> = answer.effects.iter().map(|e| &*e.name).collect();
        assert_eq!(names, ["slew_limit"], "{} {:?}", answer.headline, answer.warnings);
        let found = &answer.effects[0].values;
        assert!((found[0] / rate - 1.0).abs() < 0.02 && (found[1] / rate - 2.0).abs() < 0.04 && (found[2] - 0.5).abs() < 0.02, "{found:?}");
    }
}
