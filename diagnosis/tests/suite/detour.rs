//! A time of change is found although the likelihood has a maximum for every acceleration.

use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use wheelwright_core::effect::{Effect, EffectSimulator, Scene};
use wheelwright_core::{Dataset, ModelConfig, RegressorModel, Stretch};
use wheelwright_diagnosis::effects::PayloadChange;
use wheelwright_diagnosis::{Question, diagnose};
use wheelwright_models::VwPdConfig;

const THETA: [f64; 6] = [0.26, 0.19, 0.01, 1.02, 0.05, 1.05];

/// 65 s of steps, a second each on average, with a load from `time` on and noise of 1 %.
fn loaded(model: &dyn RegressorModel, time: f64, seed: u64) -> Dataset {
    let mut random = StdRng::seed_from_u64(seed);
    let (mut stamps, mut v, mut w) = (vec![0.0], vec![0.0], vec![0.0]);
    while stamps.len() < 1300 {
        stamps.push(stamps[stamps.len() - 1] + 0.05);
        let change = random.random_bool(0.05);
        v.push(if change { random.random_range(-0.4..0.6) } else { v[v.len() - 1] });
        w.push(if change { random.random_range(-1.2..1.2) } else { w[w.len() - 1] });
    }
    let stretch = Stretch { label: "1".to_owned(), outputs: vec![v.clone(), w.clone()], inputs: vec![v, w], time: stamps };
    let mut data = Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![stretch] };
    let scene = Scene::new(&data, model, 0.34, None, None);
    let payload = PayloadChange::default();
    let mut simulator = EffectSimulator::new(model, &THETA, &[&payload as &dyn Effect], &scene).unwrap();
    simulator.set(&THETA, &[time, 0.3, 0.3, 0.0]).unwrap();
    simulator.set_substeps(8);
    let mut run = vec![Vec::new(); 2];
    simulator.run(0, &data.stretches[0], &[0.0, 0.0], &mut run).unwrap();
    for (series, deviation) in run.iter_mut().zip([0.004, 0.012]) {
        series.iter_mut().for_each(|x| {
            let unit: f64 = StandardNormal.sample(&mut random);
            *x += deviation * unit;
        });
    }
    data.stretches[0].outputs = run;
    data
}

#[test]
fn the_time_of_a_load_is_found_past_other_maxima() {
    let model = VwPdConfig::default().build().unwrap();
    for (time, seed) in [(50.3, 50), (44.9, 44), (13.1, 13)] {
        let data = loaded(&*model, time, seed);
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
