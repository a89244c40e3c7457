//! What robots and models of a library have in common: a name, and a table in the configuration.

#![allow(unsafe_code)]

use std::ffi::{CString, c_char};

use toml::Table;
use wheelwright_core::config::ConfigError;

use crate::abi;
use crate::config_text;
use crate::deadline::{Late, within};
use crate::host::library::Limits;
use crate::host::read;
use crate::host::robot::outcome;
use crate::message::Buffer;

/// Bytes of the message of a check.
const MESSAGE: usize = 1024;

/// Name, description and configuration of a library's robot or model.
#[derive(Debug, Clone)]
pub(crate) struct Offer {
    /// What `type = "..."` says. Lives as long as the library: for ever.
    pub(crate) name: &'static str,
    pub(crate) about: String,
    /// Keys of its table, if the library leaves refusing others to the host.
    keys: Option<Vec<String>>,
    check: Option<abi::Check>,
    pub(crate) limits: Limits,
}

impl Offer {
    /// Copies what a table says.
    ///
    /// # Safety
    /// The pointers are those of a table that obeys the header.
    pub(crate) unsafe fn read(
        name: *const c_char,
        about: *const c_char,
        keys: *const *const c_char,
        check: Option<abi::Check>,
        limits: Limits,
    ) -> Result<Self, String> {
        // SAFETY: as the caller vouches.
        unsafe {
            let listed = read::list(keys, "keys")?.into_iter().map(|key| read::name(key, "a key"));
            let listed = listed.collect::<Result<Vec<_>, _>>()?;
            let name: &'static str = Box::leak(read::name(name, "name")?.into_boxed_str());
            Ok(Self { name, about: read::text(about, "about")?, keys: (!keys.is_null()).then_some(listed), check, limits })
        }
    }

    /// Checks a table of this `type`, as far as that goes without opening anything. `kind` is `robot` or `model`.
    pub(crate) fn accept(&self, kind: &str, table: &Table) -> Result<(), ConfigError> {
        if let Some(keys) = &self.keys {
            config_text::check_keys(table, keys)?;
        }
        let Some(check) = self.check else { return Ok(()) };
        let config = c_config(table);
        let call = move || {
            let mut buffer = Buffer::<MESSAGE>::new();
            let message = buffer.abi();
            // SAFETY: a text with its NUL and a message that live until the call returns.
            let status = unsafe { check(config.as_ptr(), &raw const message) };
            outcome(status, &buffer)
        };
        let who = format!("plugin {kind} `{}`", self.name);
        within(self.name, self.limits.open, call).map_or_else(
            |late| Err(ConfigError::new("type", format!("{who}: {}", self.not_returned("checking this table", late)))),
            |checked| checked.map_err(|failure| failure.into_config_error(&who)),
        )
    }

    /// What to say of a call without a result.
    pub(crate) fn not_returned(&self, what: &str, late: Late) -> String {
        match late {
            Late::Timeout => format!("{what} has not returned within {} s", self.limits.open.as_secs_f64()),
            Late::Lost(reason) => reason,
        }
    }
}

/// A table as the text that crosses the boundary. The text has no NUL inside, as TOML allows none but escaped.
pub(crate) fn c_config(table: &Table) -> CString {
    CString::new(config_text::text(table)).unwrap_or_default()
}
