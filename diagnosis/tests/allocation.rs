//! A simulation with effects allocates nothing while it steps, whatever effects they are.

#![allow(clippy::unwrap_used)]
#![allow(unsafe_code, reason = "an allocator that counts is unsafe to write; it hands everything on to the system's")]

#[path = "suite/common/mod.rs"]
mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use common::{HALF_TRACK, THETA, data, model};
use wheelwright_core::Effect;
use wheelwright_core::effect::{EffectSimulator, Scene};
use wheelwright_diagnosis::effects::library;

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call is handed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = ALLOCATIONS.try_with(|count| count.set(count.get() + 1));
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

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
        let mut count = |run: &mut Vec<Vec<f64>>| {
            let before = ALLOCATIONS.get();
            simulator.run(0, &data.stretches[0], &[0.3, 0.2], run).unwrap();
            ALLOCATIONS.get() - before
        };
        // The first run makes room for its results and, for sensors, its past.
        count(&mut run);
        assert_eq!(count(&mut run), 0, "{effect:?}");
    }
    let boxed = Box::new(ALLOCATIONS.get());
    assert_eq!(ALLOCATIONS.get() - *boxed, 1, "the counter counts");
}
