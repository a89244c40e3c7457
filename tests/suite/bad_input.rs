//! Everything a user can get wrong, with what the program must say and the status it must end with.
//!
//! Each case runs the program in a folder of its own that holds only the case's files. A message must name the file or key,
//! the place in it, and what is wrong; a case lists the parts that must appear.

use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Output};

/// A case: files to lay out, arguments, exit status, and what standard error must say.
struct Case {
    name: &'static str,
    files: Vec<(&'static str, Vec<u8>)>,
    arguments: &'static str,
    status: i32,
    says: &'static [&'static str],
}

fn run(folder: &Path, arguments: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_wheelwright")).args(arguments.split_whitespace()).current_dir(folder).output().unwrap()
}

fn text(content: &str) -> Vec<u8> {
    content.as_bytes().to_vec()
}

/// A drive of a first-order robot with a rich command, as CSV rows of t, v_ref, omega_ref, v, omega.
fn rows(count: usize) -> Vec<[f64; 5]> {
    let (mut v, mut omega) = (0.0, 0.0);
    let step = |k: usize| {
        let t = 0.05 * k as f64;
        let (v_ref, omega_ref) = (0.4 + 0.2 * (0.9 * t).sin() + 0.1 * (2.3 * t).sin(), 0.7 * (1.3 * t).sin() + 0.2 * (0.4 * t).cos());
        let row = [t, v_ref, omega_ref, v, omega];
        v += (v_ref - v) * 0.2;
        omega += (omega_ref - omega) * 0.22;
        row
    };
    (0..count).map(step).collect()
}

/// The drive as CSV text under a header, after `change` has spoilt it.
fn csv_with(header: &str, count: usize, change: impl Fn(usize, &mut Vec<String>)) -> Vec<u8> {
    let mut out = format!("{header}\n");
    for (k, row) in rows(count).iter().enumerate() {
        let mut cells: Vec<String> = row.iter().map(f64::to_string).collect();
        change(k, &mut cells);
        let _ = writeln!(out, "{}", cells.join(","));
    }
    out.into_bytes()
}

const HEADER: &str = "t,v_ref,omega_ref,v,omega";

fn good() -> Vec<u8> {
    csv_with(HEADER, 800, |_, _| ())
}

fn spoilt(change: impl Fn(usize, &mut Vec<String>)) -> Vec<u8> {
    csv_with(HEADER, 400, change)
}

fn case(
    name: &'static str,
    files: Vec<(&'static str, Vec<u8>)>,
    arguments: &'static str,
    status: i32,
    says: &'static [&'static str],
) -> Case {
    Case { name, files, arguments, status, says }
}

