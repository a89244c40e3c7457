//! `diagnose`, `trial` and `score` as a user runs them, on robots of the built-in simulator, which knows forces and no effect.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use serde_json::{Value, json};

/// A Pioneer with noise; `{more}` is the rest of its table.
const ROBOT: &str = r#"
[robot]
type = "simulator"
robot = "pioneer-3dx"
period = 0.05
{more}
[robot.sensors]
v_noise = 0.004
omega_noise = 0.01
"#;

/// Sums of sines and steps, through standstill and backwards.
const DRIVE: &str = r#"
[excitation]
type = "signals"
duration = {duration}
[[excitation.signals]]
channel = "v_ref"
kind = "sine"
amplitude = 0.3
frequency_hz = 0.07
[[excitation.signals]]
channel = "v_ref"
kind = "sine"
amplitude = 0.2
frequency_hz = {fast}
[[excitation.signals]]
channel = "omega_ref"
kind = "sine"
amplitude = 0.8
frequency_hz = 0.11
[[excitation.signals]]
channel = "omega_ref"
kind = "sine"
amplitude = 0.4
frequency_hz = {faster}
"#;

/// The preset's gains but for the derivative gain on the forward velocity, which is a third larger.
const SLOW: &str = "[robot.controller.vw-pd]\nkpt = 1733.33\nkdt = 500.0\nkpr = 103.756\nkdr = 19.7739";

const PROFILE: &str = "name = \"pioneer\"\nmodel = \"vw-pd\"\ntrack_width = 0.34\nwheel_radius = 0.0975\n";

fn wheelwright(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_wheelwright")).args(arguments).current_dir(env!("CARGO_MANIFEST_DIR")).output().unwrap()
}

fn json_of(arguments: &[&str]) -> Value {
    let output = wheelwright(&[arguments, &["--json"]].concat());
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Recordings that all tests share: a robot that hides a limit of its wheels' speed, one that hides nothing, one with a slower loop.
struct Drives {
    _folder: tempfile::TempDir,
    limit: [String; 2],
    plain: [String; 2],
    slow: String,
    profile: String,
}

fn drives() -> &'static Drives {
    static DRIVES: OnceLock<Drives> = OnceLock::new();
    DRIVES.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let drive = |name: &str, seed: u64, more: &str, (duration, fast, faster): (u32, f64, f64)| {
            let config = at(&format!("{name}.toml"));
            let drive = DRIVE.replace("{duration}", &duration.to_string()).replace("{fast}", &fast.to_string());
            let text = format!("seed = {seed}\n{}{}", ROBOT.replace("{more}", more), drive.replace("{faster}", &faster.to_string()));
            std::fs::write(&config, text).unwrap();
            let out = at(name);
            let output = wheelwright(&["run", &config, "--quick", "--quiet", "--out", &out]);
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            format!("{out}/recording.csv")
        };
        let (train, other) = ((60, 0.37, 0.53), (30, 0.29, 0.67));
        let limit = "limits = { wheel_speed = 4.2 }";
        let profile = at("robot.toml");
        std::fs::write(&profile, PROFILE).unwrap();
        Drives {
            limit: [drive("limit", 1, limit, train), drive("limit_other", 2, limit, other)],
            plain: [drive("plain", 3, "", train), drive("plain_other", 4, "", other)],
            slow: drive("slow", 5, SLOW, train),
            profile,
            _folder: folder,
        }
    })
}

fn names(document: &Value) -> Vec<&str> {
    document["effects"].as_array().unwrap().iter().map(|e| e["name"].as_str().unwrap()).collect()
}

#[test]
fn a_hidden_limit_is_named_proven_and_modelled() {
    let d = drives();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let found = json_of(&["diagnose", &d.limit[0], "--validate", &d.limit[1], "--robot", &d.profile, "--compensate", "--out", out]);
    assert_eq!(found["schema"], "wheelwright.diagnose/1");
    assert_eq!(found["verdict"], "explained", "{found:#}");
    assert_eq!(names(&found), ["velocity_saturation"]);
    for output in ["v", "omega"] {
        let fit = |which: &str| found["fit"][which][output].as_f64().unwrap();
        assert!(fit("after") > fit("before") && fit("after") > fit("noise_ceiling") - 1.0, "{output}: {}", found["fit"]);
    }
    for file in ["result.json", "report.html", "model.toml", "before.csv", "after.csv", "feedforward.csv", "feedforward.toml"] {
        assert!(folder.path().join(file).metadata().unwrap().len() > 0, "{file}");
    }
    let written: Value = serde_json::from_str(&std::fs::read_to_string(folder.path().join("result.json")).unwrap()).unwrap();
    assert_eq!(written, found);
    let feedforward = std::fs::read_to_string(folder.path().join("feedforward.toml")).unwrap();
    assert!(feedforward.contains("velocity_saturation") && feedforward.contains("by = \"none\""), "{feedforward}");
    augmented_model_reproduces_the_after_series(folder.path(), &d.limit[1]);
}

