//! The commands as a user runs them.

use std::path::{Path, PathBuf};
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

fn shared(path: &str) -> Option<String> {
    let root =
        std::env::var_os("WHEELWRIGHT_SHARED").map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let file = root.join(path);
    if !file.exists() {
        println!("skipped: {} is absent", file.display());
        return None;
    }
    Some(file.display().to_string())
}

fn parameter(document: &Value, name: &str) -> f64 {
    let all = document["parameters"].as_array().unwrap();
    all.iter().find(|p| p["name"] == name).unwrap()["value"].as_f64().unwrap()
}

#[test]
fn run_goes_from_nothing_to_a_report() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    for config in ["examples/pioneer.toml", "examples/khepera.toml"] {
        let document = json(&["run", config, "--out", out.to_str().unwrap()]);
        assert_eq!(document["schema"], "wheelwright.identify/1");
        for channel in ["v", "omega"] {
            assert!(document["fit"]["validate"][channel].as_f64().unwrap() > 90.0, "{config} {channel}: {}", document["fit"]);
        }
        for file in ["result.json", "report.html", "model.toml", "simulated.csv", "recording.csv"] {
            assert!(out.join(file).metadata().unwrap().len() > 0, "{file}");
        }
    }
}

#[test]
fn the_recording_a_run_kept_identifies_to_the_same_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap().to_owned();
    let ran = json(&["run", "examples/pioneer.toml", "--out", &out]);
    let recording = folder.path().join("recording.csv");
    let again = json(&["identify", recording.to_str().unwrap(), "--model", "vw-pd"]);
    assert_eq!(ran["parameters"], again["parameters"]);
    assert_eq!(ran["recordings"][0]["sha256"], again["recordings"][0]["sha256"]);
}

#[test]
fn an_identified_model_simulates_its_own_recording_with_the_fit_reported() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap().to_owned();
    let ran = json(&["run", "examples/pioneer.toml", "--holdout", "0", "--out", &out]);
    assert!(ran["fit"]["validate"].is_null());
    let (model, commands) = (format!("{out}/model.toml"), format!("{out}/recording.csv"));
    let simulated = json(&["simulate", &model, "--commands", &commands, "--out", &format!("{out}/again")]);
    for channel in ["v", "omega"] {
        let (a, b) = (ran["fit"]["train"][channel].as_f64().unwrap(), simulated["fit"][channel].as_f64().unwrap());
        assert!((a - b).abs() < 1e-9, "{channel}: {a} and {b}");
    }
    let recording = json(&["inspect", &format!("{out}/again/simulated.csv")]);
    assert_eq!(recording["samples"], ran["recordings"][0]["samples"], "a simulation is a recording");
}

#[test]
fn the_same_input_and_seed_give_the_same_bytes_for_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let run = |name: &str, threads: &str| {
        let out = folder.path().join(name);
        let status = Command::new(env!("CARGO_BIN_EXE_wheelwright"))
            .args(["run", "examples/pioneer.toml", "--quiet", "--out"])
            .arg(&out)
            .env("RAYON_NUM_THREADS", threads)
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .output()
            .unwrap();
        assert!(status.status.success());
        out
    };
    let (one, two) = (run("out", "1"), run("other/out", "2"));
    for file in ["recording.csv", "model.toml", "simulated.csv"] {
        assert_eq!(std::fs::read(one.join(file)).unwrap(), std::fs::read(two.join(file)).unwrap(), "{file}");
    }
    // These two name the folder they were written to; nothing else may differ.
    for file in ["result.json", "report.html"] {
        let read = |folder: &Path| std::fs::read_to_string(folder.join(file)).unwrap().replace(folder.to_str().unwrap(), "OUT");
        assert_eq!(read(&one), read(&two), "{file}");
    }
    let recording = one.join("recording.csv");
    for more in [["--solver", "output-error"], ["--solver", "iv"], ["--online", "--quick"]] {
        let identified = |threads: &str| {
            let mut command = Command::new(env!("CARGO_BIN_EXE_wheelwright"));
            command.arg("identify").arg(&recording).args(more).arg("--json").env("RAYON_NUM_THREADS", threads);
            let output = command.output().unwrap();
            assert!(output.status.success(), "{more:?}: {}", String::from_utf8_lossy(&output.stderr));
            output.stdout
        };
        assert!(identified("1") == identified("3"), "{more:?}");
    }
}

#[test]
fn real_skid_steer_logs_identify_as_they_are() {
    for (file, segments) in [("warthog/asphalt", 26), ("warthog/ice", 0), ("warthog/sand", 0), ("husky/steps", 17)] {
        let Some(path) = shared(&format!("recordings/{file}.csv")) else { return };
        let document = json(&["identify", &path, "--holdout", "0.3"]);
        assert!(document["fit"]["validate"]["v"].as_f64().is_some(), "{file}");
        if segments > 0 {
            assert_eq!(document["recordings"][0]["segments"], segments, "{file}");
        }
    }
}

#[test]
fn frc_logs_give_the_same_numbers_from_csv_and_from_the_raw_json() {
    for (csv, raw) in [("carter", "CarterIsChaotic20200214-1926"), ("piperservant", "Piperservant20200206-1721")] {
        let (Some(csv), Some(raw)) =
            (shared(&format!("recordings/frc5024/{csv}.csv")), shared(&format!("recordings/frc5024/raw/{raw}.json")))
        else {
            return;
        };
        let (from_csv, from_raw) =
            (json(&["identify", &csv, "--model", "wheel-voltage"]), json(&["identify", &raw, "--model", "wheel-voltage"]));
        for name in ["kV_left", "kA_left", "kV_right", "kA_right"] {
            let (a, b) = (parameter(&from_csv, name), parameter(&from_raw, name));
            // The CSV holds five decimals.
            assert!((a - b).abs() < 1e-3 * b.abs(), "{name}: {a} from CSV, {b} from JSON");
        }
    }
}

