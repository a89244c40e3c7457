//! Tests of the effects and of the diagnosis. One program, because each costs its build.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs, unreachable_pub, reason = "a test that cannot go on fails")]

mod command_side;
mod common;
mod conformance;
mod course;
mod detour;
mod diagnose;
mod documentation;
mod drive;
mod dynamics;
mod elsewhere;
mod forward;
mod heading;
mod library;
mod measurement;
mod radii;
mod recorded;
mod rig;
mod rivals;
mod sensor_end;
mod slow;
mod sticking;
