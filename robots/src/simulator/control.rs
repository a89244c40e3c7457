//! The robot's low-level controller: from a set point and the motion to two motor voltages.

use serde::{Deserialize, Serialize};

use super::plant::{PlantConstants, Sides};

/// Which law closes the loop, in continuous time. Derivatives brake: they enter with a minus sign.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum ControlLaw {
    /// A loop on each wheel.
    WheelPd(WheelGains),
    /// Loops on the forward and the angular velocity.
    VwPd(VwGains),
}

/// u = kP (ω_w,ref − ω_w) − kD ω_w' for each wheel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WheelGains {
    /// kP \[V s/rad\].
    pub kp: f64,
    /// kD \[V s²/rad\].
    pub kd: f64,
}

/// u_v = kPT (v_ref − v) − kDT v' and u_ω = kPR (ω_ref − ω) − kDR ω'; the right motor gets u_v + u_ω, the left
/// u_v − u_ω.
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

/// What a low-level controller measures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Forward velocity \[m/s\].
    pub v: f64,
    /// Angular velocity \[rad/s\].
    pub omega: f64,
    /// Forward acceleration \[m/s²\].
    pub v_dot: f64,
    /// Angular acceleration \[rad/s²\].
    pub omega_dot: f64,
}

impl ControlLaw {
    /// Motor voltages \[V\] for a set point (v_ref, ω_ref).
    pub fn voltages(&self, c: &PlantConstants, [v_ref, omega_ref]: [f64; 2], motion: &Motion) -> Sides {
        match self {
            Self::WheelPd(gains) => {
                let wheels = |forward, turning| Sides::of_body(forward, turning, c.track_width, c.wheel_radius);
                let error = wheels(v_ref - motion.v, omega_ref - motion.omega);
                let acceleration = wheels(motion.v_dot, motion.omega_dot);
                Sides {
                    left: gains.kp * error.left - gains.kd * acceleration.left,
                    right: gains.kp * error.right - gains.kd * acceleration.right,
                }
            }
            Self::VwPd(gains) => {
                let forward = gains.kpt * (v_ref - motion.v) - gains.kdt * motion.v_dot;
                let turning = gains.kpr * (omega_ref - motion.omega) - gains.kdr * motion.omega_dot;
                Sides { left: forward - turning, right: forward + turning }
            }
        }
    }

    /// Gains by key: (name, value, true if it must not be zero).
    pub(super) fn gains(&self) -> Vec<(&'static str, f64, bool)> {
        match self {
            Self::WheelPd(g) => vec![("controller.wheel-pd.kp", g.kp, true), ("controller.wheel-pd.kd", g.kd, false)],
            Self::VwPd(g) => vec![
                ("controller.vw-pd.kpt", g.kpt, true),
                ("controller.vw-pd.kdt", g.kdt, false),
                ("controller.vw-pd.kpr", g.kpr, true),
                ("controller.vw-pd.kdr", g.kdr, false),
            ],
        }
    }
}
