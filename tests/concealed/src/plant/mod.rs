//! The robot as matter: every part in a room of its own, and [`Rig`], which holds them together.

pub mod bearing;
pub mod body;
pub mod castor;
pub mod contact;
pub mod gear;
pub mod motor;
pub mod solve;
pub mod step;
pub mod surroundings;

use bearing::Bearing;
use body::{Body, Load};
use castor::{Ball, Castor};
use contact::{Contact, Scrub};
use gear::Gear;
use motor::{Battery, Motor};
use surroundings::{GRAVITY, Surroundings};

/// Index of the left wheel in every pair.
pub const LEFT: usize = 0;
/// Index of the right wheel in every pair.
pub const RIGHT: usize = 1;

/// One wheel as it really is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wheel {
    /// Mean radius \[m\].
    pub radius: f64,
    /// Radius variation over a turn, as a share of the radius.
    pub eccentricity: f64,
    /// Periods of the variation per turn (1: off-centre, 2: oval).
    pub lobes: f64,
    /// Angle at which it begins \[rad\].
    pub phase: f64,
    /// Inertia of wheel and everything that turns with it, at the wheel \[kg m²\].
    pub inertia: f64,
    /// Bearing and gear friction.
    pub bearing: Bearing,
    /// Contact with the ground.
    pub contact: Contact,
}

impl Wheel {
    /// Radius that touches the ground at wheel angle `angle` \[m\].
    pub fn radius_at(&self, angle: f64) -> f64 {
        if self.eccentricity == 0.0 {
            return self.radius;
        }
        self.radius * (1.0 + self.eccentricity * (self.lobes * angle + self.phase).cos())
    }
}

/// Times during which a wheel hangs in the air (crossing a bump).
#[derive(Clone, Debug, PartialEq)]
pub struct Lifted {
    /// Which wheel.
    pub wheel: usize,
    /// Begin and end \[s\].
    pub during: Vec<(f64, f64)>,
}

/// A whole robot on its ground.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    /// The body.
    pub body: Body,
    /// Left and right wheel.
    pub wheels: [Wheel; 2],
    /// Left and right motor.
    pub motors: [Motor; 2],
    /// Half the true distance between the wheels \[m\].
    pub half_track: f64,
    /// The battery.
    pub battery: Battery,
    /// Rolling resistance coefficient of wheels and third wheel.
    pub rolling_resistance: f64,
    /// Where the third wheel stands, ahead of the axle \[m\] (negative: behind).
    pub third_wheel: f64,
    /// Gear play or a soft shaft, where there is one.
    pub gear: Option<Gear>,
    /// A ball that drags in place of a castor.
    pub dragging_ball: Option<Ball>,
    /// A swivelling castor that costs force.
    pub castor: Option<Castor>,
    /// Sideways scrub of four patches.
    pub scrub: Option<Scrub>,
    /// A load put on.
    pub load: Option<Load>,
    /// A wheel that is lifted at times.
    pub lifted: Option<Lifted>,
    /// Slope, carpet, air, pushes.
    pub surroundings: Surroundings,
    /// Speed below which "soft" laws of the ground bend \[m/s\].
    pub soft_speed: f64,
}

impl Rig {
    /// The body with what it carries at time `t`.
    pub fn body_at(&self, t: f64) -> Body {
        self.load.map_or(self.body, |load| load.carried(&self.body, t))
    }

    /// Normal loads `[left, right, third]` \[N\] of a body at rest on three points.
    pub fn normal_loads(&self, body: &Body) -> [f64; 3] {
        let weight = body.mass * GRAVITY;
        let third = if self.third_wheel == 0.0 { 0.0 } else { (body.forward / self.third_wheel).clamp(0.05, 0.6) };
        let axle = weight * (1.0 - third);
        let lean = (body.left / self.half_track).clamp(-0.9, 0.9);
        [0.5 * axle * (1.0 + lean), 0.5 * axle * (1.0 - lean), weight * third]
    }

    /// The drag of the third wheel as a ball, where rolling resistance is on.
    pub fn ball(&self, loads: &[f64; 3]) -> Option<Ball> {
        (self.rolling_resistance > 0.0).then(|| Ball {
            place: self.third_wheel,
            drag: self.rolling_resistance * loads[2],
            soft: self.soft_speed,
        })
    }

    /// Whether a wheel touches the ground at time `t`.
    pub fn touches(&self, wheel: usize, t: f64) -> bool {
        self.lifted.as_ref().is_none_or(|l| l.wheel != wheel || !l.during.iter().any(|&(from, to)| t >= from && t < to))
    }
}

/// Where everything is and how fast it moves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct State {
    /// Time \[s\].
    pub t: f64,
    /// Place of the axle's middle \[m\] and heading \[rad\].
    pub pose: (f64, f64, f64),
    /// Forward speed \[m/s\] and turning speed \[rad/s\] of the axle's middle.
    pub twist: [f64; 2],
    /// Yaw acceleration over the last step \[rad/s²\].
    pub turning: f64,
    /// Wheel speeds \[rad/s\].
    pub wheel: [f64; 2],
    /// Wheel angles \[rad\].
    pub angle: [f64; 2],
    /// Rotor speeds at the wheel's side of the gear \[rad/s\]; the wheel's own where nothing gives between them.
    pub rotor: [f64; 2],
    /// Rotor angles, likewise \[rad\].
    pub rotor_angle: [f64; 2],
    /// Winding currents \[A\].
    pub current: [f64; 2],
    /// Bristle deflections of the bearings \[rad\].
    pub bristle: [f64; 2],
    /// Swivel angle of the castor \[rad\] and its rate \[rad/s\].
    pub swivel: (f64, f64),
}

impl State {
    /// At rest at a heading.
    pub fn at_rest(t: f64, heading: f64) -> State {
        State { t, pose: (0.0, 0.0, heading), ..State::default() }
    }
}
