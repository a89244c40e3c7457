//! Inverse dynamics (3.8)–(3.13): the command that makes the velocity errors fade, for any model.
//!
//! With the error ν̃ of the wanted velocities, σ = ν_k' + K ν̃ is the acceleration to ask for, and the model's equation at σ
//! gives the command.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use wheelwright_core::controller::{ControlError, Subject};
use wheelwright_core::model::{Sample, solve_inputs};
use wheelwright_core::{Reference, RegressorModel};

use crate::body::Body;
use crate::kinematic::KinematicGains;

/// Which derivative of the wanted velocities enters σ.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sigma {
    /// The exact one, ν_k'.
    #[default]
    Exact,
    /// That of the trajectory, (v_d', α_d), as the thesis' Table 4.1 needs.
    DesiredAccel,
    /// None at all.
    None,
}

/// Gains of the inverse dynamics.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gains {
    /// Of the kinematic law.
    pub kinematic: KinematicGains,
    /// K: k_v and k_ω \[1/s\].
    pub velocity: [f64; 2],
    /// What enters σ.
    pub sigma: Sigma,
}

impl Gains {
    /// Checks gains as a configuration gives them.
    ///
    /// # Errors
    /// [`ControlError::Config`] naming the key.
    pub fn new(k: [f64; 3], kv: f64, kw: f64, sigma: Sigma) -> Result<Self, ControlError> {
        for (key, value) in [("kv", kv), ("kw", kw)] {
            if !(value.is_finite() && value > 0.0) {
                return Err(ControlError::config(key, format!("must be a positive number [1/s], not {value}")));
            }
        }
        Ok(Self { kinematic: KinematicGains::new(k)?, velocity: [kv, kw], sigma })
    }

    /// How fast each velocity error is driven to zero by the whole loop \[1/s\]: k1 + k_v and k3 + k_ω, or K alone where σ
    /// does not contain the derivative of the kinematic law.
    pub fn rates(&self) -> [f64; 2] {
        let [kv, kw] = self.velocity;
        match self.sigma {
            Sigma::Exact => [self.kinematic.k1 + kv, self.kinematic.k3 + kw],
            Sigma::DesiredAccel | Sigma::None => [kv, kw],
        }
    }
}

/// The law at work: a model, gains and room for the model's rows.
#[derive(Debug, Clone)]
pub struct Law {
    model: Arc<dyn RegressorModel>,
    body: Body,
    gains: Gains,
    /// True where the model's right side is its input, so that Φθ is the command.
    direct: bool,
    phi: Vec<f64>,
    y: Vec<f64>,
    idle: Vec<f64>,
    /// Error of the outputs at the last evaluation.
    error: [f64; 2],
}

impl Law {
    /// The law for a robot.
    ///
    /// # Errors
    /// [`ControlError`] if the model cannot be inverted or does not tell how the body moves.
    pub fn new(subject: &Subject, gains: Gains) -> Result<Self, ControlError> {
        let model = Arc::clone(&subject.model);
        let body = Body::of(&*model, &subject.envelope)?;
        let (equations, parameters, inputs) = (model.equations(), model.parameters().len(), model.inputs().len());
        if subject.theta.len() != parameters {
            let reason = format!("{} parameter values were given, it has {parameters}", subject.theta.len());
            return Err(ControlError::Model { model: model.name().to_owned(), reason });
        }
        let mut law = Self {
            body,
            gains,
            direct: false,
            phi: vec![0.0; equations * parameters],
            y: vec![0.0; equations],
            idle: vec![0.0; inputs],
            error: [0.0; 2],
            model,
        };
        law.direct = law.input_is_the_right_side();
        let outputs = law.body.to_outputs([0.1, 0.1]);
        solve_inputs(&*law.model, &subject.theta, &outputs, &outputs, &mut vec![0.0; inputs])?;
        Ok(law)
    }

    /// Whether y is the input and Φ does not depend on it, by trying: that decides how the command is found, and adaptation
    /// needs it.
    fn input_is_the_right_side(&mut self) -> bool {
        if self.model.equations() != self.idle.len() {
            return false;
        }
        let outputs = self.body.to_outputs([0.3, -0.7]);
        let mut rows = |inputs: &[f64]| {
            self.model.regressor(Sample { inputs, outputs: &outputs, accelerations: &[0.2, 0.5] }, &mut self.phi, &mut self.y);
            (self.phi.clone(), self.y.clone())
        };
        let n = self.idle.len();
        let (phi, y) = rows(&vec![0.0; n]);
        let units = (0..n).all(|j| {
            let unit: Vec<f64> = (0..n).map(|i| f64::from(u8::from(i == j))).collect();
            rows(&unit) == (phi.clone(), unit)
        });
        units && y.iter().all(|v| *v == 0.0)
    }

    /// Whether Φθ is the command, which adaptation needs.
    pub fn is_direct(&self) -> bool {
        self.direct
    }

    /// The model.
    pub fn model(&self) -> &dyn RegressorModel {
        &*self.model
    }

