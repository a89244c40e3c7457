//! What stands in an equation, found by trying: a model computes its regressors, it does not name them, but axes need
//! names and units. Doubling and negating one channel at a time tells whether a term is a constant times powers of the
//! channels, and which.

use wheelwright_core::model::{RegressorModel, Sample};

use crate::report::number;

/// Largest power looked for.
const MAX_POWER: i32 = 3;
/// Relative deviation at which a term no longer counts as a product of powers.
const TOLERANCE: f64 = 1e-9;

/// A term as printed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Term {
    /// Such as `v·omega` or `−omega²`.
    pub label: String,
    /// Its unit; `None` if the term is no product of channels.
    pub unit: Option<String>,
}

/// The terms of one equation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Equation {
    /// y.
    pub response: Term,
    /// One column of Φ a parameter; `None` where it is zero.
    pub columns: Vec<Option<Term>>,
}

impl Equation {
    /// The same equation integrated over time.
    pub fn integrate(&mut self) {
        for term in self.columns.iter_mut().flatten().chain([&mut self.response]) {
            term.label = format!("∫ {} dt", term.label);
            term.unit = term.unit.as_ref().map(|unit| if unit == "1" { "s".to_owned() } else { format!("({unit})·s") });
        }
    }
}

/// A quantity that regressors are made of.
struct Variable {
    name: String,
    unit: String,
}

/// Finds the terms of all equations of a model.
pub fn equations(model: &dyn RegressorModel) -> Vec<Equation> {
    let variables = variables(model);
    let base: Vec<f64> = (0..variables.len()).map(|i| 0.7 + 0.13 * i as f64).collect();
    let at_base = evaluate(model, &base);
    let probes: Vec<[Vec<f64>; 2]> = (0..variables.len())
        .map(|i| {
            [2.0, -1.0].map(|factor| {
                let mut point = base.clone();
                point[i] *= factor;
                evaluate(model, &point)
            })
        })
        .collect();
    let parameters = model.parameters();
    let (equations, p) = (model.equations(), parameters.len());
    // `evaluate` gives all of Φ and then y.
    let term = |index: usize| -> Option<Term> {
        let value = at_base[index];
        let responses: Vec<(f64, f64)> = probes.iter().map(|[double, minus]| (double[index] / value, minus[index] / value)).collect();
        monomial(&variables, &base, value, &responses)
    };
    let is_zero = |index: usize| at_base[index] == 0.0 && probes.iter().all(|p| p.iter().all(|values| values[index] == 0.0));
    let unknown = |label: String| Term { label, unit: None };
    (0..equations)
        .map(|e| Equation {
            response: term(equations * p + e).unwrap_or_else(|| unknown(format!("response of equation {}", e + 1))),
            columns: (0..p)
                .map(|j| e * p + j)
                .map(|i| (!is_zero(i)).then(|| term(i).unwrap_or_else(|| unknown(format!("regressor of {}", parameters[i % p].name)))))
                .collect(),
        })
        .collect()
}

/// Inputs, outputs and derivatives of the outputs.
fn variables(model: &dyn RegressorModel) -> Vec<Variable> {
    let plain = model.inputs().iter().chain(model.outputs()).map(|c| Variable { name: c.name.to_string(), unit: c.unit.to_string() });
    let rates = model.outputs().iter().map(|c| Variable { name: format!("d{}/dt", c.name), unit: per_second(&c.unit) });
    plain.chain(rates).collect()
}

/// Unit of a derivative: m/s becomes m/s².
pub fn per_second(unit: &str) -> String {
    match unit.strip_suffix("/s") {
        Some(head) => format!("{head}/s²"),
        None if unit.is_empty() => String::new(),
        None => format!("{unit}/s"),
    }
}

fn evaluate(model: &dyn RegressorModel, point: &[f64]) -> Vec<f64> {
    let (inputs, outputs) = (model.inputs().len(), model.outputs().len());
    let (equations, parameters) = (model.equations(), model.parameters().len());
    let mut phi = vec![0.0; equations * parameters];
    let mut y = vec![0.0; equations];
    let sample = Sample {
        inputs: &point[..inputs],
        outputs: &point[inputs..inputs + outputs],
        accelerations: &point[inputs + outputs..inputs + 2 * outputs],
    };
    model.regressor(sample, &mut phi, &mut y);
    phi.extend(y);
    phi
}

/// The product of powers that explains how a term answers to doubling and negating each variable.
fn monomial(variables: &[Variable], base: &[f64], value: f64, responses: &[(f64, f64)]) -> Option<Term> {
    let (mut label, mut units) = (Vec::new(), Vec::new());
    let mut product = 1.0;
    for ((variable, x), (double, minus)) in variables.iter().zip(base).zip(responses) {
        let power = (-MAX_POWER..=MAX_POWER).find(|k| (double - 2f64.powi(*k)).abs() <= TOLERANCE * 2f64.powi(*k))?;
        if (minus - (-1f64).powi(power)).abs() > TOLERANCE {
            return None;
        }
        product *= x.powi(power);
        if power != 0 {
            label.push(raised(&variable.name, power));
            units.push(unit_raised(&variable.unit, power));
        }
    }
    let factor = value / product;
    let (sign, size) = (if factor < 0.0 { "−" } else { "" }, factor.abs());
    if (size - 1.0).abs() > TOLERANCE || label.is_empty() {
        label.insert(0, number::significant(size, 4));
    }
    if units.len() > 1 {
        units.iter_mut().filter(|u| u.contains('/') && !u.starts_with('(')).for_each(|u| *u = format!("({u})"));
    }
    let unit = if units.iter().any(String::is_empty) { None } else { Some(units.join("·")) };
    Some(Term { label: format!("{sign}{}", label.join("·")), unit: unit.map(|u| if u.is_empty() { "1".to_owned() } else { u }) })
}

fn raised(name: &str, power: i32) -> String {
    match power {
        1 => name.to_owned(),
        _ if name.contains('/') => format!("({name}){}", superscript(power)),
        _ => format!("{name}{}", superscript(power)),
    }
}

fn unit_raised(unit: &str, power: i32) -> String {
    match power {
        1 => unit.to_owned(),
        _ if unit.is_empty() => String::new(),
        _ => format!("({unit}){}", superscript(power)),
    }
}

fn superscript(power: i32) -> String {
    power.to_string().replace('-', "⁻").replace('1', "¹").replace('2', "²").replace('3', "³")
}
