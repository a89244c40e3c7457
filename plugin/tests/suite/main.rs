//! Tests of the plugin boundary. One program, because each costs its build.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs, unreachable_pub, reason = "a test that cannot go on fails")]

mod c_plugins;
mod checking;
mod effects;
mod loading;
mod rust_plugins;
mod support;
