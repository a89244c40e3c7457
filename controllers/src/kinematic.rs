//! The kinematic law (4.8) with its exact derivative, and the controller that commands it as it is.
//!
//! With the position error seen from the robot, e1 ahead and e2 to the left, and the heading error e3,
//!
//! v_k = v_d cos e3 + k1 e1,   ω_k = ω_d + k2 v_d S(e3) e2 + k3 e3,   S(e) = sin e / e                  (4.8)

use serde::{Deserialize, Serialize};
use wheelwright_core::channel::{OMEGA_REF, V_REF};
use wheelwright_core::controller::{Concern, ControlError, Controller, ControllerConfig, Observation, Plan, StepState, Subject};
use wheelwright_core::trajectory::Envelope;
use wheelwright_core::{Channel, Reference};

use crate::saturation::saturate;
use crate::stability::limit_concerns;
use crate::trajectory::wrap;

static INPUTS: [Channel; 2] = [V_REF, OMEGA_REF];

/// Gains of the kinematic law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KinematicGains {
    /// k1 \[1/s\], along the robot.
    pub k1: f64,
    /// k2 \[1/m²\], across it.
    pub k2: f64,
    /// k3 \[1/s\], heading.
    pub k3: f64,
}

/// The velocities that a kinematic law wants, and how they change.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Wanted {
    /// v_k \[m/s\].
    pub v: f64,
    /// ω_k \[rad/s\].
    pub omega: f64,
    /// Derivative of `v` \[m/s²\].
    pub v_dot: f64,
    /// Derivative of `omega` \[rad/s²\].
    pub omega_dot: f64,
}

impl KinematicGains {
    /// Checks a list k1, k2, k3.
    ///
    /// # Errors
    /// [`ControlError::Config`] at `k`.
    pub fn new([k1, k2, k3]: [f64; 3]) -> Result<Self, ControlError> {
        match [k1, k2, k3].iter().find(|k| !(k.is_finite() && **k >= 0.0)) {
            Some(k) => Err(ControlError::config("k", format!("holds k1 [1/s], k2 [1/m2] and k3 [1/s], none of them below zero, not {k}"))),
            None => Ok(Self { k1, k2, k3 }),
        }
    }

    /// The wanted velocities at a pose (x, y, φ) of a robot that moves with (v, ω).
    pub fn wanted(&self, reference: &Reference, pose: [f64; 3], [v, omega]: [f64; 2]) -> Wanted {
        let (sin, cos) = pose[2].sin_cos();
        let (ex, ey) = (reference.x - pose[0], reference.y - pose[1]);
        let (e1, e2, e3) = (ex * cos + ey * sin, -ex * sin + ey * cos, wrap(reference.phi - pose[2]));
        let (sin3, cos3) = e3.sin_cos();
        let (s, slope) = sinc(e3, sin3, cos3);
        let vd = reference.v;
        let e1_dot = vd * cos3 - v + omega * e2;
        let e2_dot = vd * sin3 - omega * e1;
        let e3_dot = reference.omega - omega;
        Wanted {
            v: vd * cos3 + self.k1 * e1,
            omega: reference.omega + self.k2 * vd * s * e2 + self.k3 * e3,
            v_dot: reference.v_dot * cos3 - vd * sin3 * e3_dot + self.k1 * e1_dot,
            omega_dot: reference.omega_dot
                + self.k2 * (reference.v_dot * s * e2 + vd * slope * e3_dot * e2 + vd * s * e2_dot)
                + self.k3 * e3_dot,
        }
    }
}

/// S(e) = sin e/e and its derivative, by their series where the quotient has no digits left.
fn sinc(e: f64, sin: f64, cos: f64) -> (f64, f64) {
    let value = if e.abs() < 1e-4 { 1.0 - e * e / 6.0 } else { sin / e };
    let slope = if e.abs() < 1e-3 { e * (e * e / 30.0 - 1.0 / 3.0) } else { (e * cos - sin) / (e * e) };
    (value, slope)
}

/// `type = "kinematic"`: commands the wanted velocities, as if the robot had no dynamics.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KinematicConfig {
    /// k1 \[1/s\], k2 \[1/m²\], k3 \[1/s\].
    pub k: [f64; 3],
    /// Keeps commands within the robot's limits by slowing both velocities alike, so that the path stays. Default true.
    #[serde(default = "yes")]
    pub saturation: bool,
}

pub(crate) fn yes() -> bool {
    true
}

#[typetag::serde(name = "kinematic")]
impl ControllerConfig for KinematicConfig {
    fn about(&self) -> String {
        "kinematic law (4.8) alone: commands the wanted velocities".to_owned()
    }

    fn build(&self, subject: &Subject) -> Result<Box<dyn Controller>, ControlError> {
        let gains = KinematicGains::new(self.k)?;
        Ok(Box::new(Kinematic { gains, envelope: subject.envelope, saturation: self.saturation, share: 1.0 }))
    }
}

/// The controller.
#[derive(Debug)]
struct Kinematic {
    gains: KinematicGains,
    envelope: Envelope,
    saturation: bool,
    share: f64,
}

impl Controller for Kinematic {
    fn inputs(&self) -> &[Channel] {
        &INPUTS
    }

    fn outputs(&self) -> &[Channel] {
        &[]
    }

    fn step(&mut self, now: &Observation<'_>, command: &mut [f64]) {
        // The velocities only enter the derivatives, which nothing here uses.
        let wanted = self.gains.wanted(&now.reference, now.pose, [0.0; 2]);
        command.copy_from_slice(&[wanted.v, wanted.omega]);
        self.share = if self.saturation { saturate(&self.envelope, [Some(0), Some(1)], command) } else { 1.0 };
    }

    fn state(&self) -> StepState {
        StepState { share: self.share, adapting: false }
    }

    fn assess(&self, plan: &Plan<'_>) -> Vec<Concern> {
        limit_concerns(plan, &self.envelope)
    }
}
