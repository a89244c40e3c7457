//! A sample taken in by the recursive estimator allocates nothing, from the first to the last.

#![allow(clippy::unwrap_used)]
#![allow(unsafe_code, reason = "an allocator that counts is unsafe to write; it hands everything on to the system's")]

#[path = "suite/common/mod.rs"]
mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use common::{PIONEER, pioneer_reference, record, times, vw_pd};
use wheelwright_solvers::Recursive;

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
fn a_sample_allocates_nothing() {
    let model = vw_pd();
    let data = record(PIONEER, times(0.1, 1500), pioneer_reference, 0.01);
    let stretch = &data.stretches[0];
    for memory_s in [None, Some(20.0)] {
        let mut estimator = Recursive { memory_s, ..Recursive::default() }.start(&*model, &model.map()).unwrap();
        let (mut theta, mut std) = ([0.0; 6], [0.0; 6]);
        let before = ALLOCATIONS.get();
        for (k, time) in stretch.time.iter().enumerate() {
            estimator.push(*time, &[stretch.inputs[0][k], stretch.inputs[1][k]], &[stretch.outputs[0][k], stretch.outputs[1][k]]);
            estimator.estimate(&mut theta, &mut std);
        }
        assert_eq!(ALLOCATIONS.get() - before, 0);
        assert!(std.iter().all(|s| s.is_finite()), "the free run was part of it: {std:?}");
    }
    let boxed = Box::new(ALLOCATIONS.get());
    assert_eq!(ALLOCATIONS.get() - *boxed, 1, "the counter counts");
}
