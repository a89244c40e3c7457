//! TOML files that know their lines: an error at a key says where in the file the key stands.

use std::path::{Path, PathBuf};

use toml::Table;
use toml::de::{DeTable, DeValue};
use wheelwright_core::config::ConfigError;

use crate::error::Error;

/// A TOML file's path and text. The default is no file: settings of the command line.
#[derive(Debug, Clone, Default)]
pub struct TomlFile {
    path: PathBuf,
    text: String,
}

impl TomlFile {
    /// Reads a file.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn read(path: &Path) -> Result<Self, Error> {
        let text = std::fs::read_to_string(path).map_err(|error| Error::Io { path: path.to_owned(), error })?;
        Ok(Self { path: path.to_owned(), text })
    }

    /// The file's table.
    ///
    /// # Errors
    /// [`Error::Config`] with line and column.
    pub fn table(&self) -> Result<Table, Error> {
        self.text.parse().map_err(|e: toml::de::Error| {
            let position = e.span().map(|span| line_and_column(&self.text, span.start));
            Error::Config { file: self.path.clone(), position, error: ConfigError::new("", e.message()) }
        })
    }

    /// An error at a key, with its line and column if the key stands in the file.
    pub fn error(&self, error: ConfigError) -> Error {
        Error::Config { position: locate(&self.text, &error.path), file: self.path.clone(), error }
    }

    /// The file; empty for none.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// Line and column from 1 of the key at a dotted path, or of the nearest table above it.
fn locate(text: &str, path: &str) -> Option<(usize, usize)> {
    let document = DeTable::parse(text).ok()?;
    let mut table = document.get_ref();
    let mut found = None;
    for part in path.split('.') {
        let name = part.split('[').next().unwrap_or(part);
        let Some((key, value)) = table.iter().find(|(key, _)| key.get_ref().as_ref() == name) else { break };
        found = Some(key.span().start);
        match value.get_ref() {
            DeValue::Table(inner) => table = inner,
            _ => break,
        }
    }
    found.map(|offset| line_and_column(text, offset))
}

fn line_and_column(text: &str, offset: usize) -> (usize, usize) {
    let before = &text[..offset.min(text.len())];
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().map_or(0, |l| l.chars().count()) + 1;
    (line, column)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_found_with_its_line_and_column() {
        let text = "seed = 1\n[robot]\ntype = \"simulator\"\n  mass = -9\n";
        assert_eq!(locate(text, "robot.mass"), Some((4, 3)));
        assert_eq!(locate(text, "robot.absent"), Some((2, 2)), "the table above stands in for a key that is not there");
        assert_eq!(locate(text, "model"), None);
    }
}
