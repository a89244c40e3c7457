//! `track` on a robot from a library that writes down what it is told, in real time: data that freeze, a driver that hangs, a model that
//! hangs inside the controller.

use crate::library::compile;
use crate::machine::undisturbed;
use crate::signals::{COURSE, Driving, TRACK, readable};
use crate::{CYCLES, STRIKE, line};

const ROBOT: &str = r#"
[robot]
type = "scribe"

[model]
type = "two-lags"
theta = [0.1, 1.0, 0.1, 1.0]

[limits]
deadline = 2.0
"#;

/// Period of the robot \[s\].
const PERIOD: f64 = 0.05;
/// What it writes down when it is told to stand.
const STAND: &str = "0 0";
/// Time that frozen data are let pass \[s\].
const PATIENCE: f64 = 0.5;

/// Tracks until what the library was compiled for goes wrong. Gives what the robot was told.
fn tracked_until(define: &str, says: &str) -> Option<Vec<String>> {
    let place = tempfile::tempdir().unwrap();
    let library = place.path().join("libscribe.so");
    if !compile("tests/faults/robot.c", &[define], &library) {
        return None;
    }
    let config = format!("[[plugin]]\npath = '{}'\n{ROBOT}{COURSE}", library.display());
    let mut driving = Driving::start_with(&config, TRACK, "", "");
    let (status, said) = driving.wait();
    assert_eq!(status.code(), Some(5), "{define}: {said}");
    assert!(said.contains(says), "{define}: {said}");
    let told = std::fs::read_to_string(driving.folder.path().join("told")).unwrap();
    let told: Vec<String> = told.lines().map(str::to_owned).collect();
    let commands = told.iter().filter(|told| !["stop", STAND].contains(&told.as_str())).count();
    let rows = readable(&driving.out);
    assert!(rows >= STRIKE && rows <= commands + 1, "{define}: {rows} rows, {commands} commands");
    line(&format!("{define}, track"), commands - STRIKE, rows, said.trim());
    Some(told)
}

/// No command follows a stop, and it came in time; until then it may be told to stand.
fn stopped_after(told: &[String], commands: usize) {
    let first = told.iter().position(|told| told == "stop").unwrap();
    let moved = told[..first].iter().rposition(|told| told != STAND).map_or(0, |last| last + 1);
    assert!(moved <= commands, "told to stop after {moved} commands: {told:?}");
    assert!(told[first..].iter().all(|told| told == "stop"), "commanded after a stop: {told:?}");
}

#[test]
fn data_that_freeze_while_tracking_stop_the_robot() {
    undisturbed(frozen);
}

fn frozen() {
    let Some(told) = tracked_until("FREEZE", "nothing measured has changed since") else { return };
    stopped_after(&told, STRIKE + (PATIENCE / PERIOD) as usize + CYCLES);
}

#[test]
fn a_driver_that_hangs_while_tracking_is_told_to_stop_beside_its_call() {
    undisturbed(hung);
}

fn hung() {
    let Some(told) = tracked_until("HANG", "the call of `step` has not returned; the robot was told to stop") else { return };
    stopped_after(&told, STRIKE);
}

/// The hanging thread cannot be called back: the robot is told to stop beside it, and then the program ends.
#[test]
fn a_model_that_hangs_in_the_controller_leaves_a_robot_that_was_told_to_stop() {
    undisturbed(hung_in_the_law);
}

fn hung_in_the_law() {
    let Some(told) = tracked_until("HANG_LAW", "the program ends so that the link goes down") else { return };
    assert!(told.iter().any(|told| told == STAND), "told to stand before it was told to stop: {told:?}");
    stopped_after(&told, STRIKE);
}
