//! The host's side: load a library, check what it hands out, and make its robots, models and effects look like built-in ones.

pub(crate) mod effect;
pub(crate) mod file;
pub(crate) mod library;
pub(crate) mod model;
pub(crate) mod offer;
pub(crate) mod read;
pub(crate) mod robot;
pub(crate) mod watch;
