//! ROS 2 robots: velocity commands out, odometry in, by DDS and without an installation of ROS.
//!
//! One idea: the robot sets the pace. A command goes out when odometry has come, and the next odometry is its answer; time
//! is what the robot stamped it with. Layers: `message` are the contents, `node` carries them, `graph` knows who is there
//! and what does not fit, `timeline` gives a time, `driver` drives.
//!
//! Everything but the configuration needs the Cargo feature `ros2`.

mod config;
#[cfg(feature = "ros2")]
mod driver;
#[cfg(feature = "ros2")]
pub(crate) mod graph;
#[cfg(feature = "ros2")]
pub(crate) mod message;
#[cfg(feature = "ros2")]
pub(crate) mod node;
#[cfg(feature = "ros2")]
mod timeline;

#[cfg(not(feature = "ros2"))]
pub(crate) use config::without_feature;
pub(crate) use config::{COMMAND_TOPIC, Network, ODOMETRY_TOPIC, check_topic};
pub use config::{CommandType, Ros2Config, TimeSource};
