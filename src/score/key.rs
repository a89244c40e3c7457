//! What a key and an answer say, as far as a score needs it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::error::Error;

/// A key: what was hidden in each case.
#[derive(Debug, Clone, Deserialize)]
pub struct Key {
    /// `wheelwright.key/1`.
    pub schema: String,
    /// The cases.
    pub cases: Vec<KeyCase>,
}

/// One case of a key. Everything but the first three may be absent.
#[derive(Debug, Clone, Deserialize)]
pub struct KeyCase {
    /// Name of its folder.
    pub case: String,
    /// What kind of case it is.
    pub kind: Kind,
    /// The effects hidden.
    #[serde(default)]
    pub truth: Vec<Truth>,
    /// Other sets of names that are the same mathematics on this recording.
    #[serde(default)]
    pub acceptable: Option<Vec<Vec<String>>>,
    /// The cause in words where it is in no library.
    #[serde(default)]
    pub outside: Option<String>,
    /// Robot.
    #[serde(default)]
    pub robot: Option<String>,
    /// Kind of driving.
    #[serde(default)]
    pub excitation: Option<String>,
    /// Kind of noise.
    #[serde(default)]
    pub noise: Option<String>,
    /// Samples a second.
    #[serde(default)]
    pub rate_hz: Option<f64>,
    /// Strength of the effect.
    #[serde(default)]
    pub strength: Option<f64>,
    /// Twice the log-likelihood ratio of the true model over the best without the effect; of several effects the smallest counts.
    #[serde(default)]
    pub detectability: Option<Detectability>,
    /// The same of each effect of several, with the others kept.
    #[serde(default)]
    pub detectability_each: Option<Vec<Option<f64>>>,
    /// When it acts \[s\].
    #[serde(default)]
    pub times: Option<Vec<(f64, f64)>>,
    /// Where it acts.
    #[serde(default)]
    pub regions: Option<Vec<Range>>,
    /// The most that any model could reach on `validate.csv`, per output.
    #[serde(default)]
    pub noise_ceiling: Option<BTreeMap<String, f64>>,
}

impl KeyCase {
    /// Detectability of what is hardest to see.
    pub fn hardest(&self) -> Option<f64> {
        let each = self.detectability_each.as_deref().and_then(smallest);
        each.or_else(|| self.detectability.as_ref().and_then(Detectability::smallest))
    }
}

/// What kind of case it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Nothing hidden.
    None,
    /// One effect.
    Single,
    /// Two effects.
    Pair,
    /// An effect in another physical form than the library's.
    OtherForm,
    /// A cause in no library.
    Outside,
}

/// An effect hidden.
#[derive(Debug, Clone, Deserialize)]
pub struct Truth {
    /// Its name.
    pub effect: String,
    /// Its parameters, as far as the key tells them.
    #[serde(default)]
    pub parameters: BTreeMap<String, Value>,
}

/// One index, or one an effect.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
pub enum Detectability {
    /// Of the case.
    One(f64),
    /// Of each effect.
    Each(Vec<Option<f64>>),
}

impl Detectability {
    /// The index of what is hardest to see.
    pub fn smallest(&self) -> Option<f64> {
        match self {
            Self::One(value) => Some(*value),
            Self::Each(values) => smallest(values),
        }
    }
}

/// The smallest of the indices that there are.
fn smallest(indices: &[Option<f64>]) -> Option<f64> {
    indices.iter().flatten().copied().reduce(f64::min)
}

/// A range of a quantity; an end that is absent is open.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Range {
    /// Quantity.
    pub of: String,
    /// Lower end.
    #[serde(default)]
    pub from: Option<f64>,
    /// Upper end.
    #[serde(default)]
    pub to: Option<f64>,
}

/// An answer of `trial`, as far as it is scored.
#[derive(Debug, Clone, Deserialize)]
pub struct Answer {
    /// Name of the case.
    pub case: String,
    /// `no_mismatch`, `explained`, `ambiguous`, `unexplained`.
    pub verdict: String,
    /// The effects named.
    #[serde(default)]
    pub effects: Vec<Named>,
    /// Where.
    #[serde(default, rename = "where")]
    pub place: Place,
    /// Held-out fits.
    #[serde(default)]
    pub fit: Fits,
    /// Whether the case could not be diagnosed at all.
    #[serde(default)]
    pub failed: bool,
    /// Seconds it took.
    #[serde(default)]
    pub seconds: Option<f64>,
}

