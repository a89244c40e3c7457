//! What a configuration knows about parameters beforehand, laid over what the model knows.

use std::collections::BTreeMap;

use wheelwright_core::config::{ConfigError, nearest};
use wheelwright_core::model::{ParameterMap, RegressorModel};

use crate::config::Constraint;

/// The parameters' freedom: which are free, and within which bounds.
#[derive(Debug, Clone, PartialEq)]
pub struct Freedom {
    /// θ = T z + c.
    pub map: ParameterMap,
    /// Bounds of each θ.
    pub bounds: Vec<(f64, f64)>,
}

/// Lays constraints over a model's own equalities and bounds.
///
/// # Errors
/// [`ConfigError`] naming the key, relative to `[parameters]`.
pub fn freedom(model: &dyn RegressorModel, constraints: &BTreeMap<String, Constraint>) -> Result<Freedom, ConfigError> {
    let mut freedom = Freedom { map: model.map(), bounds: model.parameters().iter().map(|p| p.bounds).collect() };
    for (name, constraint) in constraints {
        let index = position(model, name).map_err(|message| ConfigError::new(name, message))?;
        apply(&mut freedom, model, index, constraint).map_err(|e| e.inside(name))?;
    }
    Ok(freedom)
}

fn apply(freedom: &mut Freedom, model: &dyn RegressorModel, index: usize, constraint: &Constraint) -> Result<(), ConfigError> {
    let (low, high) = (constraint.min.unwrap_or(freedom.bounds[index].0), constraint.max.unwrap_or(freedom.bounds[index].1));
    if low > high || low.is_nan() || high.is_nan() {
        return Err(ConfigError::new("min", format!("the lower bound {low} is above the upper bound {high}")));
    }
    freedom.bounds[index] = (low, high);
    let impose = |map: &mut ParameterMap, key: &str, equality: &[(usize, f64)], value: f64| {
        map.impose(equality, value).map_err(|e| ConfigError::new(key, e.to_string()))
    };
    match (constraint.fixed, &constraint.tied_to) {
        (Some(_), Some(_)) => Err(ConfigError::new("tied_to", "a parameter is either fixed or tied, not both")),
        (Some(value), None) if !value.is_finite() => Err(ConfigError::new("fixed", format!("{value} is not a finite number"))),
        (Some(value), None) => impose(&mut freedom.map, "fixed", &[(index, 1.0)], value),
        (None, Some(other)) => {
            let other = position(model, other).map_err(|message| ConfigError::new("tied_to", message))?;
            let (factor, offset) = (constraint.factor.unwrap_or(1.0), constraint.offset.unwrap_or(0.0));
            impose(&mut freedom.map, "tied_to", &[(index, 1.0), (other, -factor)], offset)
        }
        (None, None) if constraint.factor.is_some() || constraint.offset.is_some() => {
            Err(ConfigError::new("tied_to", "is missing: factor and offset describe a tie"))
        }
        (None, None) => Ok(()),
    }
}

fn position(model: &dyn RegressorModel, name: &str) -> Result<usize, String> {
    let names = || model.parameters().iter().map(|p| p.name.as_str());
    names().position(|known| known == name).ok_or_else(|| {
        let meant = nearest(name, names()).map(|n| format!("; did you mean `{n}`?")).unwrap_or_default();
        format!("model `{}` has no parameter `{name}`{meant} It has {}", model.name(), names().collect::<Vec<_>>().join(", "))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prelude::*;

    fn of(text: &str) -> Result<Freedom, ConfigError> {
        let constraints: BTreeMap<String, Constraint> = toml::from_str(text).unwrap();
        freedom(&*VwPdConfig::default().build().unwrap(), &constraints)
    }

    #[test]
    fn fixed_tied_and_bounded_parameters_act_together() {
        let freedom = of("theta3 = { fixed = 0.0 }\ntheta6 = { tied_to = \"theta4\" }\ntheta5 = { min = -0.1, max = 0.1 }").unwrap();
        assert_eq!(freedom.map.free.len(), 4);
        let theta = freedom.map.theta(&[0.1, 0.2, 0.9, 0.4]);
        assert_eq!((theta[2], theta[3]), (0.0, theta[5]));
        assert_eq!(freedom.bounds[4], (-0.1, 0.1));
    }

    #[test]
    fn impossible_constraints_name_their_key() {
        for (text, key) in [
            ("theta7 = { fixed = 0.0 }", "theta7"),
            ("theta1 = { min = 1.0, max = 0.0 }", "theta1.min"),
            ("theta1 = { tied_to = \"thta2\" }", "theta1.tied_to"),
            ("theta1 = { fixed = 1.0, tied_to = \"theta2\" }", "theta1.tied_to"),
            ("theta1 = { factor = 2.0 }", "theta1.tied_to"),
            ("theta1 = { tied_to = \"theta1\" }", "theta1.tied_to"),
        ] {
            assert_eq!(of(text).unwrap_err().path, key, "{text}");
        }
    }
}
