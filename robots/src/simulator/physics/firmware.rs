//! A sampled low-level controller in place of the continuous one: every period it counts encoder ticks, and sets voltages that hold until
//! the next.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use super::super::plant::{PlantConstants, Sides};
use super::{Flaw, NOT_NEGATIVE, POSITIVE, first_flaw};

/// PID on each wheel, as a microcontroller does it. It replaces the law of `controller`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Firmware {
    /// Period of its loop \[s\].
    pub period: f64,
    /// Volts per error of the wheel's speed \[V s/rad\].
    pub kp: f64,
    /// Volts per error summed over time \[V/rad\].
    #[serde(default)]
    pub ki: f64,
    /// Volts per wheel acceleration, against it \[V s²/rad\].
    #[serde(default)]
    pub kd: f64,
    /// Volts per wheel speed asked for \[V s/rad\].
    #[serde(default)]
    pub feed_forward: f64,
    /// Most volts that the sum of the error may come to \[V\].
    #[serde(default = "windup")]
    pub windup: f64,
    /// Encoder counts a wheel revolution that it counts by; exact angles if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ticks_per_revolution: Option<f64>,
}

fn windup() -> f64 {
    12.0
}

impl Firmware {
    pub(super) fn flaw(&self) -> Option<Flaw> {
        let ticks = self.ticks_per_revolution.unwrap_or(1.0);
        first_flaw(&[
            ("period", self.period, self.period > 1e-5 && self.period <= 1.0, "between 0.00001 and 1 (it is in seconds)"),
            ("kp", self.kp, self.kp >= 0.0, NOT_NEGATIVE),
            ("ki", self.ki, self.ki >= 0.0, NOT_NEGATIVE),
            ("kd", self.kd, self.kd >= 0.0, NOT_NEGATIVE),
            ("feed_forward", self.feed_forward, self.feed_forward >= 0.0, NOT_NEGATIVE),
            ("windup", self.windup, self.windup >= 0.0, NOT_NEGATIVE),
            ("ticks_per_revolution", ticks, ticks > 0.0, POSITIVE),
        ])
    }
}

/// The loop at work.
#[derive(Debug, Clone, Default)]
pub(super) struct Loop {
    /// Ticks passed.
    pub(super) count: u64,
    /// Voltages held since the last tick.
    pub(super) volts: Sides,
    angles: Option<Sides>,
    speeds: Sides,
    sums: Sides,
}

impl Loop {
    /// A tick: looks at the encoders' angles \[rad\] and sets voltages for a set point.
    pub(super) fn tick(&mut self, firmware: &Firmware, c: &PlantConstants, angles: Sides, [v, omega]: [f64; 2]) {
        let seen = firmware.ticks_per_revolution.map_or(angles, |ticks| angles.map(|a| (a / TAU * ticks).floor() * TAU / ticks));
        let wanted = Sides::of_body(v, omega, c.track_width, c.wheel_radius);
        let before = self.angles.replace(seen).unwrap_or(seen);
        let side = |seen: f64, before: f64, last: f64, wanted: f64, sum: &mut f64| {
            let speed = (seen - before) / firmware.period;
            let error = wanted - speed;
            *sum = (*sum + firmware.ki * error * firmware.period).clamp(-firmware.windup, firmware.windup);
            let volts = firmware.kp * error + *sum - firmware.kd * (speed - last) / firmware.period + firmware.feed_forward * wanted;
            (speed, volts)
        };
        let left = side(seen.left, before.left, self.speeds.left, wanted.left, &mut self.sums.left);
        let right = side(seen.right, before.right, self.speeds.right, wanted.right, &mut self.sums.right);
        self.speeds = Sides { left: left.0, right: right.0 };
        self.volts = Sides { left: left.1, right: right.1 };
        self.count += 1;
    }
}
