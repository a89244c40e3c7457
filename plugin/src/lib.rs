//! The plugin boundary: robots, models and effects from shared libraries.
//!
//! One idea: *typetag inside a library, a versioned C table between libraries.* typetag's registry does not cross a
//! dynamically loaded library, and Rust's own ABI between separately built ones is not defined; a C table with its version and
//! sizes in front is. A Rust plugin is written exactly like a built-in plus one [`export!`] line; C and C++ use
//! `include/wheelwright_plugin.h`. To a configuration all look like a built-in: [`Registry`] resolves `type = "..."`.
//!
//! What the host guards against: a file that anybody may write, a library that is cut off or of another kind, version or
//! layout, nulls, texts without end or not UTF-8, names twice, panics, values that are not finite, writes past an array, and
//! calls that do not return. What it cannot: a library runs with all rights of the program, and a segmentation fault in it ends
//! the program.

#![deny(unsafe_op_in_unsafe_fn)]
#![deny(clippy::undocumented_unsafe_blocks)]

pub mod abi;
mod alone;
pub mod check;
mod config_text;
mod deadline;
mod error;
pub mod export;
mod host;
mod message;
mod registry;
mod status;

pub use deadline::exit;
pub use error::PluginError;
pub use host::library::{Library, PluginEntry};
pub use host::watch::watch_models;
pub use registry::{Kind, Listed, Registry};
