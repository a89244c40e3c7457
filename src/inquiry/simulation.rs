//! The simulation that a recording is compared with, as a model: its parameters, its effects, and what differs from the robot.
//!
//! A simulation comes as a `model.toml` or as a recording of any simulator, on which the base model is then identified and
//! diagnosed as on a robot's. What the robot does otherwise is split into parameters that changed and effects that the
//! simulation lacks.

use serde::Serialize;
use serde_json::{Value, json};
use wheelwright_core::effect::{Effect, Scene};
use wheelwright_core::model::RegressorModel;
use wheelwright_core::simulation::Readout;
use wheelwright_core::validation::{Validation, validate, validate_with_effects};
use wheelwright_diagnosis::finding::{BaseParameter, Finding, Replay, Rung};
use wheelwright_diagnosis::{Diagnosis, Verdict};
use wheelwright_models::physics::INFLUENCES;

use super::Part;
use crate::error::Error;
use crate::model_file::{LoadedEffect, ModelFile};
use crate::registry::Registry;

/// Family-wise level at which a parameter counts as changed.
const LEVEL: f64 = 0.05;
/// Half the width of a 95 % interval in standard deviations.
const NORMAL_95: f64 = 1.959_963_984_540_054;

/// A simulation as a model.
#[derive(Debug)]
pub struct Simulated {
    /// Where it came from, as the user named it.
    pub path: String,
    /// The words for it: `model`, `recording`.
    pub kind: &'static str,
    /// Its parameters, with intervals where they have any.
    pub parameters: Vec<Quantity>,
    /// Its effects with their values.
    pub effects: Vec<LoadedEffect>,
    /// The scene in which the effects' values mean what they say; `None` without effects.
    pub scene: Option<Scene>,
    /// How recorded velocities are simulated.
    pub readout: Readout,
    /// The parameters of its effects, with intervals.
    pub effect_parameters: Vec<Quantity>,
    /// Whether the base model and the effects represent the simulator's recording; `None` for a model.
    pub represents: Option<Represents>,
}

/// A number with its interval.
#[derive(Debug, Clone, PartialEq)]
pub struct Quantity {
    /// Name; of an effect's parameter with the effect's name before it.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Value.
    pub value: f64,
    /// 95 % interval.
    pub ci95: Option<(f64, f64)>,
}

/// How well a model stands for a simulator's recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Represents {
    /// The verdict on the simulator's recording.
    pub verdict: Verdict,
    /// True unless something is missing there that has no name.
    pub holds: bool,
    /// In words.
    pub statement: String,
    /// Names of the effects that the simulator has beyond the base model.
    pub effects: Vec<String>,
    /// Held-out fit there in percent, one value an output.
    pub fit: Vec<f64>,
    /// What noise leaves to any model.
    pub noise_ceiling: Option<Vec<f64>>,
}

/// A parameter of the simulation beside that of the robot.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Change {
    /// Name.
    pub parameter: String,
    /// Unit.
    pub unit: String,
    /// In the simulation.
    pub simulated: f64,
    /// Its 95 % interval.
    pub simulated_ci95: Option<(f64, f64)>,
    /// On the robot, beside the effects found.
    pub recorded: f64,
    /// Its 95 % interval.
    pub recorded_ci95: Option<(f64, f64)>,
    /// Chance of a difference this large if there were none, from both intervals; `None` without any interval.
    pub p: Option<f64>,
    /// Whether it changed, at a family-wise level of 5 % (Holm).
    pub changed: bool,
    /// The physical constants it points to.
    pub points_to: Vec<&'static str>,
}

/// What a comparison with a simulation adds to a diagnosis.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// Parameters side by side.
    pub changes: Vec<Change>,
    /// Effects that the simulation has and the robot does not show.
    pub superfluous: Vec<String>,
    /// Held-out fit of the simulation as it stands; `None` where it diverges.
    pub as_given: Vec<Option<f64>>,
    /// The parts in sentences.
    pub sentences: Vec<String>,
    /// Keys of the document.
    pub document: Value,
}

