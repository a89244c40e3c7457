//! A configuration table with nothing but its `type`.

use serde::de::DeserializeOwned;
use toml::{Table, Value};
use wheelwright_core::config;

/// `type = "name"`.
pub(crate) fn table(name: &str) -> Table {
    Table::from_iter([("type".to_owned(), Value::String(name.to_owned()))])
}

/// What such a configuration says of itself; nothing if it needs more keys.
pub(crate) fn about<T: DeserializeOwned>(name: &str, about: impl Fn(&T) -> String) -> String {
    config::tagged::<T>(table(name)).map_or_else(|_| String::new(), |config| about(&config))
}
