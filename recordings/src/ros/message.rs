//! The three message types that a drive log is made of, and what is taken from them.

use super::wire::{Encoding, Wire, WireError};

/// Message types that are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// `geometry_msgs/Twist`: a command without a stamp.
    Twist,
    /// `geometry_msgs/TwistStamped`: a command with one.
    TwistStamped,
    /// `nav_msgs/Odometry`: pose and velocity.
    Odometry,
}

impl Kind {
    /// The kind of a type name as ROS 2 (`nav_msgs/msg/Odometry`) or ROS 1 (`nav_msgs/Odometry`) spells it.
    pub(crate) fn of(type_name: &str) -> Option<Self> {
        match type_name.replace("/msg/", "/").as_str() {
            "geometry_msgs/Twist" => Some(Self::Twist),
            "geometry_msgs/TwistStamped" => Some(Self::TwistStamped),
            "nav_msgs/Odometry" => Some(Self::Odometry),
            _ => None,
        }
    }

    /// MD5 of the ROS 1 definition: another one means another layout under the same name.
    pub(crate) fn ros1_md5(self) -> &'static str {
        match self {
            Self::Twist => "9f195f881246fdfa2798d1d3eebca84a",
            Self::TwistStamped => "98d34b0043a2093cf9d9345ab6eef12e",
            Self::Odometry => "cd5e73d190d741a2f92e81eda573aca7",
        }
    }

    /// Decodes one message.
    pub(crate) fn decode(self, encoding: Encoding, message: &[u8]) -> Result<Motion, WireError> {
        let mut wire = Wire::new(encoding, message)?;
        let mut motion = Motion { stamp: None, v: 0.0, omega: 0.0, pose: Pose::default() };
        if self != Self::Twist {
            motion.stamp = Some(wire.header()?);
        }
        if self == Self::Odometry {
            wire.skip_text()?; // child_frame_id
            let [x, y, _] = wire.f64s()?;
            let orientation = wire.f64s()?;
            motion.pose = Pose { x, y, yaw: yaw(orientation) };
            wire.skip_f64s::<36>()?;
        }
        let [v, _, _, _, _, omega] = wire.f64s()?;
        (motion.v, motion.omega) = (v, omega);
        if self == Self::Odometry {
            wire.skip_f64s::<36>()?;
        }
        wire.end()?;
        Ok(motion)
    }
}

/// What is taken from a message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Motion {
    /// Header stamp \[ns\], where the type has a header.
    pub(crate) stamp: Option<i64>,
    /// Forward velocity, `linear.x` \[m/s\].
    pub(crate) v: f64,
    /// Yaw rate, `angular.z` \[rad/s\].
    pub(crate) omega: f64,
    /// Pose; zero for commands.
    pub(crate) pose: Pose,
}

/// Pose in the plane \[m, m, rad\].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Pose {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) yaw: f64,
}

/// Yaw of a quaternion (x, y, z, w) that need not have unit length; zero for the zero quaternion of an unset pose.
fn yaw([x, y, z, w]: [f64; 4]) -> f64 {
    (2.0 * (w * z + x * y)).atan2(w * w + x * x - y * y - z * z)
}
