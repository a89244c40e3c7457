//! Messages across the boundary: the host's fixed buffer, and how a library writes into it.

#![allow(unsafe_code)]

use std::ffi::c_char;

use crate::abi::Message;

/// A message buffer of the host; reading it never looks beyond its `N` bytes, whatever a library wrote.
pub(crate) struct Buffer<const N: usize>([u8; N]);

impl<const N: usize> Buffer<N> {
    pub(crate) fn new() -> Self {
        Self([0; N])
    }

    /// What a call gets; valid while `self` is neither moved nor dropped.
    pub(crate) fn abi(&mut self) -> Message {
        Message { text: self.0.as_mut_ptr().cast::<c_char>(), capacity: N }
    }

    /// Up to the closing NUL or the end of the buffer; bytes that are not UTF-8 are replaced.
    pub(crate) fn text(&self) -> String {
        let end = self.0.iter().position(|&b| b == 0).unwrap_or(N);
        String::from_utf8_lossy(&self.0[..end]).trim().to_owned()
    }
}

/// Writes `text` into the host's buffer, cut at a character so that the closing NUL fits.
///
/// # Safety
/// `message` is null or points to a [`Message`] whose `text` has `capacity` writable bytes.
pub(crate) unsafe fn write(message: *const Message, text: &str) {
    // SAFETY: the caller vouches for a pointer that is not null.
    let Some(message) = (unsafe { message.as_ref() }) else { return };
    if message.text.is_null() || message.capacity == 0 {
        return;
    }
    let mut end = text.len().min(message.capacity - 1);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    // SAFETY: `end < capacity`, so the copy and the NUL behind it stay in the buffer, which cannot overlap our text.
    unsafe {
        std::ptr::copy_nonoverlapping(text.as_ptr(), message.text.cast::<u8>(), end);
        *message.text.add(end) = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_message_is_cut_at_a_character_inside_the_buffer() {
        let mut buffer = Buffer::<8>::new();
        let short = Message { capacity: 6, ..buffer.abi() };
        // SAFETY: the buffer has more than the six bytes promised.
        unsafe { write(&raw const short, "abcdäöü") };
        assert_eq!(buffer.text(), "abcd");
        assert_eq!(buffer.0[6..], [0, 0]);
    }

    #[test]
    fn a_buffer_without_a_closing_nul_is_read_to_its_end() {
        let buffer = Buffer::<4>([b'a', b'b', 0xff, b'd']);
        assert_eq!(buffer.text(), "ab\u{fffd}d");
    }
}
