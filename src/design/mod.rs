//! An excitation as short as the wanted accuracy and the limits allow.
//!
//! Many candidates are drawn, brought within the limits as a drive would bring them, and foreseen through the model's information
//! matrix: after which time are all intervals as narrow as wanted? The shortest is refined by changing it a little, again and again.
//! The pose is foreseen too, so that a drive that would leave the floor ends there and counts as far as it goes.

mod candidate;

use std::collections::BTreeMap;
use std::path::PathBuf;

use rand::SeedableRng;
use rand::rngs::StdRng;
use serde::Deserialize;
use wheelwright_core::channel::{Channel, OMEGA, OMEGA_REF, PHI, V, V_REF, X, Y};
use wheelwright_core::config::ConfigError;
use wheelwright_core::dataset::{Dataset, Stretch};
use wheelwright_core::drive::{Floor, FloorWatch, Limiter, Safety};
use wheelwright_core::identifiability::{Foresight, foresee};
use wheelwright_core::model::{ParameterMap, RegressorModel};

use crate::autonomous::{Missing, WantedSection};
use crate::error::Error;
use candidate::Candidate;

/// Half the width of a 95 % interval in standard errors.
const HALF_WIDTH: f64 = 1.96;
/// Kept free beyond the floor's margin \[m\]: the robot will not drive quite as foreseen, and must not be stopped for that.
const ROOM: f64 = 0.1;
/// Looks at the intervals over a candidate's length.
const LOOKS: usize = 120;

/// `[design]`
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DesignSection {
    /// Wanted width of every 95 % interval, from end to end, as a share of the value, as in `[autonomous]`.
    #[serde(default = "tenth")]
    pub width: f64,
    /// The same for single parameters, by name.
    #[serde(default)]
    pub widths: BTreeMap<String, f64>,
    /// Wanted width in the parameter's own unit, by name.
    #[serde(default)]
    pub absolute: BTreeMap<String, f64>,
    /// Longest excitation \[s\].
    #[serde(default = "longest")]
    pub longest: f64,
    /// Standard deviation of the noise expected on each output, by name.
    pub noise: BTreeMap<String, f64>,
    /// Largest command of each input, by name; the limit on its speed if absent.
    #[serde(default)]
    pub reach: BTreeMap<String, f64>,
    /// Parameters about which to design; a profile's or a model file's if absent.
    #[serde(default)]
    pub theta: Option<Vec<f64>>,
    /// A `model.toml` with the parameters, relative to the configuration.
    #[serde(default)]
    pub model: Option<PathBuf>,
    /// Control period \[s\]; the robot's if absent, which is connected to be asked.
    #[serde(default)]
    pub period: Option<f64>,
    /// Candidates drawn, and changes tried on the best of them.
    #[serde(default = "tries")]
    pub tries: usize,
}

fn tenth() -> f64 {
    0.1
}

fn longest() -> f64 {
    300.0
}

fn tries() -> usize {
    120
}

/// What is designed for.
#[derive(Debug)]
pub struct Task<'a> {
    /// The model.
    pub model: &'a dyn RegressorModel,
    /// Which parameters are free.
    pub map: &'a ParameterMap,
    /// Parameters about which to design.
    pub theta: Vec<f64>,
    /// Control period \[s\].
    pub period: f64,
    /// Limits of the drive.
    pub safety: Safety,
    /// Share of the rows that a fit will see; the rest is held out.
    pub fitted: f64,
    /// The wishes.
    pub section: &'a DesignSection,
    /// Seed of the search.
    pub seed: u64,
}

/// A designed excitation.
#[derive(Debug, Clone, PartialEq)]
pub struct Design {
    /// Times of the rows \[s\].
    pub time: Vec<f64>,
    /// Commands, one column a channel of the model's inputs.
    pub commands: Vec<Vec<f64>>,
    /// Length \[s\].
    pub duration: f64,
    /// Width of each parameter's interval that is foreseen, and the one wanted.
    pub widths: Vec<(f64, f64)>,
    /// Candidates foreseen.
    pub candidates: usize,
}

