//! What is loaded and what is refused, with its message.

use std::fs;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};

use crate::support::{broken, has_c_compiler, load, registry, table};
use wheelwright_plugin::{Kind, Library, PluginEntry, PluginError, Registry};

/// Loads the misbehaving plugin with rules broken and returns what is said, and whether it is the plugin's failure.
fn said(defines: &[&str]) -> (String, bool) {
    let path = broken(defines);
    let error = load(&path).unwrap_err();
    let text = error.to_string();
    let text = text.strip_prefix(&format!("plugin {}: ", path.display())).expect("the message begins with the path").to_owned();
    (text, error.is_plugin_failure())
}

#[test]
fn a_broken_descriptor_is_refused_by_what_is_wrong_with_it() {
    if !has_c_compiler() {
        return;
    }
    let table = [
        ("WRONG_VERSION", "it speaks plugin interface 1, this program speaks 5"),
        ("WRONG_SIZE", "its `ww_robot_info` has 40 bytes, this program's 48"),
        ("NO_SYMBOL", "it does not export `wheelwright_plugin`"),
        ("NULL_DESCRIPTOR", "wheelwright_plugin: the descriptor is NULL"),
        ("MISALIGNED", "wheelwright_plugin: the descriptor is a misaligned pointer"),
        ("NULL_VERSION", "the descriptor: version is NULL"),
        ("NULL_NAME", "robot 1: name is NULL"),
        ("EMPTY_NAME", "robot 1: name is empty"),
        ("NOT_UTF8", "robot 1: name is not UTF-8 (byte 1)"),
        ("NULL_FUNCTION", "robot 1: the function `step` is NULL"),
        ("TWIN_NAMES", "robots: the name \"mock\" appears twice"),
        ("OFFERS_NOTHING", "it offers neither a robot nor a model nor an effect"),
        ("RESERVED", "solvers are reserved in this version and must be NULL"),
    ];
    for (define, expected) in table {
        let (text, failure) = said(&[define]);
        assert!(text.contains(expected), "{define}: {text}");
        assert!(failure, "{define}");
    }
}

#[test]
fn a_missing_vendor_symbol_is_found_while_loading() {
    if !has_c_compiler() {
        return;
    }
    let (text, failure) = said(&["VENDOR_SYMBOL"]);
    assert!(text.starts_with("cannot be loaded: ") && text.contains("vendor_symbol_that_is_missing"), "{text}");
    assert!(!failure);
}

#[test]
fn files_that_are_no_libraries_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str, content: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, content).unwrap();
        path
    };
    let program = fs::read(std::env::current_exe().unwrap()).unwrap();
    let mut object = program[..64].to_vec();
    object[16] = 1;
    let cases: [(PathBuf, &str); 6] = [
        (folder.path().join("absent.so"), "no such file; the path is taken relative to the config's folder, and nothing is searched"),
        (place("empty.so", b""), "not a shared library: it has only 0 bytes"),
        (place("text.so", &[b'x'; 100]), "not a shared library: it does not begin as one"),
        (folder.path().to_owned(), "not a shared library: it is not a regular file"),
        (place("object.so", &object), "not a shared library: it is an ELF file of another kind"),
        (place("program.so", &program), "cannot be loaded: "),
    ];
    for (path, expected) in cases {
        let error = load(&path).unwrap_err();
        assert!(error.to_string().contains(expected), "{error}");
        assert!(!error.is_plugin_failure());
    }
}

#[test]
fn a_truncated_library_is_refused_before_the_loader_maps_it() {
    if !has_c_compiler() {
        return;
    }
    let whole = fs::read(broken(&[])).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for share in [1, 2, 3, 4, 5, 6, 7] {
        // A file each: writing to one that is loaded would change running code.
        let path = folder.path().join(format!("cut-{share}.so"));
        fs::write(&path, &whole[..whole.len() * share / 8]).unwrap();
        match load(&path) {
            Err(PluginError::NotALibrary { reason, .. }) => assert!(reason.contains("it is cut off: "), "{reason}"),
            // What is not loaded into memory (section headers, debugging) may be missing.
            other => assert!(share >= 4 && other.is_ok(), "{share}/8: {other:?}"),
        }
    }
}

#[test]
fn what_everybody_may_write_is_refused_also_behind_a_link() {
    if !has_c_compiler() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("inner");
    fs::create_dir(&inner).unwrap();
    let library = inner.join("libmock.so");
    fs::copy(broken(&[]), &library).unwrap();
    let link = folder.path().join("link.so");
    symlink(&library, &link).unwrap();
    let mode = |path: &Path, mode| fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();

    mode(&library, 0o757);
    for path in [&library, &link] {
        let error = load(path).unwrap_err().to_string();
        assert!(error.contains("it is writable by everybody (mode 757), so anybody could run code here; `chmod o-w` it"), "{error}");
    }
    mode(&library, 0o755);
    mode(&inner, 0o777);
    let error = load(&link).unwrap_err();
    assert!(matches!(&error, PluginError::WorldWritable { mode: 0o777, .. }) && error.to_string().contains("its folder"), "{error}");
    mode(&inner, 0o1777);
    assert_eq!(load(&link).unwrap().name(), "broken");
}

