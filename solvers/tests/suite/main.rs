//! Tests of the estimators. One program, because each costs its build.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs, unreachable_pub, reason = "a test that cannot go on fails")]

mod behaviour;
mod common;
mod iv;
mod notes;
mod numerics;
mod output_error;
mod recursive;
mod reference;
mod robust;
