//! Effects across the boundary: in C and in Rust they keep the promises of built-in ones, and compute the same.

use crate::support;

use serde::{Deserialize, Serialize};
use support::{compile, has_c_compiler, model, registry, rust_example, table};
use wheelwright_core::conformance::check_effect;
use wheelwright_core::dataset::{Dataset, Stretch};
use wheelwright_core::effect::{EffectParameter, EffectSimulator, Estimate, Instant, Scene, Stage, Start};
use wheelwright_core::{Effect, RegressorModel};
use wheelwright_plugin::Registry;

const THETA: [f64; 4] = [0.3, 0.9, 0.2, 1.1];

/// Commands that change at every sample, from an uneven grid of numbers.
fn data(model: &dyn RegressorModel) -> Dataset {
    let time: Vec<f64> = (0..400).map(|k| 3.0 + 0.05 * f64::from(k)).collect();
    let wave = |a: f64, b: f64| (0..400).map(|k| (a * f64::from(k)).sin() + 0.4 * (b * f64::from(k)).cos()).collect::<Vec<f64>>();
    let inputs = vec![wave(0.13, 0.71), wave(0.09, 0.57)];
    let stretch = Stretch { label: String::new(), time, outputs: inputs.clone(), inputs };
    Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![stretch] }
}

fn run(model: &dyn RegressorModel, scene: &Scene, stretch: &Stretch, effects: &[&dyn Effect], values: &[f64]) -> Vec<Vec<f64>> {
    let mut simulator = EffectSimulator::new(model, &THETA, effects, scene).unwrap();
    simulator.set(&THETA, values).unwrap();
    simulator.set_substeps(2);
    let mut out = vec![Vec::new(); 2];
    simulator.run(0, stretch, &[0.1, -0.2], &mut out).unwrap();
    out
}

fn effect(registry: &Registry, text: &str) -> Box<dyn Effect> {
    registry.effect(table(text)).unwrap()
}

/// The C example's equation once more.
#[derive(Debug, Serialize, Deserialize)]
struct Cubic {}

#[typetag::serde(name = "cubic-drag-of-a-test")]
impl Effect for Cubic {
    fn name(&self) -> &str {
        "cubic-drag-of-a-test"
    }
    fn about(&self) -> String {
        "drag".to_owned()
    }
    fn stage(&self) -> Stage {
        Stage::Load
    }
    fn parameters(&self, _scene: &Scene) -> Vec<EffectParameter> {
        vec![EffectParameter::new("a", "1", (0.0, 9.0), 1.0), EffectParameter::new("b", "1", (0.0, 9.0), 1.0)]
    }
    fn starts(&self, _scene: &Scene) -> Vec<Start> {
        Vec::new()
    }
    fn statement(&self, _values: &[Estimate], _scene: &Scene) -> String {
        String::new()
    }
    fn excitation(&self) -> &'static str {
        "any"
    }
    fn load(&self, p: &[f64], _at: &Instant<'_>, outputs: &[f64], _state: &[f64], load: &mut [f64]) {
        load.iter_mut().zip(p).zip(outputs).for_each(|((l, p), y)| *l += p * y * y * y);
    }
}

#[test]
fn the_example_effect_in_c_computes_as_a_built_in() {
    if !has_c_compiler() {
        return;
    }
    let registry = registry(&compile("examples/plugins/c/effect.c", &[], "effect_c"));
    let drag = effect(&registry, "type = \"c_cubic_drag\"");
    assert_eq!(check_effect(&*drag), Ok(()));
    let rust = support::registry(&rust_example());
    let model = model(&rust, "type = \"lag\"").unwrap();
    let data = data(&*model);
    let scene = Scene::new(&data, &*model, 0.34, None, None);
    let stretch = &data.stretches[0];
    let values = [0.3, 0.7];
    let own = run(&*model, &scene, stretch, &[&*drag], &values);
    assert_eq!(own, run(&*model, &scene, stretch, &[&Cubic {}], &values));
    assert_ne!(own, run(&*model, &scene, stretch, &[], &[]));
    let label: Vec<_> = drag.parameters(&scene).into_iter().map(|p| (p.name, p.unit, p.label)).collect();
    let of = |unit: &str, output: &str| ("drag".to_owned(), unit.to_owned(), Some(("output", output.to_owned())));
    assert_eq!(label, [of("m/s per cubed m/s", "v"), of("rad/s per cubed rad/s", "omega")]);
    let said = drag.statement(&[Estimate { value: 0.3, ci95: None }, Estimate { value: 0.7, ci95: Some((0.6, 0.8)) }], &scene);
    assert_eq!(
        said,
        "a drag grows with the cube of speed: 0.3 m/s per cubed m/s, 0.7 (0.6 to 0.8) rad/s per cubed rad/s; the model had none"
    );
    let error = registry.effect(table("type = \"c_cubic_drag\"\nfast = true")).unwrap_err();
    assert_eq!(error.path, "fast");
    let error = registry.effect(table("type = \"c_cubic_dreg\"")).unwrap_err();
    assert!(error.message.contains("did you mean \"c_cubic_drag\"?"), "{error}");
}

#[test]
fn the_example_effect_in_rust_sees_the_stretch_and_keeps_its_state() {
    let registry = registry(&rust_example());
    let bus = effect(&registry, "type = \"bus_period\"");
    assert_eq!(check_effect(&*bus), Ok(()));
    assert_eq!((bus.family(), bus.stage(), bus.confusions()[0].with), ("lateness", Stage::Transport, "command_delay"));
    let model = model(&registry, "type = \"lag\"").unwrap();
    let data = data(&*model);
    let scene = Scene::new(&data, &*model, 0.34, None, None);
    // A bus that ticks with every third sample passes every third command.
    let mut third = data.stretches[0].clone();
    for column in &mut third.inputs {
        *column = (0..column.len()).map(|k| column[k / 3 * 3]).collect();
    }
    let own = run(&*model, &scene, &data.stretches[0], &[&*bus], &[0.15]);
    let plain = run(&*model, &scene, &third, &[], &[]);
    let worst = own.iter().flatten().zip(plain.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-12, "{worst}");
    let short = effect(&registry, "type = \"bus_period\"\nlongest = 0.12");
    assert_eq!(short.parameters(&scene)[0].bounds, (0.0, 0.12));
    assert_eq!(serde_json::to_value(&*short as &dyn Effect).unwrap(), serde_json::json!({"bus_period": {"longest": 0.12}}));
}

/// Each run over another stretch finds its own commands, from many threads at once.
#[test]
fn runs_over_different_stretches_do_not_mix() {
    let registry = registry(&rust_example());
    let bus = effect(&registry, "type = \"bus_period\"");
    let model = model(&registry, "type = \"lag\"").unwrap();
    let data = data(&*model);
    let scene = Scene::new(&data, &*model, 0.34, None, None);
    let variant = |n: usize| {
        let mut stretch = data.stretches[0].clone();
        stretch.inputs.iter_mut().flatten().for_each(|u| *u *= 1.0 + 0.1 * n as f64);
        stretch
    };
    let alone: Vec<_> = (0..4).map(|n| run(&*model, &scene, &variant(n), &[&*bus], &[0.2])).collect();
    std::thread::scope(|scope| {
        for (n, expected) in alone.iter().enumerate() {
            let (bus, model, scene) = (&bus, &model, &scene);
            scope.spawn(move || {
                for _ in 0..20 {
                    assert_eq!(run(&**model, scene, &variant(n), &[&**bus], &[0.2]), *expected);
                }
            });
        }
    });
}