#[test]
fn paths_are_relative_to_the_configuration() {
    if !has_c_compiler() {
        return;
    }
    let path = broken(&[]);
    let (folder, file) = (path.parent().unwrap(), path.file_name().unwrap());
    assert!(matches!(Library::load(Path::new("."), &PluginEntry::new(file)), Err(PluginError::Missing { .. })));
    let registry = Registry::load(folder, &[PluginEntry::new(file)]).unwrap();
    let library = &registry.libraries()[0];
    assert_eq!((library.name(), library.version(), library.path()), ("broken", "0.1", path.as_path()));
    let twice = Registry::load(folder, &[PluginEntry::new(file), PluginEntry::new(file)]).unwrap_err();
    assert!(twice.to_string().ends_with(&format!("the robot name \"mock\" is taken by {}", path.display())), "{twice}");
}

#[test]
fn a_name_of_a_built_in_is_refused() {
    if !has_c_compiler() {
        return;
    }
    let error = Registry::new().add(load(&broken(&["TAKEN_NAME"])).unwrap()).unwrap_err();
    assert!(error.to_string().ends_with("the robot name \"built-in-mock\" is taken by a built-in"), "{error}");
}

#[test]
fn limits_outside_reason_are_refused() {
    let toml = |text: &str| -> PluginEntry { toml::from_str(text).unwrap() };
    for (text, expected) in [
        ("path = 'a.so'\nopen_timeout_s = -1", "`open_timeout_s`: must be above 0 and at most 3600 s, not -1"),
        ("path = 'a.so'\ncall_timeout_s = nan", "`call_timeout_s`: must be above 0 and at most 3600 s, not NaN"),
        ("path = 'a.so'\ncall_timeout_s = 1e300", "`call_timeout_s`: "),
    ] {
        let error = Library::load(Path::new("."), &toml(text)).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
    assert!(toml::from_str::<PluginEntry>("path = 'a.so'\nsearch = true").unwrap_err().to_string().contains("unknown field `search`"));
}

#[test]
fn a_library_is_named_by_its_path_or_a_table() {
    let entries = |text: &str| table(text).remove("plugin").unwrap().try_into::<Vec<PluginEntry>>();
    let slow = PluginEntry { open_timeout_s: Some(60.0), ..PluginEntry::new("b.so") };
    assert_eq!(entries("plugin = ['a.so', { path = 'b.so', open_timeout_s = 60 }]"), Ok(vec![PluginEntry::new("a.so"), slow]));
    let error = entries("plugin = [3]").unwrap_err().to_string();
    assert!(error.contains("expected the path of a library, or a table with `path`"), "{error}");
}

#[test]
fn both_kinds_are_listed_and_unknown_names_list_both() {
    if !has_c_compiler() {
        return;
    }
    let path = broken(&[]);
    let registry = registry(&path);
    let list: Vec<_> = registry.list().into_iter().map(|l| (l.kind, l.name, l.about, l.library)).collect();
    let built_in = |kind| (kind, "built-in-mock".to_owned(), "a built-in of the tests".to_owned(), None);
    let loaded = |kind, about: &str| (kind, "mock".to_owned(), about.to_owned(), Some(path.clone()));
    // The effect is one of `effects.rs`, in the same program.
    let effect = (Kind::Effect, "cubic-drag-of-a-test".to_owned(), "drag".to_owned(), None);
    let expected = [
        built_in(Kind::Robot),
        built_in(Kind::Model),
        effect,
        loaded(Kind::Robot, "a robot to break"),
        loaded(Kind::Model, "a model to break"),
    ];
    assert_eq!(list, expected);
    let error = registry.robot(table("type = \"mokc\"")).unwrap_err().to_string();
    assert_eq!(error, "`type`: nothing is named \"mokc\"; did you mean \"mock\"? Known: built-in-mock, mock");
    assert!(registry.model(table("value = 1")).unwrap_err().to_string().contains("is missing"));
    let config = registry.robot(table("type = \"mock\"\nvalue = 1.5")).unwrap();
    assert_eq!(serde_json::to_string(&config).unwrap(), r#"{"mock":{"value":1.5}}"#);
    assert!(registry.robot(table("type = \"built-in-mock\"")).is_ok());
}
