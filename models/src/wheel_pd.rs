//! `wheel-pd`: a robot whose firmware closes a PD loop on each wheel's speed (Laut 2011, section 2.2), such as the
//! Khepera III.

use serde::{Deserialize, Serialize};
use wheelwright_core::model::{ModelConfig, ModelError, RegressorModel};

use crate::pd::PdModel;
use crate::physics::{PhysicalConstants, WheelGains, positive, wheel_pd_theta};
use crate::vw_pd::both;

/// Configuration of `wheel-pd`: no key is needed; `physical` and `gains` together give θ from the robot's constants.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WheelPdConfig {
    /// Imposes what the physics of this controller demands, θ4 = θ6 and θ3 = (d²/4) θ5, so that four unknowns are left.
    #[serde(default)]
    pub constrained: bool,
    /// d: distance between the wheels as the firmware believes it \[m\]; needed with `constrained`, unless `physical` has it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub track_width: Option<f64>,
    /// Body, wheels and motors.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub physical: Option<PhysicalConstants>,
    /// Controller gains.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gains: Option<WheelGains>,
}

impl WheelPdConfig {
    /// θ1..θ6 of the physical constants; `None` without them.
    ///
    /// # Errors
    /// [`ModelError::Config`] if one of `physical` and `gains` is absent or a constant is impossible.
    pub fn theta(&self) -> Result<Option<[f64; 6]>, ModelError> {
        let Some((robot, gains)) = both(self.physical.as_ref(), self.gains.as_ref())? else { return Ok(None) };
        robot.check()?;
        gains.check()?;
        Ok(Some(wheel_pd_theta(robot, gains)))
    }

    /// d of the constraint.
    fn constraint_track(&self) -> Result<f64, ModelError> {
        let track = self.track_width.or(self.physical.as_ref().map(|p| p.track_width));
        track.ok_or_else(|| ModelError::Config {
            key: "track_width".to_owned(),
            reason: "is missing: `constrained = true` needs the distance between the wheels [m]".to_owned(),
        })
    }
}

#[typetag::serde(name = "wheel-pd")]
impl ModelConfig for WheelPdConfig {
    fn about(&self) -> String {
        "robot under PD control of each wheel's speed: v_ref, omega_ref to v, omega, six parameters (four with `constrained`)".to_owned()
    }

    fn build(&self) -> Result<Box<dyn RegressorModel>, ModelError> {
        self.theta()?;
        if let Some(track) = self.track_width {
            positive("track_width", track)?;
        }
        let model = PdModel::new("wheel-pd");
        Ok(Box::new(if self.constrained { model.with_wheel_constraints(self.constraint_track()?) } else { model }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wheelwright_core::config::tagged;

    fn build(text: &str) -> Result<Box<dyn RegressorModel>, String> {
        let config: Box<dyn ModelConfig> = tagged(toml::from_str(text).unwrap()).map_err(|e| e.to_string())?;
        config.build().map_err(|e| e.to_string())
    }

    #[test]
    fn unconstrained_unless_asked() {
        let model = build("type = 'wheel-pd'\ntrack_width = 0.089").unwrap();
        assert_eq!((model.name(), model.map().free.len()), ("wheel-pd", 6));
    }

    #[test]
    fn constrained_keeps_the_equalities_of_its_own_formulas() {
        let text = "type = 'wheel-pd'\nconstrained = true\n[physical]\nmass = 0.742\nyaw_inertia = 0.0016\ncom_offset = 0.008\ntrack_width = 0.089
            wheel_radius = 0.0205\nwheel_inertia = 4e-5\nwheel_friction = 2e-4\nresistance = 8.0\ntorque_constant = 0.25\nemf_constant = 0.24
            [gains]\nkp = 2.0\nkd = 0.02";
        let mut table: toml::Table = toml::from_str(text).unwrap();
        let model = build(text).unwrap();
        table.remove("type");
        let theta = wheelwright_core::config::plain::<WheelPdConfig>(table).unwrap().theta().unwrap().unwrap();
        let mapped = model.map().theta(&[theta[0], theta[1], theta[3], theta[4]]);
        for (a, b) in mapped.iter().zip(theta) {
            assert!((a - b).abs() < 1e-15, "{mapped:?} {theta:?}");
        }
    }

    #[test]
    fn constraints_need_a_track_width() {
        let error = build("type = 'wheel-pd'\nconstrained = true").unwrap_err();
        assert_eq!(error, "`track_width`: is missing: `constrained = true` needs the distance between the wheels [m]");
        let error = build("type = 'wheel-pd'\nconstrained = true\ntrack_width = -1.0").unwrap_err();
        assert_eq!(error, "`track_width`: must be a number above zero, not -1");
    }
}
