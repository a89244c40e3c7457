//! A simulation with effects allocates nothing while it steps, whatever effects they are.

#![allow(clippy::unwrap_used)]

#[path = "suite/common/mod.rs"]
mod common;
#[path = "../../core/tests/support/counting.rs"]
mod counting;

use common::{HALF_TRACK, THETA, data, model};
use counting::allocations;
use wheelwright_core::Effect;
use wheelwright_core::effect::{EffectSimulator, Scene};
use wheelwright_diagnosis::effects::library;

#[test]
fn stepping_allocates_nothing() {
    let model = model();
    let data = data(&*model);
    let scene = Scene::new(&data, &*model, 2.0 * HALF_TRACK, Some(0.09), None);
    for effect in library().iter().filter(|e| e.inapplicable(&scene).is_none()) {
        let effects: [&dyn Effect; 1] = [&**effect];
        let mut simulator = EffectSimulator::new(&*model, &THETA, &effects, &scene).unwrap();
        if let Some(start) = effect.starts(&scene).into_iter().next() {
            simulator.set(&THETA, &start.values).unwrap();
        }
        simulator.set_substeps(2);
        let mut run = vec![Vec::new(); 2];
        let mut count = |run: &mut Vec<Vec<f64>>| allocations(|| simulator.run(0, &data.stretches[0], &[0.3, 0.2], run).unwrap());
        // The first run makes room for its results and, for sensors, its past.
        count(&mut run);
        assert_eq!(count(&mut run), 0, "{effect:?}");
    }
}
