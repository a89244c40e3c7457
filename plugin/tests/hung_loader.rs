//! A library that hangs while it is loaded holds the loader's lock, on which the usual way out of a process waits as well. So
//! this is a program of its own, and that it ends is half of the test.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "helpers of tests")]

#[path = "suite/support/mod.rs"]
mod support;

use wheelwright_plugin::PluginError;

fn main() {
    if support::has_c_compiler() {
        let path = support::broken(&["HANG_IN_CONSTRUCTOR"]);
        let expected = PluginError::Hung { path: path.clone(), what: "loading it".to_owned(), limit_s: 1.0 };
        assert_eq!(support::load_hurried(&path).err(), Some(expected));
        println!("a library that hangs while it is loaded: refused");
    }
    wheelwright_plugin::exit(0)
}
