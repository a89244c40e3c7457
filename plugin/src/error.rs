//! Why a library is not loaded.

use std::path::PathBuf;

use thiserror::Error;

/// Why a library is not loaded. Every message begins with the library's path.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum PluginError {
    /// There is no such file.
    #[error("plugin {}: no such file; the path is taken relative to the config's folder, and nothing is searched", .path.display())]
    Missing {
        /// As given, joined to the config's folder.
        path: PathBuf,
    },
    /// The file cannot be read.
    #[error("plugin {}: {reason}", .path.display())]
    Unreadable {
        /// Library.
        path: PathBuf,
        /// What the system says.
        reason: String,
    },
    /// Anybody could put other code in its place.
    #[error("plugin {}: {what} is writable by everybody (mode {mode:o}), so anybody could run code here; `chmod o-w` it", .path.display())]
    WorldWritable {
        /// Library.
        path: PathBuf,
        /// `it`, or its folder.
        what: String,
        /// Permission bits.
        mode: u32,
    },
    /// Not a shared library of this machine, or not a whole one.
    #[error("plugin {}: not a shared library: {reason}", .path.display())]
    NotALibrary {
        /// Library.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The system's loader refused it, for example for a vendor library or symbol that is missing.
    #[error("plugin {}: cannot be loaded: {reason}", .path.display())]
    Load {
        /// Library.
        path: PathBuf,
        /// What the loader says.
        reason: String,
    },
    /// A library, but not of Wheelwright.
    #[error("plugin {}: it does not export `{symbol}`, so it is no Wheelwright plugin (C++ needs extern \"C\")", .path.display())]
    NoSymbol {
        /// Library.
        path: PathBuf,
        /// The symbol.
        symbol: &'static str,
    },
    /// Another version of the interface.
    #[error("plugin {}: it speaks plugin interface {found}, this program speaks {expected}; compile it with this program's header", .path.display())]
    Version {
        /// Library.
        path: PathBuf,
        /// The library's.
        found: u32,
        /// This program's.
        expected: u32,
    },
    /// A structure of another size.
    #[error("plugin {}: its `{structure}` has {found} bytes, this program's {expected}; compile it with this program's header", .path.display())]
    Size {
        /// Library.
        path: PathBuf,
        /// Structure.
        structure: &'static str,
        /// The library's.
        found: u32,
        /// This program's.
        expected: u32,
    },
    /// The descriptor breaks a rule of the header.
    #[error("plugin {}: {place}: {reason}", .path.display())]
    Invalid {
        /// Library.
        path: PathBuf,
        /// Where: `robot 2 `my-robot``.
        place: String,
        /// What is wrong.
        reason: String,
    },
    /// A name that is taken.
    #[error("plugin {}: the {kind} name \"{name}\" is taken by {by}", .path.display())]
    Taken {
        /// Library.
        path: PathBuf,
        /// `robot` or `model`.
        kind: &'static str,
        /// Name.
        name: String,
        /// Who has it.
        by: String,
    },
    /// A call while loading has not returned.
    #[error("plugin {}: {what} has not returned within {limit_s} s", .path.display())]
    Hung {
        /// Library.
        path: PathBuf,
        /// Which call.
        what: String,
        /// Limit \[s\].
        limit_s: f64,
    },
    /// A limit in the configuration is impossible.
    #[error("plugin {}: `{key}`: {reason}", .path.display())]
    Setting {
        /// Library.
        path: PathBuf,
        /// Key.
        key: &'static str,
        /// What is wrong.
        reason: String,
    },
}

impl PluginError {
    /// True if the library was loaded and then failed or broke the interface (exit status 5), false if what the
    /// configuration names cannot be taken at all (exit status 2).
    pub fn is_plugin_failure(&self) -> bool {
        matches!(self, Self::NoSymbol { .. } | Self::Version { .. } | Self::Size { .. } | Self::Invalid { .. } | Self::Hung { .. })
    }
}
