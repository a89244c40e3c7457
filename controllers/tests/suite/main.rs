//! Tests of the controllers and their trajectories. One program, because each costs its build.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs, unreachable_pub, reason = "a test that cannot go on fails")]

mod balance;
mod common;
mod conformance;
mod derivatives;
mod golden;
mod migration;
mod orderings;
mod sampled;
mod thesis;
