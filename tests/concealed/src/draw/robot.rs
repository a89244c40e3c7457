//! Robots: like a Pioneer, like a Khepera, or any. Nothing is hidden in them: ideal rolling, no dry friction, symmetric.

use super::{log_uniform, pick, sign};
use crate::firmware::Firmware;
use crate::firmware::control::{Control, Style};
use crate::firmware::link::Link;
use crate::firmware::setpoint::Shaping;
use crate::plant::bearing::Bearing;
use crate::plant::body::Body;
use crate::plant::contact::Contact;
use crate::plant::motor::{Battery, Motor};
use crate::plant::surroundings::Surroundings;
use crate::plant::{Rig, Wheel};
use crate::sensors::{Sensors, Source};
use rand::Rng;

/// Kinds of robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Like a Pioneer 3-DX.
    Pioneer,
    /// Like a Khepera III.
    Khepera,
    /// Anything from half a kilogram to a hundred.
    Random,
}

impl Kind {
    /// The word the key uses.
    pub fn word(self) -> &'static str {
        match self {
            Kind::Pioneer => "pioneer",
            Kind::Khepera => "khepera",
            Kind::Random => "random",
        }
    }
}

/// A robot with its firmware and sensors, and the scales it lives on.
#[derive(Clone, Debug, PartialEq)]
pub struct Machine {
    /// Its matter.
    pub rig: Rig,
    /// Its firmware.
    pub firmware: Firmware,
    /// Its sensors.
    pub sensors: Sensors,
    /// Typical forward \[m/s\] and turning speed \[rad/s\].
    pub typical: [f64; 2],
    /// Force per forward speed error \[N s/m\] and yaw torque per turning speed error \[N m s/rad\] of the servo.
    pub servo: [f64; 2],
    /// Mass with what turns with it \[kg\], yaw inertia about the axle likewise \[kg m²\].
    pub moved: [f64; 2],
    /// Force per forward speed \[N s/m\] and yaw torque per turning speed \[N m s/rad\] that back-EMF and bearings cost.
    pub drag: [f64; 2],
    /// Which kind it is.
    pub kind: Kind,
}

/// Share of the yaw servo's stiffness that a robot's own middle of mass may take at speed.
const STEADY: f64 = 0.25;

/// Fastest forward set-point over the typical one.
const FASTEST: f64 = 1.6;

/// What a robot is drawn with.
struct Scale {
    mass: f64,
    half_track: f64,
    radius: f64,
    typical: [f64; 2],
    time: [f64; 2],
    style: Style,
}

fn scale<R: Rng>(kind: Kind, rng: &mut R) -> Scale {
    match kind {
        Kind::Pioneer => Scale {
            mass: rng.random_range(8.5..10.0),
            half_track: 0.17,
            radius: 0.0975,
            typical: [0.4, 0.75],
            time: [rng.random_range(0.19..0.27), rng.random_range(0.17..0.25)],
            style: Style::Twist,
        },
        Kind::Khepera => Scale {
            mass: rng.random_range(0.69..0.80),
            half_track: 0.0445,
            radius: 0.0205,
            typical: [0.1, 1.0],
            time: [rng.random_range(0.05..0.09), rng.random_range(0.05..0.12)],
            style: Style::Wheels,
        },
        Kind::Random => {
            let mass = log_uniform(rng, 0.5, 100.0);
            let half_track = 0.07 * mass.cbrt() * rng.random_range(0.8..1.25);
            let v = log_uniform(rng, 2.0, 6.0) * half_track;
            let forward = log_uniform(rng, 0.05, 0.5);
            Scale {
                mass,
                half_track,
                radius: half_track * rng.random_range(0.35..0.75),
                typical: [v, rng.random_range(0.3..0.55) * v / half_track],
                time: [forward, (forward * rng.random_range(0.6..1.6)).clamp(0.05, 0.5)],
                style: *pick(rng, &[Style::Wheels, Style::Twist, Style::Twist, Style::Open]),
            }
        }
    }
}

