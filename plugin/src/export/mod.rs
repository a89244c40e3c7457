//! The library's side for Rust: everything behind [`export!`](crate::export!).
//!
//! The tables name what the library's own typetag registry holds; `open` looks the configuration's `type` up there, so a
//! plugin is written exactly like a built-in. Every call is caught when it panics.

#![allow(unsafe_code)]

mod effect;
mod model;
mod robot;

use std::any::Any;
use std::ffi::{CStr, CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::OnceLock;

use toml::Table;
use wheelwright_core::Effect;
use wheelwright_core::channel::Channel;
use wheelwright_core::config;
use wheelwright_core::model::ModelConfig;
use wheelwright_core::robot::RobotConfig;

use crate::abi;
use crate::alone::about;
use crate::message;
use crate::status::Failure;

/// Makes a crate of type `cdylib` a Wheelwright plugin. Its robots, models and effects are `#[typetag::serde]` implementations
/// of [`RobotConfig`], [`ModelConfig`] and [`Effect`], as built-in ones are.
///
/// ```ignore
/// wheelwright_plugin::export! { robots: ["my-base"], models: ["my-model"], effects: ["my_effect"] }
/// ```
///
/// Each kind may be left out; the order is that of the example.
///
/// Without names, `export!()` offers everything that the crate and the crates it links register. A plugin that uses
/// `wheelwright-models` must name its own, or it would offer `vw-pd` once more and be refused.
#[macro_export]
macro_rules! export {
    () => { $crate::export!(@ None, None, None); };
    (
        $(robots: [$($robot:literal),* $(,)?] $(,)?)?
        $(models: [$($model:literal),* $(,)?] $(,)?)?
        $(effects: [$($effect:literal),* $(,)?] $(,)?)?
    ) => {
        $crate::export!(@ Some(&[$($($robot),*)?]), Some(&[$($($model),*)?]), Some(&[$($($effect),*)?]));
    };
    (@ $robots:expr, $models:expr, $effects:expr) => {
        #[cfg(panic = "abort")]
        compile_error!("a Wheelwright plugin must be compiled with panic = \"unwind\": a panic has to become an error of the host");

        /// The one symbol of a Wheelwright plugin.
        #[allow(unsafe_code)]
        #[unsafe(no_mangle)]
        pub extern "C" fn wheelwright_plugin() -> *const $crate::abi::Plugin {
            let crate_name = (env!("CARGO_PKG_NAME"), env!("CARGO_PKG_VERSION"));
            $crate::export::descriptor(crate_name, $crate::export::Selection { robots: $robots, models: $models, effects: $effects })
        }
    };
}

/// Names to offer; `None` stands for all that are registered.
#[derive(Debug, Clone, Copy)]
pub struct Selection {
    /// Robots.
    pub robots: Option<&'static [&'static str]>,
    /// Models.
    pub models: Option<&'static [&'static str]>,
    /// Effects.
    pub effects: Option<&'static [&'static str]>,
}

/// The descriptor of the library that this crate is linked into, made once and never freed; null if making it panics.
pub fn descriptor((name, version): (&str, &str), selection: Selection) -> *const abi::Plugin {
    /// A descriptor is never changed once made.
    struct Descriptor(*const abi::Plugin);
    // SAFETY: it points to memory that is never written again nor freed.
    unsafe impl Send for Descriptor {}
    // SAFETY: as above.
    unsafe impl Sync for Descriptor {}
    static DESCRIPTOR: OnceLock<Descriptor> = OnceLock::new();

    let make = || {
        let robots = names::<Box<dyn RobotConfig>>(selection.robots).into_iter().map(|name| {
            let about = about::<Box<dyn RobotConfig>>(&name, |robot| robot.about());
            robot::table(forever(&name), forever(&about))
        });
        let models = names::<Box<dyn ModelConfig>>(selection.models).into_iter().map(|name| {
            let about = about::<Box<dyn ModelConfig>>(&name, |model| model.about());
            model::table(forever(&name), forever(&about))
        });
        let effects = names::<Box<dyn Effect>>(selection.effects).into_iter().map(|name| {
            let about = about::<Box<dyn Effect>>(&name, |effect| effect.about());
            effect::table(forever(&name), forever(&about))
        });
        let plugin = abi::Plugin {
            header: abi::Header::OWN,
            name: forever(name),
            version: forever(version),
            robots: list(robots),
            models: list(models),
            solvers: std::ptr::null(),
            effects: list(effects),
        };
        Descriptor(Box::leak(Box::new(plugin)))
    };
    catch_unwind(|| DESCRIPTOR.get_or_init(make).0).unwrap_or(std::ptr::null())
}

