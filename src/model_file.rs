//! `model.toml`: an identified model as a file that other commands read.
//!
//! ```toml
//! schema = "wheelwright.model/1"
//! [robot]                 # the profile it was identified with, if one was given
//! [model]
//! type = "vw-pd"
//! [[parameter]]
//! name = "theta1"
//! value = 0.2604
//! std = 0.0003
//! ci95 = [0.2598, 0.2610]
//! unit = "s"
//! [scene]                 # with effects: the recording's scales, in which their values mean what they say
//! [[effect]]              # physics found beside the model, with its settings and values
//! type = "command_delay"
//! [[effect.parameter]]
//! name = "delay"
//! value = 0.12
//! ```

use std::path::Path;

use serde::{Deserialize, Serialize};
use toml::Table;
use wheelwright_core::Dataset;
use wheelwright_core::config::{self, ConfigError};
use wheelwright_core::effect::{Effect, EffectParameter, Frame, Scales, Scene};
use wheelwright_core::identification::Identification;
use wheelwright_core::model::RegressorModel;
use wheelwright_core::profile::RobotProfile;
use wheelwright_core::simulation::Readout;
use wheelwright_diagnosis::finding::{Diagnosis, Finding, FoundParameter};

use crate::error::Error;
use crate::registry::Registry;
use crate::toml_file::TomlFile;

const SCHEMA: &str = "wheelwright.model/1";

/// The content of a `model.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelFile {
    /// Version of this form.
    pub schema: String,
    /// The robot's profile.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot: Option<RobotProfile>,
    /// The model's configuration.
    pub model: Table,
    /// Its parameters.
    pub parameter: Vec<ParameterValue>,
    /// In what the effects' values are measured; there if there are effects.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene: Option<SceneFile>,
    /// Effects beside the model, in the order found.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effect: Vec<EffectEntry>,
}

/// Dimensions and scales of the recording on which effects were found: widths of kinks and units of some values are shares
/// of them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// Distance between the wheels' contact points \[m\]; absent where the model's channels know no wheels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub track_width: Option<f64>,
    /// Radius of the wheels \[m\], if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wheel_radius: Option<f64>,
    /// Root mean square of each input.
    pub inputs_rms: Vec<f64>,
    /// Largest magnitude of each input.
    pub inputs_largest: Vec<f64>,
    /// Root mean square of each output.
    pub outputs_rms: Vec<f64>,
    /// Root mean square of the wheels' commands.
    pub command_rms: f64,
    /// Largest magnitude of a wheel's command.
    pub command_largest: f64,
    /// Root mean square of the wheels' ground speeds.
    pub speed_rms: f64,
    /// First and last time \[s\].
    pub time: (f64, f64),
    /// Median step between samples \[s\].
    pub period: f64,
    /// True where the recorded velocities are means since the sample before.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub interval_mean: bool,
}

/// An effect: `type` and settings of the plugin, and its parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EffectEntry {
    /// Values, one a parameter of the effect.
    #[serde(default)]
    pub parameter: Vec<EffectValue>,
    /// `type` and settings.
    #[serde(flatten)]
    pub settings: Table,
}

/// A value of an effect's parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectValue {
    /// Name.
    pub name: String,
    /// Value in SI.
    pub value: f64,
    /// 95 % interval.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ci95: Option<(f64, f64)>,
    /// Unit.
    #[serde(default)]
    pub unit: String,
    /// Which wheel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wheel: Option<String>,
    /// Which axis.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axis: Option<String>,
}

/// An effect as read from a file, with its values in its own order.
#[derive(Debug)]
pub struct LoadedEffect {
    /// The effect.
    pub effect: Box<dyn Effect>,
    /// Value of each parameter.
    pub values: Vec<f64>,
}

/// A parameter's value with what is known about it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ParameterValue {
    /// Name.
    pub name: String,
    /// Value in SI.
    pub value: f64,
    /// Standard error.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub std: Option<f64>,
    /// 95 % confidence interval.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ci95: Option<(f64, f64)>,
    /// Unit.
    #[serde(default)]
    pub unit: String,
}

