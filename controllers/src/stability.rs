//! What can be said of a sampled loop before the robot moves: whether it is stable, and where noise carries its parameters.
//!
//! Each velocity obeys θ1 ν' + θ4 ν = command with a command held over the period T, so with a = e^{−T θ4/θ1} and the
//! controller's own values marked by ^, the inner loop has the pole a + b, b = (1 − a)(θ̂4 − θ̂1 k)/θ4, where k = k1 + k_v. It
//! leaves the unit circle at −1:
//!
//! θ̂1 k < θ̂4 + θ4 coth(T θ4/(2 θ1))
//!
//! The position loop around it, whose error changes by −ν, adds k1 k_v q to k, q = (T/2) coth(T θ4/(2 θ1)) − θ1/θ4, which matters
//! where the period is not small beside the lag: det(A + 1) = 0 of the two-state sampled loop, solved for the gains.
//!
//! Measurement noise of variance s² is multiplied with itself in Φᵀ ν̃, which does not average out: the parameters drift.

use wheelwright_core::RegressorModel;
use wheelwright_core::controller::{Concern, Gravity, Plan, Subject};
use wheelwright_core::model::Sample;
use wheelwright_core::trajectory::{Envelope, SHARES, Trajectory, peaks};

use crate::adaptation::Adaptation;
use crate::body::Body;
use crate::law::Law;

/// A share of the stability bound above which it is worth a warning: measurement and transport add delays to the loop.
const CLOSE: f64 = 0.7;
/// Drift over a run that is worth a warning: as a share of the parameter, and at least.
const DRIFT: (f64, f64) = (0.2, 0.01);
/// Body velocity about which damping is measured \[m/s, rad/s\]: off zero, where friction jumps.
const PROBE: f64 = 0.1;
/// Names of the body's two axes.
const AXES: [&str; 2] = ["v", "omega"];

/// One axis of a robot: inertia × ν' + damping × ν = command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axis {
    /// θ1 or θ2 \[s\].
    pub inertia: f64,
    /// θ4 or θ6 \[1\].
    pub damping: f64,
}

impl Axis {
    /// Both axes of a model, by evaluating its equation; coupling between them is left out.
    pub fn of(model: &dyn RegressorModel, body: &Body, theta: &[f64]) -> [Self; 2] {
        let (mut phi, mut y) = (vec![0.0; model.equations() * theta.len()], vec![0.0; model.equations()]);
        let inputs = vec![0.0; model.inputs().len()];
        let mut command = |velocity: [f64; 2], acceleration: [f64; 2]| {
            let (outputs, accelerations) = (body.to_outputs(velocity), body.to_outputs(acceleration));
            model.regressor(Sample { inputs: &inputs, outputs: &outputs, accelerations: &accelerations }, &mut phi, &mut y);
            let row = |i: usize| phi[i * theta.len()..(i + 1) * theta.len()].iter().zip(theta).map(|(a, b)| a * b).sum::<f64>() - y[i];
            let rows = [row(0), row(1)];
            body.to_body(&rows)
        };
        std::array::from_fn(|axis| {
            let along = |size: f64| std::array::from_fn(|i| if i == axis { size } else { 0.0 });
            let step = 0.1 * PROBE;
            let inertia = command(along(PROBE), along(1.0))[axis] - command(along(PROBE), [0.0; 2])[axis];
            let damping = (command(along(PROBE + step), [0.0; 2])[axis] - command(along(PROBE - step), [0.0; 2])[axis]) / (2.0 * step);
            Self { inertia, damping }
        })
    }

    /// The gain k \[1/s\] of a loop whose position error is fed back with `position` and whose velocity error with `velocity`,
    /// both included; `rate` is the gain without the position loop.
    pub fn effective_gain(&self, rate: f64, position: f64, velocity: f64, period: f64) -> f64 {
        let lag = self.inertia / self.damping;
        rate + position * velocity * (0.5 * period / (0.5 * period / lag).tanh() - lag)
    }

