//! When an unattended identification is good enough: the wanted widths of the intervals, and what is still missing.

use std::collections::BTreeMap;

use serde::Deserialize;
use wheelwright_core::config::ConfigError;
use wheelwright_core::identifiability::Identifiability;
use wheelwright_core::identification::{Estimate, Identification};
use wheelwright_core::model::ParameterMap;

/// Share of its plausible size that stands for a parameter near zero: below it the parameter hardly matters.
const NEAR_ZERO: f64 = 0.2;

/// `[autonomous]`
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WantedSection {
    /// Wanted width of every 95 % interval, from end to end, as a share of the value. A parameter near zero is held against a
    /// fifth of its plausible size instead.
    #[serde(default = "tenth")]
    pub width: f64,
    /// The same for single parameters, by name.
    #[serde(default)]
    pub widths: BTreeMap<String, f64>,
    /// Wanted width in the parameter's own unit, by name; stands before the relative one.
    #[serde(default)]
    pub absolute: BTreeMap<String, f64>,
    /// Longest time of driving \[s\], all rounds together.
    #[serde(default = "longest")]
    pub longest: f64,
    /// Time driven between two looks at the intervals \[s\].
    #[serde(default = "round")]
    pub round: f64,
}

fn tenth() -> f64 {
    0.1
}

fn longest() -> f64 {
    600.0
}

fn round() -> f64 {
    30.0
}

/// One parameter that is not known well enough.
#[derive(Debug, Clone, PartialEq)]
pub struct Missing {
    /// Name.
    pub name: String,
    /// Width of its interval; `None` without an interval.
    pub width: Option<f64>,
    /// Width wanted.
    pub wanted: f64,
    /// Unit.
    pub unit: String,
}

impl Missing {
    /// The gap in words.
    pub fn statement(&self) -> String {
        let unit = if self.unit == "1" { String::new() } else { format!(" {}", self.unit) };
        match self.width {
            Some(width) => format!("{} is known to a width of {width:.2e}{unit}, wanted are {:.2e}{unit}", self.name, self.wanted),
            None => format!("{} has no interval, wanted is a width of {:.2e}{unit}", self.name, self.wanted),
        }
    }
}

impl WantedSection {
    /// Values must be positive, and names those of parameters.
    ///
    /// # Errors
    /// [`ConfigError`] at the key, relative to the section.
    pub fn check(&self, parameters: &[String]) -> Result<(), ConfigError> {
        let single = [("width", self.width), ("longest", self.longest), ("round", self.round)];
        let named = [("widths", &self.widths), ("absolute", &self.absolute)];
        let all = single.into_iter().map(|(k, v)| (k.to_owned(), v));
        let each = named.into_iter().flat_map(|(table, map)| map.iter().map(move |(k, v)| (format!("{table}.{k}"), *v)));
        if let Some((key, value)) = all.chain(each).find(|(_, v)| !(v.is_finite() && *v > 0.0)) {
            return Err(ConfigError::new(key, format!("must be a positive number, not {value}")));
        }
        let names = named.into_iter().flat_map(|(table, map)| map.keys().map(move |k| (table, k)));
        match names.into_iter().find(|(_, name)| !parameters.contains(name)) {
            Some((table, name)) => {
                Err(ConfigError::new(format!("{table}.{name}"), wheelwright_core::config::unknown_name(name, parameters)))
            }
            None => Ok(()),
        }
    }

    /// Parameters whose intervals are wider than wanted; those that a constraint fixes have none and are passed over.
    pub fn missing(&self, found: &Identification, judged: Option<&Identifiability>, fixed: &[bool]) -> Vec<Missing> {
        let each = found.estimates.iter().enumerate().filter(|(i, _)| !fixed.get(*i).copied().unwrap_or(false));
        each.filter_map(|(i, estimate)| {
            let plausible = judged.and_then(|j| j.parameters.get(i)).map_or(0.0, |j| j.plausible.abs());
            self.gap(estimate, plausible)
        })
        .collect()
    }

    /// Wanted width of the interval of a parameter, in its unit, from its value and its plausible size.
    pub fn wanted(&self, name: &str, value: f64, plausible: f64) -> f64 {
        let share = self.widths.get(name).copied().unwrap_or(self.width);
        let size = value.abs().max(if plausible.is_finite() { NEAR_ZERO * plausible } else { 0.0 });
        self.absolute.get(name).copied().unwrap_or(share * size)
    }

    fn gap(&self, estimate: &Estimate, plausible: f64) -> Option<Missing> {
        let parameter = &estimate.parameter;
        let wanted = self.wanted(&parameter.name, estimate.value, plausible);
        let width = estimate.ci95.map(|(low, high)| high - low);
        let enough = width.is_some_and(|width| width <= wanted);
        (!enough).then(|| Missing { name: parameter.name.clone(), width, wanted, unit: parameter.unit.clone() })
    }
}

/// Which parameters a constraint gives, so that they have no interval.
pub fn fixed(map: &ParameterMap) -> Vec<bool> {
    let free = map.free.len();
    (0..map.offset.len()).map(|p| map.matrix[p * free..(p + 1) * free].iter().all(|t| *t == 0.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use wheelwright_core::model::Parameter;

    fn wanted(text: &str) -> WantedSection {
        wheelwright_core::config::plain(text.parse().unwrap()).unwrap()
    }

    fn estimate(name: &str, value: f64, half: f64) -> Estimate {
        let parameter = Parameter::new(name, "s", "", "");
        Estimate { parameter, value, std: Some(half / 1.96), ci95: Some((value - half, value + half)), at_bound: false }
    }

    #[test]
    fn widths_are_shares_of_the_value_unless_said_otherwise() {
        let section = wanted("width = 0.1\nwidths = { theta2 = 0.5 }\nabsolute = { theta3 = 0.01 }");
        assert_eq!(section.gap(&estimate("theta1", 0.2, 0.009), 0.0), None);
        let gap = section.gap(&estimate("theta1", 0.2, 0.011), 0.0).unwrap();
        assert!((gap.wanted - 0.02).abs() < 1e-12 && (gap.width.unwrap() - 0.022).abs() < 1e-12);
        assert_eq!(section.gap(&estimate("theta2", 0.2, 0.04), 0.0), None);
        assert_eq!(section.gap(&estimate("theta3", 0.0, 0.0049), 0.0), None);
        assert!(section.gap(&estimate("theta3", 0.0, 0.0051), 0.0).is_some());
    }

    #[test]
    fn a_parameter_near_zero_is_held_against_its_plausible_size() {
        let section = wanted("width = 0.1");
        assert_eq!(section.gap(&estimate("theta3", 1e-5, 0.0009), 0.1), None);
        assert!(section.gap(&estimate("theta3", 1e-5, 0.0011), 0.1).is_some());
    }

    #[test]
    fn impossible_wishes_name_their_key() {
        let known = ["theta1".to_owned()];
        assert!(wanted("width = -1").check(&known).unwrap_err().to_string().starts_with("`width`"));
        let message = wanted("widths = { thet1 = 0.1 }").check(&known).unwrap_err().to_string();
        assert!(message.contains("`widths.thet1`") && message.contains("theta1"), "{message}");
    }
}
