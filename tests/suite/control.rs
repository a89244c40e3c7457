//! `track`, `migrate` and `export` as a user runs them.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;
use wheelwright_core::recording::ReadOptions;

use crate::machine::undisturbed;

fn wheelwright(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_wheelwright")).args(arguments).current_dir(env!("CARGO_MANIFEST_DIR")).output().unwrap()
}

fn json(arguments: &[&str]) -> Value {
    let output = wheelwright(&[arguments, &["--json"]].concat());
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn rows(path: &Path) -> Vec<Vec<f64>> {
    let text = fs::read_to_string(path).unwrap();
    text.lines().map(|line| line.split_whitespace().map(|word| word.parse().unwrap()).collect()).collect()
}

/// Rows of a recording.
fn inspected(path: &Path) -> u64 {
    let recording = wheelwright::recordings::open(path, &ReadOptions::default()).unwrap();
    recording.rows() as u64
}

#[test]
fn track_leaves_the_thesis_files_and_a_page() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let document = json(&["track", "examples/track_pioneer.toml", "--out", out]);
    assert_eq!(document["schema"], "wheelwright.track/1");
    let (desired, actual) = (rows(&folder.path().join("desired")), rows(&folder.path().join("actual")));
    assert_eq!(desired.len(), 1201);
    assert_eq!(actual.len(), 1201);
    assert!(desired.iter().chain(&actual).all(|row| row.len() == 3));
    // The error told is that between the files, the start-up left out.
    let square = |k: usize| (desired[k][0] - actual[k][0]).powi(2) + (desired[k][1] - actual[k][1]).powi(2);
    let rms = ((900..=1200).map(square).sum::<f64>() / 301.0).sqrt();
    let told = &document["distance"]["windows"][3];
    assert!((told["rms"].as_f64().unwrap() - rms).abs() < 1e-6 && rms < 0.03, "{told} {rms}");
    assert_eq!(document["parameters"].as_array().unwrap().len(), 6);
    assert!(document["ended_early"].is_null());
    let page = fs::read_to_string(folder.path().join("report.html")).unwrap();
    for part in ["<svg", "Distance error", "Parameters over time", "Velocities"] {
        assert!(page.contains(part), "{part}");
    }
    for file in ["track.csv", "track.mcap", "recording.csv", "recording.mcap"] {
        let inspected = json(&["inspect", folder.path().join(file).to_str().unwrap()]);
        assert!(inspected.is_object(), "{file}");
    }
}

#[test]
fn what_is_dangerous_is_refused_before_the_robot_moves() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let refused = wheelwright(&["track", "examples/track_pioneer.toml", "--out", out, "--set", "controller.kv=60.0"]);
    assert_eq!(refused.status.code(), Some(2));
    let message = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(message.contains("refused") && message.contains("at which it is stable"), "{message}");
    assert!(!folder.path().join("actual").exists() && !folder.path().join("recording.csv").exists());
    let missing = wheelwright(&["track", "examples/pioneer.toml", "--out", out]);
    assert_eq!(missing.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&missing.stderr).contains("`controller`: is missing"));
}

#[test]
fn a_robot_off_its_course_is_stopped_and_its_rows_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let ended = wheelwright(&["track", "examples/track_pioneer.toml", "--out", out, "--set", "track.off_course=0.05"]);
    assert_eq!(ended.status.code(), Some(5));
    assert!(String::from_utf8_lossy(&ended.stderr).contains("from where it should be"));
    assert!(!rows(&folder.path().join("actual")).is_empty());
    assert!(json(&["inspect", folder.path().join("recording.csv").to_str().unwrap()]).is_object());
}

