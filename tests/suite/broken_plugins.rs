//! Libraries that break a rule, before and in the middle of a run: the reason, the exit status, and one document.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::process::{Command, Output};

use serde_json::Value;
use tempfile::TempDir;

use crate::library::compile;

const BROKEN: &str = "plugin/tests/broken/broken.c";

fn wheelwright(folder: &TempDir, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_wheelwright")).args(arguments).arg("--json").current_dir(folder.path()).output().unwrap()
}

/// Exit status and the one JSON document.
fn answer(output: &Output) -> (Option<i32>, Value) {
    let document = serde_json::from_slice(&output.stdout);
    (output.status.code(), document.unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(&output.stderr))))
}

/// A folder with the misbehaving library, a configuration that drives its robot, and a recording for its model.
fn folder(defines: &[&str]) -> Option<TempDir> {
    let folder = tempfile::tempdir().unwrap();
    if !compile(BROKEN, defines, &folder.path().join("libmock.so")) {
        return None;
    }
    let config = "[[plugin]]\npath = 'libmock.so'\nopen_timeout_s = 2\ncall_timeout_s = 0.5\n[robot]\ntype = 'mock'\n[model]\ntype = 'mock'\n\
        [excitation]\ntype = 'signals'\nduration = 2.0\n[[excitation.signals]]\nchannel = 'u'\nkind = 'constant'\nvalue = 0.5\n";
    fs::write(folder.path().join("run.toml"), config).unwrap();
    Some(folder)
}

/// Rows of the mock model's channels, in which `u` is `special` once.
fn recording(folder: &TempDir, special: f64) {
    let mut text = "t,u,x\n".to_owned();
    for k in 0..400 {
        let u = if k == 200 { special } else { f64::from(k / 50 % 3) * 0.3 };
        text.push_str(&format!("{},{u},{}\n", 0.05 * f64::from(k), (0.1 * f64::from(k)).sin()));
    }
    fs::write(folder.path().join("a.csv"), text).unwrap();
}

#[test]
fn a_library_that_cannot_be_taken_ends_with_status_2_and_a_broken_one_with_5() {
    for (defines, status, expected) in [
        (["WRONG_VERSION"].as_slice(), 5, "it speaks plugin interface 1, this program speaks 5"),
        (&["NO_SYMBOL"], 5, "it does not export `wheelwright_plugin`"),
        (&["NULL_FUNCTION"], 5, "robot 1: the function `step` is NULL"),
        (&["HANG_IN_CONSTRUCTOR"], 5, "loading it has not returned within 2 s"),
        (&["VENDOR_SYMBOL"], 2, "vendor_symbol_that_is_missing"),
        (&["HANG_IN_OPEN"], 5, "model plugin `mock`: opening it has not returned within 2 s"),
        (&["HANG_IN_STEP", "HANG_AT_ONCE"], 5, "the call of `step` has not returned; the robot was told to stop"),
        (&["NAN_MEASURED"], 5, "`z` is NaN at t = 0"),
    ] {
        let Some(folder) = folder(defines) else { return };
        let (found, document) = answer(&wheelwright(&folder, &["run", "run.toml"]));
        let message = document["message"].as_str().unwrap();
        assert!(message.contains(expected), "{defines:?}: {message}");
        assert_eq!(found, Some(status), "{defines:?}: {message}");
    }
    let Some(folder) = folder(&[]) else { return };
    let library = folder.path().join("libmock.so");
    fs::set_permissions(&library, fs::Permissions::from_mode(0o777)).unwrap();
    let (status, document) = answer(&wheelwright(&folder, &["run", "run.toml"]));
    assert!(status == Some(2) && document["message"].as_str().unwrap().contains("is writable by everybody"), "{document}");
    fs::remove_file(library).unwrap();
    let (status, document) = answer(&wheelwright(&folder, &["run", "run.toml"]));
    assert!(status == Some(2) && document["message"].as_str().unwrap().contains("no such file"), "{document}");
}

#[test]
fn a_model_that_fails_or_hangs_in_the_middle_ends_with_status_5_and_its_reason() {
    let Some(folder) = folder(&[]) else { return };
    for (special, expected) in [
        (7.0, "model plugin `mock`: equation 1: the coefficient of `b` is NaN at inputs [7.0]"),
        (8.0, "model plugin `mock`: eight is too many"),
        (9.0, "model plugin `mock`: a call has not returned within 10 s"),
    ] {
        recording(&folder, special);
        let (status, document) = answer(&wheelwright(&folder, &["identify", "a.csv", "--config", "run.toml"]));
        let message = document["message"].as_str().unwrap_or_default();
        assert!(message.contains(expected), "{special}: {document}");
        assert_eq!(status, Some(5));
    }
}

#[test]
fn check_says_what_is_kept_and_what_is_broken() {
    for (defines, status, outcome) in [([].as_slice(), Some(0), "ok"), (&["NOT_AFFINE"], Some(5), "broken")] {
        let Some(folder) = folder(defines) else { return };
        let (found, document) = answer(&wheelwright(&folder, &["plugins", "check", "libmock.so"]));
        assert_eq!((found, &document["schema"]), (status, &Value::from("wheelwright.plugins-check/1")), "{document}");
        assert_eq!((&document["checked"][0]["outcome"], &document["checked"][1]["outcome"]), (&"ok".into(), &outcome.into()), "{document}");
    }
}
