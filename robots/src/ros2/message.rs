//! The messages of velocity commands and odometry, field by field as ROS 2 defines them (geometry_msgs, nav_msgs, std_msgs).

use serde::{Deserialize, Serialize};

use super::CommandType;

/// Nanoseconds a second.
const SECOND: i64 = 1_000_000_000;

/// A message of a ROS 2 type.
pub(crate) trait Typed: Serialize + for<'de> Deserialize<'de> + 'static {
    /// Package and name.
    const TYPE: (&'static str, &'static str);
}

/// The name of a type as ROS 2 writes it, as in `geometry_msgs/msg/Twist`.
pub(crate) fn type_name<M: Typed>() -> String {
    let (package, name) = M::TYPE;
    format!("{package}/msg/{name}")
}

impl CommandType {
    /// The type's name as ROS 2 writes it.
    pub(crate) fn name(self) -> String {
        match self {
            Self::Twist => type_name::<Twist>(),
            Self::TwistStamped => type_name::<TwistStamped>(),
        }
    }
}

/// `builtin_interfaces/msg/Time`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub(crate) struct Time {
    sec: i32,
    nanosec: u32,
}

impl Time {
    /// Nanoseconds since the clock's zero.
    pub(crate) fn nanoseconds(self) -> i64 {
        i64::from(self.sec) * SECOND + i64::from(self.nanosec)
    }

    /// The time of so many nanoseconds; the last one there is if they are too many.
    pub(crate) fn from_nanoseconds(nanoseconds: i64) -> Self {
        let (sec, nanosec) = (nanoseconds.div_euclid(SECOND), nanoseconds.rem_euclid(SECOND));
        i32::try_from(sec).map_or(Self { sec: i32::MAX, nanosec: 0 }, |sec| Self { sec, nanosec: nanosec as u32 })
    }
}

/// `std_msgs/msg/Header`
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct Header {
    pub stamp: Time,
    pub frame_id: String,
}

/// `geometry_msgs/msg/Vector3` and `geometry_msgs/msg/Point`, which are alike on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct Vector3 {
    pub x: f64,
    pub y: f64,
    pub z: f64,
}

/// `geometry_msgs/msg/Quaternion`
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Quaternion {
    pub x: f64,
    pub y: f64,
    pub z: f64,
    pub w: f64,
}

impl Quaternion {
    /// A turn about the vertical \[rad\].
    pub(crate) fn of_yaw(yaw: f64) -> Self {
        let (z, w) = (0.5 * yaw).sin_cos();
        Self { x: 0.0, y: 0.0, z, w }
    }

    /// The turn about the vertical \[rad\], from −π to π.
    pub(crate) fn yaw(self) -> f64 {
        let Self { x, y, z, w } = self;
        (2.0 * (w * z + x * y)).atan2(w * w + x * x - y * y - z * z)
    }
}

/// `geometry_msgs/msg/Twist`
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct Twist {
    pub linear: Vector3,
    pub angular: Vector3,
}

impl Typed for Twist {
    const TYPE: (&'static str, &'static str) = ("geometry_msgs", "Twist");
}

impl Twist {
    /// v \[m/s\] ahead and ω \[rad/s\] about the vertical.
    pub(crate) fn planar([v, omega]: [f64; 2]) -> Self {
        Self { linear: Vector3 { x: v, ..Vector3::default() }, angular: Vector3 { z: omega, ..Vector3::default() } }
    }

    /// v \[m/s\] and ω \[rad/s\].
    pub(crate) fn velocity(&self) -> [f64; 2] {
        [self.linear.x, self.angular.z]
    }
}

/// `geometry_msgs/msg/TwistStamped`
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct TwistStamped {
    pub header: Header,
    pub twist: Twist,
}

impl Typed for TwistStamped {
    const TYPE: (&'static str, &'static str) = ("geometry_msgs", "TwistStamped");
}

/// `geometry_msgs/msg/Pose`
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Pose {
    pub position: Vector3,
    pub orientation: Quaternion,
}

/// A covariance of x, y, z and the turns about them, row by row.
type Covariance = [[f64; 6]; 6];

/// `geometry_msgs/msg/PoseWithCovariance`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct PoseWithCovariance {
    pub pose: Pose,
    pub covariance: Covariance,
}

/// `geometry_msgs/msg/TwistWithCovariance`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct TwistWithCovariance {
    pub twist: Twist,
    pub covariance: Covariance,
}

/// `nav_msgs/msg/Odometry`; the twist is in the child frame, which is the robot's own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Odometry {
    pub header: Header,
    pub child_frame_id: String,
    pub pose: PoseWithCovariance,
    pub twist: TwistWithCovariance,
}

impl Typed for Odometry {
    const TYPE: (&'static str, &'static str) = ("nav_msgs", "Odometry");
}

impl Odometry {
    /// Odometry on a plane, with covariances that say nothing: x, y \[m\], φ \[rad\]; v \[m/s\], ω \[rad/s\].
    pub(crate) fn planar(stamp: Time, [x, y, phi]: [f64; 3], velocity: [f64; 2]) -> Self {
        let pose = Pose { position: Vector3 { x, y, z: 0.0 }, orientation: Quaternion::of_yaw(phi) };
        let covariance = Covariance::default();
        Self {
            header: Header { stamp, frame_id: "odom".to_owned() },
            child_frame_id: "base_link".to_owned(),
            pose: PoseWithCovariance { pose, covariance },
            twist: TwistWithCovariance { twist: Twist::planar(velocity), covariance },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_and_turns_come_back() {
        for nanoseconds in [0, 1, -1, 1_500_000_000, -2_500_000_000, i64::from(i32::MAX) * SECOND] {
            assert_eq!(Time::from_nanoseconds(nanoseconds).nanoseconds(), nanoseconds);
        }
        assert_eq!(Time::from_nanoseconds(i64::MAX).sec, i32::MAX);
        for yaw in [0.0, 1.0, -3.0, 3.1] {
            assert!((Quaternion::of_yaw(yaw).yaw() - yaw).abs() < 1e-12);
        }
    }
}
