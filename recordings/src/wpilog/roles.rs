//! Which entry of a log is which column.

use wheelwright_core::recording::{ReadError, ReadOptions, list};

use super::entries::{Entry, STATE};
use crate::columns::check_map;

/// Columns found by name, with words of which an entry's name holds one of each list.
const ROLES: [(&str, [&[&str]; 2]); 6] = [
    ("u_left", [&["left"], &["voltage", "volts"]]),
    ("u_right", [&["right"], &["voltage", "volts"]]),
    ("pos_left", [&["left"], &["position"]]),
    ("pos_right", [&["right"], &["position"]]),
    ("vel_left", [&["left"], &["velocity"]]),
    ("vel_right", [&["right"], &["velocity"]]),
];

/// Names of the gyro's angle.
const GYRO: [&str; 3] = ["gyro", "gyro-angle", "gyro_angle"];

/// Names listed in a message.
const LISTED: usize = 40;

/// A column to be made from an entry.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Choice {
    pub(super) name: String,
    pub(super) entry: usize,
    pub(super) scale: f64,
    pub(super) offset: f64,
}

/// True for entries that can become a column or mark segments.
pub(super) fn is_candidate(entry: &Entry, options: &ReadOptions) -> bool {
    let mapped = options.columns.iter().any(|m| m.from == entry.name);
    let role = entry.is_number() && (ROLES.iter().any(|(_, words)| matches(&entry.name, words)) || is_gyro(&entry.name));
    mapped || role || (entry.kind == "string" && entry.name.starts_with(STATE))
}

/// The entry that each column comes from: mapped ones, then those whose names say what they are.
///
/// # Errors
/// [`ReadError::Malformed`] for a mapping to no entry, two entries of one role, or no entry at all, with the names there are.
pub(super) fn choose(entries: &[Entry], options: &ReadOptions, warnings: &mut Vec<String>) -> Result<Vec<Choice>, ReadError> {
    let mut choices: Vec<Choice> = Vec::new();
    let mut targets = Vec::new();
    for map in &options.columns {
        check_map(map, &targets)?;
        targets.push(map.name.clone());
        let refuse = |reason: String| Err(ReadError::Malformed { position: format!("mapping {}={}", map.name, map.from), reason });
        if map.name == "t" {
            return refuse("a log's time is its records' stamps; leave `t` out".to_owned());
        }
        match entries.iter().position(|e| e.name == map.from) {
            _ if map.name == "segment" => {}
            Some(entry) if entries[entry].count == 0 => return refuse("the entry holds no values".to_owned()),
            Some(entry) if entries[entry].is_number() => {
                choices.push(Choice { name: map.name.clone(), entry, scale: map.scale, offset: map.offset });
            }
            Some(entry) => return refuse(format!("the entry is of type {}, not a number", entries[entry].kind)),
            None => return refuse(format!("no such entry; {}", numeric_entries(entries))),
        }
    }
    let mut absent = Vec::new();
    for (name, words) in ROLES {
        if targets.iter().any(|t| t == name) {
            continue;
        }
        match find(entries, name, &words)? {
            Some(entry) => choices.push(identity(name, entry)),
            None => absent.push(name),
        }
    }
    let gyro = entries.iter().position(|e| e.is_number() && e.count > 0 && is_gyro(&e.name));
    if let Some(entry) = gyro.filter(|_| !targets.iter().any(|t| t == "gyro_angle")) {
        choices.push(identity("gyro_angle", entry));
    }
    if choices.is_empty() {
        let reason = format!("none is named like `left-velocity`; choose with --map vel_left=ENTRY; {}", numeric_entries(entries));
        return Err(ReadError::Malformed { position: "entries".to_owned(), reason });
    }
    // Whoever maps columns knows what the log holds.
    if !absent.is_empty() && options.columns.is_empty() {
        let names = list(absent.iter().copied());
        warnings.push(format!("no entry for {names}; map them with --map {}=ENTRY; {}", absent[0], numeric_entries(entries)));
    }
    Ok(choices)
}

fn identity(name: &str, entry: usize) -> Choice {
    Choice { name: name.to_owned(), entry, scale: 1.0, offset: 0.0 }
}

/// The one entry with the words of a role.
fn find(entries: &[Entry], role: &str, words: &[&[&str]; 2]) -> Result<Option<usize>, ReadError> {
    let exact = format!("{}-{}", words[0][0], words[1][0]);
    let number = |e: &Entry| e.is_number() && e.count > 0;
    if let Some(entry) = entries.iter().position(|e| number(e) && e.name == exact) {
        return Ok(Some(entry));
    }
    let found: Vec<usize> = (0..entries.len()).filter(|&i| number(&entries[i]) && matches(&entries[i].name, words)).collect();
    if found.len() > 1 {
        let names = list(found.iter().take(LISTED).map(|&i| entries[i].name.as_str()));
        let reason = format!("{names} could each be `{role}`; choose with --map {role}=ENTRY");
        return Err(ReadError::Malformed { position: "entries".to_owned(), reason });
    }
    Ok(found.first().copied())
}

/// True if the name holds, as words of its own, one of each list.
fn matches(name: &str, words: &[&[&str]; 2]) -> bool {
    let lower = name.to_ascii_lowercase();
    let holds = |list: &&[&str]| lower.split(|c: char| !c.is_ascii_alphanumeric()).any(|word| list.contains(&word));
    words.iter().all(holds)
}

fn is_gyro(name: &str) -> bool {
    GYRO.contains(&name.to_ascii_lowercase().as_str())
}

fn numeric_entries(entries: &[Entry]) -> String {
    let names: Vec<&str> = entries.iter().filter(|e| e.is_number()).map(|e| e.name.as_str()).collect();
    let more = if names.len() > LISTED { format!(" and {} more", names.len() - LISTED) } else { String::new() };
    format!("the numeric entries are {}{more}", list(names.iter().take(LISTED).copied()))
}
