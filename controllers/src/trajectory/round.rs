//! Circle and line at constant speed.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};
use wheelwright_core::trajectory::{Envelope, Reference, Trajectory, TrajectoryConfig, TrajectoryError};

use super::{nonzero, positive};

/// A circle from the origin, heading along x: to the left for a positive radius, to the right for a negative one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Circle {
    /// Radius \[m\].
    pub radius: f64,
    /// Speed \[m/s\].
    pub speed: f64,
}

#[typetag::serde(name = "circle")]
impl TrajectoryConfig for Circle {
    fn about(&self) -> String {
        "a circle at constant speed, to the left or, with a negative radius, to the right".to_owned()
    }

    fn build(&self, _envelope: &Envelope) -> Result<Box<dyn Trajectory>, TrajectoryError> {
        nonzero("radius", self.radius)?;
        positive("speed", self.speed)?;
        Ok(Box::new(self.clone()))
    }
}

impl Trajectory for Circle {
    fn duration(&self) -> f64 {
        TAU * self.radius.abs() / self.speed
    }

    fn at(&self, t: f64) -> Reference {
        let omega = self.speed / self.radius;
        let phi = omega * t;
        let (sin, cos) = phi.sin_cos();
        Reference { x: self.radius * sin, y: self.radius * (1.0 - cos), phi, v: self.speed, omega, ..Reference::default() }
    }
}

/// A straight line from the origin along x at constant speed; it does not end, its duration is that of `length`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Line {
    /// Length \[m\].
    pub length: f64,
    /// Speed \[m/s\].
    pub speed: f64,
}

#[typetag::serde(name = "line")]
impl TrajectoryConfig for Line {
    fn about(&self) -> String {
        "a straight line at constant speed".to_owned()
    }

    fn build(&self, _envelope: &Envelope) -> Result<Box<dyn Trajectory>, TrajectoryError> {
        positive("length", self.length)?;
        positive("speed", self.speed)?;
        Ok(Box::new(self.clone()))
    }
}

impl Trajectory for Line {
    fn duration(&self) -> f64 {
        self.length / self.speed
    }

    fn at(&self, t: f64) -> Reference {
        Reference { x: self.speed * t, v: self.speed, ..Reference::default() }
    }
}
