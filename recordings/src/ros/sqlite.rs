//! rosbag2's sqlite3 storage: table `topics`, table `messages`, one row a message.
//!
//! Only the columns that all schema versions (1 to 4) have are asked for. The rows are read in one pass in the order of
//! the table, the bytes of unwanted topics stay on disk, and the file is neither written nor locked where that can be
//! avoided.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rusqlite::types::ValueRef;
use rusqlite::{Connection, OpenFlags};
use wheelwright_core::recording::ReadError;

use super::collect::{Collector, LONGEST_MESSAGE, malformed};

/// How every SQLite 3 file begins.
pub(crate) const MAGIC: [u8; 16] = *b"SQLite format 3\0";

/// Reads all messages into the collector.
///
/// # Errors
/// `Malformed` for a damaged database, `Unsupported` for a database that is no rosbag2 storage.
pub(crate) fn scan(path: &Path, head: &[u8], collector: &mut Collector) -> Result<(), ReadError> {
    let connection = open(path, head, collector).map_err(damaged)?;
    if !is_bag(&connection).map_err(damaged)? {
        return Err(ReadError::Unsupported {
            what: "an SQLite database without the tables `topics` and `messages`".to_owned(),
            reason: "only rosbag2 recordings are read from SQLite".to_owned(),
        });
    }
    let topics = topics(&connection, collector).map_err(damaged)?;
    let most = std::fs::metadata(path)?.len() + wal(path).and_then(|w| std::fs::metadata(w).ok()).map_or(0, |m| m.len());
    match messages(&connection, &topics, most, collector) {
        Ok(()) => Ok(()),
        // A database cut short is read up to the missing page; anything else in it may be wrong, too, so only that is let pass.
        Err(e) if is_corrupt(&e) && collector.has_messages() => {
            collector.warnings.push(format!("the database is damaged or cut off ({e}): what could be read before was read"));
            Ok(())
        }
        Err(e) => Err(damaged(e)),
    }
}

fn damaged(error: rusqlite::Error) -> ReadError {
    malformed("SQLite storage", format!("{error}; `sqlite3 FILE .recover` may save a damaged database"))
}

fn is_corrupt(error: &rusqlite::Error) -> bool {
    matches!(error.sqlite_error_code(), Some(rusqlite::ErrorCode::DatabaseCorrupt | rusqlite::ErrorCode::NotADatabase))
}

/// Opens the file without writing. Without a write-ahead log there is nothing to lock, so it is opened as immutable, which
/// also works on read-only media and leaves no files behind.
fn open(path: &Path, head: &[u8], collector: &mut Collector) -> rusqlite::Result<Connection> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_URI | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let log = wal(path).and_then(|w| std::fs::metadata(w).ok()).map(|m| m.len());
    let write_ahead = head.get(18) == Some(&2) || head.get(19) == Some(&2);
    if write_ahead && log.is_none() {
        let lone = "the database was in write-ahead mode and its -wal file is not beside it: messages that were only there are lost";
        collector.warnings.push(lone.to_owned());
    }
    let pending = log.is_some_and(|length| length > 0);
    let connection = Connection::open_with_flags(uri(path, !pending), flags)?;
    connection.execute_batch("PRAGMA trusted_schema = OFF; PRAGMA cell_size_check = ON; PRAGMA query_only = ON; PRAGMA mmap_size = 0;")?;
    Ok(connection)
}

fn wal(path: &Path) -> Option<PathBuf> {
    let mut name = path.file_name()?.to_owned();
    name.push("-wal");
    Some(path.with_file_name(name))
}

/// The path as an SQLite URI.
fn uri(path: &Path, immutable: bool) -> String {
    let mut uri = String::from("file:");
    for byte in path.as_os_str().as_encoded_bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'/' | b'.' | b'-' | b'_' => uri.push(char::from(*byte)),
            other => uri.push_str(&format!("%{other:02x}")),
        }
    }
    uri + if immutable { "?immutable=1" } else { "?mode=ro" }
}

/// True if both names are real tables: a view could compute without end.
fn is_bag(connection: &Connection) -> rusqlite::Result<bool> {
    let query = "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND rootpage > 0 AND name IN ('topics', 'messages')";
    connection.query_row(query, [], |row| row.get::<_, i64>(0)).map(|count| count == 2)
}

/// Topic index by topic id of the database.
fn topics(connection: &Connection, collector: &mut Collector) -> rusqlite::Result<BTreeMap<i64, usize>> {
    let mut statement = connection.prepare("SELECT id, name, type, serialization_format FROM topics ORDER BY id")?;
    let mut rows = statement.query([])?;
    let mut topics = BTreeMap::new();
    while let Some(row) = rows.next()? {
        let text = |column: usize| row.get::<_, String>(column);
        topics.insert(row.get(0)?, collector.topic(&text(1)?, &text(2)?, &text(3)?));
    }
    Ok(topics)
}

/// Passes all messages on, at most as many as the file has bytes: pages that point at each other could go on without end.
fn messages(connection: &Connection, topics: &BTreeMap<i64, usize>, most: u64, collector: &mut Collector) -> rusqlite::Result<()> {
    let wanted: Vec<String> = topics.iter().filter(|(_, topic)| collector.wants(**topic)).map(|(id, _)| id.to_string()).collect();
    let query = format!(
        "SELECT topic_id, timestamp, CASE WHEN topic_id IN ({}) THEN length(data) END, \
         CASE WHEN topic_id IN ({0}) AND length(data) <= {LONGEST_MESSAGE} THEN data END FROM messages",
        wanted.join(",")
    );
    let mut statement = connection.prepare(&query)?;
    let mut rows = statement.query([])?;
    let mut seen = 0;
    while let Some(row) = rows.next()? {
        seen += 1;
        if seen > most {
            return Err(rusqlite::Error::SqliteFailure(rusqlite::ffi::Error::new(rusqlite::ffi::SQLITE_CORRUPT), None));
        }
        let Some(&topic) = topics.get(&row.get(0)?) else {
            continue;
        };
        let length: Option<i64> = row.get(2)?;
        match (length, row.get_ref(3)?) {
            (_, ValueRef::Blob(bytes)) => {
                let log: i64 = row.get(1)?;
                collector.message(topic, u64::try_from(log).unwrap_or(u64::MAX), bytes);
            }
            (Some(length), _) => collector.too_long(topic, length.unsigned_abs()),
            _ => collector.pass(topic),
        }
    }
    Ok(())
}
