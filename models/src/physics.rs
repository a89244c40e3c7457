//! From masses, lengths and motor constants to θ: the corrected formulas of Laut 2011, section 2.2 (wheel controller) and
//! appendix A.3 (velocity controller; identical to De La Cruz and Carelli, 2008).
//!
//! The robot is two driven wheels under one rigid body: m (v' − v̄ ω) = ΣF along the body, torque τ = ka (u − kb ω_wheel)/Ra on
//! each wheel, ground force (τ − Ie ω_wheel' − Be ω_wheel)/Rt. The controllers are
//!
//! wheels: u = kP (ω_ref − ω_wheel) − kD ω_wheel';   velocities: u_v = kPT (v_ref − v) − kDT v', u_ω = kPR (ω_ref − ω) − kDR ω'
//! with u_right,left = u_v ± u_ω.

use serde::{Deserialize, Serialize};
use wheelwright_core::model::ModelError;

/// A robot's body, wheels and motors. Motor constants are seen from the wheel: gear ratio included.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhysicalConstants {
    /// m: mass of the whole robot \[kg\].
    pub mass: f64,
    /// Iz: moment of inertia about the vertical axis through the centre of mass \[kg m²\].
    pub yaw_inertia: f64,
    /// b: how far the centre of mass lies ahead of the axle, negative behind it \[m\].
    pub com_offset: f64,
    /// d: distance between the wheels \[m\].
    pub track_width: f64,
    /// r: travel of a wheel a radian \[m\].
    pub wheel_radius: f64,
    /// Rt: lever arm of the ground force \[m\]; the wheel radius where it is absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tyre_radius: Option<f64>,
    /// Ie: moment of inertia of a wheel with its gear and rotor \[kg m²\].
    pub wheel_inertia: f64,
    /// Be: viscous friction of a wheel with its gear and rotor \[N m s/rad\].
    pub wheel_friction: f64,
    /// Ra: resistance of a motor's winding \[Ω\].
    pub resistance: f64,
    /// ka: torque on the wheel a unit of current \[N m/A\].
    pub torque_constant: f64,
    /// kb: voltage induced a unit of wheel speed \[V s/rad\].
    pub emf_constant: f64,
}

/// Gains of the controller on the wheel speeds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WheelGains {
    /// kP \[V s/rad\].
    pub kp: f64,
    /// kD \[V s²/rad\].
    pub kd: f64,
}

/// Gains of the controller on forward and angular velocity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VwGains {
    /// kPT \[V s/m\].
    pub kpt: f64,
    /// kDT \[V s²/m\].
    pub kdt: f64,
    /// kPR \[V s/rad\].
    pub kpr: f64,
    /// kDR \[V s²/rad\].
    pub kdr: f64,
}

impl PhysicalConstants {
    /// Rt \[m\].
    pub fn tyre_radius(&self) -> f64 {
        self.tyre_radius.unwrap_or(self.wheel_radius)
    }

    /// Checks that every constant is possible.
    ///
    /// # Errors
    /// [`ModelError::Config`] with the key, as `physical.mass`.
    pub fn check(&self) -> Result<(), ModelError> {
        positive("physical.mass", self.mass)?;
        positive("physical.yaw_inertia", self.yaw_inertia)?;
        finite("physical.com_offset", self.com_offset)?;
        positive("physical.track_width", self.track_width)?;
        positive("physical.wheel_radius", self.wheel_radius)?;
        positive("physical.tyre_radius", self.tyre_radius())?;
        not_negative("physical.wheel_inertia", self.wheel_inertia)?;
        not_negative("physical.wheel_friction", self.wheel_friction)?;
        positive("physical.resistance", self.resistance)?;
        positive("physical.torque_constant", self.torque_constant)?;
        not_negative("physical.emf_constant", self.emf_constant)
    }
}

impl WheelGains {
    /// Checks that kP is positive and kD not negative.
    ///
    /// # Errors
    /// [`ModelError::Config`] with the key.
    pub fn check(&self) -> Result<(), ModelError> {
        positive("gains.kp", self.kp)?;
        not_negative("gains.kd", self.kd)
    }

    /// The same controller written as one on forward and angular velocity:
    /// kPT = kP/r, kDT = kD/r, kPR = kP d/(2r), kDR = kD d/(2r).
    pub fn as_vw(&self, wheel_radius: f64, track_width: f64) -> VwGains {
        let rotation = track_width / (2.0 * wheel_radius);
        VwGains { kpt: self.kp / wheel_radius, kdt: self.kd / wheel_radius, kpr: self.kp * rotation, kdr: self.kd * rotation }
    }
}

