//! Tests of the proving ground. One program, because each costs its build.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs, unreachable_pub, reason = "a test that cannot go on fails")]

mod common;
mod firmware;
mod physics;
mod program;
mod referee;
mod sets;
