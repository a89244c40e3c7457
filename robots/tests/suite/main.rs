//! Tests of the drivers, the emulators and the simulator. One program, because each costs its build.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs, unreachable_pub, reason = "a test that cannot go on fails")]

mod common;
mod config;
mod emulated;
mod khepera_transcript;
#[path = "../../../tests/suite/machine.rs"]
mod machine;
mod measurement;
mod physics;
mod pioneer_packets;
mod pioneer_transcripts;
mod trajectory;
mod transcripts;
