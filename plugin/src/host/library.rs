//! A loaded library: from a path to checked tables.

#![allow(unsafe_code)]

use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::de::value::MapAccessDeserializer;
use serde::de::{self, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};

use crate::abi;
use crate::deadline::{Late, within};
use crate::error::PluginError;
use crate::host::offer::Offer;
use crate::host::{file, read};

/// A library as a configuration names it: a `[[plugin]]` table, or in short its path alone.
///
/// ```toml
/// plugin = ["libmy.so", { path = "libslow.so", open_timeout_s = 60 }]
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct PluginEntry {
    /// The library, relative to the folder of the configuration.
    pub path: PathBuf,
    /// How long loading and each `open` may take \[s\]; 10 by default.
    pub open_timeout_s: Option<f64>,
    /// How long any other call of a robot may take \[s\]; by default ten control periods, at least 1.
    pub call_timeout_s: Option<f64>,
}

impl PluginEntry {
    /// A library with the default limits.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into(), open_timeout_s: None, call_timeout_s: None }
    }
}

impl<'de> Deserialize<'de> for PluginEntry {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(EntryVisitor)
    }
}

/// Takes a text or a table. Not an untagged enum, whose error would not name the key.
struct EntryVisitor;

impl<'de> Visitor<'de> for EntryVisitor {
    type Value = PluginEntry;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the path of a library, or a table with `path`")
    }

    fn visit_str<E: de::Error>(self, path: &str) -> Result<PluginEntry, E> {
        Ok(PluginEntry::new(path))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<PluginEntry, A::Error> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Long {
            path: PathBuf,
            open_timeout_s: Option<f64>,
            call_timeout_s: Option<f64>,
        }
        let Long { path, open_timeout_s, call_timeout_s } = Long::deserialize(MapAccessDeserializer::new(map))?;
        Ok(PluginEntry { path, open_timeout_s, call_timeout_s })
    }
}

/// How long calls may take.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    pub(crate) open: Duration,
    call: Option<Duration>,
}

impl Limits {
    const OPEN_S: f64 = 10.0;
    const CALL_S: f64 = 1.0;
    const CALL_PERIODS: f64 = 10.0;
    /// Longest limit and longest control period that can be meant: an hour \[s\].
    pub(crate) const LONGEST_S: f64 = 3600.0;

    fn of(entry: &PluginEntry, path: &Path) -> Result<Self, PluginError> {
        let seconds = |key: &'static str, value: f64| {
            let reason = format!("must be above 0 and at most {} s, not {value}", Self::LONGEST_S);
            let ok = value > 0.0 && value <= Self::LONGEST_S;
            ok.then(|| Duration::from_secs_f64(value)).ok_or(PluginError::Setting { path: path.to_owned(), key, reason })
        };
        let open = seconds("open_timeout_s", entry.open_timeout_s.unwrap_or(Self::OPEN_S))?;
        let call = entry.call_timeout_s.map(|value| seconds("call_timeout_s", value)).transpose()?;
        Ok(Self { open, call })
    }

    /// For a robot of this control period \[s\].
    pub(crate) fn call(&self, period: f64) -> Duration {
        let default = (Self::CALL_PERIODS * period).clamp(Self::CALL_S, Self::CALL_PERIODS * Self::LONGEST_S);
        self.call.unwrap_or_else(|| Duration::from_secs_f64(default))
    }
}

/// A robot of a library.
#[derive(Debug, Clone)]
pub(crate) struct RobotTable {
    pub(crate) offer: Offer,
    pub(crate) open: abi::OpenRobot,
    pub(crate) calls: RobotCalls,
}

/// What can be called on a connected robot.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RobotCalls {
    pub(crate) measure: abi::Measure,
    pub(crate) step: abi::Step,
    pub(crate) stop: abi::Stop,
    pub(crate) close: abi::Close,
}

/// A model of a library.
#[derive(Debug, Clone)]
pub(crate) struct ModelTable {
    pub(crate) offer: Offer,
    pub(crate) open: abi::OpenModel,
    pub(crate) regressor: abi::Regressor,
    pub(crate) accelerations: Option<abi::Accelerations>,
    pub(crate) close: abi::Close,
}

/// An effect of a library.
#[derive(Debug, Clone)]
pub(crate) struct EffectTable {
    pub(crate) offer: Offer,
    pub(crate) open: abi::OpenEffect,
    pub(crate) prepare: abi::Prepare,
    pub(crate) statement: abi::Statement,
    pub(crate) release: abi::Close,
    pub(crate) close: abi::Close,
    /// The table, for the hooks that it may leave out.
    pub(crate) hooks: EffectHooks,
}