/// The whole characterization and each half of it, of which the first holds slow ramps alone.
#[test]
fn frc_logs_give_ks_kv_and_ka_with_intervals() {
    let Some(path) = shared("recordings/frc5024/carter.csv") else { return };
    let text = std::fs::read_to_string(path).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    let rows: Vec<&str> = rows.lines().collect();
    let folder = tempfile::tempdir().unwrap();
    for (name, rows) in [("whole", rows.as_slice()), ("slow", &rows[..rows.len() / 2]), ("quick", &rows[rows.len() / 2..])] {
        let path = folder.path().join(format!("{name}.csv"));
        std::fs::write(&path, [&[header], rows].concat().join("\n")).unwrap();
        let document = json(&["identify", path.to_str().unwrap(), "--model", "wheel-voltage", "--quick"]);
        assert_eq!((&document["solver"], &document["status"]), (&"output-error".into(), &"solved".into()), "{name}");
        for (parameter, unit) in document["parameters"].as_array().unwrap().iter().zip(["V s/m", "V s^2/m", "V"].iter().cycle()) {
            let [value, low, high] = [&parameter["value"], &parameter["ci95"][0], &parameter["ci95"][1]].map(|x| x.as_f64().unwrap());
            assert!(parameter["unit"] == *unit && 0.0 < low && low < value && value < high, "{name}: {parameter}");
        }
        assert!(["vel_left", "vel_right"].iter().all(|v| document["fit"]["validate"][v].as_f64().unwrap() > 85.0), "{name}");
    }
}

#[test]
fn a_replay_shows_parameters_over_time_and_ends_where_the_solver_does() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap().to_owned();
    json(&["run", "examples/pioneer.toml", "--quick", "--out", &out]);
    let recording = folder.path().join("recording.csv");
    let (recording, replay) = (recording.to_str().unwrap(), folder.path().join("replay"));
    let online = json(&["identify", "--online", recording, "--quick", "--out", replay.to_str().unwrap()]);
    let solved = json(&["identify", recording, "--quick", "--solver", "recursive"]);
    assert_eq!(online["parameters"], solved["parameters"]);
    assert!(solved["online"].is_null());
    let theta1 = &online["online"]["parameters"][0];
    assert_eq!(theta1["value"].as_array().unwrap().last().unwrap(), &online["parameters"][0]["value"]);
    assert_eq!(theta1["value"].as_array().unwrap().len(), online["online"]["t"].as_array().unwrap().len());
    let samples = online["online"]["samples"].as_u64().unwrap() as usize;
    assert_eq!(std::fs::read_to_string(replay.join("online.csv")).unwrap().lines().count(), samples + 1);
    assert!(std::fs::read_to_string(replay.join("report.html")).unwrap().contains("Estimates over time"));

    let forgetting = json(&["identify", "--online", recording, "--quick", "--set", "solver.memory_s=20"]);
    assert_eq!(forgetting["online"]["memory_s"], 20.0);
    assert_ne!(forgetting["parameters"], online["parameters"]);
    for wrong in [vec!["--solver", "ols"], vec!["--set", "solver.memory_s=-1"], vec!["--set", "solver.memry=1"]] {
        let output = wheelwright(&[&["identify", "--online", recording], wrong.as_slice()].concat());
        assert_eq!(output.status.code(), Some(2), "{wrong:?}: {}", String::from_utf8_lossy(&output.stderr));
    }
}

#[test]
fn every_built_in_is_linked_and_listed() {
    let document = json(&["plugins"]);
    let names = |kind: &str| document[kind].as_array().unwrap().iter().map(|p| p["name"].as_str().unwrap().to_owned()).collect::<Vec<_>>();
    for built_in in ["models", "robots", "solvers", "excitations", "effects"].iter().flat_map(|kind| document[*kind].as_array().unwrap()) {
        let about = built_in["about"].as_str().unwrap();
        assert!(!about.is_empty() && !about.contains("needs settings"), "{built_in}");
    }
    assert_eq!(names("models"), ["expression", "vw-pd", "wheel-pd", "wheel-voltage"]);
    assert_eq!(names("robots"), ["khepera", "pioneer", "ros2", "simulator"]);
    for solver in ["box", "iv", "ols", "output-error", "recursive", "robust", "steady-state", "thesis"] {
        assert!(names("solvers").contains(&solver.to_owned()), "{solver}");
    }
    // The contract's effects and the offset that rivals many of them.
    assert_eq!(names("effects").len(), 30, "{:?}", names("effects"));
    for (effect, place) in [("command_delay", "command"), ("coulomb_friction", "dynamics"), ("sensor_delay", "measurement")] {
        let listed = document["effects"].as_array().unwrap().iter().find(|e| e["name"] == effect).unwrap();
        assert_eq!(listed["place"], place, "{effect}");
    }
    for excitation in ["signals", "thesis-constant", "thesis-khepera", "thesis-multisine", "thesis-pioneer"] {
        assert!(names("excitations").contains(&excitation.to_owned()), "{excitation}");
    }
}

#[test]
fn json_goes_alone_to_standard_output_also_on_failure() {
    let output = wheelwright(&["identify", "absent.csv", "--json"]);
    assert_eq!(output.status.code(), Some(2));
    let document: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(document["schema"], "wheelwright.error/1");
    assert_eq!(document["status"], 2);
}