impl VwGains {
    /// Checks that the proportional gains are positive and the derivative gains not negative.
    ///
    /// # Errors
    /// [`ModelError::Config`] with the key.
    pub fn check(&self) -> Result<(), ModelError> {
        positive("gains.kpt", self.kpt)?;
        not_negative("gains.kdt", self.kdt)?;
        positive("gains.kpr", self.kpr)?;
        not_negative("gains.kdr", self.kdr)
    }
}

/// θ1..θ6 of a robot whose firmware controls the wheel speeds (section 2.2, corrected).
pub fn wheel_pd_theta(robot: &PhysicalConstants, gains: &WheelGains) -> [f64; 6] {
    let PhysicalConstants { mass: m, yaw_inertia: iz, com_offset: b, track_width: d, wheel_radius: r, wheel_inertia: ie, .. } = *robot;
    let PhysicalConstants { wheel_friction: be, resistance: ra, torque_constant: ka, emf_constant: kb, .. } = *robot;
    let (rt, WheelGains { kp, kd }) = (robot.tyre_radius(), *gains);
    let reach = (ka * (kp + kb) + ra * be) / (ka * kp);
    [
        (ra * rt * r * m + 2.0 * ka * kd + 2.0 * ra * ie) / (2.0 * ka * kp),
        (ka * kd * d * d + ra * ie * d * d + 2.0 * ra * rt * r * (iz + m * b * b)) / (ka * kp * d * d),
        ra * rt * r * m * b / (2.0 * ka * kp),
        reach,
        2.0 * ra * rt * r * m * b / (ka * kp * d * d),
        reach,
    ]
}

/// θ1..θ6 of a robot whose firmware controls forward and angular velocity (appendix A.3, corrected).
pub fn vw_pd_theta(robot: &PhysicalConstants, gains: &VwGains) -> [f64; 6] {
    let PhysicalConstants { mass: m, yaw_inertia: iz, com_offset: b, track_width: d, wheel_radius: r, wheel_inertia: ie, .. } = *robot;
    let PhysicalConstants { wheel_friction: be, resistance: ra, torque_constant: ka, emf_constant: kb, .. } = *robot;
    let (rt, VwGains { kpt, kdt, kpr, kdr }) = (robot.tyre_radius(), *gains);
    // Voltage a unit of torque, and voltage a unit of steady wheel speed.
    let (per_torque, per_speed) = (ra / ka, kb + ra * be / ka);
    [
        (per_torque * (m * rt * r + 2.0 * ie) + 2.0 * r * kdt) / (2.0 * r * kpt),
        (per_torque * (ie * d * d + 2.0 * rt * r * (iz + m * b * b)) + 2.0 * r * d * kdr) / (2.0 * r * d * kpr),
        per_torque * m * b * rt / (2.0 * kpt),
        per_speed / (r * kpt) + 1.0,
        per_torque * m * b * rt / (d * kpr),
        per_speed * d / (2.0 * r * kpr) + 1.0,
    ]
}

/// What one physical constant or gain does to the parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Influence {
    /// Key in a configuration, such as `mass`.
    pub key: &'static str,
    /// Symbol in the literature, such as `m`.
    pub symbol: &'static str,
    /// SI unit.
    pub unit: &'static str,
    /// What it does, in one sentence.
    pub does: &'static str,
    /// The parameters it enters under the wheel controller; empty if it is no constant of such a robot.
    pub wheel_pd: &'static [&'static str],
    /// The parameters it enters under the velocity controller.
    pub vw_pd: &'static [&'static str],
}

const ALL: &[&str] = &["theta1", "theta2", "theta3", "theta4", "theta5", "theta6"];
const INERTIAL: &[&str] = &["theta1", "theta2", "theta3", "theta5"];
const OFFSET: &[&str] = &["theta2", "theta3", "theta5"];
const LAGS: &[&str] = &["theta1", "theta2"];
const REACH: &[&str] = &["theta4", "theta6"];

