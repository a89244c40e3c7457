//! `signals`: any sum of constants, steps, ramps and sines on any channel, written in TOML.
//!
//! ```toml
//! [excitation]
//! type = "signals"
//! duration = 60.0
//!
//! [[excitation.signals]]
//! channel = "v_ref"
//! kind = "sine"
//! amplitude = 0.1
//! frequency_hz = 0.5
//! ```

use serde::{Deserialize, Serialize};

use super::{Excitation, ExcitationError, check_channel, check_duration};
use crate::channel::Channel;

/// A sum of signals; signals on one channel add up.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Signals {
    /// Length \[s\]; to be given.
    pub duration: f64,
    /// The summands; at least one.
    pub signals: Vec<Signal>,
}

/// One summand, picked by `kind`. Values are in the unit of the channel, times in seconds since the excitation's start.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
#[non_exhaustive]
pub enum Signal {
    /// A value from beginning to end.
    Constant(Constant),
    /// A value from one time to another.
    Step(Step),
    /// A value that changes at a constant rate and then stays.
    Ramp(Ramp),
    /// A sine.
    Sine(Sine),
}

/// A value from beginning to end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Constant {
    /// Channel commanded.
    pub channel: String,
    /// The value.
    pub value: f64,
}

/// `value` from `start` until just before `end`, zero elsewhere.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// Channel commanded.
    pub channel: String,
    /// The value.
    pub value: f64,
    /// First time \[s\].
    #[serde(default)]
    pub start: f64,
    /// Time at which it is over \[s\]; the end of the excitation if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end: Option<f64>,
}

/// Zero before `start`; `from` at `start`, then a constant rate until `end`; what was reached then is held.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ramp {
    /// Channel commanded.
    pub channel: String,
    /// Value at `start`.
    #[serde(default)]
    pub from: f64,
    /// Value at `end`; either this or `rate`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub to: Option<f64>,
    /// Change a second; either this or `to`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate: Option<f64>,
    /// Time at which it begins \[s\].
    #[serde(default)]
    pub start: f64,
    /// Time from which the value is held \[s\]; the end of the excitation if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end: Option<f64>,
}

/// amplitude · sin(ω (t − start) + phase) from `start` until just before `end`, zero elsewhere.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sine {
    /// Channel commanded.
    pub channel: String,
    /// Amplitude.
    pub amplitude: f64,
    /// Frequency \[Hz\]; either this or `omega_rad_s`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency_hz: Option<f64>,
    /// Angular frequency \[rad/s\]; either this or `frequency_hz`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub omega_rad_s: Option<f64>,
    /// Phase at `start` \[rad\].
    #[serde(default)]
    pub phase_rad: f64,
    /// First time \[s\].
    #[serde(default)]
    pub start: f64,
    /// Time at which it is over \[s\]; the end of the excitation if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end: Option<f64>,
}

#[typetag::serde(name = "signals")]
impl Excitation for Signals {
    fn about(&self) -> String {
        "any sum of constants, steps, ramps and sines on any command channel, written in TOML".to_owned()
    }

    fn duration(&self) -> f64 {
        self.duration
    }

    fn check(&self, inputs: &[Channel]) -> Result<(), ExcitationError> {
        check_duration(self.duration)?;
        if self.signals.is_empty() {
            return Err(ExcitationError::config("signals", "is empty: give at least one [[excitation.signals]]"));
        }
        for (i, signal) in self.signals.iter().enumerate() {
            signal.check(&Place { index: i, duration: self.duration })?;
            check_channel(signal.channel(), inputs)?;
        }
        Ok(())
    }

    fn command(&self, t: f64, inputs: &[Channel], command: &mut [f64]) {
        for (channel, value) in inputs.iter().zip(command) {
            *value = self.signals.iter().filter(|s| s.channel() == channel.name).map(|s| s.at(t, self.duration)).sum();
        }
    }
}

impl Signal {
    /// Channel commanded.
    pub fn channel(&self) -> &str {
        match self {
            Self::Constant(s) => &s.channel,
            Self::Step(s) => &s.channel,
            Self::Ramp(s) => &s.channel,
            Self::Sine(s) => &s.channel,
        }
    }