    /// The largest gain k \[1/s\] for which the loop of a controller that believes `believed` is stable at a period \[s\].
    pub fn largest_gain(&self, believed: &Self, period: f64) -> f64 {
        self.reach(believed.damping, period) / believed.inertia
    }

    /// The largest inertia θ̂1 that a controller of gain k may believe in, if it believes in that damping.
    pub fn largest_inertia(&self, damping: f64, gain: f64, period: f64) -> f64 {
        self.reach(damping, period) / gain
    }

    /// θ̂4 + θ4 coth(T θ4/(2 θ1))
    fn reach(&self, damping: f64, period: f64) -> f64 {
        damping + self.damping / (0.5 * period * self.damping / self.inertia).tanh()
    }

    /// Variance of the true velocity caused by measurement noise of unit variance that the loop feeds back; infinite where
    /// the loop is unstable.
    pub fn noise_gain(&self, believed: &Self, gain: f64, period: f64) -> f64 {
        let a = (-period * self.damping / self.inertia).exp();
        let b = (1.0 - a) * (believed.damping - believed.inertia * gain) / self.damping;
        let pole = a + b;
        if pole.abs() < 1.0 { b * b / (1.0 - pole * pole) } else { f64::INFINITY }
    }
}

/// A trajectory beyond the robot's limits cannot be followed.
pub fn limit_concerns(plan: &Plan<'_>, envelope: &Envelope) -> Vec<Concern> {
    let shares = peaks(plan.trajectory, plan.duration, envelope);
    let beyond = |(share, name): (f64, &str)| {
        (share > 1.0).then(|| {
            let message = format!("the trajectory asks for {:.0} % of the robot's {name}: slow it down or make it larger", 100.0 * share);
            Concern::new(Gravity::Danger, message)
        })
    };
    shares.into_iter().zip(SHARES).filter_map(beyond).collect()
}

/// A controller's loop as sampled.
pub(crate) struct Loop<'a> {
    pub(crate) law: &'a Law,
    pub(crate) subject: &'a Subject,
    pub(crate) theta: &'a [f64],
}

