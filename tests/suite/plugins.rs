//! Robots, models and effects from shared libraries, good and broken, as the program meets them.

#[path = "../../plugin/tests/suite/support/built.rs"]
mod built;

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use rand_distr::StandardNormal;
use serde_json::Value;

use crate::library;

/// Compiles a C plugin into `folder`; `None` without a C compiler.
fn compile(source: &str, folder: &Path) -> Option<PathBuf> {
    let library = folder.join("libplugin.so");
    library::compile(source, &[], &library).then_some(library)
}

fn run(folder: &Path, config: &str, more: &[&str]) -> Output {
    std::fs::write(folder.join("run.toml"), config).unwrap();
    let program = env!("CARGO_BIN_EXE_wheelwright");
    Command::new(program).args(["run", "run.toml", "--json"]).args(more).current_dir(folder).stdin(Stdio::null()).output().unwrap()
}

fn config(robot: &str) -> String {
    format!("[[plugin]]\npath = \"libplugin.so\"\n[robot]\n{robot}\n[excitation]\ntype = \"thesis-pioneer\"\nduration = 60.0\n")
}

fn theta(document: &Value) -> Vec<f64> {
    document["parameters"].as_array().unwrap().iter().map(|p| p["value"].as_f64().unwrap()).collect()
}

#[test]
fn a_robot_in_c_is_driven_and_identified_like_a_built_in() {
    let folder = tempfile::tempdir().unwrap();
    if compile("examples/plugins/c/robot.c", folder.path()).is_none() {
        return;
    }
    let output = run(folder.path(), &config("type = \"c-base\"\ntau = 0.25"), &[]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let theta = theta(&serde_json::from_slice(&output.stdout).unwrap());
    for (value, expected) in theta.iter().zip([0.25, 0.25, 0.0, 1.0, 0.0, 1.0]) {
        assert!((value - expected).abs() < 0.01, "{theta:?}");
    }
}

#[test]
fn a_robot_and_a_model_in_rust_work_together() {
    let built = built::rust_library("wheelwright_example_plugin");
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(built, folder.path().join("libplugin.so")).unwrap();
    let output = run(folder.path(), &config("type = \"second-order-base\""), &[]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let document: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(document["model"], "vw-pd");
    assert!(
        document["fit"]["validate"]["v"].as_f64().unwrap() > 80.0,
        "a second-order robot is nearly a first-order one: {}",
        document["fit"]
    );
}

#[test]
fn a_model_in_c_finds_the_truth_of_a_robot_in_c() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("model");
    std::fs::create_dir(&model).unwrap();
    if compile("examples/plugins/c/robot.c", folder.path()).and(compile("examples/plugins/c/model.c", &model)).is_none() {
        return;
    }
    let both = format!("{}[model]\ntype = \"c-lag\"\n[[plugin]]\npath = \"model/libplugin.so\"\n", config("type = \"c-base\"\ntau = 0.25"));
    let output = run(folder.path(), &both, &[]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let document: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(document["model"], "c-lag");
    let theta = theta(&document);
    for (value, expected) in theta.iter().zip([0.25, 1.0, 0.25, 1.0]) {
        assert!((value - expected).abs() < 1e-3 * expected, "{theta:?}");
    }
}

#[test]
fn plugins_lists_and_checks_a_library() {
    let folder = tempfile::tempdir().unwrap();
    let Some(library) = compile("examples/plugins/c/model.c", folder.path()) else { return };
    let output = Command::new(env!("CARGO_BIN_EXE_wheelwright")).args(["plugins", "check"]).arg(&library).output().unwrap();
    assert!(output.status.success(), "{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(String::from_utf8_lossy(&output.stdout).contains(": ok"));
    std::fs::write(folder.path().join("c.toml"), "[[plugin]]\npath = \"libplugin.so\"\n").unwrap();
    let listed = Command::new(env!("CARGO_BIN_EXE_wheelwright"))
        .args(["plugins", "--json", "--config"])
        .arg(folder.path().join("c.toml"))
        .output()
        .unwrap();
    let document: Value = serde_json::from_slice(&listed.stdout).unwrap();
    let loaded = document["models"].as_array().unwrap().iter().filter(|m| m["source"].as_str().unwrap().ends_with("libplugin.so"));
    assert_eq!(loaded.count(), 1);
}

/// A robot whose drag grows with the cube of speed, stepped finely from its equations, with noise; truth 0.5 and 0.25.
fn cubic_recording() -> String {
    let mut random = StdRng::seed_from_u64(3);
    let (mut v, mut w, mut u) = (0.0_f64, 0.0_f64, [0.0; 2]);
    let mut text = String::from("t,v_ref,omega_ref,v,omega\n");
    for k in 0..1200 {
        if k % 13 == 0 {
            u = [random.random_range(-0.8..0.8), random.random_range(-1.5..1.5)];
        }
        let noise: [f64; 2] = std::array::from_fn(|_| random.sample::<f64, _>(StandardNormal));
        text.push_str(&format!("{},{},{},{},{}\n", 0.05 * f64::from(k), u[0], u[1], v + 0.004 * noise[0], w + 0.008 * noise[1]));
        for _ in 0..50 {
            v += 1e-3 * (u[0] - 0.5 * v.powi(3) - 1.02 * v) / 0.26;
            w += 1e-3 * (u[1] - 0.25 * w.powi(3) - 1.05 * w) / 0.19;
        }
    }
    text
}

#[test]
fn an_effect_in_c_is_named_by_a_diagnosis() {
    let folder = tempfile::tempdir().unwrap();
    if compile("examples/plugins/c/effect.c", folder.path()).is_none() {
        return;
    }
    std::fs::write(folder.path().join("drive.csv"), cubic_recording()).unwrap();
    std::fs::write(folder.path().join("plugin.toml"), "[[plugin]]\npath = \"libplugin.so\"\n").unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_wheelwright"))
        .args(["diagnose", "drive.csv", "--config", "plugin.toml", "--json"])
        .current_dir(folder.path())
        .stdin(Stdio::null())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let document: Value = serde_json::from_slice(&output.stdout).unwrap();
    let effects = document["effects"].as_array().unwrap();
    assert_eq!(effects[0]["name"], "c_cubic_drag", "{document:#}");
    for (parameter, truth) in effects[0]["parameters"].as_array().unwrap().iter().zip([0.5, 0.25]) {
        assert!((parameter["value"].as_f64().unwrap() / truth - 1.0).abs() < 0.1, "{parameter}");
    }
}
