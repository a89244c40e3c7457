//! `emulate` and `run` as a user has them in two terminals: a robot's protocol between two processes.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

const PROGRAM: &str = env!("CARGO_BIN_EXE_wheelwright");

/// A running `emulate`, ended with the test.
struct Serving {
    child: Child,
    address: String,
}

impl Drop for Serving {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn serve(folder: &Path, config: &str) -> Serving {
    let file = folder.join("emulate.toml");
    std::fs::write(&file, config).unwrap();
    let mut child = Command::new(PROGRAM)
        .args(["emulate", "--json", "--duration", "60"])
        .arg(&file)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let address = lines.map_while(Result::ok).find_map(|line| Some(line.split_once("\"address\": \"")?.1.split('"').next()?.to_owned()));
    Serving { child, address: address.unwrap() }
}

fn run(folder: &Path, robot: &str, excitation: &str, model: &str) -> Output {
    let file = folder.join("run.toml");
    let config = format!("[robot]\n{robot}\n[excitation]\ntype = \"{excitation}\"\nduration = 30.0\n[model]\ntype = \"{model}\"\n");
    std::fs::write(&file, config).unwrap();
    Command::new(PROGRAM).args(["run", "--quick", "--json"]).arg(&file).output().unwrap()
}

fn theta(output: &Output) -> Vec<f64> {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let result: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    result["parameters"].as_array().unwrap().iter().map(|p| p["value"].as_f64().unwrap()).collect()
}

fn agree(direct: &[f64], through: &[f64]) {
    for (a, b) in direct.iter().zip(through) {
        assert!((a - b).abs() <= (0.01 * a.abs()).max(0.005), "{direct:?} directly, {through:?} through the wire");
    }
}

#[test]
fn a_pioneer_is_identified_in_another_process() {
    let folder = tempfile::tempdir().unwrap();
    let simulator = "type = \"simulator\"\nrobot = \"pioneer-3dx\"";
    let server = format!("[emulator]\ntype = \"pioneer\"\nlisten = \"127.0.0.1:0\"\nclock = \"stepped\"\n[robot]\n{simulator}\n");
    let serving = serve(folder.path(), &server);
    let robot =
        format!("type = \"pioneer\"\nclock = \"stepped\"\ntcp = \"{}\"\nlimits = {{ v_dot = 20, omega_dot = 60 }}", serving.address);
    let direct = theta(&run(folder.path(), simulator, "thesis-pioneer", "vw-pd"));
    agree(&direct, &theta(&run(folder.path(), &robot, "thesis-pioneer", "vw-pd")));
}

#[cfg(unix)]
#[test]
fn a_khepera_is_identified_over_a_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let simulator = "type = \"simulator\"\nrobot = \"khepera-3\"";
    let link = folder.path().join("khepera");
    let server = format!("[emulator]\ntype = \"khepera\"\npty = \"{}\"\nclock = \"stepped\"\n[robot]\n{simulator}\n", link.display());
    let serving = serve(folder.path(), &server);
    let robot = format!("type = \"khepera\"\nclock = \"stepped\"\nserial = \"{}\"", serving.address);
    let direct = theta(&run(folder.path(), simulator, "thesis-khepera", "wheel-pd"));
    agree(&direct, &theta(&run(folder.path(), &robot, "thesis-khepera", "wheel-pd")));
}

#[test]
fn what_is_missing_or_wrong_is_named_with_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("emulate.toml");
    let cases = [
        ("[robot]\ntype = \"simulator\"\nrobot = \"pioneer-3dx\"\n", "[emulator]"),
        ("[emulator]\ntype = \"pioneer\"\n", "[robot]"),
        (
            "[emulator]\ntype = \"pioneer\"\nsubclass = \"r2d2\"\n[robot]\ntype = \"simulator\"\nrobot = \"pioneer-3dx\"\n",
            "emulate.toml:3:1",
        ),
        (
            "[emulator]\ntype = \"pioneer\"\ncycle = 0.15\n[robot]\ntype = \"simulator\"\nrobot = \"pioneer-3dx\"\n",
            "multiple of the robot's period",
        ),
        ("[emulator]\ntype = \"khepera\"\n[robot]\ntype = \"simulator\"\nrobot = \"khepera-3\"\n", "give one of listen"),
    ];
    for (config, expected) in cases {
        std::fs::write(&file, config).unwrap();
        let output = Command::new(PROGRAM).args(["emulate", "--duration", "0.1"]).arg(&file).output().unwrap();
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(2) && message.contains(expected), "{expected}: {message}");
    }
}