    /// How outputs and body depend on each other.
    pub fn body(&self) -> &Body {
        &self.body
    }

    /// The gains.
    pub fn gains(&self) -> &Gains {
        &self.gains
    }

    /// Writes the command at a pose with measured outputs. Φ and the outputs' error stay for [`gradient`](Self::gradient).
    pub fn command(&mut self, reference: &Reference, pose: [f64; 3], outputs: &[f64], theta: &[f64], command: &mut [f64]) {
        let body = self.body.to_body(outputs);
        let wanted = self.gains.kinematic.wanted(reference, pose, body);
        let error = [wanted.v - body[0], wanted.omega - body[1]];
        let feed = match self.gains.sigma {
            Sigma::Exact => [wanted.v_dot, wanted.omega_dot],
            Sigma::DesiredAccel => [reference.v_dot, reference.omega_dot],
            Sigma::None => [0.0; 2],
        };
        let [kv, kw] = self.gains.velocity;
        let sigma = self.body.to_outputs([feed[0] + kv * error[0], feed[1] + kw * error[1]]);
        self.error = self.body.to_outputs(error);
        self.rows(outputs, &sigma);
        if self.direct {
            for (value, row) in command.iter_mut().zip(self.phi.chunks_exact(theta.len())) {
                *value = row.iter().zip(theta).map(|(a, b)| a * b).sum();
            }
        } else if solve_inputs(&*self.model, theta, outputs, &sigma, command).is_err() {
            // The loop that drives the robot refuses to send what is no number, and stops it.
            command.fill(f64::NAN);
        }
    }

    /// Evaluates the model's rows at outputs and accelerations.
    fn rows(&mut self, outputs: &[f64], accelerations: &[f64]) {
        self.model.regressor(Sample { inputs: &self.idle, outputs, accelerations }, &mut self.phi, &mut self.y);
    }

    /// Adds Φᵀ ν̃ of one equation, of the last evaluation, to `gradient`.                                           (3.21)
    pub fn gradient(&self, equation: usize, gradient: &mut [f64]) {
        self.add_row(equation, self.error[equation], gradient);
    }

    /// Adds a multiple of a row of Φ of the last evaluation.
    fn add_row(&self, equation: usize, factor: f64, sum: &mut [f64]) {
        let n = sum.len();
        for (sum, phi) in sum.iter_mut().zip(&self.phi[equation * n..(equation + 1) * n]) {
            *sum += factor * phi;
        }
    }

    /// Error of each output at the last evaluation: wanted minus measured.
    pub fn error(&self) -> [f64; 2] {
        self.error
    }

    /// Φ on a course, row by row.
    pub(crate) fn demand(&mut self, at: &Reference) -> &[f64] {
        let (outputs, accelerations) = (self.body.to_outputs([at.v, at.omega]), self.body.to_outputs([at.v_dot, at.omega_dot]));
        self.rows(&outputs, &accelerations);
        &self.phi
    }

    /// Of each output: D K, what an error of it adds to its command, and K \[1/s\], how fast the error fades.
    pub(crate) fn stiffness(&mut self, theta: &[f64]) -> [(f64, f64); 2] {
        let [kv, kw] = self.gains.velocity;
        std::array::from_fn(|i| {
            let unit: [f64; 2] = std::array::from_fn(|j| f64::from(u8::from(i == j)));
            let mut row = |accelerations: &[f64; 2]| {
                self.rows(&[0.0; 2], accelerations);
                self.phi.chunks_exact(theta.len()).nth(i).map_or(0.0, |row| row.iter().zip(theta).map(|(a, b)| a * b).sum::<f64>())
            };
            let inertia = (row(&unit) - row(&[0.0; 2])).abs();
            let [v, omega] = self.body.to_body(&unit);
            let bandwidth = self.body.to_outputs([kv * v, kw * omega])[i];
            (inertia * bandwidth, bandwidth)
        })
    }

    /// Mean of Φᵀ ν̃ when the body velocities are measured with an error of ± `noise` on one axis about (v, ω), everything else
    /// being on its course: the drift that noise gives the adaptation.                                    (notes to 3.21)
    pub(crate) fn noise_gradient(&mut self, at: [f64; 2], axis: usize, noise: f64, gradient: &mut [f64]) {
        let (mut wrong, mut answer) = ([0.0; 2], [0.0; 2]);
        wrong[axis] = noise;
        answer[axis] = -self.gains.rates()[axis] * noise;
        let (centre, wrong, answer) = (self.body.to_outputs(at), self.body.to_outputs(wrong), self.body.to_outputs(answer));
        for sign in [1.0, -1.0] {
            self.rows(&[centre[0] + sign * wrong[0], centre[1] + sign * wrong[1]], &[sign * answer[0], sign * answer[1]]);
            for (equation, wrong) in wrong.iter().enumerate() {
                // Where the noise of one axis reaches one output only, half of the rows have no part in it.
                if *wrong != 0.0 {
                    self.add_row(equation, -0.5 * sign * wrong, gradient);
                }
            }
        }
    }
}
