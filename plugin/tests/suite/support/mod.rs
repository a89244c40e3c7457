//! Builds the plugins that the tests load.
#![allow(dead_code, reason = "each test program uses its own part")]

mod built;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use toml::Table;
use wheelwright_core::model::{ModelConfig, ModelError, RegressorModel};
use wheelwright_core::robot::{Robot, RobotConfig, RobotError};
use wheelwright_plugin::{Library, PluginEntry, PluginError, Registry};

/// Root of the workspace.
pub(crate) fn workspace() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

fn scratch() -> &'static Path {
    static SCRATCH: OnceLock<PathBuf> = OnceLock::new();
    SCRATCH.get_or_init(|| {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("plugins");
        std::fs::create_dir_all(&path).unwrap();
        path
    })
}

fn compiler() -> String {
    std::env::var("CC").unwrap_or_else(|_| "cc".to_owned())
}

/// False, said plainly, where there is no C compiler.
pub(crate) fn has_c_compiler() -> bool {
    let found = Command::new(compiler()).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok();
    if !found {
        eprintln!("SKIPPED: no C compiler (`{}`) on PATH", compiler());
    }
    found
}

/// Compiles a C file of the workspace to a library of its own name; the header must be free of warnings.
pub(crate) fn compile(source: &str, defines: &[&str], name: &str) -> PathBuf {
    // Its own process and name, because tests run side by side.
    let library = scratch().join(format!("lib{name}-{}.so", std::process::id()));
    let flags = ["-shared", "-fPIC", "-std=gnu11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-I"];
    let status = Command::new(compiler())
        .args(flags)
        .arg(workspace().join("plugin/include"))
        .args(defines.iter().map(|d| format!("-D{d}")))
        .arg(workspace().join(source))
        .arg("-o")
        .arg(&library)
        .arg("-lm")
        .status()
        .unwrap();
    assert!(status.success(), "{source} with {defines:?} does not compile");
    library
}

/// The misbehaving C plugin with some of its rules broken.
pub(crate) fn broken(defines: &[&str]) -> PathBuf {
    static COUNT: std::sync::atomic::AtomicUsize = std::sync::atomic::AtomicUsize::new(0);
    let count = COUNT.fetch_add(1, std::sync::atomic::Ordering::SeqCst);
    compile("plugin/tests/broken/broken.c", defines, &format!("broken-{count}"))
}

/// The example plugin in Rust.
pub(crate) fn rust_example() -> PathBuf {
    built::rust_library("wheelwright_example_plugin")
}

/// The Rust plugin that panics.
pub(crate) fn panicking() -> PathBuf {
    built::rust_library("panicking")
}

/// Loads with limits that a busy machine keeps.
pub(crate) fn load(path: &Path) -> Result<Library, PluginError> {
    Library::load(Path::new("."), &PluginEntry { open_timeout_s: Some(10.0), call_timeout_s: Some(8.0), ..PluginEntry::new(path) })
}

/// Loads with short limits, for what hangs.
pub(crate) fn load_hurried(path: &Path) -> Result<Library, PluginError> {
    Library::load(Path::new("."), &PluginEntry { open_timeout_s: Some(1.0), call_timeout_s: Some(0.3), ..PluginEntry::new(path) })
}

/// A registry with one library.
pub(crate) fn registry(path: &Path) -> Registry {
    with(load(path))
}

/// A registry with one library that hangs.
pub(crate) fn hurried(path: &Path) -> Registry {
    with(load_hurried(path))
}

fn with(library: Result<Library, PluginError>) -> Registry {
    let mut registry = Registry::new();
    registry.add(library.unwrap()).unwrap();
    registry
}

pub(crate) fn table(text: &str) -> Table {
    text.parse().unwrap()
}

/// The robot of a TOML table, connected.
pub(crate) fn robot(registry: &Registry, text: &str) -> Result<Box<dyn Robot>, RobotError> {
    registry.robot(table(text)).unwrap().connect(1)
}

/// The model of a TOML table, built.
pub(crate) fn model(registry: &Registry, text: &str) -> Result<Box<dyn RegressorModel>, ModelError> {
    registry.model(table(text)).unwrap().build()
}

/// The error of what has no `Debug` to unwrap.
pub(crate) fn refused<T>(result: Result<T, RobotError>) -> RobotError {
    result.map(|_| ()).unwrap_err()
}

/// Made into a built-in, for clashes and lists.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct BuiltInMock {}

#[typetag::serde(name = "built-in-mock")]
impl RobotConfig for BuiltInMock {
    fn about(&self) -> String {
        "a built-in of the tests".to_owned()
    }

    fn connect(&self, _: u64) -> Result<Box<dyn Robot>, RobotError> {
        Err(RobotError::Connection("a mock".to_owned()))
    }
}

#[typetag::serde(name = "built-in-mock")]
impl ModelConfig for BuiltInMock {
    fn about(&self) -> String {
        "a built-in of the tests".to_owned()
    }

    fn build(&self) -> Result<Box<dyn RegressorModel>, ModelError> {
        Err(ModelError::Config { key: "type".to_owned(), reason: "a mock".to_owned() })
    }
}