impl Task<'_> {
    /// Searches.
    ///
    /// # Errors
    /// [`Error::Config`] for an impossible setting; [`Error::TooLittle`] if no excitation within the longest time is enough,
    /// saying which parameters are short of what.
    pub fn solve(&self) -> Result<Design, Error> {
        let reach = self.reach()?;
        let sigma = self.sigma()?;
        let mut rng = StdRng::seed_from_u64(self.seed);
        let mut best: Option<Rated> = None;
        let keep = |rated: Rated, best: &mut Option<Rated>| {
            if best.as_ref().is_none_or(|b| rated.score < b.score) {
                *best = Some(rated);
            }
        };
        for _ in 0..self.section.tries {
            let candidate = Candidate::draw(&mut rng, reach.len(), self.period, self.section.longest, self.safety.floor.is_some());
            if let Some(rated) = self.rate(candidate, &reach, &sigma)? {
                keep(rated, &mut best);
            }
        }
        for _ in 0..self.section.tries {
            let Some(parent) = best.as_ref().map(|b| b.candidate.clone()) else { break };
            if let Some(rated) = self.rate(parent.changed(&mut rng), &reach, &sigma)? {
                keep(rated, &mut best);
            }
        }
        self.conclude(best)
    }

    fn conclude(&self, best: Option<Rated>) -> Result<Design, Error> {
        let Some(best) = best else {
            return Err(Error::TooLittle(
                "no candidate could be driven: the limits or the floor leave no room to move, or the model cannot be simulated".to_owned(),
            ));
        };
        if best.end_s.is_none() {
            let gaps: Vec<String> = self.gaps(&best.widths).iter().map(Missing::statement).collect();
            return Err(Error::TooLittle(format!(
                "no excitation of {} s within the limits is enough: {}; allow a longer one, larger commands or more floor, or want less",
                self.section.longest,
                gaps.join("; ")
            )));
        }
        let rows = best.rows;
        Ok(Design {
            time: best.stretch.time[..rows].to_vec(),
            commands: best.stretch.inputs.iter().map(|c| c[..rows].to_vec()).collect(),
            duration: self.period * rows as f64,
            widths: best.widths,
            candidates: 2 * self.section.tries,
        })
    }

    fn gaps(&self, widths: &[(f64, f64)]) -> Vec<Missing> {
        let each = self.model.parameters().iter().zip(widths).filter(|(_, (width, wanted))| width > wanted);
        each.map(|(p, (width, wanted))| Missing { name: p.name.clone(), width: Some(*width), wanted: *wanted, unit: p.unit.clone() })
            .collect()
    }

    /// Foresees a candidate; `None` if it cannot be driven at all.
    fn rate(&self, candidate: Candidate, reach: &[f64], sigma: &[f64]) -> Result<Option<Rated>, Error> {
        let stretch = self.commands(&candidate, reach)?;
        let data =
            Dataset { inputs: self.model.inputs().to_vec(), outputs: self.model.outputs().to_vec(), stretches: vec![stretch.clone()] };
        let Ok(foreseen) = foresee(self.model, self.map, &self.theta, data, sigma, LOOKS) else { return Ok(None) };
        let inside = self.stays_until(&stretch, &foreseen);
        let looks = foreseen.time.iter().take_while(|t| **t <= inside).count();
        let Some(last) = looks.checked_sub(1) else { return Ok(None) };
        let widths_at = |k: usize| -> Vec<(f64, f64)> {
            let each = self.model.parameters().iter().enumerate();
            each.map(|(p, parameter)| {
                let width = 2.0 * HALF_WIDTH * foreseen.std[k][p] / self.fitted.sqrt();
                (width, self.section.wanted().wanted(&parameter.name, self.theta[p], foreseen.plausible[p]))
            })
            .collect()
        };
        let worst = |widths: &[(f64, f64)]| widths.iter().map(|(width, wanted)| width / wanted).fold(0.0, f64::max);
        let enough = (0..looks).find(|k| worst(&widths_at(*k)) <= 1.0);
        let at = enough.unwrap_or(last);
        let (widths, end) = (widths_at(at), foreseen.time[at]);
        // Among drives that are enough the shortest is best; those that are not come after all of them.
        let score = if enough.is_some() { end } else { self.section.longest * (1.0 + worst(&widths)) };
        let rows = (end / self.period).round() as usize + 1;
        Ok(Some(Rated { candidate, rows: rows.min(stretch.len()), stretch, score, end_s: enough.map(|k| foreseen.time[k]), widths }))
    }

    /// The candidate's commands as a drive within the limits would send them.
    fn commands(&self, candidate: &Candidate, reach: &[f64]) -> Result<Stretch, Error> {
        let rows = ((self.section.longest / self.period) as usize).max(2);
        let inputs = self.model.inputs();
        let mut limiter =
            Limiter::new(self.safety.limits, self.safety.wheels, inputs).map_err(|e| Error::setting("limits", e.to_string()))?;
        let time: Vec<f64> = (0..rows).map(|k| k as f64 * self.period).collect();
        let mut columns = vec![Vec::with_capacity(rows); inputs.len()];
        let mut command = vec![0.0; inputs.len()];
        for t in &time {
            candidate.command(*t, reach, &mut command);
            limiter.apply(*t, self.period, &mut command);
            columns.iter_mut().zip(&command).for_each(|(column, value)| column.push(*value));
        }
        Ok(Stretch { label: String::new(), outputs: vec![vec![0.0; rows]; self.model.outputs().len()], time, inputs: columns })
    }

    /// The time until which the foreseen motion stays on the floor.
    fn stays_until(&self, stretch: &Stretch, foreseen: &Foresight) -> f64 {
        let outputs = self.model.outputs();
        let column = |channel: &Channel| outputs.iter().position(|c| c.name == channel.name).map(|i| &foreseen.outputs[i]);
        let (Some(floor), Some(v), Some(omega)) = (self.safety.floor, column(&V), column(&OMEGA)) else { return f64::INFINITY };
        let floor = Floor { margin: floor.margin + ROOM, ..floor };
        let watched = [V, OMEGA, X, Y, PHI];
        let inputs = [V_REF, OMEGA_REF];
        let Some(mut watch) = FloorWatch::new(floor, self.safety.limits.v_dot, self.period, &inputs, &watched) else {
            return f64::INFINITY;
        };
        let command = |channel: &Channel| self.model.inputs().iter().position(|c| c.name == channel.name).map(|i| &stretch.inputs[i]);
        let (forward, turning) = (command(&V_REF), command(&OMEGA_REF));
        let (mut x, mut y, mut phi) = (0.0, 0.0, 0.0);
        for k in 0..stretch.len() {
            let held = [forward.map_or(0.0, |c| c[k]), turning.map_or(0.0, |c| c[k])];
            if watch.check(&[v[k], omega[k], x, y, phi], &held).is_some() {
                return stretch.time[k] - self.period;
            }
            let next = (k + 1).min(stretch.len() - 1);
            let (path, turn) = (0.5 * self.period * (v[k] + v[next]), 0.5 * self.period * (omega[k] + omega[next]));
            let (sin, cos) = f64::sin_cos(phi + 0.5 * turn);
            (x, y, phi) = (x + path * cos, y + path * sin, phi + turn);
        }
        f64::INFINITY
    }

    fn reach(&self) -> Result<Vec<f64>, Error> {
        let limits = &self.safety.limits;
        let of = |channel: &Channel| {
            let limit = match &*channel.name {
                "v_ref" => limits.v,
                "omega_ref" => limits.omega,
                _ => None,
            };
            let missing = || {
                let key = format!("design.reach.{}", channel.name);
                Error::setting(&key, "is missing: how large may this command be? Give it, or the limit on its speed in [limits]")
            };
            self.section.reach.get(channel.name.as_ref()).copied().or(limit).filter(|r| *r > 0.0).ok_or_else(missing)
        };
        self.model.inputs().iter().map(of).collect()
    }

    fn sigma(&self) -> Result<Vec<f64>, Error> {
        let of = |channel: &Channel| {
            let missing = || {
                let key = format!("design.noise.{}", channel.name);
                Error::setting(
                    &key,
                    "is missing or not positive: the standard deviation of the noise on this output, as `identify` reports it",
                )
            };
            self.section.noise.get(channel.name.as_ref()).copied().filter(|s| s.is_finite() && *s > 0.0).ok_or_else(missing)
        };
        self.model.outputs().iter().map(of).collect()
    }
}

/// A candidate with what it is good for.
struct Rated {
    candidate: Candidate,
    stretch: Stretch,
    rows: usize,
    score: f64,
    end_s: Option<f64>,
    widths: Vec<(f64, f64)>,
}

impl DesignSection {
    /// Values must be positive, and names those of parameters.
    ///
    /// # Errors
    /// [`ConfigError`] at the key, relative to the section.
    pub fn check(&self, parameters: &[String]) -> Result<(), ConfigError> {
        self.wanted().check(parameters)?;
        if self.tries == 0 {
            return Err(ConfigError::new("tries", "must be at least 1"));
        }
        match self.period {
            Some(period) if !(period.is_finite() && period > 0.0) => {
                Err(ConfigError::new("period", format!("must be a positive number, not {period}")))
            }
            _ => Ok(()),
        }
    }

    /// The wishes as `[autonomous]` states them.
    pub fn wanted(&self) -> WantedSection {
        WantedSection {
            width: self.width,
            widths: self.widths.clone(),
            absolute: self.absolute.clone(),
            longest: self.longest,
            round: self.longest,
        }
    }
}

#[cfg(test)]
mod tests;