fn names<T: serde::de::DeserializeOwned>(selected: Option<&[&str]>) -> Vec<String> {
    selected.map_or_else(config::names::<T>, |names| names.iter().map(|&name| name.to_owned()).collect())
}

/// A NULL-terminated list that is never freed.
fn list<T>(tables: impl Iterator<Item = T>) -> *const *const T {
    let ended: Vec<*const T> = tables.map(|table| &raw const *Box::leak(Box::new(table))).chain([std::ptr::null()]).collect();
    ended.leak().as_ptr()
}

fn forever(text: &str) -> *const c_char {
    c_text(text).into_raw()
}

/// As a C text; a NUL inside would end it and becomes a space.
fn c_text(text: &str) -> CString {
    CString::new(text.replace('\0', " ")).unwrap_or_default()
}

/// C channels, and the texts they point to.
pub(crate) fn c_channels(channels: &[Channel], texts: &mut Vec<CString>) -> Vec<abi::Channel> {
    let each = channels.iter().map(|channel| abi::Channel { name: keep(&channel.name, texts), unit: keep(&channel.unit, texts) });
    each.collect()
}

/// Stores a text and points to it; a `CString` does not move its bytes when it moves.
fn keep(text: &str, texts: &mut Vec<CString>) -> *const c_char {
    let text = c_text(text);
    let pointer = text.as_ptr();
    texts.push(text);
    pointer
}

/// Runs a call; an error or a panic becomes status and message.
///
/// # Safety
/// `message` is as the header says.
unsafe fn guard(message: *const abi::Message, call: impl FnOnce() -> Result<(), Failure>) -> abi::Status {
    // The host lets nothing but `stop` and `close` follow a panic, so broken invariants are not seen again.
    match catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(|payload| Err(panicked(payload))) {
        Ok(()) => abi::OK,
        Err(failure) => {
            // SAFETY: as the caller vouches.
            unsafe { message::write(message, &failure.text) };
            failure.status
        }
    }
}

fn panicked(payload: Box<dyn Any + Send>) -> Failure {
    let text = payload.downcast_ref::<&str>().map(|&s| s.to_owned()).or_else(|| payload.downcast_ref::<String>().cloned());
    // Dropping a payload may panic in turn, and that one nobody would catch.
    std::mem::forget(payload);
    Failure::new(abi::DRIVER, format!("panicked: {}", text.unwrap_or_else(|| "without a text".to_owned())))
}

/// Reads the configuration text of the host into what it names.
///
/// # Safety
/// `text` is null or a text with its NUL.
unsafe fn configured<T: serde::de::DeserializeOwned>(text: *const c_char) -> Result<T, Failure> {
    if text.is_null() {
        return Err(Failure::new(abi::DRIVER, "the host gave no configuration"));
    }
    // SAFETY: not null; the caller vouches for the rest.
    let text = unsafe { CStr::from_ptr(text) }.to_str().map_err(|e| Failure::new(abi::CONFIG, e.to_string()))?;
    let table: Table = text.parse().map_err(|e: toml::de::Error| Failure::new(abi::CONFIG, e.message()))?;
    Ok(config::tagged::<T>(table)?)
}

/// The check of a configuration: that it can be read.
///
/// # Safety
/// As the header says.
unsafe fn check<T: serde::de::DeserializeOwned>(config: *const c_char, message: *const abi::Message) -> abi::Status {
    // SAFETY: as the caller vouches.
    unsafe { guard(message, || configured::<T>(config).map(drop)) }
}

/// A slice of the host's, which may be empty and then null.
///
/// # Safety
/// `pointer` leads to `count` values that nobody writes meanwhile.
unsafe fn slice<'a>(pointer: *const f64, count: usize) -> &'a [f64] {
    // SAFETY: as the caller vouches.
    if pointer.is_null() || count == 0 { &[] } else { unsafe { std::slice::from_raw_parts(pointer, count) } }
}

/// A slice of the host's to write to.
///
/// # Safety
/// `pointer` leads to `count` initialized values that nobody else uses meanwhile.
unsafe fn slice_mut<'a>(pointer: *mut f64, count: usize) -> &'a mut [f64] {
    // SAFETY: as the caller vouches.
    if pointer.is_null() || count == 0 { &mut [] } else { unsafe { std::slice::from_raw_parts_mut(pointer, count) } }
}

/// Ends something of the library's. There is nobody to report to, and dropping a payload may panic in turn.
fn end(call: impl FnOnce()) {
    if let Err(payload) = catch_unwind(AssertUnwindSafe(call)) {
        std::mem::forget(payload);
    }
}