/// Pioneer to Khepera and back, and to a robot that exists only as a configuration.
#[test]
fn a_migrated_controller_is_as_good_as_a_native_one() {
    for name in ["pioneer_to_khepera", "khepera_to_pioneer", "third"] {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().to_str().unwrap();
        let document = json(&["migrate", &format!("examples/migrate_{name}.toml"), "--out", out]);
        let verdict = |key: &str| document["verdict"][key].as_f64().unwrap_or_else(|| panic!("{name}: {}", document["verdict"]));
        assert!((verdict("migrated_over_native") - 1.0).abs() < 0.05, "{name}: {}", document["verdict"]);
        assert!(verdict("unmigrated_over_migrated") > 3.0, "{name}: {}", document["verdict"]);
        for file in ["result.json", "report.html", "controller.toml", "model.toml", "desired", "actual"] {
            assert!(folder.path().join(file).exists(), "{name}: {file}");
        }
        let runs = document["runs"].as_array().unwrap().iter().map(|run| (run["folder"].as_str().unwrap(), run["result"]["rows"].as_u64()));
        let others = [("identification", None), ("native-identification", None)];
        for (run, rows) in runs.chain(others) {
            let read = |file: &str| inspected(&folder.path().join(run).join(file));
            let (csv, mcap) = (read("recording.csv"), read("recording.mcap"));
            assert_eq!(csv, mcap, "{name}: {run}");
            assert!(rows.is_none_or(|rows| rows == csv), "{name}: {run}: {rows:?} {csv}");
        }
    }
}

#[test]
fn a_migration_that_would_be_unsafe_is_refused() {
    let kept = wheelwright(&[
        "migrate",
        "examples/migrate_khepera_to_pioneer.toml",
        "--set",
        "migrate.gains=kept",
        "--set",
        "source.controller.kv=40.0",
    ]);
    assert_eq!(kept.status.code(), Some(2));
    let message = String::from_utf8_lossy(&kept.stderr).into_owned();
    assert!(message.contains("refused") && message.contains("let the gains be retuned"), "{message}");
}

const MODEL: &str = r#"
schema = "wheelwright.model/1"
[robot]
name = "a"
model = "vw-pd"
track_width = 0.34
wheel_radius = 0.0975
[robot.limits]
v = 1.4
omega_dot = 1.7
[model]
type = "vw-pd"
"#;

fn model_file(folder: &Path) -> String {
    let theta = [0.2604, 0.2509, -0.0004, 0.9965, 0.0026, 1.0768];
    let parameters: String =
        theta.iter().enumerate().map(|(i, t)| format!("[[parameter]]\nname = \"theta{}\"\nvalue = {t:?}\n", i + 1)).collect();
    let path = folder.join("model.toml");
    fs::write(&path, format!("{MODEL}{parameters}")).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn an_exported_model_is_what_was_identified() {
    let folder = tempfile::tempdir().unwrap();
    let model = model_file(folder.path());
    let yaml = String::from_utf8(wheelwright(&["export", &model, "--to", "ros2"]).stdout).unwrap();
    for line in ["wheel_separation: 0.34", "linear.x.max_velocity: 1.4", "angular.z.max_acceleration: 1.7", "theta6: 1.0768"] {
        assert!(yaml.contains(line), "{line} in {yaml}");
    }
    assert!(!yaml.contains("linear.x.max_acceleration"), "nobody gave it");
    let refused = wheelwright(&["export", &model, "--to", "wpilib"]);
    assert_eq!(refused.status.code(), Some(2));
    assert_eq!(wheelwright(&["export", &model, "--to", "simulink"]).status.code(), Some(2));
    let out = folder.path().to_str().unwrap();
    let document = json(&["export", &model, "--to", "python", "--out", out]);
    assert_eq!(document["schema"], "wheelwright.export/1");
    let check =
        "import robot_model as m; a = m.accelerations(.3, -.7, .5, .2); print(*m.command(.3, -.7, *a), *m.step((0, 0, 0, 0, 0), 1, 1, .1))";
    let Ok(python) = Command::new("python3").args(["-B", "-c", check]).current_dir(folder.path()).output() else {
        println!("skipped: python3 is absent");
        return;
    };
    let numbers: Vec<f64> = String::from_utf8(python.stdout).unwrap().split_whitespace().map(|w| w.parse().unwrap()).collect();
    // Inverse of forward is the command; from rest, theta1 v' + theta4 v = 1 to a fourth order.
    assert!((numbers[0] - 0.5).abs() < 1e-12 && (numbers[1] - 0.2).abs() < 1e-12, "{numbers:?}");
    let v = (1.0 - (-0.1 * 0.9965_f64 / 0.2604).exp()) / 0.9965;
    assert!((numbers[5] - v).abs() < 1e-4, "{numbers:?} {v}");
}

#[test]
fn a_model_from_voltages_gives_feedforward_gains() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.toml");
    let names = ["kS_left", "kV_left", "kA_left", "kS_right", "kV_right", "kA_right"];
    let parameters: String = names.iter().enumerate().map(|(i, n)| format!("[[parameter]]\nname = \"{n}\"\nvalue = {}.5\n", i)).collect();
    fs::write(&path, format!("schema = \"wheelwright.model/1\"\n[model]\ntype = \"wheel-voltage\"\n{parameters}")).unwrap();
    let document: Value = serde_json::from_slice(&wheelwright(&["export", path.to_str().unwrap(), "--to", "wpilib"]).stdout).unwrap();
    assert_eq!(document["sides"]["left"]["kV"], 1.5);
    assert_eq!(document["sides"]["right"]["kA"], 5.5);
}