impl Simulated {
    /// The simulation that a `model.toml` describes.
    ///
    /// # Errors
    /// [`Error::Config`] naming the file and the key.
    pub fn from_file(
        file: &ModelFile,
        path: &std::path::Path,
        model: &dyn RegressorModel,
        part: &Part,
        registry: &Registry,
    ) -> Result<Self, Error> {
        let refuse = |error| Error::Config { file: path.to_owned(), position: None, error };
        let theta = file.theta(model).map_err(refuse)?;
        let parameters = model.parameters().iter().zip(&theta).map(|(p, value)| {
            let written = file.parameter.iter().find(|w| w.name == p.name);
            Quantity { name: p.name.clone(), unit: p.unit.clone(), value: *value, ci95: written.and_then(|w| w.ci95) }
        });
        let scene = match &file.scene {
            None if file.effect.is_empty() => None,
            _ => Some(file.scene(&part.data, model, part.headings.as_deref()).map_err(refuse)?),
        };
        let effects = scene.as_ref().map_or_else(|| Ok(Vec::new()), |scene| file.effects(scene, registry)).map_err(refuse)?;
        let of_effects = effects.iter().zip(&file.effect).flat_map(|(loaded, entry)| {
            entry.parameter.iter().map(|v| {
                let side = v.wheel.as_deref().or(v.axis.as_deref());
                Quantity { name: qualified(loaded.effect.name(), &v.name, side), unit: v.unit.clone(), value: v.value, ci95: v.ci95 }
            })
        });
        Ok(Self {
            path: path.display().to_string(),
            kind: "model",
            parameters: parameters.collect(),
            effect_parameters: of_effects.collect(),
            effects,
            scene,
            readout: file.readout(),
            represents: None,
        })
    }

    /// The simulation that a simulator's recording shows, by its own diagnosis.
    ///
    /// # Errors
    /// [`Error::Config`] if an effect found there cannot be made again from its settings.
    pub fn from_recording(found: &Diagnosis, path: &std::path::Path, registry: &Registry) -> Result<Self, Error> {
        let parameters =
            found.base.iter().map(|p| Quantity { name: p.name.clone(), unit: p.unit.clone(), value: p.after, ci95: p.ci95 }).collect();
        let load = |f: &Finding| {
            let table = toml::Table::try_from(&f.settings).map_err(|e| Error::setting(&f.name, format!("has no TOML form: {e}")))?;
            let effect = registry.effect(table).map_err(|e| Error::setting(&f.name, e.to_string()))?;
            Ok(LoadedEffect { effect, values: f.values.clone() })
        };
        let effects = found.effects.iter().map(load).collect::<Result<Vec<_>, Error>>()?;
        let holds = found.verdict != Verdict::Unexplained;
        let names: Vec<String> = found.effects.iter().map(|f| f.name.clone()).collect();
        let statement = match (found.verdict, names.is_empty()) {
            (Verdict::Unexplained, _) => {
                "the base model and the library do not represent the simulator's recording: a difference may be theirs".to_owned()
            }
            (_, true) => "the base model represents the simulator's recording to within its noise".to_owned(),
            _ => format!("the base model with {} represents the simulator's recording", names.join(" and ")),
        };
        let represents = Represents {
            verdict: found.verdict,
            holds,
            statement,
            effects: names,
            fit: found.fit.after.clone(),
            noise_ceiling: found.fit.noise_ceiling.clone(),
        };
        Ok(Self {
            path: path.display().to_string(),
            kind: "recording",
            parameters,
            scene: (!effects.is_empty() || found.readout != Readout::default()).then(|| found.scene.clone()),
            readout: found.readout,
            effects,
            effect_parameters: quantities(&found.effects),
            represents: Some(represents),
        })
    }

    /// Values of its parameters.
    pub fn theta(&self) -> Vec<f64> {
        self.parameters.iter().map(|p| p.value).collect()
    }

    /// Free run of the simulation as it stands.
    fn run(&self, model: &dyn RegressorModel, part: &Part) -> Result<Validation, Error> {
        let theta = self.theta();
        let run = match &self.scene {
            None => validate(model, &theta, &part.data),
            Some(scene) => {
                let scene = scene.like(&part.data, part.headings.as_deref());
                let effects: Vec<&dyn Effect> = self.effects.iter().map(|l| &*l.effect).collect();
                let values: Vec<f64> = self.effects.iter().flat_map(|l| l.values.iter().copied()).collect();
                validate_with_effects(model, &theta, &effects, &values, (&scene, self.readout), &part.data)
            }
        };
        run.map_err(|e| Error::Identify(e.into()))
    }

