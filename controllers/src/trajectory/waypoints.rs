//! A course through points, from rest to rest, within the robot's limits.

use serde::{Deserialize, Serialize};
use wheelwright_core::trajectory::{Envelope, Reference, Trajectory, TrajectoryConfig, TrajectoryError, pace_within};

use super::jet::wrap;
use super::positive;
use super::spline::Spline;
use super::time_law::{Course, TimeLaw};

/// Places on the curve at which its speed limit is computed.
const PLACES: usize = 2000;

/// A smooth curve through points, run from rest to rest: bounded in speed, acceleration and, by its bends, in angular and
/// wheel speed. The robot's own limits apply where they are tighter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Waypoints {
    /// The points (x, y) \[m\], the first of them where the robot starts.
    pub points: Vec<[f64; 2]>,
    /// Largest speed \[m/s\].
    pub speed: f64,
    /// Largest change of speed \[m/s²\].
    pub acceleration: f64,
    /// Largest angular speed \[rad/s\]; the robot's by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angular_speed: Option<f64>,
    /// Largest angular acceleration \[rad/s²\]; the robot's by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angular_acceleration: Option<f64>,
}

/// The course as planned.
#[derive(Debug)]
struct Planned {
    spline: Spline,
    /// Heading at equally spaced places, not wrapped.
    heading: Vec<f64>,
    law: TimeLaw,
    /// Slows the whole until it is within every limit.
    pace: f64,
}

#[typetag::serde(name = "waypoints")]
impl TrajectoryConfig for Waypoints {
    fn about(&self) -> String {
        "a smooth curve through points, from rest to rest, within limits of speed, acceleration and wheel speed".to_owned()
    }

    fn build(&self, envelope: &Envelope) -> Result<Box<dyn Trajectory>, TrajectoryError> {
        self.check()?;
        let envelope = self.tightened(envelope);
        let spline = Spline::through(&self.points);
        let spacing = spline.end() / PLACES as f64;
        let places: Vec<Place> = (0..=PLACES).map(|i| Place::on(&spline, spacing * i as f64)).collect();
        let typical = places.iter().map(|p| p.stretch).sum::<f64>() / places.len() as f64;
        if let Some(i) = places.iter().position(|p| p.stretch < 1e-3 * typical) {
            let (x, y) = (places[i].at[0], places[i].at[1]);
            return Err(TrajectoryError::config("points", format!("the curve turns on the spot near ({x:.3}, {y:.3}): add a point there")));
        }
        let stretch: Vec<f64> = places.iter().map(|p| p.stretch).collect();
        let speed: Vec<f64> = places.iter().map(|p| p.speed_limit(&envelope)).collect();
        let law = TimeLaw::along(&Course { spacing, stretch: &stretch, speed: &speed, acceleration: self.acceleration });
        let mut heading: Vec<f64> = Vec::with_capacity(places.len());
        for place in &places {
            heading.push(heading.last().map_or(place.heading, |last| last + wrap(place.heading - last)));
        }
        let planned = Planned { spline, heading, law, pace: 1.0 };
        let pace = pace_within(&planned, planned.duration(), &envelope, 1.0);
        Ok(Box::new(Planned { pace, ..planned }))
    }
}

impl Waypoints {
    fn check(&self) -> Result<(), TrajectoryError> {
        if self.points.len() < 2 {
            return Err(TrajectoryError::config("points", format!("needs at least two points, has {}", self.points.len())));
        }
        if let Some(i) = self.points.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            return Err(TrajectoryError::config("points", format!("point {} is not a pair of finite numbers", i + 1)));
        }
        if let Some(i) = self.points.windows(2).position(|p| p[0] == p[1]) {
            return Err(TrajectoryError::config("points", format!("points {} and {} are the same place", i + 1, i + 2)));
        }
        positive("speed", self.speed)?;
        positive("acceleration", self.acceleration)?;
        self.angular_speed.map_or(Ok(()), |w| positive("angular_speed", w))?;
        self.angular_acceleration.map_or(Ok(()), |w| positive("angular_acceleration", w))
    }

    /// The robot's envelope with these settings where they are tighter.
    fn tightened(&self, envelope: &Envelope) -> Envelope {
        let tighter = |own: Option<f64>, robot: Option<f64>| match (own, robot) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        };
        let mut limits = envelope.limits;
        limits.v = tighter(Some(self.speed), limits.v);
        limits.v_dot = tighter(Some(self.acceleration), limits.v_dot);
        limits.omega = tighter(self.angular_speed, limits.omega);
        limits.omega_dot = tighter(self.angular_acceleration, limits.omega_dot);
        Envelope { limits, ..*envelope }
    }
}