/// An effect named.
#[derive(Debug, Clone, Deserialize)]
pub struct Named {
    /// Name.
    pub name: String,
    /// Parameters.
    #[serde(default)]
    pub parameters: Vec<Parameter>,
    /// Other effects it may be.
    #[serde(default)]
    pub alternatives: Vec<String>,
}

/// A parameter of an effect named.
#[derive(Debug, Clone, Deserialize)]
pub struct Parameter {
    /// Name.
    pub name: String,
    /// Value.
    pub value: Option<f64>,
}

/// Where an answer says the misfit is.
#[derive(Debug, Clone, Default, Deserialize)]
pub struct Place {
    /// Stretches of time \[s\].
    #[serde(default)]
    pub times: Vec<(f64, f64)>,
    /// Regions of state.
    #[serde(default)]
    pub regions: Vec<Range>,
}

/// Held-out fits of an answer, per output.
#[derive(Debug, Clone, Default, Deserialize)]
pub struct Fits {
    /// Without effects.
    #[serde(default)]
    pub before: BTreeMap<String, Option<f64>>,
    /// With them.
    #[serde(default)]
    pub after: BTreeMap<String, Option<f64>>,
    /// What noise leaves.
    #[serde(default)]
    pub noise_ceiling: Option<BTreeMap<String, Option<f64>>>,
}

/// The header of a folder of answers.
#[derive(Debug, Clone, Default, Deserialize)]
pub struct Header {
    /// Version of the program that answered.
    #[serde(default)]
    pub version: Option<String>,
    /// Effects that were left out of the library.
    #[serde(default)]
    pub without: Vec<String>,
    /// SHA-256 of the key, given before the answers were made.
    #[serde(default)]
    pub sealed_key_sha256: Option<String>,
}

/// Name of the header's file.
pub const HEADER: &str = "answers.json";

/// Reads a key.
///
/// # Errors
/// [`Error::Io`], or [`Error::Json`] with line and column.
pub fn read_key(path: &Path) -> Result<Key, Error> {
    let key: Key = read(path)?;
    if key.schema != "wheelwright.key/1" {
        return Err(Error::json(path, format!("`schema` is \"{}\"; this program scores \"wheelwright.key/1\"", key.schema)));
    }
    let mut names: Vec<&str> = key.cases.iter().map(|c| c.case.as_str()).collect();
    names.sort_unstable();
    match names.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(twice) => Err(Error::json(path, format!("case `{}` stands there twice", twice[0]))),
        None => Ok(key),
    }
}

/// Reads a folder of answers: the header if there is one, and every other JSON file, in order of name.
///
/// # Errors
/// [`Error::Io`], or [`Error::Json`] naming the file.
pub fn read_answers(folder: &Path) -> Result<(Option<Header>, Vec<Answer>), Error> {
    let io = |error| Error::Io { path: folder.to_owned(), error };
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(folder).map_err(io)?.map(|entry| entry.map(|e| e.path())).collect::<Result<_, _>>().map_err(io)?;
    files.retain(|f| f.extension().is_some_and(|e| e == "json"));
    files.sort();
    let is_header = |f: &&PathBuf| f.file_name().is_some_and(|n| n == HEADER);
    let header = files.iter().find(is_header).map(|f| read(f)).transpose()?;
    let answers = files.iter().filter(|f| !is_header(f)).map(|f| read(f)).collect::<Result<_, _>>()?;
    Ok((header, answers))
}

fn read<T: DeserializeOwned>(path: &Path) -> Result<T, Error> {
    let text = std::fs::read_to_string(path).map_err(|error| Error::Io { path: path.to_owned(), error })?;
    serde_json::from_str(&text).map_err(|e| Error::json(path, e.to_string()))
}