/// A child that is ended with the test.
struct Emulator(std::process::Child);

impl Drop for Emulator {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn emulate(config: &str, setting: &str) -> Emulator {
    let mut command = Command::new(env!("CARGO_BIN_EXE_wheelwright"));
    command.args(["emulate", config, "--quiet", "--set", setting]).current_dir(env!("CARGO_MANIFEST_DIR"));
    Emulator(command.stdout(std::process::Stdio::null()).stderr(std::process::Stdio::null()).spawn().unwrap())
}

const COURSE: &str = "
[model]
type = \"vw-pd\"
theta = [0.1, 0.1, 0.0, 1.0, 0.0, 1.0]
[trajectory]
type = \"circle\"
radius = 0.4
speed = 0.08
[controller]
type = \"inverse-dynamics\"
k = [0.8, 4.0, 0.8]
kv = 1.5
kw = 1.5
[track]
duration = 5.0
[limits]
deadline = 5.0
";

/// One course, three robots: only `[robot]` differs.
#[test]
fn the_same_course_runs_on_simulator_and_emulators() {
    undisturbed(|| {
        let folder = tempfile::tempdir().unwrap();
        // A port that was free a moment ago.
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let pty = folder.path().join("pty");
        let _pioneer = emulate("examples/emulate_pioneer.toml", &format!("emulator.listen=\"127.0.0.1:{port}\""));
        let _khepera = emulate("examples/emulate_khepera.toml", &format!("emulator.pty=\"{}\"", pty.display()));
        let robots = [
            ("simulator", "type = \"simulator\"\nrobot = \"pioneer-3dx\"".to_owned()),
            ("pioneer", format!("type = \"pioneer\"\ntcp = \"127.0.0.1:{port}\"")),
            ("khepera", format!("type = \"khepera\"\nserial = \"{}\"\nperiod = 0.04", pty.display())),
        ];
        for (name, robot) in robots {
            let (config, out) = (folder.path().join(format!("{name}.toml")), folder.path().join(name));
            fs::write(&config, format!("[robot]\n{robot}\n{COURSE}")).unwrap();
            let run = || wheelwright(&["track", config.to_str().unwrap(), "--out", out.to_str().unwrap(), "--json"]);
            // The emulator may still be starting.
            let mut output = run();
            for _ in 0..20 {
                if output.status.success() || out.join("recording.csv").exists() {
                    break;
                }
                std::thread::sleep(std::time::Duration::from_millis(500));
                output = run();
            }
            assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
            let document: Value = serde_json::from_slice(&output.stdout).unwrap();
            let last = document["distance"]["last"].as_f64().unwrap();
            assert!(last < 0.05, "{name}: {document:#}");
        }
    });
}