/// The curve at one place.
struct Place {
    at: [f64; 2],
    /// |dp/du|.
    stretch: f64,
    heading: f64,
    /// κ \[1/m\].
    curvature: f64,
    /// dκ/du.
    curvature_slope: f64,
    /// d|dp/du|/du.
    stretch_slope: f64,
}

impl Place {
    fn on(spline: &Spline, u: f64) -> Self {
        let [x, y] = spline.at(u);
        let stretch = x[1].hypot(y[1]);
        let along = x[1] * x[2] + y[1] * y[2];
        let turning = x[1] * y[2] - y[1] * x[2];
        let cube = stretch.powi(3);
        Self {
            at: [x[0], y[0]],
            stretch,
            heading: y[1].atan2(x[1]),
            curvature: turning / cube,
            curvature_slope: (x[1] * y[3] - y[1] * x[3]) / cube - 3.0 * turning * along / (cube * stretch * stretch),
            stretch_slope: along / stretch,
        }
    }

    /// The speed at which the tightest of the limits on v, ω and the wheels is reached.
    fn speed_limit(&self, envelope: &Envelope) -> f64 {
        let unit = Reference { v: 1.0, omega: self.curvature, ..Reference::default() };
        1.0 / envelope.shares(&unit).into_iter().fold(f64::MIN_POSITIVE, f64::max)
    }
}

impl Trajectory for Planned {
    fn duration(&self) -> f64 {
        self.law.duration() / self.pace
    }

    fn at(&self, t: f64) -> Reference {
        let [u, u_dot, u_ddot] = self.law.at(t * self.pace);
        let (u_dot, u_ddot) = (u_dot * self.pace, u_ddot * self.pace * self.pace);
        let place = Place::on(&self.spline, u);
        let (v, v_dot) = (place.stretch * u_dot, place.stretch_slope * u_dot * u_dot + place.stretch * u_ddot);
        let near = self.heading[((u / self.spline.end() * PLACES as f64).round() as usize).min(PLACES)];
        Reference {
            x: place.at[0],
            y: place.at[1],
            phi: near + wrap(place.heading - near),
            v,
            omega: place.curvature * v,
            v_dot,
            omega_dot: place.curvature_slope * u_dot * v + place.curvature * v_dot,
        }
    }
}

#[cfg(test)]
mod tests {
    use wheelwright_core::profile::Limits;
    use wheelwright_core::trajectory::peaks;

    use super::*;

    #[test]
    fn a_course_keeps_every_limit_and_uses_one() {
        let limits = Limits { v: Some(1.2), omega: Some(1.5), wheel_speed: Some(9.0), omega_dot: Some(4.0), ..Limits::default() };
        let envelope = Envelope { limits, track_width: Some(0.34), wheel_radius: Some(0.0975) };
        let points = vec![[0.0, 0.0], [2.0, 0.2], [2.5, 1.5], [1.0, 2.0], [-1.0, 0.5]];
        let course = Waypoints { points, speed: 0.8, acceleration: 0.5, angular_speed: None, angular_acceleration: None };
        let planned = course.build(&envelope).unwrap();
        let shares = peaks(&*planned, planned.duration(), &course.tightened(&envelope));
        let most = shares.into_iter().fold(0.0, f64::max);
        assert!(most < 1.0 + 1e-9 && most > 0.95, "{shares:?}");
        let (begin, end) = (planned.at(0.0), planned.at(planned.duration() + 1.0));
        assert!(begin.x.hypot(begin.y) < 1e-12 && begin.v == 0.0);
        assert!((end.x + 1.0).abs() < 1e-9 && (end.y - 0.5).abs() < 1e-9 && end.v == 0.0);
        assert!(planned.duration() < 25.0, "{}", planned.duration());
    }

    #[test]
    fn impossible_points_are_named() {
        let course =
            |points: Vec<[f64; 2]>| Waypoints { points, speed: 1.0, acceleration: 1.0, angular_speed: None, angular_acceleration: None };
        let refused = |points| course(points).build(&Envelope::default()).unwrap_err().to_string();
        assert!(refused(vec![[0.0, 0.0]]).contains("at least two points"));
        assert!(refused(vec![[0.0, 0.0], [1.0, 0.0], [1.0, 0.0]]).contains("points 2 and 3 are the same place"));
        assert!(refused(vec![[0.0, 0.0], [f64::NAN, 0.0]]).contains("point 2"));
    }
}
