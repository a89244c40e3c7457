//! Each velocity lags behind its reference: τ x' + x = k u, linear in τ and k as x' τ - u k = -x.

use serde::{Deserialize, Serialize};
use wheelwright_core::channel::{Channel, OMEGA, OMEGA_REF, V, V_REF};
use wheelwright_core::model::{ModelConfig, ModelError, Parameter, ParameterMap, RegressorModel, Sample};

/// `[model] type = "lag"`.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LagConfig {
    /// Fixes both gains at one, for a base whose controllers leave no steady error.
    pub unit_gain: bool,
}

#[typetag::serde(name = "lag")]
impl ModelConfig for LagConfig {
    fn about(&self) -> String {
        "a time constant and a gain for each velocity, from the example plugin".to_owned()
    }

    fn build(&self) -> Result<Box<dyn RegressorModel>, ModelError> {
        let time_constant = |name, excitation| Parameter::new(name, "s", "time constant", excitation).within(0.0, f64::INFINITY);
        let gain = |name, excitation| Parameter::new(name, "1", "velocity reached per reference", excitation);
        Ok(Box::new(Lag {
            unit_gain: self.unit_gain,
            parameters: [
                time_constant("tau_v", "changes of v_ref"),
                gain("k_v", "driving at different v_ref"),
                time_constant("tau_omega", "changes of omega_ref"),
                gain("k_omega", "turning at different omega_ref"),
            ],
        }))
    }
}

#[derive(Debug)]
struct Lag {
    unit_gain: bool,
    parameters: [Parameter; 4],
}

impl RegressorModel for Lag {
    fn name(&self) -> &str {
        "lag"
    }

    fn inputs(&self) -> &[Channel] {
        const { &[V_REF, OMEGA_REF] }
    }

    fn outputs(&self) -> &[Channel] {
        const { &[V, OMEGA] }
    }

    fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    fn regressor(&self, sample: Sample<'_>, phi: &mut [f64], y: &mut [f64]) {
        phi.fill(0.0);
        for i in 0..2 {
            phi[4 * i + 2 * i] = sample.accelerations[i];
            phi[4 * i + 2 * i + 1] = -sample.inputs[i];
            y[i] = -sample.outputs[i];
        }
    }

    fn map(&self) -> ParameterMap {
        if !self.unit_gain {
            return ParameterMap::identity(&self.parameters);
        }
        let matrix = vec![1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0];
        ParameterMap { free: vec!["tau_v".to_owned(), "tau_omega".to_owned()], matrix, offset: vec![0.0, 1.0, 0.0, 1.0] }
    }
}