impl ModelFile {
    /// The file of an identification.
    pub fn new(model: &Table, robot: Option<RobotProfile>, found: &Identification) -> Self {
        let parameter = found.estimates.iter().map(|e| ParameterValue {
            name: e.parameter.name.clone(),
            value: e.value,
            std: e.std,
            ci95: e.ci95,
            unit: e.parameter.unit.clone(),
        });
        Self { schema: SCHEMA.to_owned(), robot, model: model.clone(), parameter: parameter.collect(), scene: None, effect: Vec::new() }
    }

    /// The file of a diagnosis: the model with its parameters beside the effects, and the effects.
    ///
    /// # Errors
    /// [`ConfigError`] if an effect's settings cannot be written as TOML or make no effect.
    pub fn diagnosed(model: &Table, robot: Option<RobotProfile>, found: &Diagnosis, registry: &Registry) -> Result<Self, ConfigError> {
        let parameter = found.base.iter().map(|p| ParameterValue {
            name: p.name.clone(),
            value: p.after,
            std: None,
            ci95: p.ci95,
            unit: p.unit.clone(),
        });
        let entry = |finding: &Finding| EffectEntry::of(finding, &found.scene, registry);
        let effect = found.effects.iter().map(entry).collect::<Result<Vec<_>, _>>()?;
        let scene = (!effect.is_empty() || found.readout != Readout::default()).then(|| SceneFile::of(&found.scene, found.readout));
        Ok(Self { schema: SCHEMA.to_owned(), robot, model: model.clone(), parameter: parameter.collect(), scene, effect })
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`Error::Io`], or [`Error::Config`] naming the key.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let source = TomlFile::read(path)?;
        let file: Self = config::plain(source.table()?).map_err(|e| source.error(e))?;
        if file.schema != SCHEMA {
            return Err(source.error(ConfigError::new("schema", format!("is \"{}\"; this program reads \"{SCHEMA}\"", file.schema))));
        }
        Ok(file)
    }

    /// Parameter values in the order of a model's parameters.
    ///
    /// # Errors
    /// [`ConfigError`] naming a parameter that is missing or unknown.
    pub fn theta(&self, model: &dyn RegressorModel) -> Result<Vec<f64>, ConfigError> {
        let known: Vec<&str> = model.parameters().iter().map(|p| p.name.as_str()).collect();
        if let Some(stray) = self.parameter.iter().find(|p| !known.contains(&p.name.as_str())) {
            return Err(ConfigError::new(
                "parameter",
                format!("model `{}` has no parameter `{}`: it has {}", model.name(), stray.name, known.join(", ")),
            ));
        }
        let value = |name: &&str| {
            let found = self.parameter.iter().find(|p| p.name == **name).map(|p| p.value);
            found.ok_or_else(|| ConfigError::new("parameter", format!("`{name}` of model `{}` has no value", model.name())))
        };
        known.iter().map(value).collect()
    }

    /// The effects with their values, for a scene of the model's channels.
    ///
    /// # Errors
    /// [`ConfigError`] naming the effect's table and the key.
    pub fn effects(&self, scene: &Scene, registry: &Registry) -> Result<Vec<LoadedEffect>, ConfigError> {
        let load = |(i, entry): (usize, &EffectEntry)| entry.load(scene, registry).map_err(|e| e.inside(&format!("effect[{i}]")));
        self.effect.iter().enumerate().map(load).collect()
    }

    /// The scene of a data set, in this file's scales where it has them. `headings` as in [`Scene::new`].
    ///
    /// # Errors
    /// [`ConfigError`] if there are effects without `[scene]`, or its lists do not suit the model.
    pub fn scene(&self, data: &Dataset, model: &dyn RegressorModel, headings: Option<&[Vec<f64>]>) -> Result<Scene, ConfigError> {
        let Some(file) = &self.scene else {
            return Err(ConfigError::new("scene", "is missing: the values of [[effect]] are measured in its scales"));
        };
        file.check(model).map_err(|e| e.inside("scene"))?;
        let track_width = file.track_width.unwrap_or(f64::NAN);
        let fresh = Scene::new(data, model, track_width, file.wheel_radius, headings);
        Ok(Scene { scales: file.scales(), ..fresh })
    }

    /// How recorded velocities are to be simulated.
    pub fn readout(&self) -> Readout {
        if self.scene.as_ref().is_some_and(|s| s.interval_mean) { Readout::IntervalMean } else { Readout::Instantaneous }
    }

    /// The file's text.
    pub fn to_toml(&self) -> String {
        // A struct of plain values and string-keyed tables always has a TOML form.
        toml::to_string(self).unwrap_or_default()
    }
}

