//! What a whole diagnosis costs: 150 s at 20 Hz, the full library, one thread; with nothing hidden and with a command that is cut or comes late.
//!
//! What is hidden is done to the commands by hand, before the base model runs on them.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use rand_distr::StandardNormal;
use wheelwright::core::simulation::Simulator;
use wheelwright::core::{ModelConfig, Stretch};
use wheelwright::diagnosis::effects::library;
use wheelwright::diagnosis::{Question, diagnose};
use wheelwright::prelude::*;

const THETA: [f64; 6] = [0.2604, 0.2509, -0.0004, 0.9965, 0.0026, 1.0768];

/// Makes the commands that arrive of those that are sent.
type Arrival = fn(&[f64]) -> Vec<f64>;

/// 3000 rows at 20 Hz, forwards and backwards, with white noise of 0.005.
fn recording(model: &dyn RegressorModel, arrive: Arrival) -> Option<Dataset> {
    let time: Vec<f64> = (0..3000).map(|k| 0.05 * f64::from(k)).collect();
    let sines = |t: f64, rates: [f64; 4]| rates.iter().map(|r| (r * t).sin()).sum::<f64>();
    let inputs: Vec<Vec<f64>> = vec![
        time.iter().map(|t| 0.1 + 0.15 * sines(*t, [2.0, 1.0, 1.0 / 3.0, 1.0 / 11.0])).collect(),
        time.iter().map(|t| 0.3 * sines(*t, [1.5, 1.0, 0.5, 0.2])).collect(),
    ];
    let arrived = inputs.iter().map(|u| arrive(u)).collect();
    let mut stretch = Stretch { label: "0".to_owned(), outputs: vec![vec![0.0; time.len()]; 2], time, inputs: arrived };
    let mut outputs = vec![Vec::new(), Vec::new()];
    Simulator::new(model, &THETA).ok()?.run(&stretch, &[0.0, 0.0], &mut outputs).ok()?;
    let mut random = StdRng::seed_from_u64(1);
    outputs.iter_mut().flatten().for_each(|x| *x += 0.005 * random.sample::<f64, _>(StandardNormal));
    (stretch.outputs, stretch.inputs) = (outputs, inputs);
    Some(Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![stretch] })
}

/// Nothing of a small command arrives.
fn cut(u: &[f64]) -> Vec<f64> {
    u.iter().map(|u| u.signum() * (u.abs() - 0.05).max(0.0)).collect()
}

/// Commands arrive three samples late.
fn late(u: &[f64]) -> Vec<f64> {
    (0..u.len()).map(|k| if k < 3 { 0.0 } else { u[k - 3] }).collect()
}

fn diagnoses(criterion: &mut Criterion) {
    let Ok(model) = VwPdConfig::default().build() else { return };
    let library = library();
    let mut group = criterion.benchmark_group("diagnosis");
    group.sample_size(10);
    let hidden: [(&str, Arrival); 3] = [("nothing", <[f64]>::to_vec), ("dead_zone", cut), ("delay", late)];
    for (name, arrive) in hidden {
        let Some(data) = recording(&*model, arrive) else { return };
        let question = Question { track_width: Some(0.34), wheel_radius: Some(0.0975), ..Question::new(&*model, &data, &library) };
        group.bench_function(name, |b| b.iter(|| black_box(diagnose(&question).map(|d| d.verdict))));
    }
    group.finish();
}

criterion_group!(benches, diagnoses);
criterion_main!(benches);
