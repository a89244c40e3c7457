//! What can be hidden in a robot: each effect of the contract as a change of its matter, firmware or sensors, with a strength.
//!
//! Strength 1 is strong on a scale common to all robots: magnitudes are taken relative to the robot's typical speeds and to the stiffness of
//! its servo, then turned into newtons, metres, seconds or volts of the robot at hand.

pub mod build;
pub mod command;
pub mod equivalents;
pub mod forms;
pub mod friction;
pub mod measuring;
pub mod outside;
pub mod power;
pub mod resistance;

use crate::draw::robot::Machine;
use crate::firmware::Command;
use crate::plant::{LEFT, RIGHT};
use crate::sensors::Source;
use rand::Rng;
use rand::rngs::StdRng;
use serde_json::{Map, Value};

/// Magnitudes and places that go into the key.
pub type Parameters = Map<String, Value>;

/// Changes a robot to hide an effect in it.
pub type Hide = fn(&mut Subject, &mut StdRng) -> Parameters;

/// An effect of the contract.
#[derive(Clone, Copy, Debug)]
pub struct Effect {
    /// Its name.
    pub name: &'static str,
    /// Parts of the robot it takes; two effects that take the same part are never combined.
    pub takes: &'static [&'static str],
    /// Where speeds must be measured for it to show.
    pub seen: Option<Source>,
    /// How it is hidden.
    pub hide: Hide,
}

/// All effects of the contract's section 5, in its order.
pub const EFFECTS: [Effect; 29] = [
    Effect { name: "coulomb_friction", takes: &["dry"], seen: None, hide: friction::coulomb },
    Effect { name: "coulomb_friction_one_wheel", takes: &["dry"], seen: None, hide: friction::one_wheel },
    Effect { name: "stribeck_friction", takes: &["dry"], seen: None, hide: friction::stribeck },
    Effect { name: "rolling_resistance", takes: &["dry"], seen: None, hide: friction::rolling },
    Effect { name: "viscous_asymmetry", takes: &["side"], seen: None, hide: friction::viscous_asymmetry },
    Effect { name: "direction_asymmetry", takes: &["dry"], seen: None, hide: friction::direction },
    Effect { name: "quadratic_drag", takes: &["air"], seen: None, hide: resistance::quadratic },
    Effect { name: "dead_zone", takes: &["small"], seen: None, hide: command::dead_zone },
    Effect { name: "velocity_saturation", takes: &["large"], seen: None, hide: command::velocity_saturation },
    Effect { name: "slew_limit", takes: &["ramp"], seen: None, hide: command::slew_limit },
    Effect { name: "torque_saturation", takes: &["ramp", "torque"], seen: None, hide: power::torque_saturation },
    Effect { name: "command_delay", takes: &["late"], seen: None, hide: command::delay },
    Effect { name: "actuator_lag", takes: &["late"], seen: None, hide: command::lag },
    Effect { name: "integral_action", takes: &["integral"], seen: None, hide: command::integral },
    Effect { name: "gain_asymmetry", takes: &["side"], seen: None, hide: command::gain_asymmetry },
    Effect { name: "wheel_radius_mismatch", takes: &["side"], seen: Some(Source::Body), hide: build::radius_mismatch },
    Effect { name: "track_width_error", takes: &["track"], seen: Some(Source::Body), hide: build::track_error },
    Effect { name: "lateral_com_offset", takes: &["mass"], seen: None, hide: build::lateral_com },
    Effect { name: "wheel_slip", takes: &["ground"], seen: Some(Source::Body), hide: build::slip },
    Effect { name: "turning_scrub", takes: &["scrub"], seen: None, hide: resistance::scrub },
    Effect { name: "castor_drag", takes: &["castor"], seen: None, hide: resistance::castor },
    Effect { name: "slope", takes: &["slope"], seen: None, hide: resistance::slope },
    Effect { name: "payload_change", takes: &["mass", "time"], seen: None, hide: build::payload },
    Effect { name: "battery_sag", takes: &["time"], seen: None, hide: power::sag },
    Effect { name: "backlash", takes: &["gear"], seen: None, hide: build::backlash },
    Effect { name: "wheel_eccentricity", takes: &["round"], seen: Some(Source::Body), hide: build::eccentricity },
    Effect { name: "encoder_quantisation", takes: &["late", "stamps"], seen: Some(Source::Wheels), hide: measuring::quantisation },
    Effect { name: "timestamp_jitter", takes: &["stamps"], seen: None, hide: measuring::jitter },
    Effect { name: "sensor_delay", takes: &["late"], seen: None, hide: measuring::delay },
];