/// One CSV of a given content, identified.
fn csv_case(name: &'static str, content: Vec<u8>, status: i32, says: &'static [&'static str]) -> Case {
    case(name, vec![("log.csv", content)], "identify log.csv", status, says)
}

/// A good CSV with a configuration.
fn config_case(name: &'static str, config: &str, status: i32, says: &'static [&'static str]) -> Case {
    case(name, vec![("log.csv", good()), ("c.toml", text(config))], "identify log.csv --config c.toml", status, says)
}

/// A run from a configuration alone.
fn run_case(name: &'static str, config: &str, status: i32, says: &'static [&'static str]) -> Case {
    case(name, vec![("c.toml", text(config))], "run c.toml", status, says)
}

fn recordings() -> Vec<Case> {
    let set = |row: usize, column: usize, value: &'static str| {
        spoilt(move |k, cells| {
            if k == row {
                value.clone_into(&mut cells[column]);
            }
        })
    };
    vec![
        case("no such file", vec![], "identify absent.csv", 2, &["absent.csv", "No such file"]),
        csv_case("zero bytes", vec![], 2, &["log.csv", "0 bytes"]),
        csv_case(
            "binary garbage",
            (0..4096u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect(),
            2,
            &["log.csv", "no known format"],
        ),
        csv_case("a picture", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR".to_vec(), 2, &["PNG"]),
        csv_case("header only", text("t,v_ref,omega_ref,v,omega\n"), 2, &["log.csv", "0 data row"]),
        csv_case("one sample", text("t,v_ref,omega_ref,v,omega\n0,0,0,0,0\n"), 2, &["1 data row", "at least two"]),
        csv_case("no header", text("0,0,0,0,0\n0.1,1,1,1,1\n0.2,1,1,1,1\n"), 2, &["log.csv", "header"]),
        csv_case("not a number", set(10, 3, "fast"), 2, &["line 12", "`v`", "fast"]),
        csv_case("NaN", set(20, 4, "NaN"), 2, &["line 22", "`omega`", "NaN"]),
        csv_case("infinity", set(20, 1, "inf"), 2, &["line 22", "`v_ref`", "inf"]),
        csv_case("empty cell", set(5, 3, ""), 2, &["line 7", "`v`", "empty"]),
        csv_case("too many cells", set(5, 3, "1,2"), 2, &["line 7", "6", "5"]),
        csv_case("time goes back", set(100, 0, "1.0"), 2, &["time goes back", "1 s", "segment"]),
        csv_case(
            "frozen stamps",
            spoilt(|k, c| {
                if k >= 50 {
                    "2.5".clone_into(&mut c[0])
                }
            }),
            2,
            &["same time stamp", "2.5"],
        ),
        csv_case(
            "no motion",
            spoilt(|_, c| {
                "0".clone_into(&mut c[3]);
                "0".clone_into(&mut c[4])
            }),
            2,
            &["no motion", "`v` and `omega`"],
        ),
        csv_case(
            "decimal commas",
            text("t;v_ref;omega_ref;v;omega\n0,0;0,1;0,1;0,0;0,0\n0,1;0,2;0,1;0,1;0,0\n0,2;0,2;0,1;0,1;0,0\n"),
            2,
            &["decimal"],
        ),
        csv_case("missing column", csv_with("t,v_ref,omega_ref,v,gyro", 400, |_, _| ()), 2, &["no column `omega`", "--map omega="]),
        csv_case("missing time", csv_with("time_ms,v_ref,omega_ref,v,omega", 400, |_, _| ()), 2, &["`t`", "--map t="]),
        csv_case("the same column twice", csv_with("t,v_ref,omega_ref,v,v", 400, |_, _| ()), 2, &["`v`", "two columns"]),
        csv_case("millimetres a second", spoilt(|_, c| c[3] = (1000.0 * c[3].parse::<f64>().unwrap()).to_string()), 2, &["`v`", "0.001"]),
        case("map to an absent column", vec![("log.csv", good())], "identify log.csv --map v=sped", 2, &["sped"]),
        case("map without =", vec![("log.csv", good())], "identify log.csv --map v", 2, &["--map v", "v=twist_x"]),
        case("unknown topic role", vec![("log.csv", good())], "identify log.csv --topic scan=/scan", 2, &["scan", "cmd", "odom"]),
        case(
            "wheel speeds for a velocity model",
            vec![("log.csv", csv_with("t,u_left,u_right,vel_left,vel_right", 400, |_, _| ()))],
            "identify log.csv",
            2,
            &["v_ref", "wheel-voltage"],
        ),
        case(
            "truncated Parquet",
            vec![("log.parquet", b"PAR1\x15\x04\x15\x08".to_vec())],
            "inspect log.parquet",
            2,
            &["log.parquet", "footer"],
        ),
        case("truncated MCAP", vec![("log.mcap", b"\x89MCAP0\r\n\x01".to_vec())], "inspect log.mcap", 2, &["log.mcap"]),
        case("MCAP of 10 GB claimed", vec![("log.mcap", claimed_mcap())], "inspect log.mcap", 2, &["log.mcap"]),
        case(
            "wpilog of 10 GB claimed",
            vec![("log.wpilog", b"WPILOG\x00\x01\xff\xff\xff\xff".to_vec())],
            "inspect log.wpilog",
            2,
            &["log.wpilog"],
        ),
        case("SQLite that is no bag", vec![("log.db3", sqlite_head())], "inspect log.db3", 2, &["log.db3"]),
        case("ROS 1 bag cut after its magic", vec![("log.bag", text("#ROSBAG V2.0\n"))], "inspect log.bag", 2, &["log.bag"]),
        case("JSON of another kind", vec![("log.json", text("{\"a\": [1, 2, 3]}"))], "inspect log.json", 2, &["log.json"]),
        case(
            "JSON rows of two lengths",
            vec![("log.json", frc("[0.0, 12.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.02, 12.0]"))],
            "inspect log.json",
            2,
            &["log.json", "slow-forward"],
        ),
        case(
            "JSON rows of an unknown length",
            vec![("log.json", frc("[0.0, 12.0, 1.0], [0.02, 12.0, 1.0], [0.04, 12.0, 1.0]"))],
            "inspect log.json",
            2,
            &["log.json", "3"],
        ),
        case("JSON that ends", vec![("log.json", text("{\"slow-forward\": [[0.0, 12.0"))], "inspect log.json", 2, &["log.json"]),
        case("bag folder without metadata", vec![("bag/readme.txt", text("hello"))], "inspect bag", 2, &["bag", "metadata.yaml"]),
        case(
            "bag folder whose storage is gone",
            vec![(
                "bag/metadata.yaml",
                text("rosbag2_bagfile_information:\n  storage_identifier: sqlite3\n  relative_file_paths:\n  - gone.db3\n"),
            )],
            "inspect bag",
            2,
            &["gone.db3"],
        ),
    ]
}

fn claimed_mcap() -> Vec<u8> {
    let mut bytes = b"\x89MCAP0\r\n".to_vec();
    bytes.push(0x06);
    bytes.extend(10_000_000_000u64.to_le_bytes());
    bytes.extend([0; 64]);
    bytes
}

fn sqlite_head() -> Vec<u8> {
    let mut bytes = b"SQLite format 3\0".to_vec();
    bytes.extend([0; 200]);
    bytes
}

fn frc(rows: &str) -> Vec<u8> {
    text(&format!("{{\"slow-forward\": [{rows}], \"slow-backward\": [{rows}], \"fast-forward\": [{rows}], \"fast-backward\": [{rows}]}}"))
}

fn configurations() -> Vec<Case> {
    const ROBOT: &str = "[robot]\ntype = \"simulator\"\nrobot = \"pioneer-3dx\"\n";
    vec![
        config_case("TOML that is none", "[model\ntype = 3", 2, &["c.toml:1:"]),
        config_case("unknown section", "[modle]\ntype = \"vw-pd\"\n", 2, &["c.toml", "modle", "did you mean `model`"]),
        config_case(
            "unknown model",
            "[model]\ntype = \"vw-pid\"\n",
            2,
            &["c.toml:2:1", "model.type", "vw-pid", "did you mean \"vw-pd\"", "wheel-pd"],
        ),
        config_case("model without a type of text", "[model]\ntype = 3\n", 2, &["c.toml:2:1", "model.type", "text"]),
        config_case(
            "unknown key of a model",
            "[model]\ntype = \"wheel-pd\"\ntrack_widht = 0.3\n",
            2,
            &["c.toml:3:1", "track_widht", "did you mean `track_width`"],
        ),
        config_case("unknown solver", "[solver]\ntype = \"least-squares\"\n", 2, &["solver.type", "least-squares", "ols"]),
        config_case("unknown key of a solver", "[solver]\ntype = \"ols\"\ncutoff = 1.0\n", 2, &["c.toml:3:1", "cutoff"]),
        config_case(
            "cut-off above what the sampling can show",
            "[solver]\ntype = \"ols\"\nconditioning = { cutoff_hz = 50.0 }\n",
            2,
            &["cut-off of 50 Hz", "half the sampling rate"],
        ),
        config_case("hold-out of everything", "[validation]\nholdout = 1.0\n", 2, &["holdout", "0 to 0.9"]),
        config_case("hold-out as text", "[validation]\nholdout = \"some\"\n", 2, &["c.toml:2:1", "holdout"]),
        config_case(
            "expression with an unknown name",
            "[model]\ntype = \"expression\"\nname = \"m\"\ninputs = { v_ref = \"m/s\" }\noutputs = { v = \"m/s\" }\nequations = [\"v_ref = tau*der(v) + v\"]\n[model.parameters]\ntaw = { unit = \"s\" }\n",
            2,
            &["model.equations[0]", "column 9", "`tau`"],
        ),
        config_case(
            "expression not linear in its parameters",
            "[model]\ntype = \"expression\"\nname = \"m\"\ninputs = { v_ref = \"m/s\" }\noutputs = { v = \"m/s\" }\nequations = [\"v_ref = tau*tau*der(v) + v\"]\n[model.parameters]\ntau = { unit = \"s\" }\n",
            2,
            &["linear", "tau"],
        ),
        config_case("mapping scaled by nothing", "[recording.columns]\nv = { from = \"v\", scale = 0.0 }\n", 2, &["v", "scale"]),
        config_case("plugin that is not there", "[[plugin]]\npath = \"libgone.so\"\n", 2, &["libgone.so"]),
        config_case("plugin that is no library", "[[plugin]]\npath = \"log.csv\"\n", 2, &["log.csv", "shared library"]),
        run_case("neither robot nor recording", "[model]\ntype = \"vw-pd\"\n", 2, &["c.toml", "robot", "recording"]),
        run_case(
            "unknown robot",
            "[robot]\ntype = \"simulater\"\n[excitation]\ntype = \"thesis-pioneer\"\n",
            2,
            &["c.toml:2:1", "simulater", "did you mean \"simulator\""],
        ),
        run_case("robot without excitation", ROBOT, 2, &["excitation"]),
        run_case(
            "unknown excitation",
            &format!("{ROBOT}[excitation]\ntype = \"noise\"\n"),
            2,
            &["excitation.type", "noise", "thesis-pioneer"],
        ),
        run_case(
            "negative mass",
            &format!("{ROBOT}plant = {{ mass = -9.0 }}\n[excitation]\ntype = \"thesis-pioneer\"\n"),
            2,
            &["c.toml:4:1", "robot.plant.mass", "-9"],
        ),
        run_case("configuration that is not there", "", 2, &["robot"]),
        case("no configuration file", vec![], "run absent.toml", 2, &["absent.toml", "No such file"]),
        case("setting without value", vec![("log.csv", good())], "identify log.csv --set model", 2, &["--set model", "KEY=VALUE"]),
        case(
            "gate not passed",
            vec![("log.csv", good())],
            "identify log.csv --require fit.validate.v=100.5",
            4,
            &["fit.validate.v", "100.5"],
        ),
        case("gate on nothing", vec![("log.csv", good())], "identify log.csv --require fit.validate.z=1", 2, &["fit.validate.z"]),
        case(
            "effect that the library does not have",
            vec![("log.csv", good())],
            "diagnose log.csv --without coulomb_frction",
            2,
            &["--without coulomb_frction", "did you mean `coulomb_friction`", "wheelwright plugins"],
        ),
        case("fixed without a simulation", vec![("log.csv", good())], "diagnose log.csv --fixed", 2, &["--sim"]),
        case("simulation that is not there", vec![("log.csv", good())], "diagnose log.csv --sim gone.toml", 2, &["gone.toml"]),
        case(
            "effect of a model file with a wrong parameter",
            vec![("log.csv", good()), ("m.toml", model_file("friktion", "0.02"))],
            "simulate m.toml --commands log.csv",
            2,
            &["m.toml", "effect[0].parameter", "no parameter `friktion`", "`friction`"],
        ),
        case(
            "effect of a model file out of bounds",
            vec![("log.csv", good()), ("m.toml", model_file("friction", "-0.02"))],
            "simulate m.toml --commands log.csv",
            2,
            &["m.toml", "effect[0].parameter", "-0.02, outside 0 to inf"],
        ),
        case(
            "files to write without a folder",
            vec![("log.csv", good())],
            "diagnose log.csv --compensate",
            2,
            &["--compensate", "--out DIR"],
        ),
        case("folder without a case", vec![("cases/readme.txt", text("hello"))], "trial cases --answers a", 2, &["cases", "train.csv"]),
        case(
            "seal that is no hash",
            vec![("cases/c1/train.csv", good())],
            "trial cases --answers a --seal abc",
            2,
            &["--seal abc", "64 hexadecimal digits"],
        ),
        case(
            "key that is no key",
            vec![("a/c1.json", text("{}")), ("key.json", text("{\"schema\": \"x\", \"cases\": []}"))],
            "score a --key key.json",
            2,
            &["key.json", "wheelwright.key/1"],
        ),
        case(
            "answer that is none",
            vec![("a/c1.json", text("{}")), ("key.json", text("{\"schema\": \"wheelwright.key/1\", \"cases\": []}"))],
            "score a --key key.json",
            2,
            &["c1.json", "missing field `case`"],
        ),
        run_case(
            "table of commands beside its file",
            &format!("{ROBOT}[excitation]\ntype = \"table\"\nfile = \"next.csv\"\ntime = [0.0]\n"),
            2,
            &["excitation.file", "`time` or `commands`"],
        ),
        run_case(
            "table of commands whose file is gone",
            &format!("{ROBOT}[excitation]\ntype = \"table\"\nfile = \"gone.csv\"\n"),
            2,
            &["gone.csv", "No such file"],
        ),
        case("unknown command", vec![], "identfy log.csv", 2, &["identfy", "identify"]),
        case("unknown option", vec![], "identify --speed 3", 2, &["--speed"]),
    ]
}

/// A model file with friction, of which one parameter is as given.
fn model_file(name: &str, value: &str) -> Vec<u8> {
    let theta: String = [0.2, 0.2, 0.0, 1.0, 0.0, 1.0]
        .iter()
        .enumerate()
        .map(|(i, v)| format!("[[parameter]]\nname = \"theta{}\"\nvalue = {v:?}\n", i + 1))
        .collect();
    let scene = "[scene]\ntrack_width = 0.34\ninputs_rms = [0.4, 0.5]\ninputs_largest = [0.7, 0.9]\noutputs_rms = [0.4, 0.5]\n\
                 command_rms = 0.4\ncommand_largest = 0.8\nspeed_rms = 0.4\ntime = [0.0, 40.0]\nperiod = 0.05\n";
    let effect = format!(
        "[[effect]]\ntype = \"coulomb_friction\"\n[[effect.parameter]]\nname = \"{name}\"\nvalue = {value}\n\
         [[effect.parameter]]\nname = \"turning_ratio\"\nvalue = 1.0\n"
    );
    text(&format!("schema = \"wheelwright.model/1\"\n{scene}[model]\ntype = \"vw-pd\"\n{theta}{effect}"))
}

fn too_little() -> Vec<Case> {
    let only = |column: usize| {
        csv_with(HEADER, 1200, move |_, c| {
            for other in [2usize, 4].into_iter().filter(|o| *o != column) {
                "0".clone_into(&mut c[other]);
            }
        })
    };
    vec![
        csv_case("never turned", only(0), 3, &["theta2", "theta6", "turn"]),
        case(
            "two seconds for a filter that takes more",
            vec![("log.csv", csv_with(HEADER, 40, |_, _| ()))],
            "identify log.csv --solver ols",
            3,
            &["samples", "record at least"],
        ),
        csv_case("four rows", csv_with(HEADER, 4, |_, _| ()), 3, &["usable samples", "record at least"]),
    ]
}

#[test]
fn every_kind_of_bad_input_is_named_with_its_place_and_its_cure() {
    let cases: Vec<Case> = [recordings(), configurations(), too_little()].into_iter().flatten().collect();
    assert!(cases.len() >= 40, "only {} cases", cases.len());
    let mut failures = String::new();
    for case in &cases {
        let folder = tempfile::tempdir().unwrap();
        for (name, content) in &case.files {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, content).unwrap();
        }
        let output = run(folder.path(), case.arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        let missing: Vec<_> = case.says.iter().filter(|part| !said.contains(**part)).collect();
        if output.status.code() != Some(case.status) || !missing.is_empty() || said.contains("panicked") {
            let _ = writeln!(
                failures,
                "--- {}: status {:?} for {}, missing {missing:?} in:\n{said}",
                case.name,
                output.status.code(),
                case.status
            );
        }
    }
    assert!(failures.is_empty(), "{failures}");
}
