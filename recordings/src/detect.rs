//! The first bytes of a file, and what they look like to a person when no reader knows them.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use wheelwright_core::recording::ReadError;

/// Bytes shown to readers: enough for the comment lines that some loggers put before a table's header.
const HEAD: u64 = 64 * 1024;

const KNOWN: &str =
    "CSV with a header, Parquet, MCAP, rosbag2 (.mcap, .db3, bag folder), ROS 1 bag, WPILib .wpilog, SysId and frc-characterization JSON";

/// Beginnings of files that people pass by mistake.
const SIGNATURES: [(&[u8], &str); 11] = [
    (b"\x89PNG", "a PNG image"),
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"%PDF", "a PDF document"),
    (b"PK\x03\x04", "a ZIP archive or spreadsheet; extract it, or export the sheet as CSV"),
    (b"\x1f\x8b", "gzip-compressed data; decompress it first"),
    (b"\x28\xb5\x2f\xfd", "zstd-compressed data; decompress it first"),
    (b"BZh", "bzip2-compressed data; decompress it first"),
    (b"\x89HDF", "an HDF5 file; export it as CSV or Parquet"),
    (b"MATLAB 5.0", "a MATLAB file; export it as CSV or Parquet"),
    (b"\x7fELF", "a program"),
    (b"<", "HTML or XML"),
];

/// The first bytes of a regular file; none for a folder.
///
/// # Errors
/// `Io` if the path cannot be read, `Unsupported` for a device or pipe, which cannot be read twice.
pub(crate) fn head(path: &Path) -> Result<Vec<u8>, ReadError> {
    let kind = std::fs::metadata(path)?;
    let mut head = Vec::new();
    if kind.is_file() {
        File::open(path)?.take(HEAD).read_to_end(&mut head)?;
    } else if !kind.is_dir() {
        return Err(ReadError::Unsupported {
            what: "a device or pipe".to_owned(),
            reason: "recordings are read from regular files and bag folders; save the data to a file first".to_owned(),
        });
    }
    Ok(head)
}

/// The error for content that no reader knows.
pub(crate) fn unrecognised(path: &Path, head: &[u8]) -> ReadError {
    let found = if path.is_dir() { describe_folder(path) } else { describe(head) };
    ReadError::Unrecognised { found, known: KNOWN.to_owned() }
}

fn describe_folder(path: &Path) -> String {
    if path.join("metadata.yaml").is_file() {
        "a folder whose metadata.yaml is not a rosbag2 description".to_owned()
    } else {
        "a folder without metadata.yaml, so not a rosbag2 bag; name the file inside it".to_owned()
    }
}

fn describe(head: &[u8]) -> String {
    if head.is_empty() {
        return "0 bytes: the file is empty".to_owned();
    }
    if let Some((_, what)) = SIGNATURES.iter().find(|(magic, _)| head.starts_with(magic)) {
        return (*what).to_owned();
    }
    match text(head) {
        None if head.starts_with(b"\xff\xfe") || head.starts_with(b"\xfe\xff") => "UTF-16 text; save it as UTF-8".to_owned(),
        None => format!("binary data beginning with {}", hex(head)),
        Some(text) => describe_text(text),
    }
}

fn describe_text(text: &str) -> String {
    let first = text.trim_start_matches('\u{feff}').lines().map(str::trim).find(|l| !l.is_empty() && !l.starts_with('#'));
    match first {
        None => "text of nothing but blank lines and comments".to_owned(),
        Some(line) if line.starts_with(['{', '[']) => "JSON or similar, without the keys of a SysId or frc-characterization log".to_owned(),
        Some(line) if line.starts_with(|c: char| c.is_ascii_digit() || c == '-' || c == '.') => {
            "numbers without a header; put a first line with the column names, such as t,v_ref,omega_ref,v,omega".to_owned()
        }
        Some(_) => "text without a header of column names separated by comma, semicolon or tab".to_owned(),
    }
}

/// The head as text, if it is: valid UTF-8 but for a character cut at its end, and no control characters but white space.
pub(crate) fn text(head: &[u8]) -> Option<&str> {
    let text = match std::str::from_utf8(head) {
        Ok(text) => text,
        Err(e) if e.error_len().is_none() && head.len() as u64 == HEAD => std::str::from_utf8(&head[..e.valid_up_to()]).ok()?,
        Err(_) => return None,
    };
    let binary = |c: char| c.is_control() && !matches!(c, '\n' | '\r' | '\t' | '\x0c');
    if text.chars().any(binary) { None } else { Some(text) }
}

fn hex(head: &[u8]) -> String {
    head.iter().take(8).map(|b| format!("{b:02x}")).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heads_are_described_for_people() {
        let cases: [(&[u8], &str); 9] = [
            (b"", "0 bytes"),
            (b"\x89PNG\r\n\x1a\n", "PNG image"),
            (b"PK\x03\x04....", "ZIP archive"),
            (b"\x00\x01\x02\x03", "binary data beginning with 00 01 02 03"),
            (b"0.0,1.0\n0.1,1.0\n", "numbers without a header"),
            (b"dear diary\n", "text without a header"),
            (b"{\"a\": 1}", "JSON"),
            (b"# only\n\n#comments\n", "nothing but blank lines"),
            (b"\xff\xfet\x00,\x00", "UTF-16"),
        ];
        for (head, expected) in cases {
            let found = describe(head);
            assert!(found.contains(expected), "{head:?}: {found}");
        }
    }

    #[test]
    fn a_folder_and_an_absent_file_are_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let error = crate::open(folder.path(), &Default::default()).unwrap_err().to_string();
        assert!(error.contains("a folder without metadata.yaml"), "{error}");
        let error = crate::open(&folder.path().join("absent"), &Default::default()).unwrap_err();
        assert!(matches!(error, ReadError::Io(_)));
    }
}
