//! Result files: each is written whole to a temporary name and then renamed, so that none is ever half there.

use std::io::Write;
use std::path::{Path, PathBuf};

use wheelwright_core::dataset::{Dataset, Stretch};
use wheelwright_core::validation::Validation;
use wheelwright_diagnosis::finding::Replay;

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
    let pairs = |v: &&Validation| v.comparisons.iter().map(|c| (c.measured.clone(), c.simulated.clone())).collect();
    let parts: Vec<(&str, Vec<Pair>)> = parts.iter().map(|(part, v)| (*part, pairs(v))).collect();
    pairs_csv(channels, &parts)
}

/// The same of a diagnosis' replays, of which `which` picks the simulation.
pub fn replay_csv(parts: &[(&str, &Replay)], which: fn(&Replay) -> &Vec<Vec<Vec<f64>>>) -> String {
    let Some((_, first)) = parts.first() else { return String::new() };
    let pairs = |r: &Replay| r.measured.stretches.iter().cloned().zip(which(r).iter().cloned()).collect();
    let all: Vec<(&str, Vec<Pair>)> = parts.iter().map(|(part, r)| (*part, pairs(r))).collect();
    pairs_csv(&first.measured, &all)
}

/// A stretch and its simulated outputs.
type Pair = (Stretch, Vec<Vec<f64>>);

fn pairs_csv(channels: &Dataset, parts: &[(&str, Vec<Pair>)]) -> String {
    let mut header = vec!["t".to_owned(), "segment".to_owned(), "part".to_owned()];
    header.extend(channels.inputs.iter().chain(&channels.outputs).map(|c| c.name.to_string()));
    header.extend(channels.outputs.iter().map(|c| format!("{}_sim", c.name)));
    let mut text = header.join(",") + "\n";
    for (part, pairs) in parts {
        for (stretch, simulated) in pairs {
            let label = quoted(&stretch.label);
            for k in 0..stretch.len() {
                let mut row = vec![stretch.time[k].to_string(), label.clone(), (*part).to_owned()];
                row.extend(stretch.inputs.iter().chain(&stretch.outputs).map(|c| c[k].to_string()));
                row.extend(simulated.iter().map(|c| c.get(k).map(f64::to_string).unwrap_or_default()));
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