impl SceneFile {
    fn of(scene: &Scene, readout: Readout) -> Self {
        let Scales { inputs, largest, outputs, command, largest_command, speed, time, period } = scene.scales.clone();
        Self {
            track_width: Some(2.0 * scene.frame.half_track()).filter(|w| w.is_finite()),
            wheel_radius: scene.wheel_radius,
            inputs_rms: inputs,
            inputs_largest: largest,
            outputs_rms: outputs,
            command_rms: command,
            command_largest: largest_command,
            speed_rms: speed,
            time,
            period,
            interval_mean: readout == Readout::IntervalMean,
        }
    }

    fn scales(&self) -> Scales {
        Scales {
            inputs: self.inputs_rms.clone(),
            largest: self.inputs_largest.clone(),
            outputs: self.outputs_rms.clone(),
            command: self.command_rms,
            largest_command: self.command_largest,
            speed: self.speed_rms,
            time: self.time,
            period: self.period,
        }
    }

    fn check(&self, model: &dyn RegressorModel) -> Result<(), ConfigError> {
        let positive = |key: &str, values: &[f64]| match values.iter().find(|v| !(v.is_finite() && **v > 0.0)) {
            Some(value) => Err(ConfigError::new(key, format!("must hold positive numbers, not {value}"))),
            None => Ok(()),
        };
        let (inputs, outputs) = (model.inputs().len(), model.outputs().len());
        for (key, values, count) in [
            ("inputs_rms", &self.inputs_rms, inputs),
            ("inputs_largest", &self.inputs_largest, inputs),
            ("outputs_rms", &self.outputs_rms, outputs),
        ] {
            if values.len() != count {
                return Err(ConfigError::new(key, format!("has {} values; model `{}` needs {count}", values.len(), model.name())));
            }
        }
        positive("inputs_rms", &self.inputs_rms)?;
        positive("outputs_rms", &self.outputs_rms)?;
        for (key, value) in [("speed_rms", Some(self.speed_rms)), ("period", Some(self.period)), ("track_width", self.track_width)] {
            positive(key, value.as_slice())?;
        }
        // The frame of a model with unknown channels has no wheels and needs no track.
        if self.track_width.is_none() && Frame::of(model, 1.0).has_wheels() {
            return Err(ConfigError::new("track_width", format!("is missing: effects of model `{}` act on its wheels", model.name())));
        }
        Ok(())
    }
}

impl EffectEntry {
    fn of(finding: &Finding, scene: &Scene, registry: &Registry) -> Result<Self, ConfigError> {
        let settings: Table = Table::try_from(&finding.settings)
            .map_err(|e| ConfigError::new(&finding.name, format!("its settings have no TOML form: {e}")))?;
        let effect = registry.effect(settings.clone()).map_err(|e| e.inside(&finding.name))?;
        let value = |(p, value): (EffectParameter, &f64)| {
            let same = |f: &&FoundParameter| f.name == p.name && f.label == p.label;
            let label = |kind: &str| p.label.as_ref().filter(|l| l.0 == kind).map(|l| l.1.clone());
            EffectValue {
                value: *value,
                ci95: finding.parameters.iter().find(same).and_then(|f| f.ci95).filter(|(a, b)| a.is_finite() && b.is_finite()),
                wheel: label("wheel"),
                axis: label("axis"),
                name: p.name,
                unit: p.unit,
            }
        };
        Ok(Self { parameter: effect.parameters(scene).into_iter().zip(&finding.values).map(value).collect(), settings })
    }