/// `simulate` of the model with its effects gives the series that the diagnosis showed.
fn augmented_model_reproduces_the_after_series(folder: &Path, commands: &str) {
    let (model, out) = (folder.join("model.toml"), folder.join("again"));
    let simulated = json_of(&["simulate", model.to_str().unwrap(), "--commands", commands, "--out", out.to_str().unwrap()]);
    assert_eq!(simulated["effects"], json!(["velocity_saturation"]));
    let column = |file: PathBuf, name: &str, part: Option<&str>| -> Vec<f64> {
        let text = std::fs::read_to_string(file).unwrap();
        let mut lines = text.lines();
        let header: Vec<&str> = lines.next().unwrap().split(',').collect();
        let place = |name: &str| header.iter().position(|h| *h == name).unwrap();
        let (wanted, of) = (place(name), part.map(|_| place("part")));
        let rows = lines.map(|l| l.split(',').collect::<Vec<_>>()).filter(|row| of.is_none_or(|of| Some(row[of]) == part));
        rows.map(|row| row[wanted].parse().unwrap()).collect()
    };
    for (output, scale) in [("v", 0.3), ("omega", 0.8)] {
        let shown = column(folder.join("after.csv"), &format!("{output}_sim"), Some("validate"));
        let again = column(out.join("simulated.csv"), output, None);
        assert_eq!(shown.len(), again.len());
        let worst = shown.iter().zip(&again).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-3 * scale, "{output}: {worst}");
    }
}

#[test]
fn nothing_hidden_is_nothing_found_and_gates_tell_them_apart() {
    let d = drives();
    let clean =
        wheelwright(&["diagnose", &d.plain[0], "--validate", &d.plain[1], "--robot", &d.profile, "--fail-on", "mismatch", "--json"]);
    assert_eq!(clean.status.code(), Some(0), "{}", String::from_utf8_lossy(&clean.stdout));
    let document: Value = serde_json::from_slice(&clean.stdout).unwrap();
    assert_eq!((document["verdict"].as_str(), document["effects"].as_array().unwrap().len()), (Some("no_mismatch"), 0));
    let hidden =
        wheelwright(&["diagnose", &d.limit[0], "--validate", &d.limit[1], "--robot", &d.profile, "--fail-on", "mismatch", "--json"]);
    assert_eq!(hidden.status.code(), Some(4));
    assert!(serde_json::from_slice::<Value>(&hidden.stdout).is_ok(), "a failed gate keeps the one document");
    assert!(String::from_utf8_lossy(&hidden.stderr).contains("gate failed: the verdict is explained"));
}

#[test]
fn without_its_effect_the_library_does_not_name_it() {
    let d = drives();
    let found = json_of(&["diagnose", &d.limit[0], "--validate", &d.limit[1], "--robot", &d.profile, "--without", "velocity_saturation"]);
    assert!(!names(&found).contains(&"velocity_saturation"));
    assert_ne!(found["verdict"], "no_mismatch");
}

#[test]
fn another_simulators_recording_is_compared_parameter_by_parameter() {
    let d = drives();
    let found = json_of(&["diagnose", &d.slow, "--sim", &d.plain[0], "--robot", &d.profile]);
    assert_eq!(found["compared_with"], "recording");
    assert_eq!(found["simulation"]["represents"]["holds"], true, "{found:#}");
    let parameters = found["simulation"]["parameters"].as_array().unwrap();
    let theta1 = parameters.iter().find(|p| p["parameter"] == "theta1").unwrap();
    // More derivative gain lengthens the forward lag.
    assert_eq!(theta1["changed"], true, "{theta1}");
    assert!(theta1["recorded"].as_f64() > theta1["simulated"].as_f64());
    assert!(theta1["points_to"].as_array().unwrap().contains(&json!("kdt")));
    assert_eq!((found["verdict"].as_str(), names(&found).len()), (Some("explained"), 0));
    assert!(found["fit"]["after"]["v"].as_f64() > found["fit"]["before"]["v"].as_f64(), "{}", found["fit"]);
    let same = json_of(&["diagnose", &d.plain[1], "--sim", &d.plain[0], "--robot", &d.profile]);
    assert_eq!(same["verdict"], "no_mismatch", "{same:#}");
}

#[test]
fn a_model_file_is_a_simulation_to_compare_with() {
    let d = drives();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    json_of(&["identify", &d.plain[0], "--quick", "--out", out]);
    let model = format!("{out}/model.toml");
    for fixed in [&[][..], &["--fixed"]] {
        let arguments = [&["diagnose", &d.limit[0], "--sim", &model, "--validate", &d.limit[1], "--robot", &d.profile], fixed].concat();
        let found = json_of(&arguments);
        assert_eq!(found["compared_with"], "model");
        assert_eq!(names(&found), ["velocity_saturation"], "fixed {fixed:?}");
    }
}