impl Loop<'_> {
    fn axes(&self, theta: &[f64]) -> [Axis; 2] {
        Axis::of(self.law.model(), self.law.body(), theta)
    }

    /// The robot's own axes as far as known.
    fn own(&self) -> [Axis; 2] {
        self.axes(self.subject.own.as_deref().unwrap_or(self.theta))
    }

    /// Whether the loop is stable now, and stays so wherever the adaptation may carry the parameters.
    pub(crate) fn stability_concerns(&self, adaptation: Option<&Adaptation>) -> Vec<Concern> {
        let (own, believed) = (self.own(), self.axes(self.theta));
        let mut concerns = Vec::new();
        let gains = self.law.gains();
        let position = [gains.kinematic.k1, gains.kinematic.k3];
        for (axis, rate) in gains.rates().into_iter().enumerate() {
            let name = AXES[axis];
            let gain = own[axis].effective_gain(rate, position[axis], gains.velocity[axis], self.subject.period);
            for (whose, part) in [("robot's", own[axis]), ("controller's", believed[axis])] {
                if !(part.inertia > 0.0 && part.damping > 0.0) {
                    let Axis { inertia, damping } = part;
                    let message =
                        format!("the {whose} {name} axis has the lag {inertia:.4} s and the damping {damping:.4}; both must be positive");
                    concerns.push(Concern::new(Gravity::Danger, message));
                }
            }
            if !concerns.is_empty() {
                continue;
            }
            let bound = own[axis].largest_gain(&believed[axis], self.subject.period);
            let share = gain / bound;
            let facts = format!(
                "the {name} loop has the gain {gain:.3}/s of at most {bound:.3}/s at which it is stable with a period of {} s",
                self.subject.period
            );
            if share >= 1.0 {
                concerns.push(Concern::new(Gravity::Danger, format!("{facts}: it will oscillate and diverge; lower the gains")));
            } else if share > CLOSE {
                concerns.push(Concern::new(Gravity::Warning, format!("{facts}: close to instability; lower the gains")));
            }
            if let Some(adaptation) = adaptation {
                concerns.extend(self.worst_case(axis, gain, adaptation, own[axis]));
            }
        }
        concerns
    }

    /// An adaptation whose bounds reach beyond stability may go there.
    fn worst_case(&self, axis: usize, gain: f64, adaptation: &Adaptation, own: Axis) -> Option<Concern> {
        let reach: Vec<f64> = adaptation
            .bounds()
            .zip(self.theta)
            .zip(adaptation.gamma())
            .map(|(((_, high), theta), gamma)| if *gamma > 0.0 { high } else { *theta })
            .collect();
        let name = AXES[axis];
        let limit = own.largest_inertia(self.axes(self.theta)[axis].damping, gain, self.subject.period);
        if reach.iter().any(|r| r.is_infinite()) {
            let message = format!(
                "nothing keeps the adaptation from carrying the lag of the {name} axis beyond {limit:.4} s, where the sampled loop is unstable: \
                 give [controller.projection]"
            );
            return Some(Concern::new(Gravity::Note, message));
        }
        let farthest = self.axes(&reach)[axis].inertia;
        (farthest > limit).then(|| {
            let message = format!(
                "the projection lets the lag of the {name} axis grow to {farthest:.4} s; the sampled loop is unstable beyond {limit:.4} s: tighten it"
            );
            Concern::new(Gravity::Warning, message)
        })
    }

    /// Rate of change that measurement noise gives each parameter \[unit/s\], the mean over the trajectory, less what the adaptation
    /// takes out of it.
    pub(crate) fn drift(&self, adaptation: &Adaptation, trajectory: &dyn Trajectory, duration: f64, noise: [f64; 2]) -> Vec<f64> {
        const LOOKS: usize = 64;
        let (own, believed, gains) = (self.own(), self.axes(self.theta), self.law.gains().rates());
        let mut law = self.law.clone();
        let mut drift = vec![0.0; self.theta.len()];
        for k in 0..LOOKS {
            let at = trajectory.at(duration * (k as f64 + 0.5) / LOOKS as f64);
            for (axis, own) in own.iter().enumerate() {
                let fed = own.noise_gain(&believed[axis], gains[axis], self.subject.period);
                let left = noise[axis].powi(2) * (1.0 + fed) - adaptation.noise()[axis].powi(2);
                law.noise_gradient([at.v, at.omega], axis, left.max(0.0).sqrt(), &mut drift);
            }
        }
        drift.iter().zip(adaptation.gamma()).map(|(sum, gamma)| gamma * sum / LOOKS as f64).collect()
    }

    /// Drift by noise that would spoil a parameter within the run.
    pub(crate) fn drift_concerns(&self, adaptation: &Adaptation, plan: &Plan<'_>) -> Vec<Concern> {
        let Some(noise) = plan.noise else { return Vec::new() };
        let time = (plan.duration - adaptation.start()).max(0.0);
        let drift = self.drift(adaptation, plan.trajectory, plan.duration, noise);
        let concern = |i: usize| {
            let (rate, leak) = (drift[i], adaptation.leak());
            // With a leak the drift settles at rate/leak.
            let change = if leak > 0.0 { rate / leak * (1.0 - (-leak * time).exp()) } else { rate * time };
            let (low, high) = adaptation.bounds().nth(i).unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
            let reached = (self.theta[i] + change).clamp(low.min(self.theta[i]), high.max(self.theta[i]));
            let worth_saying = rate.is_finite() && (reached - self.theta[i]).abs() > (DRIFT.0 * self.theta[i].abs()).max(DRIFT.1);
            worth_saying.then(|| {
                let name = &self.law.model().parameters()[i].name;
                let message = format!(
                    "measurement noise carries `{name}` from {:.4} to about {reached:.4} within {time:.0} s of adaptation: give the noise \
                     to the controller, lower gamma, or give a projection or a leak",
                    self.theta[i]
                );
                Concern::new(Gravity::Warning, message)
            })
        };
        (0..drift.len()).filter_map(concern).collect()
    }
}
