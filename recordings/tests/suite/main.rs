//! Tests of the readers and writers. One program, because each costs its build.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs, unreachable_pub, reason = "a test that cannot go on fails")]

mod bags;
mod common;
mod csv;
mod damage;
mod json;
mod parquet;
mod record;
mod ros_clock;
mod ros_damage;
mod ros_files;
mod ros_folders;
mod wpilog;
