//! The floor a robot may use: a rectangle about its starting pose, left as little as its stopping distance allows.
//!
//! Before each command it is asked where the robot would come to rest if it were told to stop one cycle later: along the arc it
//! drives now, and along the arc it is about to be told to drive, first for the reaction time at full speed and then braking.
//! If either leaves the rectangle, the robot is stopped now.

use serde::{Deserialize, Serialize};

use crate::channel::{Channel, OMEGA_REF, PHI, V_REF, X, Y};

/// Points at which a stopping arc is looked at.
const POINTS: usize = 24;
/// Braking assumed where none is given \[m/s²\]: the default ramp of the slowest robot known to us.
const BRAKING: f64 = 0.3;
/// Control cycles between a decision to stop and the beginning of braking: the one in which the command is still held, and
/// the one in which it travels.
const REACTION_CYCLES: f64 = 2.0;

/// A rectangle about the pose at the start of the drive: x along the heading then, y to its left.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Floor {
    /// From and to \[m\].
    pub x: [f64; 2],
    /// From and to \[m\].
    pub y: [f64; 2],
    /// Kept free along every side \[m\], for the robot's own size.
    #[serde(default)]
    pub margin: f64,
    /// Deceleration of the robot when told to stop \[m/s²\]; that of its limits, or 0.3, if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub deceleration: Option<f64>,
    /// How late the robot begins to brake \[s\], beyond two control cycles.
    #[serde(default)]
    pub reaction: f64,
}

/// Where a robot would leave its floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leaving {
    /// Where it is \[m\], on the floor's axes.
    pub at: [f64; 2],
    /// Where it would come to rest, or leave at the latest \[m\].
    pub rest: [f64; 2],
    /// Length of the stopping arc \[m\].
    pub distance: f64,
}

/// Watches a robot's pose on a floor.
#[derive(Debug, Clone)]
pub struct FloorWatch {
    floor: Floor,
    deceleration: f64,
    delay: f64,
    pose: [usize; 3],
    speed: [Option<usize>; 2],
    command: [Option<usize>; 2],
    /// Pose of the first row.
    origin: Option<[f64; 3]>,
}

impl Floor {
    /// What is impossible about the rectangle, if anything: key and reason.
    pub fn flaw(&self) -> Option<(&'static str, String)> {
        for (key, [from, to]) in [("x", self.x), ("y", self.y)] {
            if !(from.is_finite() && to.is_finite() && from < to) {
                return Some((key, format!("goes from {from} to {to}; the first must be the smaller number")));
            }
            let inside = from + self.margin < 0.0 && to - self.margin > 0.0;
            if !inside {
                return Some((key, format!("goes from {from} to {to} less the margin of {} m: the start, 0, is not inside", self.margin)));
            }
        }
        let positive =
            [("deceleration", self.deceleration.unwrap_or(1.0), false), ("margin", self.margin, true), ("reaction", self.reaction, true)];
        positive
            .into_iter()
            .find(|(_, value, zero)| !(value.is_finite() && (*value > 0.0 || (*zero && *value == 0.0))))
            .map(|(key, value, _)| (key, format!("is {value}; it must be a positive number")))
    }

    fn holds(&self, [x, y]: [f64; 2]) -> bool {
        let within = |value: f64, [from, to]: [f64; 2]| value >= from + self.margin && value <= to - self.margin;
        within(x, self.x) && within(y, self.y)
    }
}

impl FloorWatch {
    /// A watch over a robot with those channels and period; `None` if it does not measure its pose. `braking` is the
    /// deceleration used where the floor names none \[m/s²\].
    pub fn new(floor: Floor, braking: Option<f64>, period: f64, inputs: &[Channel], outputs: &[Channel]) -> Option<Self> {
        let place = |channels: &[Channel], name: &str| channels.iter().position(|c| c.name == name);
        let pose = [place(outputs, &X.name)?, place(outputs, &Y.name)?, place(outputs, &PHI.name)?];
        let speed = [place(outputs, "v"), place(outputs, "omega")];
        let command = [place(inputs, &V_REF.name), place(inputs, &OMEGA_REF.name)];
        let deceleration = floor.deceleration.or(braking).unwrap_or(BRAKING);
        let delay = floor.reaction + REACTION_CYCLES * period;
        Some(Self { floor, deceleration, delay, pose, speed, command, origin: None })
    }

    /// Looks at a row: the measurement and the command about to be held.
    pub fn check(&mut self, measured: &[f64], command: &[f64]) -> Option<Leaving> {
        let pose = self.pose.map(|i| measured[i]);
        let origin = *self.origin.get_or_insert(pose);
        let (sin, cos) = origin[2].sin_cos();
        let (dx, dy) = (pose[0] - origin[0], pose[1] - origin[1]);
        let at = [cos * dx + sin * dy, cos * dy - sin * dx];
        let heading = pose[2] - origin[2];
        let pick = |places: [Option<usize>; 2], values: &[f64]| places.map(|place| place.map_or(0.0, |i| values[i]));
        [pick(self.speed, measured), pick(self.command, command)]
            .into_iter()
            .filter_map(|[v, omega]| self.arc(at, heading, v, omega))
            .max_by(|a, b| a.distance.total_cmp(&b.distance))
    }

