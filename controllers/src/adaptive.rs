//! `type = "adaptive"`: inverse dynamics whose parameters follow the velocity errors.

use serde::{Deserialize, Serialize};
use wheelwright_core::Channel;
use wheelwright_core::channel::{OMEGA_REF, V_REF};
use wheelwright_core::controller::{Concern, ControlError, Controller, ControllerConfig, Observation, Plan, StepState, Subject};

use crate::adaptation::{Adaptation, Gamma, Projection, Settings};
use crate::kinematic::yes;
use crate::law::{Gains, Law, Sigma};
use crate::saturation::saturate;
use crate::stability::{Loop, limit_concerns};

/// Longest time over which one rate of adaptation is held, in control periods: a robot that was silent for long has not
/// been learning.
const LONGEST_HOLD: f64 = 5.0;

/// Configuration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AdaptiveConfig {
    /// k1 \[1/s\], k2 \[1/m²\], k3 \[1/s\] of the kinematic law.
    pub k: [f64; 3],
    /// k_v \[1/s\].
    pub kv: f64,
    /// k_ω \[1/s\].
    pub kw: f64,
    /// Which derivative enters σ. Default `exact`.
    #[serde(default)]
    pub sigma: Sigma,
    /// Keeps commands within the robot's limits by slowing both velocities alike, so that the path stays, and holds the
    /// adaptation from winding up meanwhile. Default true.
    #[serde(default = "yes")]
    pub saturation: bool,
    /// γ, one for all parameters, one each, or `{ time = .. }`, the time constant \[s\] of each.
    pub gamma: Gamma,
    /// Parameters that keep their value, by name.
    #[serde(default)]
    pub frozen: Vec<String>,
    /// Time from which on parameters are adapted \[s\]. Default 0.
    #[serde(default)]
    pub start: f64,
    /// σ-modification: rate at which parameters are pulled back to where they started \[1/s\]. Default 0.
    #[serde(default)]
    pub leak: f64,
    /// Standard deviations of the noise on measured v \[m/s\] and ω \[rad/s\]. The drift that it gives the parameters is taken out.
    /// Default none.
    #[serde(default)]
    pub noise: [f64; 2],
    /// Bounds of the parameters; none by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub projection: Option<Projection>,
}

#[typetag::serde(name = "adaptive")]
impl ControllerConfig for AdaptiveConfig {
    fn about(&self) -> String {
        "inverse dynamics with parameters adapted to the velocity errors (3.21), projected and anti-windup".to_owned()
    }

    fn build(&self, subject: &Subject) -> Result<Box<dyn Controller>, ControlError> {
        let (law, adaptation) = self.parts(subject)?;
        Ok(Box::new(Model::new(law, Some(adaptation), subject, self.saturation)))
    }
}

impl AdaptiveConfig {
    /// The law and the adaptation, for whoever integrates them.
    ///
    /// # Errors
    /// As [`ControllerConfig::build`].
    pub fn parts(&self, subject: &Subject) -> Result<(Law, Adaptation), ControlError> {
        let law = Law::new(subject, Gains::new(self.k, self.kv, self.kw, self.sigma)?)?;
        if !law.is_direct() {
            let reason = "adaptation needs a model whose equations have their inputs alone on the right side".to_owned();
            return Err(ControlError::Model { model: subject.model.name().to_owned(), reason });
        }
        let settings = Settings {
            gamma: self.gamma.clone(),
            frozen: self.frozen.clone(),
            start: self.start,
            leak: self.leak,
            projection: self.projection.clone(),
            noise: self.noise,
        };
        let adaptation = Adaptation::new(&settings, &law, subject)?;
        Ok((law, adaptation))
    }
}

/// The controller of both configurations that know a model.
#[derive(Debug)]
pub(crate) struct Model {
    law: Law,
    adaptation: Option<Adaptation>,
    theta: Vec<f64>,
    names: Vec<String>,
    subject: Subject,
    saturation: bool,
    /// Where v_ref and omega_ref stand among the inputs.
    places: [Option<usize>; 2],
    /// Time of the last step, from which on the adaptation's rate is held.
    last: Option<f64>,
    state: StepState,
}

impl Model {
    pub(crate) fn new(law: Law, adaptation: Option<Adaptation>, subject: &Subject, saturation: bool) -> Self {
        let inputs = law.model().inputs();
        let places = [V_REF, OMEGA_REF].map(|wanted| inputs.iter().position(|c| c.name == wanted.name));
        let names = law.model().parameters().iter().map(|p| p.name.clone()).collect();
        let (theta, subject) = (subject.theta.clone(), subject.clone());
        Self { law, adaptation, theta, names, subject, saturation, places, last: None, state: StepState::default() }
    }

    /// Moves the parameters over the time since the last step, by the rate found there.
    fn learn(&mut self, t: f64) {
        let elapsed = self.last.map_or(0.0, |last| (t - last).min(LONGEST_HOLD * self.subject.period));
        if let Some(adaptation) = &self.adaptation
            && self.state.adapting
        {
            adaptation.advance(&mut self.theta, elapsed);
        }
        self.last = Some(t);
    }
}

impl Controller for Model {
    fn inputs(&self) -> &[Channel] {
        self.law.model().inputs()
    }

    fn outputs(&self) -> &[Channel] {
        self.law.model().outputs()
    }

    fn step(&mut self, now: &Observation<'_>, command: &mut [f64]) {
        self.learn(now.t);
        self.law.command(&now.reference, now.pose, now.outputs, &self.theta, command);
        let share = if self.saturation { saturate(&self.subject.envelope, self.places, command) } else { 1.0 };
        let adapting = self.adaptation.as_ref().is_some_and(|a| a.runs(now.t));
        if let Some(adaptation) = &mut self.adaptation
            && adapting
        {
            let at = [now.reference.v, now.reference.omega];
            adaptation.rate(&mut self.law, &self.theta, at, (share < 1.0).then_some(&*command));
        }
        self.state = StepState { share, adapting };
    }

    fn parameters(&self) -> &[String] {
        &self.names
    }

    fn theta(&self) -> &[f64] {
        &self.theta
    }

    fn state(&self) -> StepState {
        self.state
    }

    fn assess(&self, plan: &Plan<'_>) -> Vec<Concern> {
        let mut concerns = limit_concerns(plan, &self.subject.envelope);
        let sampled = Loop { law: &self.law, subject: &self.subject, theta: &self.theta };
        concerns.extend(sampled.stability_concerns(self.adaptation.as_ref()));
        if let Some(adaptation) = &self.adaptation {
            concerns.extend(sampled.drift_concerns(adaptation, plan));
        }
        concerns
    }
}
