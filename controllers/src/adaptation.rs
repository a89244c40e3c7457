//! Adaptation of parameters (3.21), kept within bounds, pulled back if wanted, and held while commands are saturated.

use serde::{Deserialize, Serialize};
use wheelwright_core::controller::{ControlError, Subject};

use crate::balance;
use crate::law::Law;

/// Adaptation gains: one for all parameters, one each, or whatever makes them equally quick.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Gamma {
    /// One for all.
    Same(f64),
    /// One a parameter, in the model's order.
    Each(Vec<f64>),
    /// By what the trajectory asks of each parameter.
    Balanced(Balanced),
}

/// Gains of equal pace.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Balanced {
    /// Time constant \[s\] with which each parameter's error would fade if it were the only one. Where the velocity loop does not bear
    /// that, it is longer.
    pub time: f64,
}

/// Bounds that a parameter may not leave: exactly one of the ways to give them.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Projection {
    /// Share of the start value to either side: 0.5 keeps within ±50 %.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relative: Option<f64>,
    /// Multiples of the identification's 95 % interval to either side of the start value.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub intervals: Option<f64>,
    /// Lower bounds, one a parameter, together with `upper`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lower: Option<Vec<f64>>,
    /// Upper bounds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub upper: Option<Vec<f64>>,
}

/// Settings of an adaptation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// γ.
    pub gamma: Gamma,
    /// Parameters that keep their value.
    pub frozen: Vec<String>,
    /// Time from which on parameters are adapted \[s\].
    pub start: f64,
    /// σ-modification: rate at which parameters are pulled back to where they started \[1/s\]; 0 for none.
    pub leak: f64,
    /// Bounds; none without it.
    pub projection: Option<Projection>,
    /// Standard deviations of the noise on measured v \[m/s\] and ω \[rad/s\], whose drift is taken out of the rates.
    pub noise: [f64; 2],
}

/// An adaptation at work.
#[derive(Debug, Clone)]
pub struct Adaptation {
    gamma: Vec<f64>,
    lower: Vec<f64>,
    upper: Vec<f64>,
    nominal: Vec<f64>,
    leak: f64,
    start: f64,
    noise: [f64; 2],
    rate: Vec<f64>,
    drift: Vec<f64>,
}

impl Adaptation {
    /// The adaptation of a robot's parameters.
    ///
    /// # Errors
    /// [`ControlError::Config`] naming the key.
    pub fn new(settings: &Settings, law: &Law, subject: &Subject) -> Result<Self, ControlError> {
        let names: Vec<&str> = subject.model.parameters().iter().map(|p| p.name.as_str()).collect();
        let mut gamma = match &settings.gamma {
            Gamma::Same(gamma) => vec![*gamma; names.len()],
            Gamma::Each(gammas) => gammas.clone(),
            Gamma::Balanced(Balanced { time }) if !(time.is_finite() && *time > 0.0) => {
                return Err(ControlError::config("gamma.time", format!("must be a positive number of seconds, not {time}")));
            }
            Gamma::Balanced(_) if subject.course.is_empty() => {
                return Err(ControlError::config("gamma.time", "needs a trajectory to know what is asked of each parameter"));
            }
            Gamma::Balanced(Balanced { time }) => balance::gains(&mut law.clone(), &subject.theta, &subject.course, *time),
        };
        if gamma.len() != names.len() {
            return Err(ControlError::config(
                "gamma",
                format!("has {} values for the {} parameters {}", gamma.len(), names.len(), names.join(", ")),
            ));
        }
        if let Some(gamma) = gamma.iter().find(|g| !(g.is_finite() && **g >= 0.0)) {
            return Err(ControlError::config("gamma", format!("must be zero or positive, not {gamma}")));
        }
        for frozen in &settings.frozen {
            let i = names.iter().position(|name| name == frozen).ok_or_else(|| {
                ControlError::config(
                    "frozen",
                    format!("model `{}` has no parameter `{frozen}`: it has {}", subject.model.name(), names.join(", ")),
                )
            })?;
            gamma[i] = 0.0;
        }
        for (key, value) in [("start", settings.start), ("leak", settings.leak)] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(ControlError::config(key, format!("must be zero or positive, not {value}")));
            }
        }
        if let Some(noise) = settings.noise.iter().find(|s| !(s.is_finite() && **s >= 0.0)) {
            return Err(ControlError::config("noise", format!("must be standard deviations, zero or positive, not {noise}")));
        }
        let (lower, upper) = match &settings.projection {
            Some(projection) => projection.bounds(subject, &gamma)?,
            None => (vec![f64::NEG_INFINITY; names.len()], vec![f64::INFINITY; names.len()]),
        };
        let (rate, drift, nominal) = (vec![0.0; names.len()], vec![0.0; names.len()], subject.theta.clone());
        Ok(Self { gamma, lower, upper, nominal, leak: settings.leak, start: settings.start, noise: settings.noise, rate, drift })
    }

    /// Whether parameters are adapted at a time.
    pub fn runs(&self, t: f64) -> bool {
        t >= self.start
    }

    /// Time from which on they are \[s\].
    pub fn start(&self) -> f64 {
        self.start
    }

    /// γ, one a parameter; zero for a frozen one.
    pub fn gamma(&self) -> &[f64] {
        &self.gamma
    }

    /// Bounds, one pair a parameter; infinite where there are none.
    pub fn bounds(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        self.lower.iter().copied().zip(self.upper.iter().copied())
    }

    /// Rate at which parameters are pulled back \[1/s\].
    pub fn leak(&self) -> f64 {
        self.leak
    }

    /// Standard deviations of the noise whose drift is taken out.
    pub fn noise(&self) -> [f64; 2] {
        self.noise
    }

    /// The parameters' rate of change after a law's evaluation. What noise on the measurements adds to it in the mean about the
    /// velocities `at` is taken out, as far as the noise is known. `saturated` holds the command of each equation where limits
    /// took something from it: there, only what moves the command inwards is adapted (anti-windup), as an error that no
    /// command can remove says nothing of the parameters.
    pub fn rate(&mut self, law: &mut Law, theta: &[f64], at: [f64; 2], saturated: Option<&[f64]>) -> &[f64] {
        self.rate.fill(0.0);
        let error = law.error();
        let mut held = false;
        for (equation, error) in error.into_iter().enumerate() {
            // Φ γ Φᵀ ν̃ has the sign of ν̃, so that is which way the command moves.
            let outwards = saturated.is_some_and(|command| command[equation] * error > 0.0);
            held |= outwards;
            if !outwards {
                law.gradient(equation, &mut self.rate);
            }
        }
        if !held {
            self.take_out_drift(law, at);
        }
        for (i, rate) in self.rate.iter_mut().enumerate() {
            *rate *= self.gamma[i];
            if self.gamma[i] > 0.0 {
                *rate -= self.leak * (theta[i] - self.nominal[i]);
            }
            // (4.9), corrected: at or over a bound, only the way back is open.
            if (theta[i] <= self.lower[i] && *rate < 0.0) || (theta[i] >= self.upper[i] && *rate > 0.0) {
                *rate = 0.0;
            }
        }
        &self.rate
    }

    /// Noise of a measurement meets itself in Φᵀ ν̃, which does not average out.
    fn take_out_drift(&mut self, law: &mut Law, at: [f64; 2]) {
        self.drift.fill(0.0);
        for (axis, noise) in self.noise.into_iter().enumerate().filter(|(_, noise)| *noise > 0.0) {
            law.noise_gradient(at, axis, noise, &mut self.drift);
        }
        self.rate.iter_mut().zip(&self.drift).for_each(|(rate, drift)| *rate -= drift);
    }

    /// Moves parameters by the last rate over `dt` \[s\], and back to the bound they passed.
    pub fn advance(&self, theta: &mut [f64], dt: f64) {
        for (i, value) in theta.iter_mut().enumerate() {
            *value += dt * self.rate[i];
        }
        self.clamp(theta);
    }

    /// Brings parameters back to the bound they passed. One that started beyond a bound is not thrown onto it.
    pub fn clamp(&self, theta: &mut [f64]) {
        for (i, value) in theta.iter_mut().enumerate() {
            *value = value.clamp(self.lower[i].min(self.nominal[i]), self.upper[i].max(self.nominal[i]));
        }
    }
}

