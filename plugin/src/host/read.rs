//! Reading what a library points to: every pointer is checked for null and alignment, every text and list has an end.
//!
//! Whether a pointer that is neither null nor misaligned leads to what the header says cannot be checked; that is the part of
//! the contract a library is trusted with.

#![allow(unsafe_code)]

use std::collections::BTreeSet;
use std::ffi::c_char;

use wheelwright_core::channel::Channel;

use crate::abi;

/// Longest text of a descriptor [bytes] and longest list [entries]: far above any use, far below what a wild pointer gives.
const LONGEST: usize = 4096;

/// Copies one structure.
///
/// # Safety
/// `pointer` is null, misaligned, or leads to a readable `T`.
pub(crate) unsafe fn structure<T: Copy>(pointer: *const T, what: &str) -> Result<T, String> {
    check_pointer(pointer, what)?;
    // SAFETY: neither null nor misaligned; the caller vouches for the rest.
    Ok(unsafe { pointer.read() })
}

/// Copies `count` elements.
///
/// # Safety
/// As [`structure`], for `count` elements.
pub(crate) unsafe fn array<T: Copy>(pointer: *const T, count: usize, what: &str) -> Result<Vec<T>, String> {
    if count > LONGEST {
        return Err(format!("{what}: {count} entries; more than {LONGEST} cannot be meant"));
    }
    if count == 0 {
        return Ok(Vec::new());
    }
    check_pointer(pointer, what)?;
    // SAFETY: neither null nor misaligned; the caller vouches for the rest.
    Ok(unsafe { std::slice::from_raw_parts(pointer, count) }.to_vec())
}

/// Copies the pointers of a NULL-terminated list; a null list is empty.
///
/// # Safety
/// As [`structure`], for the entries up to the first null.
pub(crate) unsafe fn list<T>(pointer: *const *const T, what: &str) -> Result<Vec<*const T>, String> {
    let mut entries = Vec::new();
    if pointer.is_null() {
        return Ok(entries);
    }
    check_pointer(pointer, what)?;
    while entries.len() < LONGEST {
        // SAFETY: the entries before this one were not null, so the list goes on.
        let entry = unsafe { pointer.add(entries.len()).read() };
        if entry.is_null() {
            return Ok(entries);
        }
        entries.push(entry);
    }
    Err(format!("{what}: no closing NULL within {LONGEST} entries"))
}

/// Copies a text.
///
/// # Safety
/// `pointer` is null or leads to a text with a closing NUL.
pub(crate) unsafe fn text(pointer: *const c_char, what: &str) -> Result<String, String> {
    check_pointer(pointer, what)?;
    let mut bytes = Vec::new();
    while bytes.len() < LONGEST {
        // SAFETY: the bytes before this one were not NUL, so the text goes on.
        let byte = unsafe { pointer.add(bytes.len()).read() }.cast_unsigned();
        if byte == 0 {
            return String::from_utf8(bytes).map_err(|e| format!("{what} is not UTF-8 (byte {})", e.utf8_error().valid_up_to()));
        }
        bytes.push(byte);
    }
    Err(format!("{what}: no closing NUL within {LONGEST} bytes"))
}

/// Copies a text that names something: not empty, no control characters.
///
/// # Safety
/// As [`text`].
pub(crate) unsafe fn name(pointer: *const c_char, what: &str) -> Result<String, String> {
    // SAFETY: as the caller vouches.
    let name = unsafe { text(pointer, what) }?;
    if name.trim().is_empty() || name.chars().any(char::is_control) {
        return Err(format!("{what} is empty or holds control characters"));
    }
    Ok(name)
}

/// Copies channels with distinct names.
///
/// # Safety
/// As [`array`] and [`text`].
pub(crate) unsafe fn channels(pointer: *const abi::Channel, count: usize, what: &str) -> Result<Vec<Channel>, String> {
    let mut channels = Vec::new();
    // SAFETY: as the caller vouches.
    for (i, raw) in unsafe { array(pointer, count, what) }?.into_iter().enumerate() {
        // SAFETY: as the caller vouches.
        let (name, unit) = unsafe { (name(raw.name, &format!("{what}[{i}].name"))?, text(raw.unit, &format!("{what}[{i}].unit"))?) };
        channels.push(Channel::owned(name, unit));
    }
    distinct(channels.iter().map(|c| &*c.name), what)?;
    Ok(channels)
}

/// Refuses a name that appears twice.
pub(crate) fn distinct<'a>(names: impl Iterator<Item = &'a str>, what: &str) -> Result<(), String> {
    let mut seen = BTreeSet::new();
    for name in names {
        if !seen.insert(name) {
            return Err(format!("{what}: the name \"{name}\" appears twice"));
        }
    }
    Ok(())
}

fn check_pointer<T>(pointer: *const T, what: &str) -> Result<(), String> {
    if pointer.is_null() {
        return Err(format!("{what} is NULL"));
    }
    if !pointer.is_aligned() {
        return Err(format!("{what} is a misaligned pointer"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endless_and_misaligned_input_is_refused() {
        let long = [b'a'.cast_signed(); LONGEST + 1];
        // SAFETY: the text and the list are longer than what is read of them; the misaligned pointer is not followed.
        unsafe {
            assert!(text(long.as_ptr(), "name").unwrap_err().contains("no closing NUL"));
            let item = 1_u64;
            let endless = vec![&raw const item; LONGEST + 1];
            assert!(list(endless.as_ptr(), "robots").unwrap_err().contains("no closing NULL"));
            let odd = (&raw const item).cast::<u8>().add(1).cast::<u64>();
            assert!(structure(odd, "robot").unwrap_err().contains("misaligned"));
            assert!(array(&raw const item, usize::MAX, "inputs").unwrap_err().contains("cannot be meant"));
        }
    }
}
