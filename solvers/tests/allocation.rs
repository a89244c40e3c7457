//! A sample taken in by the recursive estimator allocates nothing, from the first to the last.

#![allow(clippy::unwrap_used)]

#[path = "suite/common/mod.rs"]
mod common;
#[path = "../../core/tests/support/counting.rs"]
mod counting;

use common::{PIONEER, pioneer_reference, record, times, vw_pd};
use counting::allocations;
use wheelwright_solvers::Recursive;

#[test]
fn a_sample_allocates_nothing() {
    let model = vw_pd();
    let data = record(PIONEER, times(0.1, 1500), pioneer_reference, 0.01);
    let stretch = &data.stretches[0];
    for memory_s in [None, Some(20.0)] {
        let mut estimator = Recursive { memory_s, ..Recursive::default() }.start(&*model, &model.map()).unwrap();
        let (mut theta, mut std) = ([0.0; 6], [0.0; 6]);
        let made = allocations(|| {
            for (k, time) in stretch.time.iter().enumerate() {
                estimator.push(*time, &[stretch.inputs[0][k], stretch.inputs[1][k]], &[stretch.outputs[0][k], stretch.outputs[1][k]]);
                estimator.estimate(&mut theta, &mut std);
            }
        });
        assert_eq!(made, 0);
        assert!(std.iter().all(|s| s.is_finite()), "the free run was part of it: {std:?}");
    }
}
