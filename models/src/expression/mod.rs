//! `expression`: a model written in TOML alone.
//!
//! ```toml
//! [model]
//! type = "expression"
//! name = "vw-pd-with-drag"
//! inputs = { v_ref = "m/s", omega_ref = "rad/s" }
//! outputs = { v = "m/s", omega = "rad/s" }
//! equations = [
//!   "v_ref = theta1*der(v) - theta3*omega^2 + theta4*v + drag*v*abs(v)",
//!   "omega_ref = theta2*der(omega) + theta5*v*omega + theta6*omega",
//! ]
//!
//! [model.parameters]
//! theta1 = { unit = "s", min = 0.0, meaning = "lag of the forward velocity" }
//! drag = { unit = "s/m", min = 0.0, meaning = "air drag" }
//! # ...
//! ```
//!
//! Equations are taken apart once, when the model is built: into the factor of every parameter, of every derivative and
//! of every product of the two. What cannot be written so is refused there, with the column and the reason.

mod form;
mod ordered;
mod parse;
mod program;

use serde::{Deserialize, Serialize};
use wheelwright_core::Channel;
use wheelwright_core::channel::unit_of;
use wheelwright_core::model::{ModelConfig, ModelError, Parameter, RegressorModel, Sample, solve_accelerations};

use form::{Form, Names, functions};
pub use ordered::Ordered;
use parse::Fault;

/// Most outputs for which accelerations are solved without allocation.
const SMALL: usize = 8;

/// Configuration of `expression`. Names are letters, digits and `_`; all of them differ.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ExpressionConfig {
    /// Name of the model in reports.
    pub name: String,
    /// Input channels and their units.
    pub inputs: Ordered<String>,
    /// Output channels and their units.
    pub outputs: Ordered<String>,
    /// Equations, `left = right`; as many as outputs if the model is to be simulated.
    pub equations: Vec<String>,
    /// Numbers that equations may use by name.
    #[serde(skip_serializing_if = "is_empty")]
    pub constants: Ordered<f64>,
    /// Parameters in the order of θ.
    pub parameters: Ordered<ParameterConfig>,
}

/// A parameter of an `expression`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ParameterConfig {
    /// SI unit; `1` for a pure number.
    pub unit: String,
    /// Lower bound.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
    /// Upper bound.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
    /// What it does, in one sentence.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub meaning: Option<String>,
    /// The motion that shows it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub excitation: Option<String>,
}

fn is_empty<T>(table: &Ordered<T>) -> bool {
    table.0.is_empty()
}

fn wrong(key: impl Into<String>, reason: impl Into<String>) -> ModelError {
    ModelError::Config { key: key.into(), reason: reason.into() }
}

impl ExpressionConfig {
    /// Builds the model.
    ///
    /// # Errors
    /// [`ModelError::Config`] with the key, and for an equation the column.
    pub fn model(&self) -> Result<ExpressionModel, ModelError> {
        self.check_names()?;
        let names = Names {
            inputs: self.inputs.keys().collect(),
            outputs: self.outputs.keys().collect(),
            parameters: self.parameters.keys().collect(),
            constants: self.constants.0.iter().map(|(name, value)| (name.as_str(), *value)).collect(),
        };
        let mut equations = Vec::with_capacity(self.equations.len());
        for (i, text) in self.equations.iter().enumerate() {
            let fault = |f: Fault| wrong(format!("equations[{i}]"), format!("column {}: {}", f.column, f.message));
            let form = residual(text, &names).map_err(fault)?;
            if !form.has_parameter() {
                return Err(wrong(format!("equations[{i}]"), "holds no parameter: nothing can be identified from it"));
            }
            equations.push(form);
        }
        for (j, name) in names.parameters.iter().enumerate() {
            if !equations.iter().flat_map(|e| &e.0).any(|p| p.parameter == Some(j)) {
                return Err(wrong(format!("parameters.{name}"), "occurs in no equation: remove it, or use it"));
            }
        }
        let channels = |table: &Ordered<String>| table.0.iter().map(|(name, unit)| Channel::owned(name, unit)).collect();
        Ok(ExpressionModel {
            name: self.name.clone(),
            inputs: channels(&self.inputs),
            outputs: channels(&self.outputs),
            parameters: self.parameters()?,
            equations,
        })
    }

