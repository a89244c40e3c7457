//! The experiments of Laut 2011, sections 4.3 and 4.4, on robots from first principles.
//!
//! The motors are driven by current (no back-EMF acts) and the loops have no differential part, so that the lag is mass over gain:
//! a robot whose firmware hides its mass would show nothing of a payload. Constants are chosen so that θ1 and θ2 are those that
//! the thesis identified.

use std::sync::Arc;

use toml::Table;
use wheelwright_controllers::AdaptiveConfig;
use wheelwright_controllers::adaptation::{Balanced, Gamma, Projection};
use wheelwright_controllers::law::Sigma;
use wheelwright_controllers::trajectory::FigureEight;
use wheelwright_core::ModelConfig;
use wheelwright_core::controller::{ControllerConfig, Subject};
use wheelwright_core::drive::DriveOptions;
use wheelwright_core::profile::Limits;
use wheelwright_core::robot::Live;
use wheelwright_core::tracking::{TrackLog, start_pose, track};
use wheelwright_core::trajectory::{Envelope, Placed, TrajectoryConfig, course};
use wheelwright_models::VwPdConfig;
use wheelwright_models::physics::{PhysicalConstants, VwGains, vw_pd_theta};
use wheelwright_robots::SimulatorConfig;
use wheelwright_robots::simulator::ControlLaw;
use wheelwright_robots::simulator::physics::Payload;

/// A Khepera III with 20 ms, 3 mm/s of noise on each wheel, encoder counts and 0.5 m/s.
const KHEPERA: &str = "
robot = 'khepera-3'
[plant]
emf_constant = 0.0
wheel_inertia = 1.0e-5
wheel_friction = 2.0e-5
[controller.vw-pd]
kpt = 6.761
kdt = 0.0
kpr = 0.13453
kdr = 0.0
[limits]
wheel_speed = 24.4
[sensors]
pose = 'odometry'
ticks_per_revolution = 2764.8
wheel_noise = 0.146
";

/// A Pioneer 3-DX under Player: 0.3 s that are not quite, 5 mm/s of noise, whole mm/s.
const PIONEER: &str = "
robot = 'pioneer-3dx'
period = 0.3
jitter = 0.2
[plant]
com_offset = -0.01
emf_constant = 0.0
wheel_inertia = 0.002
wheel_friction = 0.003
[controller.vw-pd]
kpt = 3.156
kdt = 0.0
kpr = 0.5229
kdr = 0.0
[limits]
wheel_speed = 14.4
[sensors]
pose = 'odometry'
ticks_per_revolution = 76600.0
wheel_noise = 0.051
v_resolution = 0.001
";

/// A robot with its trajectory and gains.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bench {
    pub(crate) name: &'static str,
    robot: &'static str,
    eight: [f64; 3],
    k: [f64; 3],
    kv: f64,
    /// Parameters that are not adapted once identified.
    frozen: &'static [&'static str],
    /// Noise on v and omega that the sensors have: two wheels' on their mean, and on their difference over the track.
    pub(crate) noise: [f64; 2],
}

pub(crate) const KHEPERA_BENCH: Bench = Bench {
    name: "Khepera",
    robot: KHEPERA,
    eight: [0.15, 0.3, 0.3],
    k: [1.0, 30.0, 2.0],
    kv: 2.0,
    frozen: &["theta4", "theta6"],
    noise: [0.0021, 0.0477],
};
pub(crate) const PIONEER_BENCH: Bench = Bench {
    name: "Pioneer",
    robot: PIONEER,
    eight: [0.75, 1.5, 0.2],
    k: [0.8, 2.0, 0.8],
    kv: 1.5,
    frozen: &["theta4", "theta6"],
    noise: [0.0035, 0.0207],
};

/// Time constant of balanced gains \[s\], the same for every robot.
pub(crate) const BALANCED: f64 = 5.0;

/// What a run starts from and does.
#[derive(Debug, Clone, Default)]
pub(crate) struct Trial {
    /// θ of the controller; the robot's own, without payload, if empty.
    pub(crate) theta: Vec<f64>,
    /// Adaptation: from when \[s\]; none if absent.
    pub(crate) adapt: Option<f64>,
    /// Adapts all parameters, those frozen once identified included.
    pub(crate) thaw: bool,
    /// Time constant of gains that are balanced by what the trajectory asks \[s\]; one for all parameters if absent.
    pub(crate) balanced: Option<f64>,
    /// Bounds of the parameters.
    pub(crate) projection: Option<Projection>,
    /// Saturation control.
    pub(crate) saturation: bool,
    /// Noise on v and omega whose drift is taken out of the adaptation.
    pub(crate) noise: [f64; 2],
    /// Time at which the payload is put on \[s\]; it is there from the start if absent.
    pub(crate) loaded_at: Option<f64>,
    /// Factors on mass and yaw inertia.
    pub(crate) payload: Option<[f64; 2]>,
}

