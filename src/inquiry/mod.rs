//! An inquiry: recordings brought together with the simulation they are to be compared with, from which a diagnosis comes.

mod simulation;

use toml::{Table, Value};
use wheelwright_core::channel::{Channel, OMEGA_LEFT, OMEGA_RIGHT, PHI};
use wheelwright_core::config::nearest;
use wheelwright_core::dataset::Dataset;
use wheelwright_core::effect::Effect;
use wheelwright_core::model::RegressorModel;
use wheelwright_core::profile::RobotProfile;
use wheelwright_core::recording::RecordingError;
use wheelwright_diagnosis::{Diagnosis, Question, diagnose};

use crate::constraints::Freedom;
use crate::error::Error;
use crate::registry::Registry;
use crate::source::Source;
use crate::study::explain;

pub use simulation::{Change, Comparison, Quantity, Represents, Simulated};

/// What is asked, apart from the recordings.
#[derive(Debug)]
pub struct Inquiry {
    /// The base model's table, kept for `model.toml`.
    pub model_table: Table,
    /// The base model.
    pub model: Box<dyn RegressorModel>,
    /// Which of its parameters are free, and within which bounds.
    pub freedom: Freedom,
    /// Parameters of the simulation compared with, if it came as a model.
    pub theta: Option<Vec<f64>>,
    /// Whether they are held as they are.
    pub fixed: bool,
    /// Profile of the robot, if one was given.
    pub robot: Option<RobotProfile>,
    /// The effects that are tried.
    pub library: Vec<Box<dyn Effect>>,
    /// Share of the samples held out where no recording validates.
    pub holdout: f64,
    /// Seed of whatever is random.
    pub seed: u64,
    /// Whether the short black-box model is fitted for comparison.
    pub yardstick: bool,
}

/// Data of one part, with measured headings where all its recordings have them.
#[derive(Debug, Clone)]
pub struct Part {
    /// The model's channels.
    pub data: Dataset,
    /// One vector a stretch \[rad\].
    pub headings: Option<Vec<Vec<f64>>>,
    /// Rates of the left and the right wheel, a pair a stretch \[rad/s\].
    pub wheel_rates: Option<Vec<[Vec<f64>; 2]>>,
}

/// What is recorded beside a model's channels, taken along as outputs so that it is cut where they are.
#[derive(Debug, Clone, Copy)]
struct Extras {
    heading: bool,
    wheel_rates: bool,
}

impl Extras {
    /// What all recordings have, in each of their rows.
    fn of(sources: &[Source]) -> Self {
        let whole = |channel: &Channel| {
            sources.iter().all(|s| s.recording.column(&channel.name).is_ok_and(|values| values.iter().all(|x| x.is_finite())))
        };
        let heading = sources.iter().all(|s| s.recording.column(&PHI.name).is_ok());
        Self { heading, wheel_rates: whole(&OMEGA_LEFT) && whole(&OMEGA_RIGHT) }
    }

    fn channels(self) -> Vec<Channel> {
        let rates = self.wheel_rates.then_some([OMEGA_LEFT, OMEGA_RIGHT]);
        self.heading.then_some(PHI).into_iter().chain(rates.into_iter().flatten()).collect()
    }
}

impl Inquiry {
    /// Diagnoses recordings; `validation` is seen by no estimate. Without it a share of the recordings is held out.
    ///
    /// # Errors
    /// [`Error`] if a recording does not have what the model needs, or the data cannot be diagnosed.
    pub fn diagnose(&self, sources: &[Source], validation: &[Source]) -> Result<Diagnosis, Error> {
        let (training, held_out) = self.parts(sources, validation)?;
        self.ask(&training, held_out.as_ref())
    }

    /// The data that are diagnosed and those that prove.
    ///
    /// # Errors
    /// As [`diagnose`](Self::diagnose).
    pub fn parts(&self, sources: &[Source], validation: &[Source]) -> Result<(Part, Option<Part>), Error> {
        let whole = self.part(sources, false)?;
        if !validation.is_empty() {
            return Ok((whole, Some(self.part(validation, true)?)));
        }
        if self.holdout == 0.0 {
            return Ok((whole, None));
        }
        let (kept, held) = whole.hold_out(self.holdout);
        if kept.data.stretches.is_empty() {
            let share = 100.0 * self.holdout;
            return Err(Error::TooLittle(format!(
                "nothing is left to diagnose after holding out {share:.0} % of the samples: give a smaller --holdout or a longer recording"
            )));
        }
        Ok((kept, Some(held).filter(|h| !h.data.stretches.is_empty())))
    }

