//! One step of the adaptive controller on a dithered figure-eight, without and with the drift by known noise taken out, and the
//! trajectory by itself: a microsecond is wanted for all of it.

use std::hint::black_box;
use std::sync::Arc;

use criterion::{Criterion, criterion_group, criterion_main};
use wheelwright_controllers::AdaptiveConfig;
use wheelwright_controllers::trajectory::FigureEight;
use wheelwright_core::ModelConfig;
use wheelwright_core::controller::{Controller, ControllerConfig, Observation, Subject};
use wheelwright_core::trajectory::{Envelope, TrajectoryConfig};
use wheelwright_models::VwPdConfig;

const CONTROLLER: &str = "k = [0.5, 0.5, 0.5]\nkv = 2.0\nkw = 2.0\ngamma = 1.0\nprojection = { relative = 0.5 }";
const TRAJECTORY: &str = "ax = 1.0\nay = 1.0\nfrequency = 0.1\ndither = { amplitude = 0.003, h = 4.0, k = 2.0, direction = 'thesis' }";

fn step(criterion: &mut Criterion) {
    let Ok(trajectory) = toml::from_str::<FigureEight>(TRAJECTORY) else { return };
    let Ok(trajectory) = trajectory.build(&Envelope::default()) else { return };
    let mut t = 0.0;
    let mut next = || {
        // A run has minutes: what a sine of a larger number costs is not asked.
        t = (t + 0.02) % 200.0;
        (t, trajectory.at(t))
    };
    criterion.bench_function("trajectory alone", |b| b.iter(|| black_box(next())));
    for (name, noise) in [("adaptive step with trajectory", ""), ("the same, noise known", "noise = [0.005, 0.005]")] {
        let Some(mut controller) = controller(&format!("{CONTROLLER}\n{noise}")) else { return };
        let mut command = [0.0; 2];
        criterion.bench_function(name, |b| {
            b.iter(|| {
                let (t, reference) = next();
                let now = Observation { t, reference, pose: [0.1, 0.2, 0.3], outputs: &[0.2, 0.1] };
                controller.step(black_box(&now), &mut command);
                black_box(command)
            });
        });
    }
}

fn controller(settings: &str) -> Option<Box<dyn Controller>> {
    let model = Arc::from(VwPdConfig::default().build().ok()?);
    let theta = vec![0.2604, 0.2509, -0.0004, 0.9965, 0.0026, 1.0768];
    let (intervals, envelope, course) = (vec![None; 6], Envelope::default(), Vec::new());
    let subject = Subject { model, theta, intervals, own: None, period: 0.02, envelope, course };
    toml::from_str::<AdaptiveConfig>(settings).ok()?.build(&subject).ok()
}

criterion_group!(benches, step);
criterion_main!(benches);
