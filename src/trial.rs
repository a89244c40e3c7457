//! A blind trial: every case of a folder diagnosed, each for itself, whatever happens to the others.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::error::Error;
use crate::source::digest;

/// Files of a case that are read, the first of which makes a folder a case.
pub const FILES: [&str; 3] = ["train.csv", "validate.csv", "robot.toml"];

/// A case's folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Case {
    /// Name of the folder.
    pub name: String,
    /// The folder.
    pub folder: PathBuf,
}

impl Case {
    /// Path of one of [`FILES`], if the case has it.
    pub fn file(&self, name: &str) -> Option<PathBuf> {
        Some(self.folder.join(name)).filter(|path| path.exists())
    }

    /// SHA-256 of its files, by name.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn inputs(&self) -> Result<Value, Error> {
        let mut inputs = json!({});
        for (name, path) in FILES.iter().filter_map(|name| self.file(name).map(|path| (name, path))) {
            inputs[*name] = json!(digest(&path).map_err(|error| Error::Io { path, error })?);
        }
        Ok(inputs)
    }
}

/// The cases of a folder, in order of name.
///
/// # Errors
/// [`Error::Io`], or [`Error::Usage`] if there is none.
pub fn cases(folder: &Path) -> Result<Vec<Case>, Error> {
    let io = |error| Error::Io { path: folder.to_owned(), error };
    let entries: Vec<PathBuf> =
        std::fs::read_dir(folder).map_err(io)?.map(|entry| entry.map(|e| e.path())).collect::<Result<_, _>>().map_err(io)?;
    let named = |path: PathBuf| Some(Case { name: path.file_name()?.to_string_lossy().into_owned(), folder: path });
    let mut cases: Vec<Case> = entries.into_iter().filter(|p| p.join(FILES[0]).is_file()).filter_map(named).collect();
    cases.sort_by(|a, b| a.name.cmp(&b.name));
    if cases.is_empty() {
        let message = format!("{} holds no case: a case is a folder with a file {}", folder.display(), FILES[0]);
        return Err(Error::Usage(message));
    }
    Ok(cases)
}

/// The header that goes beside the answers: who answered what, and the seal of the key.
///
/// # Errors
/// [`Error::Io`] if an input cannot be read.
pub fn header(cases: &[Case], without: &[String], seal: Option<&str>) -> Result<Value, Error> {
    let each = |case: &Case| Ok(json!({ "case": case.name, "inputs": case.inputs()? }));
    Ok(json!({
        "schema": "wheelwright.answers/1",
        "version": env!("CARGO_PKG_VERSION"),
        "without": without,
        "sealed_key_sha256": seal,
        "cases": cases.iter().map(each).collect::<Result<Vec<_>, Error>>()?,
    }))
}

/// The answer to a case that could not be diagnosed: it abstains, with the reason. The contract's keys are all there.
pub fn failure(reason: &str) -> Value {
    json!({
        "schema": "wheelwright.diagnose/1",
        "verdict": "unexplained",
        "effects": [],
        "where": { "channels": {}, "times": [], "regions": [], "frequencies_hz": [], "statement": "" },
        "fit": { "before": {}, "after": {}, "noise_ceiling": null },
        "next_experiment": null,
        "warnings": [format!("this case could not be diagnosed: {reason}")],
        "failed": true,
    })
}

/// Refuses what is no SHA-256 in hexadecimal.
///
/// # Errors
/// [`Error::Usage`].
pub fn check_seal(seal: &str) -> Result<(), Error> {
    if seal.len() == 64 && seal.bytes().all(|b| b.is_ascii_hexdigit()) {
        return Ok(());
    }
    Err(Error::Usage(format!("--seal {seal}: expected the key's SHA-256, 64 hexadecimal digits, as sha256sum KEY.json prints it")))
}
