//! The feed-forward term: what a controller adds to its commands so that the robot moves as the base model would.
//!
//! For a wanted motion (outputs x) the base model alone needs the input u0(x) in steady state. With effects that use input up
//! it needs u0(x) + load(x), and what passes through thresholds and gains must leave them with that much: the command is
//! found by iteration. The table holds, over the range driven, the command to be sent less u0. Effects in time have no such
//! table: a delay asks for sending earlier, a lag for lead. What cannot be undone by a command (a limit, a sensor) says so.

use std::fmt::Write;

use serde::Serialize;
use wheelwright_core::effect::{Effect, Instant, Scene, Stage, Track};
use wheelwright_core::model::{ModelError, RegressorModel};
use wheelwright_core::simulation::Readout;
use wheelwright_core::{Dataset, Stretch};
use wheelwright_diagnosis::Diagnosis;

use crate::error::Error;
use crate::model_file::{LoadedEffect, ModelFile};
use crate::registry::Registry;

/// Grid points along each output.
const POINTS: usize = 41;
/// Steps of the iteration that inverts thresholds and gains; each contracts or the effect is not invertible.
const ITERATIONS: usize = 60;

/// The term for a controller.
#[derive(Debug, Clone, PartialEq)]
pub struct Term {
    outputs: Vec<String>,
    inputs: Vec<String>,
    /// Outputs, then what is added to each input.
    rows: Vec<Vec<f64>>,
    notes: Notes,
}

/// What goes into `feedforward.toml`.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Notes {
    schema: String,
    table: String,
    axes: Vec<String>,
    adds_to: Vec<String>,
    effect: Vec<Note>,
}

/// One effect and how it is met.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Note {
    name: String,
    /// `table`, `preview`, `lead`, `none`.
    by: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    seconds: Option<f64>,
    how: String,
}

/// The term against the effects of a diagnosis.
///
/// # Errors
/// [`Error`] if the model cannot be inverted or an effect not be made from the file.
pub fn term(file: &ModelFile, found: &Diagnosis, model: &dyn RegressorModel, registry: &Registry) -> Result<Term, Error> {
    let loaded = file.effects(&found.scene, registry).map_err(|e| Error::setting(&e.path, e.message.clone()))?;
    let theta: Vec<f64> = found.base.iter().map(|p| p.after).collect();
    let bench = Bench::new(&found.scene, Track::default());
    let tabled: Vec<&LoadedEffect> = loaded.iter().filter(|l| in_table(l, &found.scene)).collect();
    let mut rows = Vec::new();
    if !tabled.is_empty() {
        for x in grid(&found.training.measured) {
            let added = bench.added(model, &theta, &tabled, &x).map_err(|e| Error::Identify(e.into()))?;
            rows.push([x, added].concat());
        }
    }
    let names = |channels: &[wheelwright_core::Channel]| channels.iter().map(|c| c.name.to_string()).collect::<Vec<_>>();
    let notes = Notes {
        schema: "wheelwright.feedforward/1".to_owned(),
        table: "feedforward.csv".to_owned(),
        axes: names(model.outputs()),
        adds_to: names(model.inputs()),
        effect: loaded.iter().map(|l| note(l, &found.scene)).collect(),
    };
    Ok(Term { outputs: notes.axes.clone(), inputs: notes.adds_to.clone(), rows, notes })
}

impl Term {
    /// The table: outputs wanted, and what is to be added to each input.
    pub fn csv(&self) -> String {
        let added = self.inputs.iter().map(|name| format!("{name}_add"));
        let mut text = self.outputs.iter().cloned().chain(added).collect::<Vec<_>>().join(",") + "\n";
        for row in &self.rows {
            text.push_str(&row.iter().map(f64::to_string).collect::<Vec<_>>().join(","));
            text.push('\n');
        }
        text
    }

    /// What the table is, and what no table can hold.
    pub fn to_toml(&self) -> String {
        let mut text = String::from("# What a controller does against the effects found: add the table's values to its commands.\n");
        // Plain values always have a TOML form.
        let _ = write!(text, "{}", toml::to_string(&self.notes).unwrap_or_default());
        text
    }
}