    /// Value at a time \[s\] of an excitation that lasts `duration` \[s\].
    fn at(&self, t: f64, duration: f64) -> f64 {
        match self {
            Self::Constant(s) => s.value,
            Self::Step(s) if active(t, s.start, s.end) => s.value,
            Self::Ramp(s) if t >= s.start => s.at(t, duration),
            Self::Sine(s) if active(t, s.start, s.end) => s.amplitude * (s.angular_frequency() * (t - s.start) + s.phase_rad).sin(),
            _ => 0.0,
        }
    }

    fn check(&self, place: &Place) -> Result<(), ExcitationError> {
        match self {
            Self::Constant(s) => place.finite("value", s.value),
            Self::Step(s) => {
                place.finite("value", s.value)?;
                place.times(s.start, s.end)
            }
            Self::Ramp(s) => {
                place.finite("from", s.from)?;
                place.finite(place.either(("to", s.to), ("rate", s.rate))?, s.to.or(s.rate).unwrap_or(f64::NAN))?;
                place.times(s.start, s.end)
            }
            Self::Sine(s) => {
                place.finite("amplitude", s.amplitude)?;
                place.finite("phase_rad", s.phase_rad)?;
                let key = place.either(("frequency_hz", s.frequency_hz), ("omega_rad_s", s.omega_rad_s))?;
                place.finite(key, s.angular_frequency())?;
                place.require(key, s.angular_frequency() > 0.0, "must be above zero; a constant is kind = \"constant\"")?;
                place.times(s.start, s.end)
            }
        }
    }
}

impl Ramp {
    fn at(&self, t: f64, duration: f64) -> f64 {
        let end = self.end.unwrap_or(duration);
        let elapsed = t.min(end) - self.start;
        match (self.to, self.rate) {
            (Some(to), _) => self.from + (to - self.from) * (elapsed / (end - self.start)),
            (None, rate) => self.from + rate.unwrap_or(0.0) * elapsed,
        }
    }
}

impl Sine {
    fn angular_frequency(&self) -> f64 {
        self.omega_rad_s.or(self.frequency_hz.map(|f| std::f64::consts::TAU * f)).unwrap_or(f64::NAN)
    }
}

fn active(t: f64, start: f64, end: Option<f64>) -> bool {
    t >= start && end.is_none_or(|end| t < end)
}

/// Where a signal stands in the table, to name its keys.
struct Place {
    index: usize,
    duration: f64,
}

impl Place {
    fn error(&self, key: &str, reason: &str) -> ExcitationError {
        ExcitationError::config(format!("signals[{}].{key}", self.index), reason)
    }

    fn require(&self, key: &str, holds: bool, reason: &str) -> Result<(), ExcitationError> {
        if holds { Ok(()) } else { Err(self.error(key, reason)) }
    }

    fn finite(&self, key: &str, value: f64) -> Result<(), ExcitationError> {
        self.require(key, value.is_finite(), &format!("must be a finite number, not {value}"))
    }

    fn times(&self, start: f64, end: Option<f64>) -> Result<(), ExcitationError> {
        let duration = self.duration;
        let inside = start >= 0.0 && start < duration;
        self.require("start", inside, &format!("{start} s does not lie within the excitation's 0 to {duration} s"))?;
        let Some(end) = end else { return Ok(()) };
        self.require("end", end.is_finite() && end > start, &format!("{end} s does not lie after the start at {start} s"))
    }

    /// The key that was given, of two of which exactly one must be.
    fn either<'a>(&self, a: (&'a str, Option<f64>), b: (&'a str, Option<f64>)) -> Result<&'a str, ExcitationError> {
        match (a.1, b.1) {
            (Some(_), None) => Ok(a.0),
            (None, Some(_)) => Ok(b.0),
            (None, None) => Err(self.error(a.0, &format!("is missing: give `{}` or `{}`", a.0, b.0))),
            (Some(_), Some(_)) => Err(self.error(b.0, &format!("give `{}` or `{}`, not both", a.0, b.0))),
        }
    }
}

#[cfg(test)]
#[path = "signals_tests.rs"]
mod tests;
