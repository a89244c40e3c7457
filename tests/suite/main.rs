//! Tests of the program. One program, because each costs its build.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs, unreachable_pub, reason = "a test that cannot go on fails")]

mod bad_input;
mod broken_plugins;
mod cli;
mod control;
mod diagnose;
mod emulate;
mod library;
mod machine;
mod plugins;
mod recording;
