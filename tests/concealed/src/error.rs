//! What can go wrong.

use std::path::PathBuf;

/// Errors of the proving ground.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// No set has this name.
    #[error("no set is called \"{name}\": it is one of {known}")]
    UnknownSet {
        /// The name asked for.
        name: String,
        /// The names there are.
        known: String,
    },
    /// No case of the key has this name.
    #[error("{key} has no case \"{case}\": it has {count} cases, the first is \"{first}\"", key = key.display())]
    UnknownCase {
        /// The key file.
        key: PathBuf,
        /// The name asked for.
        case: String,
        /// How many cases there are.
        count: usize,
        /// The first of them.
        first: String,
    },
    /// A file could not be read or written.
    #[error("cannot {what} {path}: {source}", path = path.display())]
    File {
        /// `read`, `write` or `create`.
        what: &'static str,
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The key lies among the cases, where whatever diagnoses could read it.
    #[error("the key {key} lies inside the folder of cases {out}: put it elsewhere", key = key.display(), out = out.display())]
    KeyAmongCases {
        /// The key file.
        key: PathBuf,
        /// The folder of cases.
        out: PathBuf,
    },
    /// A key is not what this program writes.
    #[error("{path} is not a key: {reason}", path = path.display())]
    Key {
        /// The key file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// Commands cannot be driven.
    #[error("{path}, row {row}: {reason}", path = path.display())]
    Commands {
        /// The file of commands.
        path: PathBuf,
        /// Row, the header is row 1.
        row: usize,
        /// What is wrong and what is wanted.
        reason: String,
    },
}
