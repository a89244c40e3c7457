//! What firmware does to a set-point before any control: ramps, smallest and largest speeds, calibration, smoothing.

use super::Command;
use crate::plant::{LEFT, RIGHT};

/// Settings of the set-point path; the default hands set-points through.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shaping {
    /// Step to which the forward set-point is rounded \[m/s\] and the turning one \[rad/s\]; zero: not rounded.
    pub rounding: [f64; 2],
    /// Largest change of forward set-point \[m/s²\] and turning set-point \[rad/s²\].
    pub ramp: [f64; 2],
    /// Largest change of a wheel's set-point \[m/s²\], speeding up and slowing down.
    pub wheel_ramp: [f64; 2],
    /// Largest forward and turning set-point.
    pub axis_limit: [f64; 2],
    /// Largest set-point of a wheel \[m/s\].
    pub wheel_limit: f64,
    /// Whether that limit bends softly instead of cutting.
    pub soft_limit: bool,
    /// Smallest set-point of a wheel that has any effect \[m/s\].
    pub least: f64,
    /// Whether the smallest set-point is taken off larger ones (a dead band) instead of passing them whole (a threshold).
    pub subtract: bool,
    /// Calibration of left and right set-point.
    pub scale: [f64; 2],
    /// Time constant of smoothing the wheels' set-points \[s\].
    pub smoothing: f64,
    /// Whether smoothing has two equal stages of half the time constant each.
    pub two_stages: bool,
}

impl Default for Shaping {
    fn default() -> Shaping {
        let unlimited = [f64::INFINITY; 2];
        Shaping {
            rounding: [0.0; 2],
            ramp: unlimited,
            wheel_ramp: unlimited,
            axis_limit: unlimited,
            wheel_limit: f64::INFINITY,
            soft_limit: false,
            least: 0.0,
            subtract: false,
            scale: [1.0; 2],
            smoothing: 0.0,
            two_stages: false,
        }
    }
}

/// What the set-point path remembers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Shaper {
    axis: [f64; 2],
    wheel: [f64; 2],
    stage: [[f64; 2]; 2],
}

fn towards(from: f64, to: f64, most: f64) -> f64 {
    from + (to - from).clamp(-most, most)
}

impl Shaper {
    /// Rim speeds `[left, right]` \[m/s\] wanted now.
    pub fn shape(&mut self, set: &Shaping, asked: Command, half_track: f64, period: f64) -> [f64; 2] {
        for (k, asked) in [asked.v, asked.omega].into_iter().enumerate() {
            let rounded = if set.rounding[k] > 0.0 { (asked / set.rounding[k]).round() * set.rounding[k] } else { asked };
            let limited = rounded.clamp(-set.axis_limit[k], set.axis_limit[k]);
            self.axis[k] = towards(self.axis[k], limited, set.ramp[k] * period);
        }
        let [v, omega] = self.axis;
        let mut rims = [0.0; 2];
        for (i, side) in [(LEFT, -1.0), (RIGHT, 1.0)] {
            let rim = limit(set, least(set, v + side * half_track * omega)) * set.scale[i];
            let slowing = rim.abs() < self.wheel[i].abs() && rim * self.wheel[i] >= 0.0;
            self.wheel[i] = towards(self.wheel[i], rim, set.wheel_ramp[usize::from(slowing)] * period);
            rims[i] = self.smooth(set, i, period);
        }
        rims
    }

    fn smooth(&mut self, set: &Shaping, i: usize, period: f64) -> f64 {
        if set.smoothing <= 0.0 {
            return self.wheel[i];
        }
        let stages = if set.two_stages { 2 } else { 1 };
        let keep = (-period * f64::from(stages) / set.smoothing).exp();
        let mut passed = self.wheel[i];
        for stage in self.stage.iter_mut().take(stages as usize) {
            stage[i] = passed + (stage[i] - passed) * keep;
            passed = stage[i];
        }
        passed
    }
}

fn least(set: &Shaping, rim: f64) -> f64 {
    if rim.abs() < set.least {
        0.0
    } else if set.subtract {
        rim - set.least * rim.signum()
    } else {
        rim
    }
}

fn limit(set: &Shaping, rim: f64) -> f64 {
    if !set.wheel_limit.is_finite() {
        rim
    } else if set.soft_limit {
        set.wheel_limit * (rim / set.wheel_limit).tanh()
    } else {
        rim.clamp(-set.wheel_limit, set.wheel_limit)
    }
}
