//! A slope under a robot that begins each recording facing another way.

use wheelwright_core::ModelConfig;
use wheelwright_core::effect::{EffectSimulator, Scene};
use wheelwright_diagnosis::effects::{Slope, library};
use wheelwright_diagnosis::{Question, Verdict, diagnose};
use wheelwright_models::VwPdConfig;

use super::drive::{Drive, blur};

const THETA: [f64; 6] = [0.26, 0.19, 0.01, 1.02, 0.05, 1.05];
const TRACK: f64 = 0.34;

#[test]
fn where_no_heading_is_measured_or_an_odometry_tells_it_a_recording_begins_at_any() {
    let model = VwPdConfig::default().build().unwrap();
    // Uphill lies ahead at first, and to the left behind when the second recording begins.
    let [there, elsewhere] = [0.0_f64, 2.4].map(|uphill| [0.06 * uphill.cos(), 0.06 * uphill.sin(), 0.0, 0.0]);
    let drive = |seed| Drive { samples: 1500, change: 0.03, forward: -0.3..0.5, turning: -0.9..0.9, seed };
    let [training, held] = [(1, there), (2, elsewhere)].map(|(seed, values)| {
        let (mut data, mut random) = drive(seed).driven(&*model, &THETA, TRACK, &Slope::default(), &values);
        // The slope acts by the heading that comes of it.
        for _ in 0..8 {
            let scene = Scene::new(&data, &*model, TRACK, None, None);
            let slope = Slope::default();
            let mut simulator = EffectSimulator::new(&*model, &THETA, &[&slope], &scene).unwrap();
            simulator.set(&THETA, &values).unwrap();
            simulator.set_substeps(8);
            let mut run = vec![Vec::new(); 2];
            simulator.run(0, &data.stretches[0], &[0.0, 0.0], &mut run).unwrap();
            data.stretches[0].outputs = run;
        }
        blur(&mut data, [0.008, 0.02], &mut random);
        data
    });
    let all = library();
    let mut question = Question::new(&*model, &training, &all);
    (question.track_width, question.experiment, question.held_out) = (Some(TRACK), false, Some(&held));
    let odometry = |data| vec![Scene::new(data, &*model, TRACK, None, None).tracks[0].heading.clone()];
    for headings in [None, Some([&training, &held].map(odometry))] {
        [question.training_headings, question.held_out_headings] = headings.map_or([None, None], |h| h.map(Some));
        let answer = diagnose(&question).unwrap();
        assert_eq!((answer.verdict, answer.effects.len()), (Verdict::Explained, 1), "{}", answer.headline);
        assert_eq!(answer.effects[0].name, "slope");
        let ceiling = answer.fit.noise_ceiling.unwrap();
        assert!(answer.fit.after.iter().zip(&ceiling).all(|(after, most)| most - after < 0.3), "{:?} {ceiling:?}", answer.fit.after);
    }
}