    /// Splits what a diagnosis of the robot's recording found into changed parameters and missing effects, and sets the
    /// simulation as it stands in place of the refitted base model.
    ///
    /// # Errors
    /// [`Error`] if the simulation cannot be run on the robot's commands.
    pub fn compare(
        &self,
        found: &mut Diagnosis,
        model: &dyn RegressorModel,
        training: &Part,
        held_out: Option<&Part>,
    ) -> Result<Comparison, Error> {
        let changes = self.changes(found);
        let has = |name: &str| self.effects.iter().any(|l| l.effect.name() == name);
        let shown = |name: &str| found.effects.iter().any(|f| f.name == name);
        let superfluous: Vec<String> = self.effects.iter().map(|l| l.effect.name().to_owned()).filter(|n| !shown(n)).collect();
        found.effects.retain(|f| !has(&f.name));
        let training_run = self.run(model, training)?;
        replace(&mut found.training, &training_run);
        let proof = match (held_out, &mut found.held_out) {
            (Some(part), Some(replay)) => {
                let run = self.run(model, part)?;
                replace(replay, &run);
                run
            }
            _ => training_run,
        };
        let differs = changes.iter().any(|c| c.changed) || !superfluous.is_empty();
        if found.effects.is_empty() && found.verdict != Verdict::Unexplained {
            found.verdict = if differs { Verdict::Explained } else { Verdict::NoMismatch };
        }
        if let Some(as_given) = proof.fit.iter().copied().collect::<Option<Vec<f64>>>() {
            let refitted = std::mem::replace(&mut found.fit.before, as_given.clone());
            found.waterfall.retain(|rung| !rung.effects.is_empty());
            found.waterfall.insert(0, Rung { effects: Vec::new(), fit: as_given });
            if differs {
                found.waterfall.insert(1, Rung { effects: vec!["changed parameters".to_owned()], fit: refitted });
            }
        }
        let sentences = self.sentences(&changes, found, &superfluous);
        let document = json!({
            "path": self.path,
            "kind": self.kind,
            "represents": self.represents,
            "parameters": changes,
            "effects": self.effects.iter().map(|l| l.effect.name()).collect::<Vec<_>>(),
            "superfluous": superfluous,
            "statements": sentences,
        });
        if let Some(first) = sentences.first().filter(|_| found.effects.is_empty()) {
            found.headline = first.clone();
        }
        Ok(Comparison { changes, superfluous, as_given: proof.fit, sentences, document })
    }

    fn changes(&self, found: &Diagnosis) -> Vec<Change> {
        let base = found.base.iter().map(|p: &BaseParameter| Quantity {
            name: p.name.clone(),
            unit: p.unit.clone(),
            value: p.after,
            ci95: p.ci95,
        });
        let recorded: Vec<Quantity> = base.chain(quantities(&found.effects)).collect();
        let both = self.parameters.iter().chain(&self.effect_parameters);
        let pairs = both.filter_map(|s| recorded.iter().find(|r| r.name == s.name).map(|r| (s, r)));
        let mut changes: Vec<Change> = pairs
            .map(|(s, r)| Change {
                parameter: s.name.clone(),
                unit: s.unit.clone(),
                simulated: s.value,
                simulated_ci95: s.ci95,
                recorded: r.value,
                recorded_ci95: r.ci95,
                p: chance(s, r),
                changed: false,
                points_to: INFLUENCES.iter().filter(|i| i.vw_pd.contains(&s.name.as_str())).map(|i| i.key).collect(),
            })
            .collect();
        holm(&mut changes);
        changes
    }

    fn sentences(&self, changes: &[Change], found: &Diagnosis, superfluous: &[String]) -> Vec<String> {
        let mut sentences = Vec::new();
        let changed: Vec<&Change> = changes.iter().filter(|c| c.changed).collect();
        if changed.is_empty() {
            sentences.push("No parameter of the simulation differs from the robot's beyond the uncertainty of both.".to_owned());
        } else {
            let each: Vec<String> = changed.iter().map(|c| c.words()).collect();
            sentences.push(format!("The simulation has other parameters than the robot: {}.", each.join(", ")));
            sentences.extend(pointers(&changed));
        }
        if !found.effects.is_empty() {
            let names: Vec<&str> = found.effects.iter().map(|f| f.name.as_str()).collect();
            sentences.push(format!("The simulation lacks {}.", names.join(" and ")));
        }
        if !superfluous.is_empty() {
            sentences
                .push(format!("The simulation has {}, of which this recording of the robot shows nothing.", superfluous.join(" and ")));
        }
        sentences.extend(self.represents.iter().map(|r| format!("As a check, {}.", r.statement)));
        sentences
    }
}

impl Change {
    fn words(&self) -> String {
        let relative = 100.0 * (self.recorded - self.simulated) / self.simulated.abs();
        let amount = if relative.is_finite() && self.simulated.abs() > 0.02 * self.recorded.abs() {
            format!("{relative:+.1} %")
        } else {
            format!("from {:.4} to {:.4} {}", self.simulated, self.recorded, self.unit)
        };
        format!("{} {amount}", self.parameter)
    }
}

