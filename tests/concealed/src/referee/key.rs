//! The key: what was hidden in which case. It is written apart from the cases and sealed by its hash.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

/// The schema's name.
pub const SCHEMA: &str = "wheelwright.key/1";

/// A key file.
#[derive(Clone, Debug, Serialize, Deserialize, PartialEq)]
pub struct Key {
    /// [`SCHEMA`].
    pub schema: String,
    /// One entry a case, in the order of their names.
    pub cases: Vec<Entry>,
}

/// One hidden effect.
#[derive(Clone, Debug, Serialize, Deserialize, PartialEq)]
pub struct Truth {
    /// Its name in section 5 of the contract.
    pub effect: String,
    /// Side, axis, time, and the hidden magnitudes in SI units.
    pub parameters: Map<String, Value>,
}

/// A region of a channel's values.
#[derive(Clone, Debug, Serialize, Deserialize, PartialEq)]
pub struct Region {
    /// The channel.
    pub of: String,
    /// Lower end.
    pub from: f64,
    /// Upper end.
    pub to: f64,
}

/// A number for each of the two channels.
#[derive(Clone, Copy, Debug, Serialize, Deserialize, PartialEq)]
pub struct PerChannel {
    /// Of the forward speed.
    pub v: f64,
    /// Of the turning speed.
    pub omega: f64,
}

/// Where a case comes from, so that its robot can be driven again.
#[derive(Clone, Debug, Serialize, Deserialize, PartialEq)]
pub struct Origin {
    /// The set it was made for.
    pub set: String,
    /// The set's seed.
    pub seed: u64,
    /// Its number in the set before shuffling.
    pub index: usize,
    /// How many cases the set had.
    pub count: usize,
}

/// One case of a key.
#[derive(Clone, Debug, Serialize, Deserialize, PartialEq)]
pub struct Entry {
    /// Name of the folder.
    pub case: String,
    /// `none`, `single`, `pair`, `other_form` or `outside`.
    pub kind: String,
    /// What is hidden; empty for nothing and for causes outside any library.
    pub truth: Vec<Truth>,
    /// Other sets of names that are the same mathematics on this recording.
    pub acceptable: Vec<Vec<String>>,
    /// A cause outside the library, in words.
    pub outside: Option<String>,
    /// The physical form of an effect where it is not the usual one.
    pub form: Option<String>,
    /// Kind of robot.
    pub robot: String,
    /// Manner of driving in `train.csv`.
    pub excitation: String,
    /// Manner of driving in `validate.csv`.
    pub validate_excitation: String,
    /// Character of the noise.
    pub noise: String,
    /// Standard deviation of the noise over the root mean square of the signal, per channel.
    pub noise_level: PerChannel,
    /// Rate of the rows \[Hz\].
    pub rate_hz: f64,
    /// Strength on the scale where 1 is strong; the weaker of two.
    pub strength: Option<f64>,
    /// Strength of each effect of `truth`.
    pub strengths: Vec<f64>,
    /// Twice the log-likelihood ratio of the truth over the best model without it.
    pub detectability: Option<f64>,
    /// The same for each effect of a pair, the other one kept.
    pub detectability_each: Option<Vec<f64>>,
    /// When it acts, where only at some times.
    pub times: Option<Vec<[f64; 2]>>,
    /// Where it acts, where only in some regions.
    pub regions: Option<Vec<Region>>,
    /// Free-run fit of the true noise-free response on `validate.csv` \[percent\].
    pub noise_ceiling: Option<PerChannel>,
    /// Where the case comes from.
    pub origin: Origin,
}

/// Hexadecimal SHA-256 of bytes.
pub fn seal(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect()
}
