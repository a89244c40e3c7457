//! What a diagnosis is asked.

use thiserror::Error;
use wheelwright_core::effect::Effect;
use wheelwright_core::model::{ModelError, ParameterMap};
use wheelwright_core::profile::Limits;
use wheelwright_core::solver::SolveError;
use wheelwright_core::{Dataset, RegressorModel};

/// Steps that a search may take unless told otherwise: ten to twenty seconds of a processor.
const MOST_STEPS: u64 = 100_000_000;

/// A recording, a model to hold against it, and what is known besides.
#[derive(Debug, Clone)]
pub struct Question<'a> {
    /// The base model.
    pub model: &'a dyn RegressorModel,
    /// Which of its parameters are free, tied or fixed.
    pub map: ParameterMap,
    /// Bounds of each parameter θ, infinite where there are none.
    pub bounds: Vec<(f64, f64)>,
    /// Parameters to start from, or to hold if [`fixed`](Self::fixed); `None` to find a start in the data.
    pub theta: Option<Vec<f64>>,
    /// Holds `theta` as it is: the question is then what *this* simulation leaves out, and nothing of the base model is refitted.
    pub fixed: bool,
    /// The data that are diagnosed.
    pub training: &'a Dataset,
    /// Data that no estimate sees: the judge between what the training data leave open, and the proof.
    pub held_out: Option<&'a Dataset>,
    /// Measured headings of the training data, one vector a stretch \[rad\]; without them they are integrated.
    pub training_headings: Option<Vec<Vec<f64>>>,
    /// Measured rates of the left and the right wheel \[rad/s\], a pair a stretch: they tell radii and track where velocities are the robot's own.
    pub training_wheel_rates: Option<Vec<[Vec<f64>; 2]>>,
    /// Measured headings of the held-out data.
    pub held_out_headings: Option<Vec<Vec<f64>>>,
    /// Distance between the wheels \[m\]; without it the most likely one is taken, with a warning.
    pub track_width: Option<f64>,
    /// Rolling radius of the wheels \[m\].
    pub wheel_radius: Option<f64>,
    /// What the robot can or may do, for the next experiment.
    pub limits: Limits,
    /// The effects that are tried.
    pub library: &'a [Box<dyn Effect>],
    /// Seed of whatever is random.
    pub seed: u64,
    /// Steps of the model and of each effect in free runs after which nothing more is sought. Counted, not timed, so that the answer is the
    /// same on any machine.
    pub most_steps: u64,
    /// Whether to design the next experiment where the answer is ambiguous.
    pub experiment: bool,
    /// Whether to compute the NARX yardstick on the held-out data, which costs as much as a diagnosis.
    pub yardstick: bool,
}

impl<'a> Question<'a> {
    /// A question with the model's own map and bounds, nothing held out and no dimensions known.
    pub fn new(model: &'a dyn RegressorModel, training: &'a Dataset, library: &'a [Box<dyn Effect>]) -> Self {
        Self {
            model,
            map: model.map(),
            bounds: model.parameters().iter().map(|p| p.bounds).collect(),
            theta: None,
            fixed: false,
            training,
            held_out: None,
            training_headings: None,
            training_wheel_rates: None,
            held_out_headings: None,
            track_width: None,
            wheel_radius: None,
            limits: Limits::default(),
            library,
            seed: 0,
            most_steps: MOST_STEPS,
            experiment: true,
            yardstick: false,
        }
    }
}

/// Why there is no diagnosis.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum DiagnosisError {
    /// Nothing can be fitted to so little.
    #[error("{samples} samples cannot be diagnosed: at least {needed} are needed, {needed_s:.0} s at this rate")]
    TooFewSamples {
        /// Samples there are.
        samples: usize,
        /// Samples it takes.
        needed: usize,
        /// Their time \[s\].
        needed_s: f64,
    },
    /// An output that never changes shows nothing.
    #[error("no output ever changes: nothing was driven, or the columns are not those of the model")]
    NoMotion,
    /// Channels of data and model do not agree.
    #[error("the data have the channels {found}, the model wants {wanted}")]
    Channels {
        /// Channels of the data.
        found: String,
        /// Channels of the model.
        wanted: String,
    },
    /// Parameters were to be held, but none are given.
    #[error("the parameters are to be held fixed, but there are {found} values for {wanted} parameters")]
    NothingToHold {
        /// Values given.
        found: usize,
        /// Parameters of the model.
        wanted: usize,
    },
    /// The base model cannot be fitted or simulated on these data from any start.
    #[error("the base model cannot be simulated on these data from any start: {0}")]
    NoStart(String),
    /// The base model could not be identified.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// The model failed.
    #[error(transparent)]
    Model(#[from] ModelError),
}