/// What an effect may do while a simulation runs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EffectHooks {
    pub(crate) begin: Option<abi::Begin>,
    pub(crate) next_switch: Option<abi::NextSwitch>,
    pub(crate) command: Option<abi::Command>,
    pub(crate) load: Option<abi::Load>,
    pub(crate) drive: Option<abi::Drive>,
    pub(crate) advance: Option<abi::Advance>,
    pub(crate) measure: Option<abi::Observe>,
}

/// A loaded library. It is never unloaded: its code may be on a stack, in a callback or in a thread of its own.
#[derive(Debug, Clone)]
pub struct Library {
    path: PathBuf,
    name: String,
    version: String,
    pub(crate) robots: Vec<RobotTable>,
    pub(crate) models: Vec<ModelTable>,
    pub(crate) effects: Vec<EffectTable>,
}

impl Library {
    /// Loads the library of a configuration that lies in folder `base`.
    ///
    /// # Errors
    /// [`PluginError`].
    pub fn load(base: &Path, entry: &PluginEntry) -> Result<Self, PluginError> {
        let given = base.join(&entry.path);
        let limits = Limits::of(entry, &given)?;
        let resolved = file::checked(base, &entry.path)?;
        let path = given.clone();
        let loading = move || -> Result<Self, PluginError> {
            let descriptor = open(&given, &resolved)?;
            // SAFETY: the library's one exported function returned it, and the header says what it leads to.
            unsafe { accept(&given, descriptor, limits) }
        };
        within(&path.display().to_string(), limits.open, loading).unwrap_or_else(|late| {
            Err(match late {
                Late::Timeout => PluginError::Hung { path, what: "loading it".to_owned(), limit_s: limits.open.as_secs_f64() },
                Late::Lost(reason) => PluginError::Load { path, reason },
            })
        })
    }

    /// Its path, joined to the folder it was given relative to.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What it calls itself.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its own version.
    pub fn version(&self) -> &str {
        &self.version
    }
}

/// Loads the code, for ever, and asks for the descriptor.
fn open(given: &Path, resolved: &Path) -> Result<*const abi::Plugin, PluginError> {
    let failed = |e: libloading::Error| PluginError::Load { path: given.to_owned(), reason: one_line(&e) };
    #[cfg(unix)]
    let library = {
        use libloading::os::unix::{Library, RTLD_LOCAL, RTLD_NOW};
        // All symbols now: one that is missing must be found here and not end the process in the middle of a drive.
        // SAFETY: runs the library's initializers; who names a library in a configuration trusts its code.
        unsafe { Library::open(Some(resolved), RTLD_NOW | RTLD_LOCAL) }.map_err(failed)?
    };
    #[cfg(not(unix))]
    // SAFETY: as above.
    let library = unsafe { libloading::Library::new(resolved) }.map_err(failed)?;
    // SAFETY: the header gives the symbol this type.
    let entry = unsafe { library.get::<abi::Entry>(abi::SYMBOL) }.map(|symbol| *symbol);
    // Never unloaded, also if it is refused: its initializers may have left threads or exit handlers behind.
    std::mem::forget(library);
    let entry = entry.map_err(|_| PluginError::NoSymbol { path: given.to_owned(), symbol: abi::SYMBOL })?;
    // SAFETY: the library stays loaded, and the function takes nothing.
    Ok(unsafe { entry() })
}

fn one_line(error: &libloading::Error) -> String {
    let source = std::error::Error::source(error).map(|s| format!(": {s}")).unwrap_or_default();
    format!("{error}{source}").replace('\n', " ")
}

