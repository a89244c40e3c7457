//! Captured conversations, which lie outside of this tree.
#![allow(clippy::unwrap_used, clippy::print_stderr, missing_docs, unreachable_pub, dead_code)]

use std::path::PathBuf;

/// What one side sent at a time.
pub struct Entry {
    pub time: f64,
    pub from_client: bool,
    pub bytes: Vec<u8>,
}

/// A transcript; `None`, with a word about it, if it is not there.
pub fn read(name: &str) -> Option<Vec<Entry>> {
    let shared =
        std::env::var_os("WHEELWRIGHT_SHARED").map_or_else(|| concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared").into(), PathBuf::from);
    let path = shared.join("transcripts").join(name);
    let Ok(text) = std::fs::read_to_string(&path) else {
        eprintln!("skipped: {} is not there; set WHEELWRIGHT_SHARED", path.display());
        return None;
    };
    Some(text.lines().map(entry).collect())
}

/// `seconds DIRECTION hex.. | comment`
fn entry(line: &str) -> Entry {
    let mut words = line.split('|').next().unwrap().split_whitespace();
    let time = words.next().unwrap().parse().unwrap();
    let from_client = matches!(words.next().unwrap(), "C>S" | "H>R");
    let bytes = words.map(|b| u8::from_str_radix(b, 16).unwrap()).collect();
    Entry { time, from_client, bytes }
}
