//! What a diagnosis says: verdict, named effects, where it hurts, the proof, and what to drive next.

use serde::Serialize;
use serde_json::{Map, Value};
use wheelwright_core::Dataset;
use wheelwright_core::effect::{Effect, Place, Scene};
use wheelwright_core::simulation::Readout;

/// The answer in one word (contract, section 4).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Nothing beyond noise.
    NoMismatch,
    /// The named effects bring the held-out fit to the noise ceiling, or as near as stated.
    Explained,
    /// Something is missing, and these data cannot tell the alternatives apart.
    Ambiguous,
    /// Something is missing that no effect of the library explains.
    Unexplained,
}

/// A parameter of a named effect.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FoundParameter {
    /// Name.
    pub name: String,
    /// Value.
    pub value: f64,
    /// 95 % interval; `None` where the data give none.
    pub ci95: Option<(f64, f64)>,
    /// SI unit.
    pub unit: String,
    /// Side or axis: `("wheel", "left")`.
    pub label: Option<(&'static str, String)>,
}

/// Another explanation of the same misfit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Alternative {
    /// Name of the effect that would take the found one's place.
    pub name: String,
    /// By how much its penalised score is worse (twice the log-likelihood; negative if better); infinite-free.
    pub gap: f64,
    /// Why the two look alike, and what tells them apart.
    pub because: String,
    /// True if the two are the same mathematics: no drive tells them apart, so it is no ambiguity of these data.
    pub always: bool,
    /// True if these data leave it open which of the two it is, and another drive would tell.
    pub open: bool,
}

/// An effect that was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// Name of the effect.
    pub name: String,
    /// Where it acts.
    pub place: Place,
    /// One plain sentence with magnitude and unit.
    pub statement: String,
    /// Its parameters.
    pub parameters: Vec<FoundParameter>,
    /// Values of all its parameters in the effect's own order, for simulation.
    pub values: Vec<f64>,
    /// The effect as plain data: `type` and settings, for `model.toml`.
    pub settings: serde_json::Value,
    /// Penalised gain of adding it to the other effects: positive is better.
    pub delta_bic: f64,
    /// Points of held-out fit gained by it, mean over the outputs, added last; `None` without held-out data.
    pub holdout_gain: Option<f64>,
    /// What else it could be.
    pub alternatives: Vec<Alternative>,
}

/// An effect as plain data: `type` beside its settings, as configurations spell it. What serde writes of a trait's object is the
/// name with the settings below it.
pub fn settings(effect: &dyn Effect) -> Value {
    let mut plain = Map::new();
    plain.insert("type".to_owned(), Value::from(effect.name()));
    if let Ok(Value::Object(tagged)) = serde_json::to_value(effect) {
        plain.extend(tagged.into_iter().filter_map(|(_, settings)| if let Value::Object(s) = settings { Some(s) } else { None }).flatten());
    }
    Value::Object(plain)
}

/// A region of a channel's values, or of time or place, that holds more than its share of the excess error.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Region {
    /// Quantity: `v`, `omega`, `v_dot`, `heading`, …
    pub of: String,
    /// Lower end.
    pub from: f64,
    /// Upper end.
    pub to: f64,
    /// Share of the excess error, 0 to 1.
    pub share: f64,
    /// Share of the samples that lie in it: as large a share of the error would be nothing special.
    pub expected: f64,
    /// The region in words: `backwards`, `near standstill`.
    pub words: String,
}

/// A time from which on the misfit is another one.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChangePoint {
    /// Time \[s\].
    pub time: f64,
    /// 95 % interval \[s\].
    pub interval: (f64, f64),
    /// What changes there.
    pub words: String,
}