/// What the pattern of changed parameters points to. A constant that enters a parameter that did not change is no explanation
/// by itself; one whose parameters all changed explains the most with the least.
fn pointers(changed: &[&Change]) -> Vec<String> {
    let names: Vec<&str> = changed.iter().map(|c| c.parameter.as_str()).filter(|n| n.starts_with("theta")).collect();
    if names.is_empty() {
        return Vec::new();
    }
    let inside = INFLUENCES.iter().filter(|i| !i.vw_pd.is_empty() && i.vw_pd.iter().all(|p| names.contains(p)));
    let mut fitting: Vec<_> = inside.map(|i| (i.vw_pd.iter().filter(|p| names.contains(p)).count(), i)).collect();
    let most = fitting.iter().map(|f| f.0).max().unwrap_or(0);
    fitting.retain(|f| f.0 == most);
    if fitting.is_empty() {
        return vec!["No single physical constant enters these parameters and no other: several differ.".to_owned()];
    }
    let keys: Vec<&str> = fitting.iter().map(|f| f.1.key).collect();
    vec![format!("The constants that enter these parameters and no other are {}.", keys.join(", "))]
}

/// Two-sided chance of a difference, from both intervals taken as normal.
fn chance(a: &Quantity, b: &Quantity) -> Option<f64> {
    let std = |q: &Quantity| q.ci95.map(|(low, high)| (high - low) / (2.0 * NORMAL_95));
    let variance = [std(a), std(b)].into_iter().flatten().map(|s| s * s).sum::<f64>();
    if variance <= 0.0 || !variance.is_finite() {
        return None;
    }
    let z = (a.value - b.value).abs() / variance.sqrt();
    Some(statrs::function::erf::erfc(z / std::f64::consts::SQRT_2))
}

/// Marks what changed, by Holm's step-down procedure.
fn holm(changes: &mut [Change]) {
    let mut order: Vec<usize> = (0..changes.len()).filter(|&i| changes[i].p.is_some()).collect();
    order.sort_by(|&a, &b| changes[a].p.partial_cmp(&changes[b].p).unwrap_or(std::cmp::Ordering::Equal));
    let count = order.len();
    for (rank, &i) in order.iter().enumerate() {
        if changes[i].p.is_none_or(|p| p > LEVEL / (count - rank) as f64) {
            break;
        }
        changes[i].changed = true;
    }
}

/// Parameters of effects as quantities, named with the effect before them.
fn quantities(effects: &[Finding]) -> Vec<Quantity> {
    let each = |f: &Finding| {
        let name = f.name.clone();
        f.parameters
            .iter()
            .map(move |p| Quantity {
                name: qualified(&name, &p.name, p.label.as_ref().map(|l| l.1.as_str())),
                unit: p.unit.clone(),
                value: p.value,
                ci95: p.ci95,
            })
            .collect::<Vec<_>>()
    };
    effects.iter().flat_map(each).collect()
}

fn qualified(effect: &str, parameter: &str, side: Option<&str>) -> String {
    side.map_or_else(|| format!("{effect}.{parameter}"), |side| format!("{effect}.{parameter} ({side})"))
}

/// The simulation as it stands in the place of the base model, for the pictures.
fn replace(replay: &mut Replay, run: &Validation) {
    replay.before = run.comparisons.iter().map(|c| c.simulated.clone()).collect();
}

#[cfg(test)]
mod tests {
    use super::*;

    fn change(parameter: &str, p: f64) -> Change {
        Change {
            parameter: parameter.to_owned(),
            unit: "s".to_owned(),
            simulated: 1.0,
            simulated_ci95: None,
            recorded: 1.1,
            recorded_ci95: None,
            p: Some(p),
            changed: false,
            points_to: Vec::new(),
        }
    }

    #[test]
    fn a_change_is_judged_by_both_intervals() {
        let quantity =
            |value, half: f64| Quantity { name: "theta1".into(), unit: "s".into(), value, ci95: Some((value - half, value + half)) };
        let p = chance(&quantity(0.20, 0.03), &quantity(0.25, 0.04)).unwrap();
        // scipy.stats.norm.sf(0.05 / (0.05 / 1.959963984540054)) * 2
        assert!((p - 0.05).abs() < 1e-9, "{p}");
        let unknown = Quantity { ci95: None, ..quantity(0.25, 0.04) };
        assert!(chance(&quantity(0.20, 0.03), &unknown).unwrap() < p, "a simulation's exact value has no uncertainty");
        assert_eq!(chance(&unknown, &unknown), None);
    }

    #[test]
    fn holm_stops_at_the_first_that_is_not_significant() {
        let mut changes = [change("theta1", 0.001), change("theta2", 0.03), change("theta3", 0.2), change("theta4", 0.012)];
        holm(&mut changes);
        assert_eq!(changes.map(|c| c.changed), [true, false, false, true]);
    }

    #[test]
    fn a_pattern_of_parameters_points_to_constants() {
        let (one, two) = (change("theta1", 0.0), change("theta2", 0.0));
        assert!(pointers(&[&two])[0].contains("yaw_inertia"));
        assert!(pointers(&[&one, &two])[0].contains("wheel_inertia"));
        let five = change("theta5", 0.0);
        assert!(pointers(&[&five])[0].contains("No single"));
    }
}