/// Checks the descriptor and copies what it leads to.
///
/// # Safety
/// `descriptor` is null or obeys the header.
unsafe fn accept(path: &Path, descriptor: *const abi::Plugin, limits: Limits) -> Result<Library, PluginError> {
    let invalid = |place: &str, reason: String| PluginError::Invalid { path: path.to_owned(), place: place.to_owned(), reason };
    // A library of another version promises only the version, and one with other sizes only the header.
    // SAFETY: every version begins with its number.
    let found = unsafe { read::structure(descriptor.cast::<u32>(), "the descriptor") }.map_err(|e| invalid(abi::SYMBOL, e))?;
    if found != abi::ABI_VERSION {
        return Err(PluginError::Version { path: path.to_owned(), found, expected: abi::ABI_VERSION });
    }
    // SAFETY: this version has this header.
    let header = unsafe { read::structure(descriptor.cast::<abi::Header>(), "the descriptor") }.map_err(|e| invalid(abi::SYMBOL, e))?;
    for ((structure, found), (_, expected)) in header.sizes().into_iter().zip(abi::Header::OWN.sizes()) {
        if found != expected {
            return Err(PluginError::Size { path: path.to_owned(), structure, found, expected });
        }
    }
    // SAFETY: version and sizes are ours.
    let plugin = unsafe { read::structure(descriptor, "the descriptor") }.map_err(|e| invalid(abi::SYMBOL, e))?;
    // SAFETY: a descriptor of this version leads to what the header says.
    let library = unsafe {
        Library {
            path: path.to_owned(),
            name: read::name(plugin.name, "name").map_err(|e| invalid("the descriptor", e))?,
            version: read::name(plugin.version, "version").map_err(|e| invalid("the descriptor", e))?,
            robots: tables(plugin.robots, "robot", |table| robot(table, limits)).map_err(|(place, e)| invalid(&place, e))?,
            models: tables(plugin.models, "model", |table| model(table, limits)).map_err(|(place, e)| invalid(&place, e))?,
            effects: tables(plugin.effects, "effect", |table| effect(table, limits)).map_err(|(place, e)| invalid(&place, e))?,
        }
    };
    if !plugin.solvers.is_null() {
        return Err(invalid("the descriptor", "solvers are reserved in this version and must be NULL".to_owned()));
    }
    if library.robots.is_empty() && library.models.is_empty() && library.effects.is_empty() {
        return Err(invalid("the descriptor", "it offers neither a robot nor a model nor an effect".to_owned()));
    }
    read::distinct(library.robots.iter().map(|r| r.offer.name), "robots").map_err(|e| invalid("the descriptor", e))?;
    read::distinct(library.models.iter().map(|m| m.offer.name), "models").map_err(|e| invalid("the descriptor", e))?;
    read::distinct(library.effects.iter().map(|e| e.offer.name), "effects").map_err(|e| invalid("the descriptor", e))?;
    Ok(library)
}

/// Reads every table of a list; an error comes with the number of its table.
///
/// # Safety
/// `list` is null or a NULL-terminated list of tables that obey the header.
unsafe fn tables<T: Copy, U>(
    list: *const *const T,
    kind: &str,
    accept: impl Fn(T) -> Result<U, String>,
) -> Result<Vec<U>, (String, String)> {
    // SAFETY: as the caller vouches.
    let entries = unsafe { read::list(list, &format!("{kind}s")) }.map_err(|e| ("the descriptor".to_owned(), e))?;
    let each = entries.into_iter().enumerate().map(|(i, entry)| {
        // SAFETY: as the caller vouches.
        let table = unsafe { read::structure(entry, "the table") };
        table.and_then(&accept).map_err(|e| (format!("{kind} {}", i + 1), e))
    });
    each.collect()
}

fn required<F>(function: Option<F>, name: &str) -> Result<F, String> {
    function.ok_or_else(|| format!("the function `{name}` is NULL"))
}

/// # Safety
/// `table` obeys the header; so for [`model`].
unsafe fn robot(table: abi::Robot, limits: Limits) -> Result<RobotTable, String> {
    // SAFETY: as the caller vouches.
    let offer = unsafe { Offer::read(table.name, table.about, table.keys, table.check, limits) }?;
    let calls = RobotCalls {
        measure: required(table.measure, "measure")?,
        step: required(table.step, "step")?,
        stop: required(table.stop, "stop")?,
        close: required(table.close, "close")?,
    };
    Ok(RobotTable { offer, open: required(table.open, "open")?, calls })
}

unsafe fn model(table: abi::Model, limits: Limits) -> Result<ModelTable, String> {
    // SAFETY: as the caller vouches.
    let offer = unsafe { Offer::read(table.name, table.about, table.keys, table.check, limits) }?;
    Ok(ModelTable {
        offer,
        open: required(table.open, "open")?,
        regressor: required(table.regressor, "regressor")?,
        accelerations: table.accelerations,
        close: required(table.close, "close")?,
    })
}

unsafe fn effect(table: abi::Effect, limits: Limits) -> Result<EffectTable, String> {
    // SAFETY: as the caller vouches.
    let offer = unsafe { Offer::read(table.name, table.about, table.keys, table.check, limits) }?;
    let abi::Effect { begin, next_switch, command, load, drive, advance, measure, .. } = table;
    Ok(EffectTable {
        offer,
        open: required(table.open, "open")?,
        prepare: required(table.prepare, "prepare")?,
        statement: required(table.statement, "statement")?,
        release: required(table.release, "release")?,
        close: required(table.close, "close")?,
        hooks: EffectHooks { begin, next_switch, command, load, drive, advance, measure },
    })
}
