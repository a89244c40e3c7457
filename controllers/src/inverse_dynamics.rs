//! `type = "inverse-dynamics"`: the model's equation at the wanted acceleration is the command; its parameters stay.

use serde::{Deserialize, Serialize};
use wheelwright_core::controller::{ControlError, Controller, ControllerConfig, Subject};

use crate::adaptive::Model;
use crate::kinematic::yes;
use crate::law::{Gains, Law, Sigma};

/// Configuration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InverseDynamicsConfig {
    /// k1 \[1/s\], k2 \[1/m²\], k3 \[1/s\] of the kinematic law.
    pub k: [f64; 3],
    /// k_v \[1/s\].
    pub kv: f64,
    /// k_ω \[1/s\].
    pub kw: f64,
    /// Which derivative enters σ. Default `exact`.
    #[serde(default)]
    pub sigma: Sigma,
    /// Keeps commands within the robot's limits by slowing both velocities alike, so that the path stays. Default true.
    #[serde(default = "yes")]
    pub saturation: bool,
}

#[typetag::serde(name = "inverse-dynamics")]
impl ControllerConfig for InverseDynamicsConfig {
    fn about(&self) -> String {
        "inverse dynamics through the model's equation, parameters fixed (3.8-3.13)".to_owned()
    }

    fn build(&self, subject: &Subject) -> Result<Box<dyn Controller>, ControlError> {
        let law = Law::new(subject, Gains::new(self.k, self.kv, self.kw, self.sigma)?)?;
        Ok(Box::new(Model::new(law, None, subject, self.saturation)))
    }
}