    fn check_names(&self) -> Result<(), ModelError> {
        if self.name.trim().is_empty() {
            return Err(wrong("name", "is missing: reports call the model by it"));
        }
        let sizes = [
            ("inputs", self.inputs.0.len()),
            ("outputs", self.outputs.0.len()),
            ("parameters", self.parameters.0.len()),
            ("equations", self.equations.len()),
        ];
        if let Some((key, _)) = sizes.iter().find(|(_, n)| *n == 0) {
            return Err(wrong(*key, "is empty: a model needs at least one of each of inputs, outputs, parameters and equations"));
        }
        let mut seen: Vec<&str> = functions().collect();
        let tables: [(&str, Vec<&str>); 4] = [
            ("inputs", self.inputs.keys().collect()),
            ("outputs", self.outputs.keys().collect()),
            ("constants", self.constants.keys().collect()),
            ("parameters", self.parameters.keys().collect()),
        ];
        for (table, names) in tables {
            for name in names {
                let first = name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_');
                if !first || !name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
                    return Err(wrong(format!("{table}.{name}"), "a name is made of letters, digits and _, and begins with no digit"));
                }
                if seen.contains(&name) {
                    return Err(wrong(format!("{table}.{name}"), format!("`{name}` has a meaning already: choose another name")));
                }
                seen.push(name);
            }
        }
        self.check_values()
    }

    fn check_values(&self) -> Result<(), ModelError> {
        for (table, channels) in [("inputs", &self.inputs), ("outputs", &self.outputs)] {
            for (name, unit) in &channels.0 {
                let standard = unit_of(name);
                if unit.trim().is_empty() || (!standard.is_empty() && unit != standard) {
                    let expected =
                        if standard.is_empty() { "an SI unit, `1` for a pure number".to_owned() } else { format!("`{standard}`") };
                    return Err(wrong(format!("{table}.{name}"), format!("the unit must be {expected}, not `{unit}`")));
                }
            }
        }
        match self.constants.0.iter().find(|(_, value)| !value.is_finite()) {
            Some((name, value)) => Err(wrong(format!("constants.{name}"), format!("must be a finite number, not {value}"))),
            None => Ok(()),
        }
    }

    fn parameters(&self) -> Result<Vec<Parameter>, ModelError> {
        let parameter = |(name, p): &(String, ParameterConfig)| {
            let (lower, upper) = (p.min.unwrap_or(f64::NEG_INFINITY), p.max.unwrap_or(f64::INFINITY));
            if p.unit.trim().is_empty() {
                return Err(wrong(format!("parameters.{name}.unit"), "must be an SI unit, `1` for a pure number"));
            }
            if lower.is_nan() || upper.is_nan() || lower > upper {
                return Err(wrong(format!("parameters.{name}.min"), format!("{lower} must not lie above the upper bound {upper}")));
            }
            let meaning = p.meaning.clone().unwrap_or_else(|| format!("parameter {name} of {}", self.name));
            let excitation = p.excitation.clone().unwrap_or_else(|| format!("motion in which the terms of {name} vary by themselves"));
            Ok(Parameter::new(name, &p.unit, &meaning, &excitation).within(lower, upper))
        };
        self.parameters.0.iter().map(parameter).collect()
    }
}

/// One side of an equation minus the other, so that the parameters' side counts positive: Σ θ φ − y.
fn residual(text: &str, names: &Names<'_>) -> Result<Form, Fault> {
    let (left, right) = parse::equation(text)?;
    let (left, right) = (names.form(&left)?, names.form(&right)?);
    let mut residual = if right.has_parameter() { right.minus(left) } else { left.minus(right) };
    residual.0.retain(|part| part.factor.constant() != Some(0.0));
    Ok(residual)
}

#[typetag::serde(name = "expression")]
impl ModelConfig for ExpressionConfig {
    fn about(&self) -> String {
        "a model written in TOML: channels, parameters with units and bounds, equations as expressions".to_owned()
    }

    fn build(&self) -> Result<Box<dyn RegressorModel>, ModelError> {
        Ok(Box::new(self.model()?))
    }
}

/// The model object of `expression`.
#[derive(Debug, Clone)]
pub struct ExpressionModel {
    name: String,
    inputs: Vec<Channel>,
    outputs: Vec<Channel>,
    parameters: Vec<Parameter>,
    equations: Vec<Form>,
}

impl RegressorModel for ExpressionModel {
    fn name(&self) -> &str {
        &self.name
    }

    fn inputs(&self) -> &[Channel] {
        &self.inputs
    }

    fn outputs(&self) -> &[Channel] {
        &self.outputs
    }

    fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    fn equations(&self) -> usize {
        self.equations.len()
    }

    fn regressor(&self, sample: Sample<'_>, phi: &mut [f64], y: &mut [f64]) {
        phi.fill(0.0);
        y.fill(0.0);
        let rows = phi.chunks_exact_mut(self.parameters.len());
        for ((equation, row), response) in self.equations.iter().zip(rows).zip(y) {
            for part in &equation.0 {
                let value = part.factor.evaluate(sample.inputs, sample.outputs) * part.derivative.map_or(1.0, |k| sample.accelerations[k]);
                match part.parameter {
                    Some(j) => row[j] += value,
                    None => *response -= value,
                }
            }
        }
    }

    fn accelerations(&self, theta: &[f64], inputs: &[f64], outputs: &[f64], accelerations: &mut [f64]) -> Result<(), ModelError> {
        let n = self.outputs.len();
        if self.equations.len() != n || n > SMALL {
            return solve_accelerations(self, theta, inputs, outputs, accelerations);
        }
        // Each row holds the factors of the accelerations and, last, what stands against them.
        let mut rows = [[0.0; SMALL + 1]; SMALL];
        for (equation, row) in self.equations.iter().zip(&mut rows) {
            for part in &equation.0 {
                let value = part.factor.evaluate(inputs, outputs) * part.parameter.map_or(1.0, |j| theta[j]);
                match part.derivative {
                    Some(k) => row[k] += value,
                    None => row[SMALL] -= value,
                }
            }
        }
        solve_small(&mut rows[..n], accelerations).ok_or_else(|| ModelError::Singular { model: self.name.clone() })
    }
}

/// Gaussian elimination with row exchange; `None` where a pivot vanishes or a value is not finite.
fn solve_small(rows: &mut [[f64; SMALL + 1]], solution: &mut [f64]) -> Option<()> {
    let n = rows.len();
    for k in 0..n {
        let pivot = (k..n).max_by(|a, b| rows[*a][k].abs().total_cmp(&rows[*b][k].abs()))?;
        rows.swap(k, pivot);
        let head = rows[k];
        for row in &mut rows[k + 1..] {
            let factor = row[k] / head[k];
            for (x, h) in row.iter_mut().zip(&head).skip(k) {
                *x -= factor * h;
            }
        }
    }
    for k in (0..n).rev() {
        let known: f64 = (k + 1..n).map(|j| rows[k][j] * solution[j]).sum();
        solution[k] = (rows[k][SMALL] - known) / rows[k][k];
    }
    solution.iter().all(|x| x.is_finite()).then_some(())
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