/// Where simulation and recording differ beyond noise. Shares are of what exceeds the noise, not of the raw residual.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Location {
    /// Share of the excess error of each output, by name.
    pub channels: Vec<(String, f64)>,
    /// Share of each wheel (left, right), where wheels are known.
    pub wheels: Option<(f64, f64)>,
    /// Stretches of time with more than their share \[s\].
    pub times: Vec<(f64, f64)>,
    /// Changes in time.
    pub changes: Vec<ChangePoint>,
    /// Regions of state.
    pub regions: Vec<Region>,
    /// Bands of frequency with more than their share \[Hz\].
    pub frequencies_hz: Vec<(f64, f64)>,
    /// All of it in a sentence or two.
    pub statement: String,
    /// Results of the tests that need no library, a sentence each, for the report.
    pub tests: Vec<String>,
}

/// Held-out free-run fit in percent, one value an output.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Fits {
    /// Of the base model.
    pub before: Vec<f64>,
    /// With the effects.
    pub after: Vec<f64>,
    /// What noise leaves to any model; `None` where it cannot be told.
    pub noise_ceiling: Option<Vec<f64>>,
    /// A short nonlinear autoregressive model, as yardstick.
    pub narx: Option<Vec<f64>>,
}

/// One bar of the waterfall: held-out fit after adding one more effect.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Rung {
    /// Effects so far, the last one new; empty for the base.
    pub effects: Vec<String>,
    /// Held-out fit of each output in percent.
    pub fit: Vec<f64>,
}

/// The drive that would tell the remaining explanations apart.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Experiment {
    /// What to do, in a sentence.
    pub statement: String,
    /// Time of each row \[s\], from zero.
    pub time: Vec<f64>,
    /// One column an input channel: its name and its values, held until the next row.
    pub commands: Vec<(String, Vec<f64>)>,
    /// The rivals it separates, and by how much (twice the expected log-likelihood ratio), pair by pair.
    pub separates: Vec<(String, String, f64)>,
}

/// An effect that this recording cannot speak of.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Untestable {
    /// Name of the effect.
    pub name: String,
    /// Which motion is missing, and what size of effect would have been seen.
    pub because: String,
}

/// A model parameter before and after the effects were added.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BaseParameter {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Estimate without effects.
    pub before: f64,
    /// Estimate with them.
    pub after: f64,
    /// 95 % interval with them; `None` where it was held fixed or the data give none.
    pub ci95: Option<(f64, f64)>,
}

/// Series for pictures: measured, base and with effects, over one data set.
#[derive(Debug, Clone, PartialEq)]
pub struct Replay {
    /// The measured data.
    pub measured: Dataset,
    /// Free run of the base model: by stretch, output, row.
    pub before: Vec<Vec<Vec<f64>>>,
    /// Free run with the effects; as `before` if there is none.
    pub after: Vec<Vec<Vec<f64>>>,
}

/// The whole answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Diagnosis {
    /// In one word.
    pub verdict: Verdict,
    /// In one or two sentences, for the top of the report.
    pub headline: String,
    /// The effects; empty for `no_mismatch` and `unexplained`.
    pub effects: Vec<Finding>,
    /// Effects that explain a part where the verdict is `unexplained`: reported beside it, not as its name.
    pub partial: Vec<Finding>,
    /// Where.
    pub location: Location,
    /// Held-out fit.
    pub fit: Fits,
    /// Effect by effect.
    pub waterfall: Vec<Rung>,
    /// What to drive next, where that would help.
    pub next_experiment: Option<Experiment>,
    /// What these data cannot speak of.
    pub untestable: Vec<Untestable>,
    /// The model's parameters before and after.
    pub base: Vec<BaseParameter>,
    /// The scene in which the effects' values mean what they say.
    pub scene: Scene,
    /// How the recorded outputs were read, and are to be simulated.
    pub readout: Readout,
    /// Standard deviation of the noise of each output.
    pub noise: Vec<f64>,
    /// Training data with simulations, and held-out data with simulations.
    pub training: Replay,
    /// Held-out data with simulations; `None` without.
    pub held_out: Option<Replay>,
    /// Every effect that was tried, best first: name and penalised gain on the base model.
    pub ranking: Vec<(String, f64)>,
    /// What a user should know.
    pub warnings: Vec<String>,
}
