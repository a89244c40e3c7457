//! A base whose velocity controllers answer as second-order systems.

use serde::{Deserialize, Serialize};
use wheelwright_core::channel::{Channel, OMEGA, OMEGA_REF, V, V_REF};
use wheelwright_core::robot::{Robot, RobotConfig, RobotError};

/// `[robot] type = "second-order-base"`.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SecondOrderBase {
    /// Natural frequency of both velocity loops \[rad/s\].
    pub bandwidth: f64,
    /// Damping ratio; 1 is the fastest answer without overshoot.
    pub damping: f64,
    /// Control period \[s\].
    pub period: f64,
}

impl Default for SecondOrderBase {
    fn default() -> Self {
        Self { bandwidth: 8.0, damping: 0.9, period: 0.05 }
    }
}

#[typetag::serde(name = "second-order-base")]
impl RobotConfig for SecondOrderBase {
    fn about(&self) -> String {
        "a base with second-order velocity loops, from the example plugin".to_owned()
    }

    fn connect(&self, _seed: u64) -> Result<Box<dyn Robot>, RobotError> {
        for (key, value) in [("bandwidth", self.bandwidth), ("damping", self.damping), ("period", self.period)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(RobotError::Config { key: key.to_owned(), reason: format!("must be above 0, not {value}") });
            }
        }
        Ok(Box::new(Base { settings: self.clone(), time: 0.0, loops: [Loop::default(); 2] }))
    }
}

/// x'' = w² (u - x) - 2 ζ w x'
#[derive(Debug, Clone, Copy, Default)]
struct Loop {
    value: f64,
    rate: f64,
}

impl Loop {
    /// Symplectic Euler steps, short against the loop's own time.
    fn advance(&mut self, input: f64, settings: &SecondOrderBase) {
        let w = settings.bandwidth;
        let steps = (20.0 * w * settings.period).ceil();
        let h = settings.period / steps;
        for _ in 0..steps as usize {
            self.rate += h * (w * w * (input - self.value) - 2.0 * settings.damping * w * self.rate);
            self.value += h * self.rate;
        }
    }
}

struct Base {
    settings: SecondOrderBase,
    time: f64,
    loops: [Loop; 2],
}

impl Robot for Base {
    fn inputs(&self) -> &[Channel] {
        const { &[V_REF, OMEGA_REF] }
    }

    fn outputs(&self) -> &[Channel] {
        const { &[V, OMEGA] }
    }

    fn period(&self) -> f64 {
        self.settings.period
    }

    fn real_time(&self) -> bool {
        false
    }

    fn measure(&mut self, measured: &mut [f64]) -> Result<f64, RobotError> {
        for (value, one) in measured.iter_mut().zip(&self.loops) {
            *value = one.value;
        }
        Ok(self.time)
    }

    fn step(&mut self, command: &[f64], measured: &mut [f64]) -> Result<f64, RobotError> {
        for (one, &input) in self.loops.iter_mut().zip(command) {
            one.advance(input, &self.settings);
        }
        self.time += self.settings.period;
        self.measure(measured)
    }

    fn stop(&mut self) -> Result<(), RobotError> {
        self.loops = [Loop::default(); 2];
        Ok(())
    }
}
