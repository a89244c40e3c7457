//! What a step of the free-run simulation costs with no, one and two effects, and what carrying tangents along all parameters adds.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use wheelwright_core::effect::{Direction, EffectSimulator, Scene};
use wheelwright_core::{Dataset, Effect, ModelConfig, Stretch};
use wheelwright_diagnosis::effects::{Backlash, CastorDrag, CommandDelay, CoulombFriction, SlewLimit, SlipLaw, WheelSlip};
use wheelwright_models::VwPdConfig;

const THETA: [f64; 6] = [0.26, 0.19, -0.01, 1.02, 0.05, 1.05];
/// 150 s at 20 Hz.
const ROWS: usize = 3000;
const SUBSTEPS: usize = 2;

/// Held steps in both directions, at even times.
fn stretch() -> Stretch {
    let fraction = |seed: usize| 2.0 * (seed as f64 * 0.618_033_988_749_894_9).fract() - 1.0;
    let column = |size: f64, offset: usize| (0..ROWS).map(|k| size * fraction(1 + k / 15 + offset)).collect::<Vec<f64>>();
    let inputs = vec![column(0.5, 0), column(1.0, 71)];
    Stretch { label: String::new(), time: (0..ROWS).map(|k| 0.05 * k as f64).collect(), outputs: inputs.clone(), inputs }
}

/// Along each parameter of the model, and of forces.
fn directions(simulator: &EffectSimulator<'_>, values: &[f64], stretch: &Stretch) -> Vec<Direction> {
    let all = [&THETA[..], values].concat();
    let carried = (0..all.len()).filter(|j| j.checked_sub(THETA.len()).is_none_or(|value| simulator.has_tangent(value, stretch)));
    let along = |j: usize| {
        let (mut there, by) = (all.clone(), 1e-3);
        there[j] += by;
        Direction { theta: there[..THETA.len()].to_vec(), values: there[THETA.len()..].to_vec(), by }
    };
    carried.map(along).collect()
}

fn stepping(criterion: &mut Criterion) {
    let Ok(model) = VwPdConfig::default().build() else { return };
    let data = Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![stretch()] };
    let scene = Scene::new(&data, &*model, 0.34, None, None);
    let (friction, delay, slew) = (CoulombFriction::default(), CommandDelay::default(), SlewLimit::default());
    let (creep, grip) = (WheelSlip { law: SlipLaw::Creep }, WheelSlip { law: SlipLaw::Grip });
    let (castor, play) = (CastorDrag::default(), Backlash { at_motor: true, ..Backlash::default() });
    let cases: [(&str, Vec<&dyn Effect>, Vec<f64>); 9] = [
        ("none", vec![], vec![]),
        ("friction", vec![&friction], vec![0.03, 1.0]),
        ("delay", vec![&delay], vec![0.11]),
        ("ramp", vec![&slew], vec![1.0, 2.0]),
        ("creep", vec![&creep], vec![0.1, 0.02, 1.0]),
        ("grip", vec![&grip], vec![1.0, 0.1, 0.02, 1.0]),
        ("castor", vec![&castor], vec![0.02, 0.2, 0.05, 0.001, 0.001, 0.0, 1.0]),
        ("play", vec![&play], vec![0.004, 0.02, 0.0, 1.0]),
        ("delay and friction", vec![&delay, &friction], vec![0.11, 0.03, 1.0]),
    ];
    let mut group = criterion.benchmark_group("free_run_with_effects");
    // A delay cuts each interval in two: the time is that of the same recording all the same.
    group.throughput(Throughput::Elements((ROWS * SUBSTEPS) as u64));
    for (name, effects, values) in cases {
        let Ok(mut simulator) = EffectSimulator::new(&*model, &THETA, &effects, &scene) else { continue };
        simulator.set_substeps(SUBSTEPS);
        if simulator.set(&THETA, &values).is_err() {
            continue;
        }
        let mut run = vec![Vec::new(); 2];
        group.bench_function(BenchmarkId::from_parameter(name), |b| {
            b.iter(|| black_box(simulator.run(0, &data.stretches[0], &[0.0, 0.0], &mut run).is_ok()));
        });
        if simulator.has_tangents() {
            let directions = directions(&simulator, &values, &data.stretches[0]);
            group.bench_function(BenchmarkId::new(name, "with tangents"), |b| {
                b.iter(|| black_box(simulator.tangents(0, &data.stretches[0], &[0.0, 0.0], &directions, &mut run).is_ok()));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, stepping);
criterion_main!(benches);
