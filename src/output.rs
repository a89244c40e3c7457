//! Result files: each is written whole to a temporary name and then renamed, so that none is ever half there.

use std::io::Write;
use std::path::{Path, PathBuf};

use wheelwright_core::dataset::Dataset;
use wheelwright_core::validation::Validation;

use crate::error::Error;

/// A folder that results go to.
#[derive(Debug, Clone)]
pub struct Folder(PathBuf);

impl Folder {
    /// Makes the folder if it is not there.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn create(path: &Path) -> Result<Self, Error> {
        std::fs::create_dir_all(path).map_err(|error| Error::Io { path: path.to_owned(), error })?;
        Ok(Self(path.to_owned()))
    }

    /// Path of a file in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Writes a file, all or nothing.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(&self, name: &str, content: &str) -> Result<PathBuf, Error> {
        let path = self.path(name);
        let attempt = || -> std::io::Result<()> {
            let mut file = wheelwright_recordings::file_beside(&path)?;
            file.write_all(content.as_bytes())?;
            file.as_file().sync_all()?;
            file.persist(&path)?;
            Ok(())
        };
        attempt().map_err(|error| Error::Io { path: path.clone(), error })?;
        Ok(path)
    }
}

/// The re-simulated series: a row a sample with its part (`train`, `validate`), segment, inputs, measured outputs and, with
/// the suffix `_sim`, the free-run outputs (empty after a divergence).
pub fn series_csv(channels: &Dataset, parts: &[(&str, &Validation)]) -> String {
    let mut header = vec!["t".to_owned(), "segment".to_owned(), "part".to_owned()];
    header.extend(channels.inputs.iter().chain(&channels.outputs).map(|c| c.name.to_string()));
    header.extend(channels.outputs.iter().map(|c| format!("{}_sim", c.name)));
    let mut text = header.join(",") + "\n";
    for (part, validation) in parts {
        for comparison in &validation.comparisons {
            let stretch = &comparison.measured;
            let label = quoted(&stretch.label);
            for k in 0..stretch.len() {
                let mut row = vec![stretch.time[k].to_string(), label.clone(), (*part).to_owned()];
                row.extend(stretch.inputs.iter().chain(&stretch.outputs).map(|c| c[k].to_string()));
                row.extend(comparison.simulated.iter().map(|c| c.get(k).map(f64::to_string).unwrap_or_default()));
                text.push_str(&row.join(","));
                text.push('\n');
            }
        }
    }
    text
}

/// A CSV field, quoted where it must be.
pub fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r']) { format!("\"{}\"", field.replace('"', "\"\"")) } else { field.to_owned() }
}
