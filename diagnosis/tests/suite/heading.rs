//! Ground that slopes under a robot that begins each recording facing another way, or at another place.

use wheelwright_core::effect::{EffectSimulator, Scene};
use wheelwright_core::{Dataset, ModelConfig};
use wheelwright_diagnosis::effects::{Slope, library};
use wheelwright_diagnosis::{Question, Verdict, diagnose};
use wheelwright_models::VwPdConfig;

use super::drive::{Drive, blur};

const THETA: [f64; 6] = [0.26, 0.19, 0.01, 1.02, 0.05, 1.05];
const TRACK: f64 = 0.34;

/// A recording on ground that slopes, with noise.
fn over(slope: &Slope, values: &[f64], samples: usize, seed: u64) -> Dataset {
    let model = VwPdConfig::default().build().unwrap();
    let drive = Drive { samples, change: 0.03, forward: -0.3..0.5, turning: -0.9..0.9, seed };
    let (mut data, mut random) = drive.driven(&*model, &THETA, TRACK, slope, values);
    // The slope acts by the heading and the place that come of it.
    for _ in 0..8 {
        let scene = Scene::new(&data, &*model, TRACK, None, None);
        let mut simulator = EffectSimulator::new(&*model, &THETA, &[slope], &scene).unwrap();
        simulator.set(&THETA, values).unwrap();
        simulator.set_substeps(8);
        let mut run = vec![Vec::new(); 2];
        simulator.run(0, &data.stretches[0], &[0.0, 0.0], &mut run).unwrap();
        data.stretches[0].outputs = run;
    }
    blur(&mut data, [0.008, 0.02], &mut random);
    data
}

#[test]
fn where_no_heading_is_measured_or_an_odometry_tells_it_a_recording_begins_at_any() {
    let model = VwPdConfig::default().build().unwrap();
    // Uphill lies ahead at first, and to the left behind when the second recording begins.
    let [there, elsewhere] = [0.0_f64, 2.4].map(|uphill| [0.06 * uphill.cos(), 0.06 * uphill.sin(), 0.0, 0.0]);
    let slope = Slope::default();
    let [training, held] = [(1, there), (2, elsewhere)].map(|(seed, values)| over(&slope, &values, 1500, seed));
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

#[test]
fn ground_in_waves_is_found_with_their_length_and_direction() {
    let model = VwPdConfig::default().build().unwrap();
    let (waves, wave) = (Slope { waves: true }, [0.9_f64, -1.3_f64]);
    // The second recording begins at another place.
    let [training, held] = [(3, 0.4), (4, -1.1)].map(|(seed, phase)| over(&waves, &[0.08, wave[0], wave[1], phase, 0.0, 0.0], 2500, seed));
    let all = library();
    let mut question = Question::new(&*model, &training, &all);
    (question.track_width, question.experiment, question.held_out) = (Some(TRACK), false, Some(&held));
    let answer = diagnose(&question).unwrap();
    let names: Vec<&str> = answer.effects.iter().map(|e| e.name.as_str()).collect();
    assert_eq!((answer.verdict, &*names), (Verdict::Explained, &["slope"][..]), "{} {:?}", answer.headline, answer.warnings);
    let found = &answer.effects[0];
    let away = |found: &[f64], sign: f64| (0..2).map(|i| (sign * found[1 + i] - wave[i]).powi(2)).sum::<f64>().sqrt();
    let off = away(&found.values, 1.0).min(away(&found.values, -1.0));
    assert!(off < 0.05 * wave[0].hypot(wave[1]), "{:?}", found.values);
    assert!((found.values[0].abs() / 0.08 - 1.0).abs() < 0.1, "{:?}", found.values);
}