/// The effect of a name.
pub fn effect(name: &str) -> Option<&'static Effect> {
    EFFECTS.iter().find(|e| e.name == name)
}

/// Whether two effects can be hidden together.
pub fn combine(a: &Effect, b: &Effect) -> bool {
    let seen_alike = a.seen.is_none() || b.seen.is_none() || a.seen == b.seen;
    seen_alike && !a.takes.iter().any(|part| b.takes.contains(part))
}

/// A robot about to be changed, and what it will be asked to do.
pub struct Subject<'a> {
    /// The robot.
    pub machine: &'a mut Machine,
    /// How strongly.
    pub strength: f64,
    /// Begin and end of the first recording \[s\].
    pub span: (f64, f64),
    /// End of everything that will be driven \[s\].
    pub until: f64,
    /// Spacing of its rows \[s\].
    pub row: f64,
    /// What the first recording asks of an ideal robot.
    pub asked: Demands,
}

impl Subject<'_> {
    /// Force \[N\] on the whole robot worth `share` of the typical speed in set-point.
    pub fn force(&self, share: f64) -> f64 {
        share * self.machine.typical[0] * self.machine.servo[0]
    }

    /// Yaw torque \[N m\] worth `share` of the typical turning speed in set-point.
    pub fn torque(&self, share: f64) -> f64 {
        share * self.machine.typical[1].abs() * self.machine.servo[1]
    }

    /// Torque \[N m\] at each wheel of a force of both together.
    pub fn wheel_torque(&self, force: f64) -> f64 {
        0.5 * force * self.machine.firmware.radius
    }

    /// Forward typical speed \[m/s\].
    pub fn speed(&self) -> f64 {
        self.machine.typical[0]
    }

    /// Typical wheel speed \[rad/s\].
    pub fn wheel_speed(&self) -> f64 {
        self.speed() / self.machine.firmware.radius
    }

    /// Takes the derivative part out of the loop: parts that let go of the robot's mass would make it ring.
    pub fn drop_rate_gain(&mut self) {
        self.machine.firmware.control.rate_gain = 0.0;
    }
}

/// What a drive asks of an ideal robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Demands {
    /// Fastest rim set-point \[m/s\].
    pub fastest: f64,
    /// Largest force at a rim \[N\].
    pub hardest: f64,
    /// Largest voltage at a motor \[V\].
    pub voltage: f64,
}

/// What a drive asks of an ideal robot whose speeds follow their set-points with its time constants.
pub fn demands(machine: &Machine, commands: &[Command]) -> Demands {
    let (h, radius, motor) = (machine.firmware.half_track, machine.firmware.radius, &machine.rig.motors[LEFT]);
    let times = machine.times();
    let (mut v, mut omega) = (0.0, 0.0);
    let mut most = Demands { fastest: 0.0, hardest: 0.0, voltage: 0.0 };
    for pair in commands.windows(2) {
        let (along, yaw) = (machine.servo[0] * (pair[0].v - v), machine.servo[1] * (pair[0].omega - omega));
        for side in [-1.0, 1.0] {
            let force = 0.5 * (along + side * yaw / h);
            let drop = motor.resistance * force * radius / motor.torque_constant;
            let volts = drop + motor.back_emf * (v + side * h * omega) / radius;
            most.fastest = most.fastest.max((pair[0].v + side * h * pair[0].omega).abs());
            most.hardest = most.hardest.max(force.abs());
            most.voltage = most.voltage.max(volts.abs());
        }
        let dt = pair[1].t - pair[0].t;
        v = pair[0].v + (v - pair[0].v) * (-dt / times[0]).exp();
        omega = pair[0].omega + (omega - pair[0].omega) * (-dt / times[1]).exp();
    }
    most
}

/// Left or right, by chance.
fn side(rng: &mut StdRng) -> (usize, &'static str) {
    if rng.random::<bool>() { (LEFT, "left") } else { (RIGHT, "right") }
}

/// Parameters from names and values.
fn parameters<const N: usize>(pairs: [(&str, Value); N]) -> Parameters {
    pairs.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}
