//! One step of the adaptive controller on a dithered figure-eight, trajectory included: at most a microsecond.

use std::hint::black_box;
use std::sync::Arc;

use criterion::{Criterion, criterion_group, criterion_main};
use wheelwright_controllers::AdaptiveConfig;
use wheelwright_controllers::trajectory::FigureEight;
use wheelwright_core::ModelConfig;
use wheelwright_core::controller::{ControllerConfig, Observation, Subject};
use wheelwright_core::trajectory::{Envelope, TrajectoryConfig};
use wheelwright_models::VwPdConfig;

const CONTROLLER: &str = "k = [0.5, 0.5, 0.5]\nkv = 2.0\nkw = 2.0\ngamma = 1.0\nprojection = { relative = 0.5 }";
const TRAJECTORY: &str = "ax = 1.0\nay = 1.0\nfrequency = 0.1\ndither = { amplitude = 0.003, h = 4.0, k = 2.0, direction = 'thesis' }";

fn step(criterion: &mut Criterion) {
    let Ok(trajectory) = toml::from_str::<FigureEight>(TRAJECTORY) else { return };
    let Ok(trajectory) = trajectory.build(&Envelope::default()) else { return };
    let Ok(controller) = toml::from_str::<AdaptiveConfig>(CONTROLLER) else { return };
    let Ok(model) = VwPdConfig::default().build() else { return };
    let theta = vec![0.2604, 0.2509, -0.0004, 0.9965, 0.0026, 1.0768];
    let subject = Subject {
        model: Arc::from(model),
        theta,
        intervals: vec![None; 6],
        own: None,
        period: 0.02,
        envelope: Envelope::default(),
        course: Vec::new(),
    };
    let Ok(mut controller) = controller.build(&subject) else { return };
    let (mut t, mut command) = (0.0, [0.0; 2]);
    criterion.bench_function("adaptive step with trajectory", |b| {
        b.iter(|| {
            t += 0.02;
            let now = Observation { t, reference: trajectory.at(t), pose: [0.1, 0.2, 0.3], outputs: &[0.2, 0.1] };
            controller.step(black_box(&now), &mut command);
            black_box(command)
        });
    });
}

criterion_group!(benches, step);
criterion_main!(benches);
