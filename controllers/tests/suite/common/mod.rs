//! The robots and controllers of the tests.

#![allow(dead_code, unreachable_pub, clippy::unwrap_used, reason = "each test program uses its share")]

use std::sync::Arc;

use rand::SeedableRng;
use rand::rngs::StdRng;
use rand_distr::{Distribution, StandardNormal};

use wheelwright_controllers::AdaptiveConfig;
use wheelwright_controllers::adaptation::Gamma;
use wheelwright_controllers::law::Sigma;
use wheelwright_controllers::trajectory::FigureEight;
use wheelwright_core::controller::{Controller, Observation, Subject};
use wheelwright_core::tracking::TrackLog;
use wheelwright_core::trajectory::{Envelope, TrajectoryConfig};
use wheelwright_core::{ModelConfig, Trajectory};
use wheelwright_models::VwPdConfig;

/// θ of the simulations of Laut 2011, section 4.2.
pub const TRUE_THETA: [f64; 6] = [0.2604, 0.2509, -0.0004, 0.9965, 0.0026, 1.0768];
/// Where the adaptation of Tables 4.1 and 4.2 starts.
pub const INITIAL: [f64; 6] = [0.4, 0.1, 0.7, 0.3, 0.1, 0.6];
/// θ of the Khepera, section 4.4.1.
pub const KHEPERA: [f64; 6] = [0.0228, 0.0568, -0.0001, 1.0030, 0.0732, 0.9981];
/// θ of the Pioneer, section 4.4.2.
pub const PIONEER: [f64; 6] = [0.2183, 0.1918, -0.0050, 0.9993, -0.0279, 1.0142];

pub fn pd_subject(theta: &[f64], period: f64) -> Subject {
    let model = Arc::from(VwPdConfig::default().build().unwrap());
    let (intervals, envelope, course) = (vec![None; theta.len()], Envelope::default(), Vec::new());
    Subject { model, theta: theta.to_vec(), intervals, own: None, period, envelope, course }
}

pub fn figure_eight(ax: f64, ay: f64, frequency: f64) -> Box<dyn Trajectory> {
    FigureEight { ax, ay, frequency, dither: None }.build(&Envelope::default()).unwrap()
}

pub fn adaptive(k: [f64; 3], [kv, kw]: [f64; 2], sigma: Sigma, gamma: f64) -> AdaptiveConfig {
    AdaptiveConfig {
        k,
        kv,
        kw,
        sigma,
        saturation: false,
        gamma: Gamma::Same(gamma),
        frozen: Vec::new(),
        start: 0.0,
        leak: 0.0,
        noise: [0.0; 2],
        projection: None,
    }
}

/// A robot that is exactly a model, told and measured once a period, with white noise on its velocities.
pub struct Sampled<'a> {
    pub subject: &'a Subject,
    pub own: &'a [f64],
    pub noise: [f64; 2],
    pub seed: u64,
    /// How far ahead of the trajectory's start the robot begins [m].
    pub ahead: f64,
}

impl Sampled<'_> {
    /// Tracks from the trajectory's own start, or ahead of it.
    pub fn track(&self, controller: &mut dyn Controller, trajectory: &dyn Trajectory, duration: f64) -> TrackLog {
        const SUBSTEP: f64 = 0.002;
        let mut random = StdRng::seed_from_u64(self.seed);
        let period = self.subject.period;
        let r = trajectory.at(0.0);
        let mut state = [r.x + self.ahead * r.phi.cos(), r.y + self.ahead * r.phi.sin(), r.phi, r.v, r.omega];
        let mut command = [0.0; 2];
        let mut log = TrackLog { theta: vec![Vec::new(); controller.theta().len()], ..TrackLog::default() };
        for k in 0..=(duration / period).round() as usize {
            let t = period * k as f64;
            let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
            let outputs = [state[3] + self.noise[0] * normal(), state[4] + self.noise[1] * normal()];
            let reference = trajectory.at(t);
            controller.step(&Observation { t, reference, pose: [state[0], state[1], state[2]], outputs: &outputs }, &mut command);
            log.time.push(t);
            log.reference.push(reference);
            log.pose.push([state[0], state[1], state[2]]);
            log.theta.iter_mut().zip(controller.theta()).for_each(|(series, value)| series.push(*value));
            let steps = (period / SUBSTEP).ceil().max(1.0);
            for _ in 0..steps as usize {
                self.advance(&mut state, &command, period / steps);
            }
        }
        log
    }

    fn advance(&self, state: &mut [f64; 5], command: &[f64], h: f64) {
        let rate = |s: &[f64; 5]| {
            let mut a = [0.0; 2];
            // A diverged state is what some tests look for.
            let _ = self.subject.model.accelerations(self.own, command, &s[3..], &mut a);
            [s[3] * s[2].cos(), s[3] * s[2].sin(), s[4], a[0], a[1]]
        };
        let plus = |s: &[f64; 5], r: &[f64; 5], h: f64| -> [f64; 5] { std::array::from_fn(|i| s[i] + h * r[i]) };
        let k1 = rate(state);
        let k2 = rate(&plus(state, &k1, 0.5 * h));
        let k3 = rate(&plus(state, &k2, 0.5 * h));
        let k4 = rate(&plus(state, &k3, h));
        *state = std::array::from_fn(|i| state[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]));
    }
}