/// Whether an effect is a function of the motion and the command alone, so that a table can meet it.
fn in_table(loaded: &LoadedEffect, scene: &Scene) -> bool {
    let momentary = loaded.effect.states(scene) == 0;
    match loaded.effect.stage() {
        Stage::Bearing | Stage::Load => momentary && anywhere(loaded, scene),
        Stage::Threshold | Stage::Gain => momentary,
        _ => false,
    }
}

/// Whether a load is the same wherever the robot is and faces.
fn anywhere(loaded: &LoadedEffect, scene: &Scene) -> bool {
    let at = |heading: f64, place: [f64; 2]| {
        let track = Track { heading: vec![heading; 2], place: place.map(|x| vec![x; 2]), ..Track::default() };
        let bench = Bench::new(scene, track);
        let mut load = vec![0.0; scene.inputs.len()];
        loaded.effect.load(&loaded.values, &bench.instant(), &scene.scales.outputs, &[], &mut load);
        load
    };
    at(0.0, [0.0; 2]) == at(1.0, [1.0, 2.0])
}

/// Whether an effect uses up input.
fn loads(effect: &dyn Effect) -> bool {
    matches!(effect.stage(), Stage::Bearing | Stage::Load)
}

fn note(loaded: &LoadedEffect, scene: &Scene) -> Note {
    let effect = &*loaded.effect;
    let first = effect.parameters(scene).iter().zip(&loaded.values).find(|(p, _)| p.unit == "s").map(|(_, v)| *v);
    let (by, seconds, how) = match effect.stage() {
        _ if in_table(loaded, scene) => ("table", None, "add the table's values to the command"),
        Stage::Transport => ("preview", first, "send each command this much earlier"),
        Stage::Filter => ("lead", first, "add the rate of change of the command times this"),
        Stage::Ramp | Stage::Limit => ("none", None, "no command gets past a limit: plan motion that stays within it"),
        Stage::Sensor => ("none", None, "the motion is right and its record is not: correct the measurement"),
        Stage::Loop => ("none", None, "an outer loop compensates already: take it into the controller's design"),
        _ => ("none", None, "depends on more than the present motion: use the augmented model in the controller"),
    };
    Note { name: effect.name().to_owned(), by: by.to_owned(), seconds, how: how.to_owned() }
}

/// Evenly spaced outputs over the range driven, all combinations of the first two.
fn grid(data: &Dataset) -> Vec<Vec<f64>> {
    let axis = |i: usize| {
        let largest = data.stretches.iter().flat_map(|s| &s.outputs[i]).fold(0.0_f64, |m, y| m.max(y.abs()));
        (0..POINTS).map(move |k| largest * (2.0 * k as f64 / (POINTS - 1) as f64 - 1.0)).collect::<Vec<f64>>()
    };
    let axes: Vec<Vec<f64>> = (0..data.outputs.len()).map(axis).collect();
    let mut points = vec![Vec::new()];
    for axis in &axes {
        points = points.iter().flat_map(|p: &Vec<f64>| axis.iter().map(move |x| [p.as_slice(), &[*x]].concat())).collect();
    }
    points
}

/// A standing instant in which effects are evaluated.
struct Bench<'a> {
    scene: &'a Scene,
    stretch: Stretch,
    track: Track,
    inputs: usize,
}

impl<'a> Bench<'a> {
    fn new(scene: &'a Scene, track: Track) -> Self {
        let (inputs, outputs) = (scene.inputs.len(), scene.outputs.len());
        let (first, _) = scene.scales.time;
        let columns = |count: usize| vec![vec![0.0; 2]; count];
        let stretch = Stretch {
            label: String::new(),
            time: vec![first, first + scene.scales.period],
            inputs: columns(inputs),
            outputs: columns(outputs),
        };
        Self { scene, stretch, track, inputs }
    }

