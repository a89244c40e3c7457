//! How wheels stand is known better once what took the base model away was found.

use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use wheelwright_core::effect::{Effect, EffectSimulator, Scene};
use wheelwright_core::{Dataset, ModelConfig, RegressorModel, Stretch};
use wheelwright_diagnosis::effects::{Ripple, VelocitySaturation, Wheel, WheelEccentricity};
use wheelwright_diagnosis::{Question, diagnose};
use wheelwright_models::VwPdConfig;

const THETA: [f64; 6] = [0.26, 0.19, 0.01, 1.02, 0.05, 1.05];
const HALF_TRACK: f64 = 0.17;
const RADIUS: f64 = 0.09;

/// Steps of two seconds each on average, many of them beyond the limit of the wheels' commands, and a left wheel whose encoder is off its centre.
fn clipped_and_rippling(model: &dyn RegressorModel) -> Dataset {
    let mut random = StdRng::seed_from_u64(7);
    let (mut stamps, mut v, mut w) = (vec![0.0], vec![0.0], vec![0.0]);
    while stamps.len() < 2000 {
        stamps.push(stamps[stamps.len() - 1] + 0.05);
        let change = random.random_bool(0.025);
        v.push(if change { random.random_range(0.1..1.2) } else { v[v.len() - 1] });
        w.push(if change { random.random_range(-0.4..0.4) } else { w[w.len() - 1] });
    }
    let stretch = Stretch { label: "1".to_owned(), outputs: vec![v.clone(), w.clone()], inputs: vec![v, w], time: stamps };
    let mut data = Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![stretch] };
    let scene = Scene::new(&data, model, 2.0 * HALF_TRACK, None, None);
    let limit = VelocitySaturation::default();
    let mut simulator = EffectSimulator::new(model, &THETA, &[&limit as &dyn Effect], &scene).unwrap();
    simulator.set(&THETA, &[0.6]).unwrap();
    simulator.set_substeps(8);
    let mut run = vec![Vec::new(); 2];
    simulator.run(0, &data.stretches[0], &[0.0, 0.0], &mut run).unwrap();
    let mut angle = 0.3;
    for k in 0..run[0].len() {
        let (left, right) = (run[0][k] - HALF_TRACK * run[1][k], run[0][k] + HALF_TRACK * run[1][k]);
        angle += 0.05 * left / RADIUS;
        let left = left * (1.0 + 0.015 * f64::cos(angle));
        let noise: [f64; 2] = [StandardNormal.sample(&mut random), StandardNormal.sample(&mut random)];
        (run[0][k], run[1][k]) = (0.5 * (left + right) + 0.004 * noise[0], (right - left) / (2.0 * HALF_TRACK) + 0.01 * noise[1]);
    }
    data.stretches[0].outputs = run;
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
