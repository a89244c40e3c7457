//! The plugins in Rust, built by the cargo that runs the tests.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

/// Every package is named, not only the plugins': dependencies then have the features of the tests' own build and are not built once more.
const BUILD: [&str; 7] = ["build", "--workspace", "--lib", "--example", "panicking", "--message-format=json", "--target-dir"];

/// The shared library that cargo makes of a target, in the target directory of the tests.
pub(crate) fn rust_library(target: &str) -> PathBuf {
    static LIBRARIES: OnceLock<HashMap<String, PathBuf>> = OnceLock::new();
    LIBRARIES.get_or_init(libraries)[target].clone()
}

fn libraries() -> HashMap<String, PathBuf> {
    let output = Command::new(env!("CARGO"))
        .args(BUILD)
        .arg(Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap())
        .args(if cfg!(debug_assertions) { [].as_slice() } else { ["--release"].as_slice() })
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .stderr(Stdio::inherit())
        .output()
        .unwrap();
    assert!(output.status.success(), "cargo {BUILD:?} failed");
    let text = String::from_utf8(output.stdout).unwrap();
    let messages = text.lines().filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok());
    let named = messages.filter_map(|message| {
        let target = &message["target"];
        let shared = target["crate_types"].as_array()?.iter().any(|kind| kind == "cdylib");
        shared.then(|| Some((target["name"].as_str()?.to_owned(), PathBuf::from(message["filenames"][0].as_str()?)))).flatten()
    });
    named.collect()
}
