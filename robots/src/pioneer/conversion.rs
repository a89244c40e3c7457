//! What the robot's numbers mean in SI, which differs between robots of the family by up to 2.06 times.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};
use wheelwright_core::robot::RobotError;

use crate::wire::config;

/// Factors from the robot's units to SI.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Conversion {
    /// Metres a unit of position (DistConvFactor).
    pub distance: f64,
    /// Radians a unit of heading (AngleConvFactor).
    pub angle: f64,
    /// m/s a unit of wheel velocity (VelConvFactor).
    pub velocity: f64,
    /// Angular velocity a difference of wheel speeds: ω = (v_right − v_left)/2 × this \[rad/m\] (DiffConvFactor × 1000).
    pub difference: f64,
    /// m/s a unit of VEL2 (Vel2Divisor).
    pub vel2: f64,
}

/// One unit of heading; ARIA's parameter files round it to 0.00153, 0.26 % small.
const ANGLE: f64 = TAU / 4096.0;

/// DistConvFactor \[mm\], AngleConvFactor \[rad\], VelConvFactor, DiffConvFactor \[rad/mm\], Vel2Divisor \[mm/s\] by the
/// subclass in the answer to SYNC2 (AriaCoda `params/*.p`, AMRISim, Player and ROS p2os agree).
const KNOWN: [(&str, [f64; 5]); 9] = [
    ("p3dx-sh", [1.0, ANGLE, 1.0, 0.0056, 20.0]),
    ("p3dx-sh-lms1xx", [1.0, ANGLE, 1.0, 0.0056, 20.0]),
    ("p3dx-sh-lms500", [1.0, ANGLE, 1.0, 0.0056, 20.0]),
    ("p3dx", [0.485, ANGLE, 1.0, 0.0056, 20.0]),
    ("p2dx", [0.84, ANGLE, 1.0, 0.0056, 20.0]),
    ("p3at", [0.465, ANGLE, 1.0, 0.0034, 20.0]),
    ("p3at-sh", [1.0, ANGLE, 1.0, 0.0034, 20.0]),
    ("amigo", [0.5083, ANGLE, 0.6154, 0.011, 20.0]),
    ("pion1m", [0.05066, TAU / 1024.0, 2.5332, 0.003_33, 4.0]),
];

impl Conversion {
    /// The factors of a subclass, as the robot names itself.
    ///
    /// # Errors
    /// [`RobotError::Config`] for an unknown one: a guess would be wrong by up to a factor of two.
    pub fn of(subclass: &str) -> Result<Self, RobotError> {
        let found = KNOWN.iter().find(|(name, _)| name.eq_ignore_ascii_case(subclass));
        let (_, [distance, angle, velocity, difference, vel2]) = found.ok_or_else(|| {
            let known: Vec<_> = KNOWN.iter().map(|(name, _)| *name).collect();
            let reason = format!(
                "the robot calls itself \"{subclass}\", whose units are not known; set `subclass` to the one it equals, of {}, or give [robot.conversion]",
                known.join(", ")
            );
            config("subclass", reason)
        })?;
        Ok(Self { distance: distance * 1e-3, angle: *angle, velocity: velocity * 1e-3, difference: difference * 1e3, vel2: vel2 * 1e-3 })
    }

    /// Every factor must be positive.
    pub(super) fn check(&self) -> Result<(), RobotError> {
        let all = [
            ("distance", self.distance),
            ("angle", self.angle),
            ("velocity", self.velocity),
            ("difference", self.difference),
            ("vel2", self.vel2),
        ];
        match all.into_iter().find(|(_, value)| !value.is_finite() || *value <= 0.0) {
            Some((key, value)) => Err(config(&format!("conversion.{key}"), format!("must be a positive number, not {value}"))),
            None => Ok(()),
        }
    }

    /// Units of heading a turn.
    pub fn turn(&self) -> i64 {
        (TAU / self.angle).round().max(1.0) as i64
    }

    /// (v, ω) from the wheels' speeds \[m/s\].
    pub fn to_body(&self, left: f64, right: f64) -> [f64; 2] {
        [0.5 * (left + right), 0.5 * (right - left) * self.difference]
    }

    /// The wheels' speeds \[m/s\], left and right, from (v, ω).
    pub fn to_wheels(&self, [v, omega]: [f64; 2]) -> [f64; 2] {
        [v - omega / self.difference, v + omega / self.difference]
    }
}

/// Every counter of positions repeats after this many units, or after a multiple of it.
pub(super) const WRAP: i64 = 4096;

/// Follows a counter that wraps.
///
/// Clients and servers of the family disagree where positions wrap (15 bits, 16 bits, 12 bits); the difference modulo
/// [`WRAP`] is right for all of them as long as it stays within half of that. A heading wraps after a turn.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Unwrapped {
    last: Option<i16>,
    total: i64,
}

impl Unwrapped {
    /// The counter's value without wraps, from its next reading; `wrap` is where it begins again, or a part of that.
    pub(super) fn follow(&mut self, raw: i16, wrap: i64) -> i64 {
        self.total += match self.last {
            None => i64::from(raw),
            Some(last) => (i64::from(raw) - i64::from(last) + wrap / 2).rem_euclid(wrap) - wrap / 2,
        };
        self.last = Some(raw);
        self.total
    }
}