    /// Asks about data in parts.
    ///
    /// # Errors
    /// [`Error::Diagnose`].
    pub fn ask(&self, training: &Part, held_out: Option<&Part>) -> Result<Diagnosis, Error> {
        let question = Question {
            map: self.freedom.map.clone(),
            bounds: self.freedom.bounds.clone(),
            theta: self.theta.clone(),
            fixed: self.fixed,
            held_out: held_out.map(|p| &p.data),
            training_headings: training.headings.clone(),
            training_wheel_rates: training.wheel_rates.clone(),
            held_out_headings: held_out.and_then(|p| p.headings.clone()),
            track_width: self.robot.as_ref().map(|r| r.track_width),
            wheel_radius: self.robot.as_ref().map(|r| r.wheel_radius),
            limits: self.robot.as_ref().map(|r| r.limits).unwrap_or_default(),
            seed: self.seed,
            yardstick: self.yardstick,
            ..Question::new(&*self.model, &training.data, &self.library)
        };
        Ok(diagnose(&question)?)
    }

    /// The model's channels of several recordings, and headings if each of them has `phi`.
    fn part(&self, sources: &[Source], validates: bool) -> Result<Part, Error> {
        let extras = Extras::of(sources);
        let outputs: Vec<_> = self.model.outputs().iter().cloned().chain(extras.channels()).collect();
        let mut data = Dataset { inputs: self.model.inputs().to_vec(), outputs: outputs.clone(), stretches: Vec::new() };
        for source in sources {
            let selected = Dataset::select(&source.recording, self.model.inputs(), &outputs);
            let selected = selected.map_err(|error| explain(&*self.model, source, error))?;
            let names: Vec<&str> = self.model.outputs().iter().map(|c| c.name.as_ref()).collect();
            let moves: Result<(), RecordingError> = source.recording.require_motion(&names);
            moves.map_err(|error| Error::content(&source.facts.path, error))?;
            data.extend(selected);
        }
        if data.stretches.is_empty() {
            let what = if validates { "the recordings to validate on hold" } else { "the recordings hold" };
            return Err(Error::TooLittle(format!("{what} no segment of two rows or more: nothing can be simulated")));
        }
        Ok(Part::new(data, extras))
    }
}

impl Part {
    /// Takes what is beside the model's channels off the outputs, where it stands last.
    fn new(mut data: Dataset, extras: Extras) -> Self {
        data.outputs.truncate(data.outputs.len() - extras.channels().len());
        let last = |stretch: &mut wheelwright_core::Stretch| stretch.outputs.pop().unwrap_or_default();
        let mut wheel_rates = extras.wheel_rates.then(Vec::new);
        let mut headings = extras.heading.then(Vec::new);
        for stretch in &mut data.stretches {
            if let Some(rates) = &mut wheel_rates {
                let right = last(stretch);
                rates.push([last(stretch), right]);
            }
            if let Some(headings) = &mut headings {
                headings.push(last(stretch));
            }
        }
        Self { data, headings, wheel_rates }
    }

    /// Cuts all of it.
    fn hold_out(self, share: f64) -> (Self, Self) {
        let Self { mut data, headings, wheel_rates } = self;
        let extras = Extras { heading: headings.is_some(), wheel_rates: wheel_rates.is_some() };
        data.outputs.extend(extras.channels());
        for (stretch, heading) in data.stretches.iter_mut().zip(headings.into_iter().flatten()) {
            stretch.outputs.push(heading);
        }
        for (stretch, rates) in data.stretches.iter_mut().zip(wheel_rates.into_iter().flatten()) {
            stretch.outputs.extend(rates);
        }
        let (kept, held) = data.hold_out(share);
        (Self::new(kept, extras), Self::new(held, extras))
    }
}

/// The model that a recording's columns speak of: velocity references, or voltages. Static friction stays out of the voltage
/// model, so that a diagnosis can name it.
pub fn model_of(source: &Source) -> Option<Table> {
    let has = |names: [&str; 2]| names.iter().all(|name| source.recording.column(name).is_ok());
    let named = |name: &str| ("type".to_owned(), Value::String(name.to_owned()));
    if has(["v_ref", "omega_ref"]) {
        Some(Table::from_iter([named("vw-pd")]))
    } else if has(["u_left", "u_right"]) {
        Some(Table::from_iter([named("wheel-voltage"), ("static_friction".to_owned(), Value::Boolean(false))]))
    } else {
        None
    }
}

/// The built-in effects and those of the libraries loaded, without the effects named.
///
/// # Errors
/// [`Error::Usage`] for a name that the library does not have.
pub fn library(registry: &Registry, without: &[String]) -> Result<Vec<Box<dyn Effect>>, Error> {
    let mut library = wheelwright_diagnosis::effects::library();
    library.extend(registry.loaded_effects());
    for name in without {
        if !library.iter().any(|e| e.name() == name) {
            let known: Vec<&str> = library.iter().map(|e| e.name()).collect();
            let meant = nearest(name, known.iter().copied()).map(|n| format!("; did you mean `{n}`?")).unwrap_or_default();
            return Err(Error::Usage(format!("--without {name}: the library has no such effect{meant} `wheelwright plugins` lists them")));
        }
    }
    library.retain(|e| !without.iter().any(|name| name == e.name()));
    Ok(library)
}
