//! The program: same bytes for any number of threads, a key apart from the cases, further drives, errors that help.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Output};

fn concealed(threads: usize, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_concealed")).env("RAYON_NUM_THREADS", threads.to_string()).args(arguments).output().unwrap()
}

fn make(home: &Path, threads: usize, set: &str, count: usize) -> Output {
    let (out, key) = (home.join("cases"), home.join("key.json"));
    let arguments = ["make", "--out", out.to_str().unwrap(), "--key", key.to_str().unwrap(), "--seed", "5", "--set", set, "--count"];
    concealed(threads, &[&arguments[..], &[&count.to_string()]].concat())
}

fn contents(home: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::from([("key".to_owned(), std::fs::read(home.join("key.json")).unwrap())]);
    for case in std::fs::read_dir(home.join("cases")).unwrap() {
        for file in std::fs::read_dir(case.unwrap().path()).unwrap() {
            let path = file.unwrap().path();
            all.insert(path.strip_prefix(home).unwrap().display().to_string(), std::fs::read(&path).unwrap());
        }
    }
    all
}

#[test]
fn any_number_of_threads_writes_the_same_bytes_and_the_seal_is_the_keys() {
    let (one, three) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let said = make(one.path(), 1, "mixed", 6);
    assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
    assert!(make(three.path(), 3, "mixed", 6).status.success());
    let (a, b) = (contents(one.path()), contents(three.path()));
    assert_eq!(a, b);
    assert!(a.len() > 12);
    let sealed = wheelwright_concealed::referee::key::seal(&a["key"]);
    assert!(String::from_utf8(said.stdout).unwrap().starts_with(&sealed));
    let header = String::from_utf8(a["cases/c0001/train.csv"].clone()).unwrap();
    assert!(header.starts_with("t,v_ref,omega_ref,v,omega"));
}

#[test]
fn a_further_drive_is_the_same_robot_with_new_noise() {
    let home = tempfile::tempdir().unwrap();
    assert!(make(home.path(), 1, "nulls", 1).status.success());
    let read = |path: &Path| -> Vec<Vec<f64>> {
        let text = std::fs::read_to_string(path).unwrap();
        text.lines().skip(1).map(|l| l.split(',').map(|x| x.parse().unwrap()).collect()).collect()
    };
    let (train, key, out) = (home.path().join("cases/c0001/train.csv"), home.path().join("key.json"), home.path().join("more.csv"));
    let paths = [key.to_str().unwrap(), train.to_str().unwrap(), out.to_str().unwrap()];
    let said = concealed(1, &["drive", "--key", paths[0], "--case", "c0001", "--commands", paths[1], "--out", paths[2]]);
    assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
    let (first, again) = (read(&train), read(&out));
    assert_eq!(first.len(), again.len());
    assert!(again[0][0] > first.last().unwrap()[0], "the clock goes on");
    let column = |rows: &[Vec<f64>], k: usize| rows.iter().map(|r| r[k]).collect::<Vec<f64>>();
    let (v, more) = (column(&first, 3), column(&again, 3));
    let difference = v.iter().zip(&more).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    let size = v.iter().map(|a| a * a).sum::<f64>();
    assert!(difference > 0.0 && difference < 0.02 * size, "{difference} of {size}");
}

#[test]
fn errors_say_what_is_wrong() {
    let home = tempfile::tempdir().unwrap();
    let unknown = make(home.path(), 1, "triples", 1);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(String::from_utf8(unknown.stderr).unwrap().contains("nulls, singles"));
    let inside = home.path().join("cases/key.json");
    let out = home.path().join("cases");
    let arguments =
        ["make", "--out", out.to_str().unwrap(), "--key", inside.to_str().unwrap(), "--seed", "1", "--set", "nulls", "--count", "1"];
    assert!(String::from_utf8(concealed(1, &arguments).stderr).unwrap().contains("elsewhere"));
    assert!(make(home.path(), 1, "nulls", 1).status.success());
    let (key, commands, more) = (home.path().join("key.json"), home.path().join("c.csv"), home.path().join("o.csv"));
    for (text, wanted) in [
        ("t,v_ref\n0,1\n1,1\n", "no column \"omega_ref\""),
        ("t,v_ref,omega_ref\n0,1,0\n1,nan,0\n", "row 3: \"nan\" is not a finite number"),
        ("t,v_ref,omega_ref\n1,1,0\n1,1,0\n", "does not rise"),
        ("t,v_ref,omega_ref\n1,1,0\n", "at least two"),
        ("", "no column"),
    ] {
        std::fs::write(&commands, text).unwrap();
        let paths = [key.to_str().unwrap(), commands.to_str().unwrap(), more.to_str().unwrap()];
        let said = concealed(1, &["drive", "--key", paths[0], "--case", "c0001", "--commands", paths[1], "--out", paths[2]]);
        assert_eq!(said.status.code(), Some(2));
        let message = String::from_utf8(said.stderr).unwrap();
        assert!(message.contains(wanted), "{message}");
    }
}

#[test]
fn sets_are_listed() {
    let said = String::from_utf8(concealed(1, &["sets"]).stdout).unwrap();
    assert_eq!(said.lines().count(), 7);
    assert!(said.contains("outside"));
}