    fn load(&self, scene: &Scene, registry: &Registry) -> Result<LoadedEffect, ConfigError> {
        let effect = registry.effect(self.settings.clone())?;
        let known = effect.parameters(scene);
        let matches = |p: &EffectParameter, v: &EffectValue| {
            let label = p.label.as_ref().map(|(kind, which)| (*kind, which.as_str()));
            let given = v.wheel.as_deref().map(|w| ("wheel", w)).or(v.axis.as_deref().map(|a| ("axis", a)));
            p.name == v.name && (label == given || !matches!(label, Some(("wheel" | "axis", _))) && given.is_none())
        };
        if let Some(stray) = self.parameter.iter().find(|v| !known.iter().any(|p| matches(p, v))) {
            let names = known.iter().map(described).collect::<Vec<_>>().join(", ");
            return Err(ConfigError::new(
                "parameter",
                format!("effect `{}` has no parameter `{}`: it has {names}", effect.name(), stray.name),
            ));
        }
        let value = |p: &EffectParameter| {
            let found = self.parameter.iter().find(|v| matches(p, v)).map(|v| v.value);
            let value =
                found.ok_or_else(|| ConfigError::new("parameter", format!("{} of `{}` has no value", described(p), effect.name())))?;
            let (low, high) = p.bounds;
            let slack = 1e-9 * value.abs();
            if !(value.is_finite() && value >= low - slack && value <= high + slack) {
                return Err(ConfigError::new(
                    "parameter",
                    format!("{} of `{}` is {value}, outside {low} to {high}", described(p), effect.name()),
                ));
            }
            Ok(value)
        };
        let values = known.iter().map(value).collect::<Result<Vec<_>, _>>()?;
        Ok(LoadedEffect { effect, values })
    }
}

/// A parameter with its side or axis, for messages.
fn described(p: &EffectParameter) -> String {
    p.label.as_ref().map_or_else(|| format!("`{}`", p.name), |(kind, which)| format!("`{}` ({kind} {which})", p.name))
}

#[cfg(test)]
mod tests {
    use wheelwright_core::effect::Effect;
    use wheelwright_diagnosis::Verdict;
    use wheelwright_diagnosis::finding::settings;

    use super::*;
    use crate::report::diagnosis::tests::{example, model};

    #[test]
    fn a_diagnosed_model_is_read_back_as_it_was_found() {
        let (found, model) = (example(Verdict::Explained), model());
        let table = Table::from_iter([("type".to_owned(), toml::Value::String("vw-pd".to_owned()))]);
        let registry = Registry::default();
        let written = ModelFile::diagnosed(&table, None, &found, &registry).unwrap();
        let read: ModelFile = toml::from_str(&written.to_toml()).unwrap();
        assert_eq!(read, written);
        let scene = read.scene(&found.training.measured, &*model, None).unwrap();
        assert_eq!(scene.scales, found.scene.scales);
        let effects = read.effects(&scene, &registry).unwrap();
        assert_eq!(effects.len(), 1);
        assert_eq!((effects[0].effect.name(), &effects[0].values), ("coulomb_friction", &found.effects[0].values));
        assert_eq!(read.effect[0].parameter[0].ci95, found.effects[0].parameters[0].ci95);
    }

    #[test]
    fn every_effect_of_the_library_is_made_again_from_its_settings() {
        let registry = Registry::default();
        let library: Vec<Box<dyn Effect>> = wheelwright_diagnosis::effects::library();
        for effect in &library {
            let settings = Table::try_from(settings(&**effect)).unwrap();
            let again = registry.effect(settings.clone()).unwrap_or_else(|e| panic!("{settings}: {e}"));
            assert_eq!(format!("{again:?}"), format!("{effect:?}"));
        }
    }
}