#[test]
fn a_trial_answers_every_case_the_same_for_any_number_of_threads_and_is_scored() {
    let d = drives();
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let lay = |case: &str, files: &[String; 2]| {
        std::fs::create_dir_all(at("cases").join(case)).unwrap();
        std::fs::copy(&files[0], at("cases").join(case).join("train.csv")).unwrap();
        std::fs::copy(&files[1], at("cases").join(case).join("validate.csv")).unwrap();
        std::fs::copy(&d.profile, at("cases").join(case).join("robot.toml")).unwrap();
    };
    lay("c1", &d.limit);
    lay("c2", &d.plain);
    lay("c3", &d.plain);
    std::fs::write(at("cases/c3/train.csv"), "t,v_ref\n0,1\n").unwrap();
    let key = json!({ "schema": "wheelwright.key/1", "cases": [
        { "case": "c1", "kind": "single", "truth": [{ "effect": "velocity_saturation", "parameters": {} }], "excitation": "rich", "strength": 0.5 },
        { "case": "c2", "kind": "none", "truth": [] },
        { "case": "c3", "kind": "none", "truth": [] },
    ]});
    std::fs::write(at("key.json"), key.to_string()).unwrap();
    let seal = "0".repeat(64);
    let answered = |name: &str, threads: &str, seal: &str| {
        let output = Command::new(env!("CARGO_BIN_EXE_wheelwright"))
            .args(["trial", at("cases").to_str().unwrap(), "--answers", at(name).to_str().unwrap(), "--seal", seal])
            .env("RAYON_NUM_THREADS", threads)
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    };
    answered("one", "1", &seal);
    answered("two", "2", &seal);
    for case in ["c1", "c2", "c3"] {
        let read = |name: &str| -> Value {
            let mut answer: Value = serde_json::from_slice(&std::fs::read(at(name).join(format!("{case}.json"))).unwrap()).unwrap();
            assert!(answer["seconds"].is_number() && answer["case"] == case);
            answer["seconds"] = Value::Null;
            answer
        };
        let answer = read("one");
        assert_eq!(answer, read("two"), "{case}");
        for key in ["schema", "verdict", "effects", "where", "fit", "next_experiment", "warnings"] {
            assert!(answer.get(key).is_some(), "{case}: {key}");
        }
        assert_eq!(answer.get("failed").is_some(), case == "c3");
    }
    let header: Value = serde_json::from_slice(&std::fs::read(at("one/answers.json")).unwrap()).unwrap();
    assert_eq!(header["cases"][0]["inputs"]["train.csv"].as_str().unwrap().len(), 64);
    let (answers, key_file) = (at("one"), at("key.json"));
    let scored = wheelwright(&["score", answers.to_str().unwrap(), "--key", key_file.to_str().unwrap()]);
    assert_eq!(scored.status.code(), Some(4), "the seal is of another key");
    assert!(String::from_utf8_lossy(&scored.stderr).contains("is not the key that the answers were sealed with"));
    answered("sealed", "2", &sha256(&key_file));
    let out = at("score");
    let score = json_of(&["score", at("sealed").to_str().unwrap(), "--key", key_file.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    assert_eq!(score["sealed"], true);
    assert_eq!(score["classes"]["single"]["exact"]["hits"], 1, "{score:#}");
    assert_eq!(score["classes"]["none"]["false_alarm"]["hits"], 1, "a case without an answer is no success");
    assert_eq!(score["confusion"]["velocity_saturation"]["velocity_saturation"], 1);
    assert!(out.join("report.html").exists());
}

fn sha256(path: &Path) -> String {
    use sha2::Digest;
    sha2::Sha256::digest(std::fs::read(path).unwrap()).iter().map(|b| format!("{b:02x}")).collect()
}

#[test]
fn a_table_of_commands_is_driven_row_by_row() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    std::fs::write(at("next.csv"), "t,v_ref,omega_ref\n0,0.2,0\n2,-0.2,0.5\n4,0.3,-0.5\n30,0.1,0.2\n").unwrap();
    let config =
        "[robot]\ntype = \"simulator\"\nrobot = \"pioneer-3dx\"\n[excitation]\ntype = \"table\"\nfile = \"next.csv\"\nduration = 40.0\n";
    std::fs::write(at("next.toml"), config).unwrap();
    let ran = json_of(&["run", &at("next.toml"), "--quick", "--out", &at("out")]);
    assert!((ran["recordings"][0]["duration_s"].as_f64().unwrap() - 40.0).abs() < 0.2);
    let text = std::fs::read_to_string(at("out/recording.csv")).unwrap();
    let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    let place = |name: &str| header.iter().position(|h| *h == name).unwrap();
    for row in text.lines().skip(1).map(|l| l.split(',').collect::<Vec<_>>()) {
        let number = |name: &str| row[place(name)].parse::<f64>().unwrap();
        let t = number("t") + 1e-6;
        let expected = if t < 2.0 {
            0.2
        } else if t < 4.0 {
            -0.2
        } else if t < 30.0 {
            0.3
        } else {
            0.1
        };
        assert_eq!(number("v_ref"), expected, "at {t} s");
    }
}
