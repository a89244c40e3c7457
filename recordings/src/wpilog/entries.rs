//! The entries of a log: which are wanted, and their samples.

use std::collections::BTreeMap;
use std::io::BufRead;

use wheelwright_core::recording::ReadError;

use super::records::{Control, Header, Next, Records, malformed};

/// Numbers a log's entry may hold.
const NUMBERS: [&str; 3] = ["double", "float", "int64"];

/// Beginning of the names of SysId's state entries.
pub(super) const STATE: &str = "sysid-test-state-";

/// One entry with the samples of its type, of which one list is empty.
#[derive(Debug, Default)]
pub(super) struct Entry {
    pub(super) name: String,
    pub(super) kind: String,
    pub(super) metadata: String,
    pub(super) count: u64,
    /// (time \[µs\], number).
    pub(super) numbers: Vec<(u64, f64)>,
    /// (time \[µs\], text).
    pub(super) texts: Vec<(u64, String)>,
}

impl Entry {
    pub(super) fn is_number(&self) -> bool {
        NUMBERS.contains(&self.kind.as_str())
    }

    fn store(&mut self, header: &Header, payload: &[u8]) -> Result<(), ReadError> {
        self.count += 1;
        let number = match (self.kind.as_str(), payload) {
            ("double", bytes) => bytes.try_into().ok().map(f64::from_le_bytes),
            ("float", bytes) => bytes.try_into().ok().map(f32::from_le_bytes).map(f64::from),
            ("int64", bytes) => bytes.try_into().ok().map(|b| i64::from_le_bytes(b) as f64),
            _ => {
                self.texts.push((header.stamp, String::from_utf8_lossy(payload).into_owned()));
                return Ok(());
            }
        };
        let reason = || format!("entry `{}` holds {} bytes, which is no {}", self.name, payload.len(), self.kind);
        let number = number.ok_or_else(|| malformed(header.offset, reason()))?;
        self.numbers.push((header.stamp, number));
        Ok(())
    }
}

/// All entries of a log.
#[derive(Debug, Default)]
pub(super) struct Log {
    pub(super) entries: Vec<Entry>,
    pub(super) warnings: Vec<String>,
}

impl Log {
    /// Reads a log, keeping the samples of entries that `wanted` says yes to and counting the others'.
    pub(super) fn read(mut records: Records<impl BufRead>, wanted: impl Fn(&Entry) -> bool) -> Result<Self, ReadError> {
        let mut log = Self::default();
        let mut numbers: BTreeMap<u32, (usize, bool)> = BTreeMap::new();
        let mut unknown = 0u64;
        loop {
            let header = match records.header()? {
                Next::Whole(header) => header,
                Next::End => break,
                Next::Cut => return Ok(log.cut()),
            };
            if header.entry == 0 {
                if header.size == 0 {
                    let at = header.offset;
                    log.warnings.push(format!("byte {at}: no more records follow, only filling; what stands before is read"));
                    break;
                }
                let Next::Whole(payload) = records.payload(&header)? else { return Ok(log.cut()) };
                let control = Control::parse(&payload);
                match control.ok_or_else(|| malformed(header.offset, "a control record that makes no sense".to_owned()))? {
                    Control::Start { entry, name, kind, metadata } => {
                        let index = log.open(name, kind, metadata);
                        numbers.insert(entry, (index, wanted(&log.entries[index])));
                    }
                    Control::Other => {}
                }
                continue;
            }
            match numbers.get(&header.entry) {
                Some(&(index, true)) => {
                    let Next::Whole(payload) = records.payload(&header)? else { return Ok(log.cut()) };
                    log.entries[index].store(&header, &payload)?;
                }
                other => {
                    if !records.skip(header.size)? {
                        return Ok(log.cut());
                    }
                    match other {
                        Some(&(index, _)) => log.entries[index].count += 1,
                        None => unknown += 1,
                    }
                }
            }
        }
        if unknown > 0 {
            log.warnings.push(format!("{unknown} record(s) belong to entries that were never started and are passed over"));
        }
        Ok(log)
    }

    /// The entry of this name and type, which is a new one unless it was finished and started again.
    fn open(&mut self, name: String, kind: String, metadata: String) -> usize {
        let known = self.entries.iter().position(|e| e.name == name && e.kind == kind);
        known.unwrap_or_else(|| {
            self.entries.push(Entry { name, kind, metadata, ..Entry::default() });
            self.entries.len() - 1
        })
    }

    fn cut(mut self) -> Self {
        self.warnings.push("the file ends in the middle of a record; what stands before is read".to_owned());
        self
    }
}