    fn instant(&self) -> Instant<'_> {
        Instant::of_sample(&self.stretch, 0, &self.track, self.scene, Readout::Instantaneous)
    }

    /// What is to be added to the base model's steady input so that the outputs are held.
    fn added(&self, model: &dyn RegressorModel, theta: &[f64], effects: &[&LoadedEffect], x: &[f64]) -> Result<Vec<f64>, ModelError> {
        let at = self.instant();
        let steady = steady_input(model, theta, x)?;
        let mut load = vec![0.0; self.inputs];
        for l in effects.iter().filter(|l| loads(&*l.effect)) {
            l.effect.load(&l.values, &at, x, &[], &mut load);
        }
        let wanted: Vec<f64> = steady.iter().zip(&load).map(|(u, l)| u + l).collect();
        let mut sent = wanted.clone();
        for _ in 0..ITERATIONS {
            let mut arrives = sent.clone();
            for l in effects.iter().filter(|l| !loads(&*l.effect)) {
                let mut state = vec![0.0; l.effect.states(self.scene)];
                l.effect.begin(&l.values, &at, &arrives, x, &mut state);
                l.effect.command(&l.values, &at, x, &mut state, &mut arrives);
            }
            sent.iter_mut().zip(wanted.iter().zip(&arrives)).for_each(|(s, (w, a))| *s += w - a);
        }
        Ok(sent.iter().zip(&steady).map(|(s, u)| s - u).collect())
    }
}

/// The input that holds the outputs, u0 = −B⁻¹ a(x, 0) with B what a unit of each input does; models are affine in inputs.
fn steady_input(model: &dyn RegressorModel, theta: &[f64], x: &[f64]) -> Result<Vec<f64>, ModelError> {
    let (n, m) = (model.outputs().len(), model.inputs().len());
    let singular = || ModelError::Singular { model: model.name().to_owned() };
    let mut input = vec![0.0; m];
    let mut rest = vec![0.0; n];
    model.accelerations(theta, &input, x, &mut rest)?;
    let mut mobility = nalgebra::DMatrix::zeros(n, m);
    let mut moved = vec![0.0; n];
    for j in 0..m {
        input[j] = 1.0;
        model.accelerations(theta, &input, x, &mut moved)?;
        input[j] = 0.0;
        (0..n).for_each(|i| mobility[(i, j)] = moved[i] - rest[i]);
    }
    if n != m {
        return Err(singular());
    }
    let solved = mobility.lu().solve(&nalgebra::DVector::from_iterator(n, rest.iter().map(|a| -a))).ok_or_else(singular)?;
    Ok(solved.iter().copied().collect())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

    use wheelwright_core::ModelConfig;
    use wheelwright_diagnosis::effects::{CoulombFriction, DeadZone, Slope};
    use wheelwright_models::VwPdConfig;

    use super::*;

    #[test]
    fn a_table_holds_what_is_the_same_at_every_place_and_heading_and_at_every_time() {
        let model = VwPdConfig::default().build().unwrap();
        let columns = || vec![vec![0.1, 0.2]; 2];
        let stretch = Stretch { label: String::new(), time: vec![0.0, 0.1], inputs: columns(), outputs: columns() };
        let data = Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![stretch] };
        let scene = Scene::new(&data, &*model, 0.3, None, None);
        let held = |effect: Box<dyn Effect>, values: &[f64]| in_table(&LoadedEffect { effect, values: values.to_vec() }, &scene);
        assert!(held(Box::<CoulombFriction>::default(), &[0.05, 1.0]));
        assert!(held(Box::<DeadZone>::default(), &[0.05]));
        assert!(!held(Box::new(DeadZone { holding: true, ..DeadZone::default() }), &[0.05, 0.5]));
        assert!(!held(Box::<Slope>::default(), &[0.05, 0.02, 0.0, 0.0]));
        assert!(!held(Box::new(Slope { waves: true }), &[0.05, 1.0, 0.5, 0.3, 0.0, 0.0]));
    }
}