/// What each constant does, in the order of the configuration keys.
pub const INFLUENCES: &[Influence] = &[
    Influence {
        key: "mass",
        symbol: "m",
        unit: "kg",
        does: "more mass lengthens the forward lag and strengthens the couplings of a centre of mass off the axle",
        wheel_pd: INERTIAL,
        vw_pd: INERTIAL,
    },
    Influence {
        key: "yaw_inertia",
        symbol: "Iz",
        unit: "kg m^2",
        does: "more inertia about the vertical lengthens the turning lag, and nothing else",
        wheel_pd: &["theta2"],
        vw_pd: &["theta2"],
    },
    Influence {
        key: "com_offset",
        symbol: "b",
        unit: "m",
        does: "a centre of mass off the axle couples speed and turning (theta3 and theta5 take its sign) and lengthens the turning lag",
        wheel_pd: OFFSET,
        vw_pd: OFFSET,
    },
    Influence {
        key: "track_width",
        symbol: "d",
        unit: "m",
        does: "a wider track gives the wheels more leverage in turning: body inertia weighs less in the turning lag and coupling",
        wheel_pd: &["theta2", "theta5"],
        vw_pd: &["theta2", "theta5", "theta6"],
    },
    Influence {
        key: "wheel_radius",
        symbol: "r",
        unit: "m",
        does: "a larger wheel turns slower for the same speed: body inertia weighs more against wheel inertia and friction",
        wheel_pd: INERTIAL,
        vw_pd: &["theta1", "theta2", "theta4", "theta6"],
    },
    Influence {
        key: "tyre_radius",
        symbol: "Rt",
        unit: "m",
        does: "a longer lever of the ground force makes body inertia weigh more in both lags and both couplings",
        wheel_pd: INERTIAL,
        vw_pd: INERTIAL,
    },
    Influence {
        key: "wheel_inertia",
        symbol: "Ie",
        unit: "kg m^2",
        does: "more inertia of wheel, gear and rotor lengthens both lags",
        wheel_pd: LAGS,
        vw_pd: LAGS,
    },
    Influence {
        key: "wheel_friction",
        symbol: "Be",
        unit: "N m s/rad",
        does: "more viscous friction leaves the robot further below its commands in steady driving and turning",
        wheel_pd: REACH,
        vw_pd: REACH,
    },
    Influence {
        key: "resistance",
        symbol: "Ra",
        unit: "ohm",
        does: "a weaker motor (more resistance) lengthens lags, strengthens couplings and lowers the speed reached",
        wheel_pd: ALL,
        vw_pd: ALL,
    },
    Influence {
        key: "torque_constant",
        symbol: "ka",
        unit: "N m/A",
        does: "a stronger motor (more torque a current) shortens lags, weakens couplings and brings the speed nearer its command",
        wheel_pd: ALL,
        vw_pd: ALL,
    },
    Influence {
        key: "emf_constant",
        symbol: "kb",
        unit: "V s/rad",
        does: "more induced voltage leaves the robot further below its commands in steady driving and turning",
        wheel_pd: REACH,
        vw_pd: REACH,
    },
    Influence {
        key: "kp",
        symbol: "kP",
        unit: "V s/rad",
        does: "a higher proportional gain on the wheels shortens both lags, weakens couplings and brings speeds nearer their commands",
        wheel_pd: ALL,
        vw_pd: &[],
    },
    Influence {
        key: "kd",
        symbol: "kD",
        unit: "V s^2/rad",
        does: "a higher derivative gain on the wheels acts like wheel inertia: it lengthens both lags",
        wheel_pd: LAGS,
        vw_pd: &[],
    },
    Influence {
        key: "kpt",
        symbol: "kPT",
        unit: "V s/m",
        does: "a higher proportional gain on the forward velocity shortens its lag, weakens its coupling and brings it nearer its command",
        wheel_pd: &[],
        vw_pd: &["theta1", "theta3", "theta4"],
    },
    Influence {
        key: "kdt",
        symbol: "kDT",
        unit: "V s^2/m",
        does: "a higher derivative gain on the forward velocity lengthens its lag",
        wheel_pd: &[],
        vw_pd: &["theta1"],
    },
    Influence {
        key: "kpr",
        symbol: "kPR",
        unit: "V s/rad",
        does: "a higher proportional gain on the angular velocity shortens its lag, weakens its coupling and brings it nearer its command",
        wheel_pd: &[],
        vw_pd: &["theta2", "theta5", "theta6"],
    },
    Influence {
        key: "kdr",
        symbol: "kDR",
        unit: "V s^2/rad",
        does: "a higher derivative gain on the angular velocity lengthens its lag",
        wheel_pd: &[],
        vw_pd: &["theta2"],
    },
];

pub(crate) fn finite(key: &str, value: f64) -> Result<(), ModelError> {
    require(key, value, value.is_finite(), "a finite number")
}

pub(crate) fn positive(key: &str, value: f64) -> Result<(), ModelError> {
    require(key, value, value.is_finite() && value > 0.0, "a number above zero")
}

fn not_negative(key: &str, value: f64) -> Result<(), ModelError> {
    require(key, value, value.is_finite() && value >= 0.0, "zero or a number above it")
}

fn require(key: &str, value: f64, holds: bool, what: &str) -> Result<(), ModelError> {
    if holds {
        return Ok(());
    }
    Err(ModelError::Config { key: key.to_owned(), reason: format!("must be {what}, not {value}") })
}

#[cfg(test)]
#[path = "physics_tests.rs"]
mod tests;
