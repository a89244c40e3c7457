//! Wheels that stick and jump: no small friction leads there step by step.

use wheelwright_core::ModelConfig;
use wheelwright_core::effect::Effect;
use wheelwright_diagnosis::effects::{CoulombFriction, StribeckFriction};
use wheelwright_diagnosis::{Question, diagnose};
use wheelwright_models::VwPdConfig;

use super::drive::{Drive, blur};

const THETA: [f64; 6] = [0.25, 0.2, 0.002, 1.02, 0.02, 1.05];

#[test]
fn what_breaking_away_needs_is_found_where_it_is_more_than_the_commands_often_give() {
    let model = VwPdConfig::default().build().unwrap();
    let truth = [0.05, 0.12, 0.13, 1.0];
    for seed in 1..4 {
        let drive = Drive { samples: 1300, change: 0.08, forward: -0.5..0.5, turning: -1.2..1.2, seed };
        let (mut data, mut random) = drive.driven(&*model, &THETA, 0.46, &StribeckFriction::default(), &truth);
        blur(&mut data, [0.005, 0.02], &mut random);
        let library: Vec<Box<dyn Effect>> = vec![Box::new(CoulombFriction::default()), Box::new(StribeckFriction::default())];
        let mut question = Question::new(&*model, &data, &library);
        question.track_width = Some(0.46);
        question.experiment = false;
        let answer = diagnose(&question).unwrap();
        let names: Vec<&str> = answer.effects.iter().map(|e| &*e.name).collect();
        assert_eq!(names, ["stribeck_friction"], "{seed}");
        let found = &answer.effects[0].values;
        assert!((0..3).all(|i| (found[i] / truth[i] - 1.0).abs() < 0.1), "{seed}: {found:?}");
    }
}
