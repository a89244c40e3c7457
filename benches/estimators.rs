//! What the estimators cost: a sub-step of the free run, a sample of the recursive estimator, the default fit of 150 s at 20 Hz.
//!
//! The recording is made here: the robot of `benches/peers/make_data.py`, so that `benches/peers/output_error.py` fits the same.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use rand_distr::StandardNormal;
use wheelwright::core::simulation::Simulator;
use wheelwright::core::{ModelConfig, Stretch};
use wheelwright::prelude::*;
use wheelwright::solvers::Recursive;

const THETA: [f64; 6] = [0.2604, 0.2509, -0.0004, 0.9965, 0.0026, 1.0768];

/// 3000 rows at 20 Hz under the sines that drove the Pioneer of the thesis, with white noise of 0.005.
fn recording(model: &dyn RegressorModel) -> Option<Dataset> {
    let time: Vec<f64> = (0..3000).map(|k| 0.05 * f64::from(k)).collect();
    let sines = |t: f64, rates: [f64; 4]| rates.iter().map(|r| (r * t).sin()).sum::<f64>();
    let inputs = vec![
        time.iter().map(|t| 0.4 + 0.1 * sines(*t, [2.0, 1.0, 1.0 / 3.0, 1.0 / 11.0])).collect(),
        time.iter().map(|t| 0.75 + 0.25 * sines(*t, [1.5, 1.0, 0.5, 0.2])).collect(),
    ];
    let mut stretch = Stretch { label: "0".to_owned(), outputs: vec![vec![0.0; time.len()]; 2], time, inputs };
    let mut outputs = vec![Vec::new(), Vec::new()];
    Simulator::new(model, &THETA).ok()?.run(&stretch, &[0.0, 0.0], &mut outputs).ok()?;
    let mut random = StdRng::seed_from_u64(1);
    outputs.iter_mut().flatten().for_each(|x| *x += 0.005 * random.sample::<f64, _>(StandardNormal));
    stretch.outputs = outputs;
    Some(Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![stretch] })
}

fn estimators(criterion: &mut Criterion) {
    let Some((model, data)) = VwPdConfig::default().build().ok().and_then(|m| recording(&*m).map(|d| (m, d))) else { return };
    let stretch = &data.stretches[0];

    let mut group = criterion.benchmark_group("free_run");
    group.throughput(Throughput::Elements(stretch.len() as u64 - 1));
    let Ok(simulator) = Simulator::new(&*model, &THETA) else { return };
    let mut simulator = simulator.with_max_step(0.05);
    let mut run = vec![Vec::new(), Vec::new()];
    group.bench_function("3000_steps", |b| b.iter(|| black_box(simulator.run(stretch, &[0.0, 0.0], &mut run).is_ok())));
    group.finish();

    let mut group = criterion.benchmark_group("online");
    group.throughput(Throughput::Elements(stretch.len() as u64));
    for (name, refine) in [("regression", false), ("with_intervals", true)] {
        let settings = Recursive { refine, ..Recursive::default() };
        group.bench_function(name, |b| {
            b.iter(|| {
                let Ok(mut estimator) = settings.start(&*model, &model.map()) else { return 0 };
                let rows = stretch.time.iter().enumerate().filter(|(k, t)| {
                    let (u, x) = (&stretch.inputs, &stretch.outputs);
                    estimator.push(**t, &[u[0][*k], u[1][*k]], &[x[0][*k], x[1][*k]])
                });
                black_box(rows.count())
            });
        });
    }
    group.finish();

    let mut group = criterion.benchmark_group("output_error");
    group.sample_size(20);
    group.bench_function("3000_samples_with_intervals", |b| {
        b.iter(|| black_box(OutputError::default().solve(&Problem::new(&*model, &data)).is_ok()))
    });
    group.finish();
}

criterion_group!(benches, estimators);
criterion_main!(benches);
