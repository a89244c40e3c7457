//! `vw-pd`: a robot whose firmware closes PD loops on forward and angular velocity (Laut 2011, appendix A.3), such as
//! the Pioneer 3-DX.

use serde::{Deserialize, Serialize};
use wheelwright_core::model::{ModelConfig, ModelError, RegressorModel};

use crate::pd::PdModel;
use crate::physics::{PhysicalConstants, VwGains, vw_pd_theta};

/// Configuration of `vw-pd`: no key is needed; `physical` and `gains` together give θ from the robot's constants.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VwPdConfig {
    /// Body, wheels and motors.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub physical: Option<PhysicalConstants>,
    /// Controller gains.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gains: Option<VwGains>,
}

impl VwPdConfig {
    /// θ1..θ6 of the physical constants; `None` without them.
    ///
    /// # Errors
    /// [`ModelError::Config`] if one of `physical` and `gains` is absent or a constant is impossible.
    pub fn theta(&self) -> Result<Option<[f64; 6]>, ModelError> {
        let Some((robot, gains)) = both(self.physical.as_ref(), self.gains.as_ref())? else { return Ok(None) };
        robot.check()?;
        gains.check()?;
        Ok(Some(vw_pd_theta(robot, gains)))
    }
}

/// Constants and gains make θ only together.
pub(crate) fn both<'a, G>(
    physical: Option<&'a PhysicalConstants>,
    gains: Option<&'a G>,
) -> Result<Option<(&'a PhysicalConstants, &'a G)>, ModelError> {
    let missing = |key: &str, other: &str| {
        Err(ModelError::Config { key: key.to_owned(), reason: format!("is missing: theta follows from `{other}` and `{key}` together") })
    };
    match (physical, gains) {
        (Some(physical), Some(gains)) => Ok(Some((physical, gains))),
        (None, None) => Ok(None),
        (Some(_), None) => missing("gains", "physical"),
        (None, Some(_)) => missing("physical", "gains"),
    }
}

#[typetag::serde(name = "vw-pd")]
impl ModelConfig for VwPdConfig {
    fn about(&self) -> String {
        "robot under PD control of forward and angular velocity: v_ref, omega_ref to v, omega, six parameters".to_owned()
    }

    fn build(&self) -> Result<Box<dyn RegressorModel>, ModelError> {
        self.theta()?;
        Ok(Box::new(PdModel::new("vw-pd")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wheelwright_core::config::tagged;

    fn config(text: &str) -> Result<Box<dyn ModelConfig>, String> {
        tagged(toml::from_str(text).unwrap()).map_err(|e| e.to_string())
    }

    #[test]
    fn needs_no_key() {
        let model = config("type = 'vw-pd'").unwrap().build().unwrap();
        assert_eq!((model.name(), model.equations(), model.parameters().len()), ("vw-pd", 2, 6));
        assert_eq!(model.map().free.len(), 6);
    }

    #[test]
    fn constants_and_gains_belong_together() {
        let half = config("type = 'vw-pd'\ngains = { kpt = 30.0, kdt = 4.0, kpr = 7.0, kdr = 1.1 }").unwrap();
        assert_eq!(half.build().unwrap_err().to_string(), "`physical`: is missing: theta follows from `gains` and `physical` together");
    }

    #[test]
    fn unknown_constants_are_refused_with_path_and_suggestion() {
        let error = config("type = 'vw-pd'\n[physical]\nmas = 9.0").unwrap_err();
        assert!(error.starts_with("`physical.mas`: unknown field `mas`") && error.ends_with("did you mean `mass`?"), "{error}");
    }
}