impl Projection {
    fn bounds(&self, subject: &Subject, gamma: &[f64]) -> Result<(Vec<f64>, Vec<f64>), ControlError> {
        let wrong = |key: &str, reason: String| ControlError::config(format!("projection.{key}"), reason);
        let around = |half: &dyn Fn(usize) -> f64| {
            let sides = |sign: f64| subject.theta.iter().enumerate().map(|(i, theta)| theta + sign * half(i)).collect::<Vec<f64>>();
            (sides(-1.0), sides(1.0))
        };
        let factor = |key: &str, value: f64| {
            if value.is_finite() && value > 0.0 { Ok(value) } else { Err(wrong(key, format!("must be a positive number, not {value}"))) }
        };
        match (self.relative, self.intervals, &self.lower, &self.upper) {
            (Some(share), None, None, None) => {
                let share = factor("relative", share)?;
                Ok(around(&|i| share * subject.theta[i].abs()))
            }
            (None, Some(times), None, None) => {
                let times = factor("intervals", times)?;
                let lacking = (0..gamma.len()).find(|i| gamma[*i] > 0.0 && subject.intervals.get(*i).copied().flatten().is_none());
                if let Some(i) = lacking {
                    let name = &subject.model.parameters()[i].name;
                    return Err(wrong(
                        "intervals",
                        format!("the model file has no interval for `{name}`: identify with output-error, or give `relative`"),
                    ));
                }
                let half = |i: usize| subject.intervals.get(i).copied().flatten().map_or(0.0, |(low, high)| 0.5 * times * (high - low));
                Ok(around(&half))
            }
            (None, None, Some(lower), Some(upper)) => {
                for (key, bounds) in [("lower", lower), ("upper", upper)] {
                    if bounds.len() != gamma.len() {
                        return Err(wrong(key, format!("has {} values for {} parameters", bounds.len(), gamma.len())));
                    }
                }
                if let Some(i) = (0..gamma.len()).find(|i| lower[*i].is_nan() || upper[*i].is_nan() || lower[*i] > upper[*i]) {
                    return Err(wrong("lower", format!("bound {} is {}, above the upper bound {}", i + 1, lower[i], upper[i])));
                }
                Ok((lower.clone(), upper.clone()))
            }
            _ => Err(ControlError::config("projection", "takes exactly one of `relative`, `intervals`, or `lower` with `upper`")),
        }
    }
}