impl Machine {
    /// Draws a robot; `style` overrides what its kind would have.
    pub fn draw<R: Rng>(kind: Kind, style: Option<Style>, rng: &mut R) -> Machine {
        let mut scale = scale(kind, rng);
        scale.style = style.unwrap_or(scale.style);
        let Scale { mass, half_track, radius, typical, time, style } = scale;
        let rim_mass = mass * rng.random_range(0.03..0.15);
        let gyration = half_track * rng.random_range(0.7..1.15);
        // At speed, a middle of mass behind the axle works against the servo; far enough behind, the robot would spin.
        let softest = if style == Style::Twist { gyration * gyration / time[1] } else { half_track * half_track / time[0] };
        let forward = rng.random_range(-1.0..1.0) * (0.3 * half_track).min(STEADY * softest / (FASTEST * typical[0]));
        let body = Body { mass, inertia: mass * gyration * gyration, forward, left: 0.0 };
        let moved = [mass + 2.0 * rim_mass, body.matrix()[1][1] + 2.0 * half_track * half_track * rim_mass];

        let push = moved[0] / time[0];
        let turn = if style == Style::Twist { moved[1] / time[1] } else { push * half_track * half_track };
        let no_load = 2.5 * (typical[0] + half_track * typical[1]) / radius;
        let back_emf = pick(rng, &[7.2, 12.0, 24.0]) / no_load;
        // Losses over servo stiffness: what keeps a loop without integral from its set-point, or all there is without a loop.
        let losses = if style == Style::Open { rng.random_range(0.95..1.1) } else { rng.random_range(0.01..0.12) };
        let electric = rng.random_range(0.6..0.95);
        let gain = back_emf / (electric * losses * radius);
        let resistance = 2.0 * back_emf * gain / (push * radius);
        let viscous = (1.0 - electric) * losses * push * radius * radius / 2.0;
        let drag = losses * push;

        let motor = Motor {
            torque_constant: back_emf,
            back_emf,
            resistance,
            electric_time: 0.0,
            current_limit: f64::INFINITY,
            voltage_limit: f64::INFINITY,
            voltage_lost: 0.0,
            amplifier: 1.0,
            cogging: (0.0, 1.0),
        };
        let bearing = Bearing { viscous, ..Bearing::FREE };
        let wheel = Wheel {
            radius,
            eccentricity: 0.0,
            lobes: 1.0,
            phase: 0.0,
            inertia: rim_mass * radius * radius,
            bearing,
            contact: Contact::Rolling,
        };
        let rig = Rig {
            body,
            wheels: [wheel; 2],
            motors: [motor; 2],
            half_track,
            battery: Battery::STIFF,
            rolling_resistance: 0.0,
            third_wheel: if forward == 0.0 { 0.0 } else { sign_of(forward) * rng.random_range(1.1..1.6) * half_track },
            gear: None,
            dragging_ball: None,
            castor: None,
            scrub: None,
            load: None,
            lifted: None,
            surroundings: Surroundings::default(),
            soft_speed: 0.01 * typical[0],
        };
        let control = Control {
            style,
            gain: [gain, turn * resistance * radius / (2.0 * half_track * half_track * back_emf)],
            rate_gain: 0.0,
            integral: [0.0; 2],
            windup: f64::INFINITY,
        };
        let firmware = Firmware { link: Link::default(), shaping: Shaping::default(), control, radius, half_track, period: 5e-4 };
        let source = if rng.random::<f64>() < 0.6 { Source::Body } else { Source::Wheels };
        let mut machine = Machine {
            rig,
            firmware,
            sensors: Sensors::ideal(source, radius, half_track),
            typical,
            servo: [push, turn],
            moved,
            drag: [drag, drag * half_track * half_track],
            kind,
        };
        if style != Style::Open && rng.random::<f64>() < 0.4 {
            machine.damp_by_rate(rng.random_range(0.03..0.12));
        }
        if rng.random::<bool>() {
            machine.typical[1] *= sign(rng);
        }
        machine
    }

    /// Gives the loop a derivative part that weighs as much as `share` of the mass.
    fn damp_by_rate(&mut self, share: f64) {
        let motor = &self.rig.motors[0];
        let radius = self.firmware.radius;
        let extra = share * self.moved[0];
        self.firmware.control.rate_gain = extra * motor.resistance * radius / (2.0 * motor.torque_constant);
        self.moved[0] += extra;
        self.moved[1] += extra * self.firmware.half_track * self.firmware.half_track;
    }

    /// Largest moment of mass about the axle \[kg m\] at which `share` of the yaw servo's stiffness is at most lost at speed.
    pub fn steady_moment(&self, share: f64) -> f64 {
        share * self.servo[1] / (FASTEST * self.typical[0])
    }

    /// Forward and yaw time constants \[s\] of the servo.
    pub fn times(&self) -> [f64; 2] {
        [self.moved[0] / self.servo[0], self.moved[1] / self.servo[1]]
    }
}

fn sign_of(x: f64) -> f64 {
    if x < 0.0 { -1.0 } else { 1.0 }
}
