//! The simulation of Laut 2011, section 4.1: robot, controller and adaptation as one system of differential equations, in
//! which nothing is sampled, noisy or limited.
//!
//! Its state is the pose, the model's outputs and the controller's parameters: eleven numbers for the six-parameter model.

use std::sync::Arc;

use wheelwright_core::controller::{ControlError, Subject};
use wheelwright_core::model::ModelError;
use wheelwright_core::tracking::TrackLog;
use wheelwright_core::{RegressorModel, Trajectory};

use crate::AdaptiveConfig;
use crate::adaptation::Adaptation;
use crate::law::Law;

/// The closed loop.
#[derive(Debug)]
pub struct Continuous<'a> {
    plant: Arc<dyn RegressorModel>,
    own: Vec<f64>,
    law: Law,
    adaptation: Adaptation,
    trajectory: &'a dyn Trajectory,
    command: Vec<f64>,
    /// x, y, φ; outputs; θ.
    state: Vec<f64>,
    time: f64,
}

/// Number of pose and velocity states before the parameters.
const MOTION: usize = 5;

impl<'a> Continuous<'a> {
    /// A robot of the parameters `own` under an adaptive controller that starts from the subject's θ. `start` holds the
    /// first pose (x, y, φ) and body velocities (v, ω).
    ///
    /// # Errors
    /// As [`AdaptiveConfig::parts`].
    pub fn new(
        controller: &AdaptiveConfig,
        subject: &Subject,
        own: &[f64],
        trajectory: &'a dyn Trajectory,
        start: [f64; MOTION],
    ) -> Result<Self, ControlError> {
        let (law, adaptation) = controller.parts(subject)?;
        let outputs = law.body().to_outputs([start[3], start[4]]);
        let mut state = vec![start[0], start[1], start[2], outputs[0], outputs[1]];
        state.extend(&subject.theta);
        let command = vec![0.0; law.model().inputs().len()];
        Ok(Self { plant: Arc::clone(&subject.model), own: own.to_vec(), law, adaptation, trajectory, command, state, time: 0.0 })
    }

    /// The start on the trajectory: its pose and velocities at t = 0.
    pub fn perfect_start(trajectory: &dyn Trajectory) -> [f64; MOTION] {
        let r = trajectory.at(0.0);
        [r.x, r.y, r.phi, r.v, r.omega]
    }

    /// Time \[s\].
    pub fn time(&self) -> f64 {
        self.time
    }

    /// x, y, φ, the model's outputs, θ.
    pub fn state(&self) -> &[f64] {
        &self.state
    }

    /// One classical Runge-Kutta step of `dt` \[s\].
    ///
    /// # Errors
    /// [`ModelError`] where the robot's equations leave its accelerations undetermined, or the motion diverges.
    pub fn step(&mut self, dt: f64) -> Result<(), ModelError> {
        let begin = self.state.clone();
        let shifted = |rate: &[f64], h: f64| begin.iter().zip(rate).map(|(x, r)| x + h * r).collect::<Vec<f64>>();
        let k1 = self.rate(self.time, &begin)?;
        let k2 = self.rate(self.time + 0.5 * dt, &shifted(&k1, 0.5 * dt))?;
        let k3 = self.rate(self.time + 0.5 * dt, &shifted(&k2, 0.5 * dt))?;
        let k4 = self.rate(self.time + dt, &shifted(&k3, dt))?;
        for (i, x) in self.state.iter_mut().enumerate() {
            *x += dt / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
        }
        self.adaptation.clamp(&mut self.state[MOTION..]);
        self.time += dt;
        match self.state.iter().all(|x| x.is_finite()) {
            true => Ok(()),
            false => Err(ModelError::Diverged { model: self.plant.name().to_owned(), time: self.time }),
        }
    }

    /// Runs until `duration` \[s\] in steps of about `dt`, keeping every `keep`-th state.
    ///
    /// # Errors
    /// As [`step`](Self::step).
    pub fn run(&mut self, duration: f64, dt: f64, keep: usize) -> Result<TrackLog, ModelError> {
        let steps = (duration / dt).round().max(1.0) as usize;
        let dt = duration / steps as f64;
        let mut log = TrackLog { theta: vec![Vec::new(); self.own.len()], ..TrackLog::default() };
        for k in 0..=steps {
            if k % keep.max(1) == 0 {
                self.note(&mut log);
            }
            if k < steps {
                self.step(dt)?;
                // A sum of steps would drift by its rounding.
                self.time = dt * (k + 1) as f64;
            }
        }
        Ok(log)
    }

    fn note(&self, log: &mut TrackLog) {
        log.time.push(self.time);
        log.reference.push(self.trajectory.at(self.time));
        log.pose.push([self.state[0], self.state[1], self.state[2]]);
        log.theta.iter_mut().zip(&self.state[MOTION..]).for_each(|(series, value)| series.push(*value));
        log.share.push(1.0);
        log.adapting.push(self.adaptation.runs(self.time));
    }

    fn rate(&mut self, t: f64, state: &[f64]) -> Result<Vec<f64>, ModelError> {
        let (motion, theta) = state.split_at(MOTION);
        let (pose, outputs) = ([motion[0], motion[1], motion[2]], &motion[3..]);
        self.law.command(&self.trajectory.at(t), pose, outputs, theta, &mut self.command);
        let mut rate = vec![0.0; state.len()];
        let [v, omega] = self.law.body().to_body(outputs);
        let (sin, cos) = pose[2].sin_cos();
        rate[..3].copy_from_slice(&[v * cos, v * sin, omega]);
        self.plant.accelerations(&self.own, &self.command, outputs, &mut rate[3..MOTION])?;
        if self.adaptation.runs(t) {
            rate[MOTION..].copy_from_slice(self.adaptation.rate(&mut self.law, theta, [v, omega], None));
        }
        Ok(rate)
    }
}
