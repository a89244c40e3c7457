//! From a wish to a recording to a model: `design`, `record`, `run --autonomous` as a user runs them.

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

fn wheelwright(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_wheelwright")).args(arguments).current_dir(env!("CARGO_MANIFEST_DIR")).output().unwrap()
}

fn json(arguments: &[&str]) -> Value {
    let output = wheelwright(&[arguments, &["--json"]].concat());
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Width of a parameter's interval.
fn width(document: &Value, name: &str) -> f64 {
    let all = document["parameters"].as_array().unwrap();
    let ci = &all.iter().find(|p| p["name"] == name).unwrap()["ci95"];
    ci[1].as_f64().unwrap() - ci[0].as_f64().unwrap()
}

#[test]
fn a_designed_drive_stays_on_its_floor_and_tells_what_was_wanted() {
    let folder = tempfile::tempdir().unwrap();
    let (designed, recorded) = (folder.path().join("designed"), folder.path().join("recorded"));
    // Ideal limits and noise alone, so that the drive is the one foreseen.
    let noise = ["--set", "robot.fidelity=ideal", "--set", "robot.sensors={ v_noise = 0.005, omega_noise = 0.02 }"];
    let design = json(&[&["design", "examples/record_floor.toml", "--out", text(&designed)], &noise[..]].concat());
    assert_eq!(design["schema"], "wheelwright.design/1");
    let duration = design["duration_s"].as_f64().unwrap();
    assert!(duration < 60.0, "{duration}");

    let config = designed.join("excitation.toml");
    let record = json(&[&["record", text(&config), "--out", text(&recorded)], &noise[..]].concat());
    assert!((record["duration_s"].as_f64().unwrap() - duration).abs() < 0.11, "{record}");
    assert_eq!(record["limits"].as_array().unwrap().len(), 0, "the design is within the limits: {record}");
    let rows = wheelwright::recordings::open(&recorded.join("recording.mcap"), &Default::default()).unwrap();
    for axis in ["x", "y"] {
        assert!(rows.column(axis).unwrap().iter().all(|p| p.abs() < 1.7), "{axis} leaves the floor less its margin");
    }

    let recording = recorded.join("recording.csv");
    let found = json(&["identify", text(&recording), "--quick", "--holdout", "0"]);
    for parameter in design["parameters"].as_array().unwrap() {
        let (name, foreseen) = (parameter["name"].as_str().unwrap(), parameter["width"].as_f64().unwrap());
        // The design reckons with 30 % held out, the fit holds out nothing; the robot is not quite the parameters designed about.
        let ratio = width(&found, name) / foreseen;
        assert!((0.5..1.3).contains(&ratio), "{name}: {ratio} of what was foreseen");
    }
}

#[test]
fn an_unattended_run_drives_until_it_knows_enough() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let found = json(&["run", "examples/record_autonomous.toml", "--autonomous", "--quick", "--out", text(&out)]);
    for name in ["theta1", "theta2", "theta4", "theta6"] {
        let value = found["parameters"].as_array().unwrap().iter().find(|p| p["name"] == name).unwrap()["value"].as_f64().unwrap();
        assert!(width(&found, name) <= 0.15 * value, "{name}");
    }
    let rounds = found["recordings"].as_array().unwrap();
    assert!(!rounds.is_empty() && out.join("model.toml").exists() && out.join("recording.csv").exists());
    let driven: f64 = rounds.iter().map(|r| r["duration_s"].as_f64().unwrap()).sum();
    assert!(driven <= 121.0, "{driven}");
}

#[test]
fn an_unattended_run_that_cannot_know_enough_says_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let short = ["--set", "autonomous.longest=20.0", "--set", "autonomous.round=10.0", "--set", "autonomous.width=0.0001"];
    let output =
        wheelwright(&[&["run", "examples/record_autonomous.toml", "--autonomous", "--quick", "--out", text(&out)], &short[..]].concat());
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(said.contains("theta1 is known to a width of") && out.join("model.toml").exists(), "{said}");
    assert!(out.join("recording-2.csv").exists(), "two rounds");
}

#[test]
fn impossible_limits_are_refused_before_anything_moves() {
    let folder = tempfile::tempdir().unwrap();
    for (setting, says) in [
        ("limits.v=-1", "`limits.v`: must be a positive number, not -1"),
        ("limits.floor.x=[1.0, 2.0]", "`limits.floor.x`: goes from 1 to 2"),
        ("limits.profile=\"no-robot\"", "nothing is named \"no-robot\""),
        ("limits.speed=1", "unknown field `speed`"),
        ("record.countdown=-1", "record.countdown"),
    ] {
        let out = folder.path().join("out");
        let output = wheelwright(&["record", "examples/record_pioneer.toml", "--out", text(&out), "--set", setting]);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{setting}: {said}");
        assert!(said.contains(says), "{setting}: {said}");
        assert!(!out.join("recording.csv").exists());
    }
}
