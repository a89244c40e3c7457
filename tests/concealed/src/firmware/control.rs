//! Control laws: each wheel by itself, forward and turning speed, or no feedback at all.

use super::Firmware;
use crate::plant::{LEFT, RIGHT};

/// What the loop is closed over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// Each wheel's speed.
    Wheels,
    /// Forward and turning speed.
    Twist,
    /// Nothing: set-points become voltages.
    Open,
}

/// Gains of a control law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Control {
    /// What the loop is closed over.
    pub style: Style,
    /// Proportional gains: volts per rim speed \[V s/m\], forward and turning (equal for `Wheels` and `Open`).
    pub gain: [f64; 2],
    /// Volts per rim acceleration \[V s²/m\], against it.
    pub rate_gain: f64,
    /// Integral over proportional gain \[1/s\], forward and turning.
    pub integral: [f64; 2],
    /// Largest integral \[m/s at the rim\]; infinite without anti-windup.
    pub windup: f64,
}

/// What the loops remember.
#[derive(Clone, Copy, Debug, Default)]
pub struct Loops {
    sum: [f64; 2],
    before: Option<[f64; 2]>,
}

/// Mean and half difference of `[left, right]`.
fn split([left, right]: [f64; 2]) -> [f64; 2] {
    [0.5 * (left + right), 0.5 * (right - left)]
}

/// `[left, right]` of mean and half difference.
fn join([mean, half]: [f64; 2]) -> [f64; 2] {
    [mean - half, mean + half]
}

impl Loops {
    /// Voltages `[left, right]` for wanted rim speeds \[m/s\] and measured wheel speeds \[rad/s\].
    pub fn act(&mut self, firmware: &Firmware, wanted: [f64; 2], speed: [f64; 2]) -> [f64; 2] {
        let control = &firmware.control;
        let rim = [speed[LEFT] * firmware.radius, speed[RIGHT] * firmware.radius];
        let before = self.before.replace(rim).unwrap_or(rim);
        let rate = [(rim[LEFT] - before[LEFT]) / firmware.period, (rim[RIGHT] - before[RIGHT]) / firmware.period];
        // `Wheels` in mean and half difference is the same law as wheel by wheel, as its gains are equal.
        let (wanted, rim, rate) = (split(wanted), split(rim), split(rate));
        let mut asked = [0.0; 2];
        for k in 0..2 {
            let error = if control.style == Style::Open { wanted[k] } else { wanted[k] - rim[k] };
            if control.integral[k] > 0.0 {
                let sum = self.sum[k] + control.integral[k] * firmware.period * (wanted[k] - rim[k]);
                self.sum[k] = sum.clamp(-control.windup, control.windup);
            }
            asked[k] = control.gain[k] * (error + self.sum[k]) - control.rate_gain * rate[k];
        }
        join(asked)
    }
}