impl Bench {
    fn simulator(&self, payload: Option<[f64; 2]>, at: Option<f64>) -> Result<SimulatorConfig, Box<dyn std::error::Error>> {
        let mut config = SimulatorConfig::try_from(self.robot.parse::<Table>()?)?;
        let plant = &mut config.settings.plant;
        match (payload, at) {
            (None, _) => {}
            (Some([mass, inertia]), None) => {
                plant.mass *= mass;
                plant.yaw_inertia *= inertia;
            }
            // Put where the robot's own centre of mass is, so that it changes nothing else.
            (Some([mass, inertia]), Some(time)) => {
                let (extra, turning) = ((mass - 1.0) * plant.mass, (inertia - 1.0) * plant.yaw_inertia);
                let load = Payload { mass: extra, time, until: None, x: plant.com_offset, y: 0.0, inertia: turning };
                config.settings.physics.payload = Some(load);
            }
        }
        Ok(config)
    }

    /// The parameters that its constants make, with a payload or without.
    pub(crate) fn theta(&self, payload: Option<[f64; 2]>) -> Result<Vec<f64>, Box<dyn std::error::Error>> {
        let settings = self.simulator(payload, None)?.settings;
        let p = settings.plant;
        let ControlLaw::VwPd(g) = settings.controller else { return Err("a controller on v and omega is needed".into()) };
        let constants = PhysicalConstants {
            mass: p.mass,
            yaw_inertia: p.yaw_inertia,
            com_offset: p.com_offset,
            track_width: p.track_width,
            wheel_radius: p.wheel_radius,
            tyre_radius: p.tyre_radius,
            wheel_inertia: p.wheel_inertia,
            wheel_friction: p.wheel_friction,
            resistance: p.resistance,
            torque_constant: p.torque_constant,
            emf_constant: p.emf_constant,
        };
        Ok(vw_pd_theta(&constants, &VwGains { kpt: g.kpt, kdt: g.kdt, kpr: g.kpr, kdr: g.kdr }).to_vec())
    }

    /// Tracks for `duration` \[s\] from rest at the trajectory's beginning.
    pub(crate) fn run(&self, trial: &Trial, seed: u64, duration: f64) -> Result<TrackLog, Box<dyn std::error::Error>> {
        let simulator = self.simulator(trial.payload, trial.loaded_at)?;
        let plant = simulator.settings.plant;
        let mut robot = Live::new(Box::new(simulator.build(seed)?));
        let theta = if trial.theta.is_empty() { self.theta(None)? } else { trial.theta.clone() };
        let limits = Limits { wheel_speed: simulator.settings.limits.wheel_speed, ..Limits::default() };
        let envelope = Envelope { limits, track_width: Some(plant.track_width), wheel_radius: Some(plant.wheel_radius) };
        let model = Arc::from(VwPdConfig::default().build()?);
        let intervals = vec![None; theta.len()];
        let [ax, ay, frequency] = self.eight;
        let trajectory = FigureEight { ax, ay, frequency, dither: None }.build(&envelope)?;
        let course = course(&*trajectory, duration);
        let subject = Subject { model, theta, intervals, own: None, period: simulator.settings.period, envelope, course };
        let frozen = if trial.thaw { Vec::new() } else { self.frozen.iter().map(|f| (*f).to_owned()).collect() };
        let config = AdaptiveConfig {
            k: self.k,
            kv: self.kv,
            kw: self.kv,
            sigma: Sigma::Exact,
            saturation: trial.saturation,
            gamma: trial.balanced.map_or(Gamma::Same(1.0), |time| Gamma::Balanced(Balanced { time })),
            frozen,
            start: trial.adapt.unwrap_or(f64::MAX),
            leak: 0.0,
            noise: trial.noise,
            projection: trial.projection.clone(),
        };
        let mut measured = vec![0.0; robot.outputs().len()];
        robot.measure(&mut measured)?;
        let placed = Placed::new(trajectory).starting_at(start_pose(robot.outputs(), &measured));
        let mut controller = config.build(&subject)?;
        let tracked = track(&mut robot, &mut *controller, &placed, duration, f64::INFINITY, DriveOptions::default())?;
        Ok(tracked.log)
    }
}

/// All parameters one.
pub(crate) fn ones() -> Vec<f64> {
    vec![1.0; 6]
}

/// Bounds as an identification would leave them, about parameters that start at one.
pub(crate) fn box_around(theta: &[f64]) -> Projection {
    let side = |sign: f64| Some(theta.iter().map(|t| t + sign * (0.5 * t.abs()).max(0.02)).collect());
    Projection { lower: side(-1.0), upper: side(1.0), ..Projection::default() }
}
