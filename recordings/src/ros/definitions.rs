//! Definitions of the message types that are written, in the form in which ROS 2 embeds them: the type itself, then every
//! type that it is made of. Programs that open the file decode by these.

macro_rules! part {
    ($name:literal, $fields:literal) => {
        concat!("================================================================================\nMSG: ", $name, "\n", $fields)
    };
}

macro_rules! vector3 {
    () => {
        part!("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n")
    };
}

macro_rules! twist_fields {
    () => {
        "Vector3 linear\nVector3 angular\n"
    };
}

/// `geometry_msgs/msg/Twist`.
pub(crate) const TWIST: &str = concat!(twist_fields!(), vector3!());

/// `nav_msgs/msg/Odometry`.
pub(crate) const ODOMETRY: &str = concat!(
    "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist\n",
    part!("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"),
    part!("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n"),
    part!("geometry_msgs/PoseWithCovariance", "Pose pose\nfloat64[36] covariance\n"),
    part!("geometry_msgs/Pose", "Point position\nQuaternion orientation\n"),
    part!("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"),
    part!("geometry_msgs/Quaternion", "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n"),
    part!("geometry_msgs/TwistWithCovariance", "Twist twist\nfloat64[36] covariance\n"),
    "================================================================================\nMSG: geometry_msgs/Twist\n",
    twist_fields!(),
    vector3!(),
);