    /// The stopping arc, if it leaves the floor. Braking slows turning as it slows driving, so the curvature stays.
    fn arc(&self, at: [f64; 2], heading: f64, v: f64, omega: f64) -> Option<Leaving> {
        let distance = v.abs() * self.delay + v * v / (2.0 * self.deceleration);
        let curvature = if v == 0.0 { 0.0 } else { omega / v };
        let point = |share: f64| {
            let s = v.signum() * distance * share;
            // sin(κs)/κ and (1 − cos κs)/κ in a form that holds for κ = 0.
            let half = 0.5 * curvature * s;
            let chord = if half.abs() < 1e-9 { s } else { s * half.sin() / half };
            [at[0] + chord * (heading + half).cos(), at[1] + chord * (heading + half).sin()]
        };
        let leaves = (0..=POINTS).map(|k| point(k as f64 / POINTS as f64)).any(|p| !self.floor.holds(p));
        leaves.then(|| Leaving { at, rest: point(1.0), distance })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::channel::{OMEGA, V};

    const INPUTS: [Channel; 2] = [V_REF, OMEGA_REF];
    const OUTPUTS: [Channel; 5] = [V, OMEGA, X, Y, PHI];
    const FLOOR: Floor = Floor { x: [-1.0, 3.0], y: [-1.0, 1.0], margin: 0.25, deceleration: Some(0.5), reaction: 0.0 };

    fn watch() -> FloorWatch {
        FloorWatch::new(FLOOR, None, 0.1, &INPUTS, &OUTPUTS).unwrap()
    }

    #[test]
    fn straight_on_it_stops_where_braking_just_suffices() {
        // At 1 m/s: 0.2 m in two cycles and 1 m of braking, so x = 2.75 - 1.2 is the last place.
        let mut watch = watch();
        assert_eq!(watch.check(&[0.0, 0.0, 0.0, 0.0, 0.0], &[1.0, 0.0]), None);
        assert_eq!(watch.check(&[1.0, 0.0, 1.54, 0.0, 0.0], &[1.0, 0.0]), None);
        let leaving = watch.check(&[1.0, 0.0, 1.56, 0.0, 0.0], &[1.0, 0.0]).unwrap();
        assert!((leaving.rest[0] - 2.76).abs() < 1e-9 && (leaving.distance - 1.2).abs() < 1e-9, "{leaving:?}");
    }

    #[test]
    fn a_command_counts_before_the_robot_follows_it() {
        let mut watch = watch();
        watch.check(&[0.0; 5], &[0.0, 0.0]);
        assert!(watch.check(&[0.0, 0.0, 2.0, 0.0, 0.0], &[1.0, 0.0]).is_some());
        assert!(watch.check(&[0.0, 0.0, 2.0, 0.0, 0.0], &[-1.0, 0.0]).is_none(), "backwards there is room");
    }

    #[test]
    fn turning_on_the_spot_needs_no_room_and_an_arc_may_leave_by_the_side() {
        let mut watch = watch();
        watch.check(&[0.0; 5], &[0.0, 0.0]);
        assert!(watch.check(&[0.0, 2.0, 2.7, 0.0, 0.0], &[0.0, 2.0]).is_none());
        // A circle of 0.5 m to the left: the arc of 1.2 m goes up to y = 0.5 (1 - cos 2.4) = 0.87 > 0.75, and ends nearer.
        assert!(watch.check(&[1.0, 2.0, 0.0, 0.0, 0.0], &[1.0, 2.0]).is_some());
        assert!(watch.check(&[1.0, 2.0, 0.0, -0.2, 0.0], &[1.0, 2.0]).is_none());
    }

    #[test]
    fn the_floor_lies_about_the_pose_at_the_start() {
        let mut watch = watch();
        let quarter = std::f64::consts::FRAC_PI_2;
        assert!(watch.check(&[0.0, 0.0, 10.0, 20.0, quarter], &[0.0, 0.0]).is_none());
        // Forward was +y of the odometry: 1.56 m on is the limit there.
        assert!(watch.check(&[1.0, 0.0, 10.0, 21.54, quarter], &[1.0, 0.0]).is_none());
        assert!(watch.check(&[1.0, 0.0, 10.0, 21.56, quarter], &[1.0, 0.0]).is_some());
    }

    #[test]
    fn impossible_floors_name_their_key() {
        assert_eq!(FLOOR.flaw(), None);
        assert_eq!(Floor { x: [1.0, -1.0], ..FLOOR }.flaw().unwrap().0, "x");
        assert_eq!(Floor { y: [0.5, 2.0], ..FLOOR }.flaw().unwrap().0, "y");
        assert_eq!(Floor { margin: 1.0, ..FLOOR }.flaw().unwrap().0, "x");
        assert_eq!(Floor { deceleration: Some(0.0), ..FLOOR }.flaw().unwrap().0, "deceleration");
    }
}
