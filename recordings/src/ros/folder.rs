//! Bag folders: `metadata.yaml` and the storage files that it lists.
//!
//! Only three keys of the description matter: which files, in which order, and how messages are serialized. Compression
//! and storage are seen from the files themselves. So instead of a YAML library (the well-known one is no longer kept up)
//! there is a line reader for the block style that rosbag2 writes.

use std::path::{Component, Path, PathBuf};

use wheelwright_core::recording::ReadError;

use super::collect::{Collector, malformed};
use super::storage::{self, Storage};

/// The file that makes a folder a bag.
pub(crate) const METADATA: &str = "metadata.yaml";
/// The key at its top.
const ROOT: &str = "rosbag2_bagfile_information:";

/// Longest description that is read.
const LONGEST_METADATA: u64 = 64 << 20;

/// The folder of a bag, if `path` is one or is its description.
pub(crate) fn of(path: &Path) -> Option<PathBuf> {
    let folder = if path.file_name().is_some_and(|name| name == METADATA) { path.parent()? } else { path };
    let description = read_limited(&folder.join(METADATA)).ok()?;
    (path.is_dir() || path.ends_with(METADATA)).then_some(())?;
    description.lines().any(|line| line.trim_end() == ROOT).then(|| folder.to_owned())
}

fn read_limited(path: &Path) -> std::io::Result<String> {
    use std::io::Read;
    let mut text = String::new();
    std::fs::File::open(path)?.take(LONGEST_METADATA).read_to_string(&mut text)?;
    Ok(text)
}

/// Scans all files of a bag in order, and says which storage they are.
///
/// # Errors
/// `Malformed` for a description without files or a missing file; otherwise as the files'.
pub(crate) fn scan(folder: &Path, collector: &mut Collector) -> Result<Storage, ReadError> {
    let description = read_limited(&folder.join(METADATA))?;
    let metadata = Metadata::parse(&description);
    if let Some((topic, format)) = metadata.serializations.iter().find(|(_, format)| format != "cdr") {
        return Err(ReadError::Unsupported {
            what: format!("{METADATA}: topic `{topic}` is serialized as `{format}`"),
            reason: "only cdr is read; convert the bag with `ros2 bag convert`".to_owned(),
        });
    }
    let mut found = None;
    for name in &metadata.files {
        let path = locate(folder, name).ok_or_else(|| {
            malformed(
                format!("{METADATA}, relative_file_paths"),
                format!("`{name}` is not in the folder; copy the whole bag, or run `ros2 bag reindex`"),
            )
        })?;
        found = Some(storage::scan(&path, collector).map_err(|e| in_file(name, e))?);
    }
    found.ok_or_else(|| malformed(METADATA, "`relative_file_paths` lists no file; `ros2 bag reindex` writes it anew"))
}

/// Early rosbag2 wrote the paths with the folder's own name in front.
fn locate(folder: &Path, name: &str) -> Option<PathBuf> {
    let path = Path::new(name);
    let inside = path.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
    let candidates = [inside.then(|| folder.join(path)), path.file_name().map(|file| folder.join(file))];
    candidates.into_iter().flatten().find(|p| p.is_file())
}

fn in_file(name: &str, error: ReadError) -> ReadError {
    match error {
        ReadError::Malformed { position, reason } => ReadError::Malformed { position: format!("{name}, {position}"), reason },
        ReadError::Unsupported { what, reason } => ReadError::Unsupported { what: format!("{name}: {what}"), reason },
        other => other,
    }
}

/// What is taken from the description.
#[derive(Debug, Default, PartialEq, Eq)]
struct Metadata {
    /// Storage files in order.
    files: Vec<String>,
    /// Topic and serialization format.
    serializations: Vec<(String, String)>,
}

impl Metadata {
    fn parse(text: &str) -> Self {
        let mut metadata = Self::default();
        let mut listing = None;
        let mut name = String::new();
        for line in text.lines() {
            let indent = line.len() - line.trim_start().len();
            let content = line.trim();
            if let Some(depth) = listing {
                match content.strip_prefix("- ") {
                    Some(item) if indent >= depth => {
                        metadata.files.push(scalar(item));
                        continue;
                    }
                    _ if content.is_empty() || content.starts_with('#') => continue,
                    _ => listing = None,
                }
            }
            let Some((key, value)) = content.trim_start_matches("- ").split_once(':') else {
                continue;
            };
            match (key.trim(), value.trim()) {
                ("relative_file_paths", "") => listing = Some(indent),
                ("relative_file_paths", flow) => metadata.files = flow_list(flow),
                ("name", value) => name = scalar(value),
                ("serialization_format", value) => metadata.serializations.push((name.clone(), scalar(value))),
                _ => {}
            }
        }
        metadata
    }
}

/// A scalar without its quotes or a comment behind it.
fn scalar(text: &str) -> String {
    let text = text.trim();
    for quote in ['"', '\''] {
        if let Some((inner, _)) = text.strip_prefix(quote).and_then(|rest| rest.split_once(quote)) {
            return inner.to_owned();
        }
    }
    text.split(" #").next().unwrap_or_default().trim_end().to_owned()
}

/// `[a, b]`.
fn flow_list(text: &str) -> Vec<String> {
    let inner = text.trim_start_matches('[').trim_end_matches(']');
    inner.split(',').map(scalar).filter(|item| !item.is_empty()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_block_style_of_rosbag2_is_read() {
        let text = "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n  relative_file_paths:\n    - \"my bag_0.db3\"\n    - b_1.db3 # second\n    \
                    - 'c_2.db3'\n  duration:\n    nanoseconds: 1\n  topics_with_message_count:\n    - topic_metadata:\n        name: /odom\n        type: nav_msgs/msg/Odometry\n        \
                    serialization_format: cdr\n      message_count: 3\n  files:\n    - path: x.db3\n";
        let metadata = Metadata::parse(text);
        assert_eq!(metadata.files, ["my bag_0.db3", "b_1.db3", "c_2.db3"]);
        assert_eq!(metadata.serializations, [("/odom".to_owned(), "cdr".to_owned())]);
    }

    #[test]
    fn lists_at_the_indent_of_their_key_and_flow_lists_are_read() {
        let text = "rosbag2_bagfile_information:\n  relative_file_paths:\n  - a.mcap\n  - b.mcap\n  ros_distro: x\n";
        assert_eq!(Metadata::parse(text).files, ["a.mcap", "b.mcap"]);
        assert_eq!(Metadata::parse("  relative_file_paths: [a.mcap, \"b.mcap\"]").files, ["a.mcap", "b.mcap"]);
        assert_eq!(Metadata::parse("  relative_file_paths: []"), Metadata::default());
    }

    #[test]
    fn files_outside_the_folder_are_not_looked_at() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.db3"), b"x").unwrap();
        assert!(locate(folder.path(), "bag/a.db3").is_some_and(|p| p == folder.path().join("a.db3")));
        assert_eq!(locate(folder.path(), "../../etc/hostname"), None);
        assert_eq!(locate(folder.path(), "/etc/hostname"), None);
    }
}
