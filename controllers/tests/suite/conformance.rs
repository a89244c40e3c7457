//! Every registered controller keeps its promises on every registered trajectory.

use std::sync::Arc;

use crate::common::{KHEPERA, pd_subject};
use toml::Table;
use wheelwright_controllers as _;
use wheelwright_core::ModelConfig;
use wheelwright_core::config;
use wheelwright_core::controller::{ControllerConfig, Observation, Subject};
use wheelwright_core::profile::Limits;
use wheelwright_core::trajectory::{Envelope, TrajectoryConfig};

const CONTROLLERS: [(&str, &str); 3] = [
    ("kinematic", "k = [1, 30, 2]"),
    ("inverse-dynamics", "k = [1, 30, 2]\nkv = 2\nkw = 2"),
    ("adaptive", "k = [1, 30, 2]\nkv = 2\nkw = 2\ngamma = 0.1\nleak = 0.02\nprojection = { relative = 0.5 }"),
];
const TRAJECTORIES: [(&str, &str); 4] = [
    ("figure-eight", "ax = 0.15\nay = 0.3\nfrequency = 0.3"),
    ("circle", "radius = 0.3\nspeed = 0.1"),
    ("line", "length = 1\nspeed = 0.1"),
    ("waypoints", "points = [[0, 0], [0.5, 0.1], [0.6, 0.6]]\nspeed = 0.1\nacceleration = 0.2"),
];

fn table(name: &str, text: &str) -> Table {
    format!("type = '{name}'\n{text}").parse().unwrap()
}

#[test]
fn every_controller_and_trajectory_is_here() {
    assert_eq!(config::names::<Box<dyn ControllerConfig>>().len(), CONTROLLERS.len());
    assert_eq!(config::names::<Box<dyn TrajectoryConfig>>().len(), TRAJECTORIES.len());
}

#[test]
fn commands_are_finite_within_limits_and_repeat() {
    let limits = Limits { v: Some(0.25), omega: Some(6.0), wheel_speed: Some(14.0), ..Limits::default() };
    let envelope = Envelope { limits, track_width: Some(0.089), wheel_radius: Some(0.0205) };
    let subject = Subject { envelope, ..pd_subject(&KHEPERA, 0.02) };
    for (controller, settings) in CONTROLLERS {
        let config = config::tagged::<Box<dyn ControllerConfig>>(table(controller, settings)).unwrap();
        assert!(!config.about().is_empty());
        for (trajectory, course) in TRAJECTORIES {
            let trajectory = config::tagged::<Box<dyn TrajectoryConfig>>(table(trajectory, course)).unwrap().build(&envelope).unwrap();
            let commands = || -> Vec<f64> {
                let mut live = config.build(&subject).unwrap();
                let outputs = vec![0.05; live.outputs().len()];
                let mut command = vec![0.0; live.inputs().len()];
                let mut all = Vec::new();
                for k in 0..500 {
                    let t = 0.02 * f64::from(k);
                    let now = Observation { t, reference: trajectory.at(t), pose: [0.1, -0.2, 3.0], outputs: &outputs };
                    live.step(&now, &mut command);
                    let motion = wheelwright_core::Reference { v: command[0], omega: command[1], ..Default::default() };
                    assert!(envelope.shares(&motion).iter().all(|s| *s <= 1.0 + 1e-12), "{controller}: {command:?}");
                    assert_eq!(live.theta().len(), live.parameters().len());
                    all.extend(command.iter().chain(live.theta()));
                }
                all
            };
            let (first, second) = (commands(), commands());
            assert!(first.iter().all(|c| c.is_finite()), "{controller}");
            assert_eq!(first, second, "{controller}");
        }
    }
}

#[test]
fn impossible_settings_name_their_key() {
    let subject = pd_subject(&KHEPERA, 0.02);
    let adaptive = |settings: &str| {
        let text = format!("k = [1, 30, 2]\nkv = 2\nkw = 2\n{settings}");
        let config = config::tagged::<Box<dyn ControllerConfig>>(table("adaptive", &text)).unwrap();
        config.build(&subject).map(|_| ()).unwrap_err().to_string()
    };
    for (settings, key) in [
        ("gamma = -1", "`gamma`"),
        ("gamma = [1, 2]", "`gamma`"),
        ("gamma = 1\nfrozen = ['theta9']", "`frozen`"),
        ("gamma = 1\nleak = -0.1", "`leak`"),
        ("gamma = 1\nprojection = {}", "`projection`"),
        ("gamma = 1\nprojection = { relative = 0.5, intervals = 2 }", "`projection`"),
        ("gamma = 1\nprojection = { intervals = 2 }", "`projection.intervals`"),
        ("gamma = 1\nprojection = { lower = [0], upper = [1] }", "`projection.lower`"),
    ] {
        assert!(adaptive(settings).starts_with(key), "{settings}: {}", adaptive(settings));
    }
}

/// A robot commanded in volts, which measures its two sides, is driven by the same law.
#[test]
fn a_model_from_voltages_is_inverted_too() {
    use std::sync::Arc;
    use wheelwright_core::ModelConfig;
    use wheelwright_models::WheelVoltageConfig;

    let model = Arc::from(WheelVoltageConfig { static_friction: false, symmetric: false }.build().unwrap());
    let envelope = Envelope { track_width: Some(0.6), ..Envelope::default() };
    let theta = vec![2.5, 0.4, 2.6, 0.5];
    let subject = Subject { model, theta: theta.clone(), intervals: vec![None; 4], own: None, period: 0.02, envelope, course: Vec::new() };
    let config = config::tagged::<Box<dyn ControllerConfig>>(table("inverse-dynamics", "k = [1, 2, 2]\nkv = 2\nkw = 2")).unwrap();
    let trajectory =
        config::tagged::<Box<dyn TrajectoryConfig>>(table("circle", "radius = 1\nspeed = 0.5")).unwrap().build(&envelope).unwrap();
    let mut live = config.build(&subject).unwrap();
    // On the circle with the right speeds: left 0.35, right 0.65 m/s, and no acceleration is wanted.
    let r = trajectory.at(3.0);
    let mut command = [0.0; 2];
    live.step(&Observation { t: 3.0, reference: r, pose: [r.x, r.y, r.phi], outputs: &[0.35, 0.65] }, &mut command);
    assert!((command[0] - 2.5 * 0.35).abs() < 1e-9 && (command[1] - 2.6 * 0.65).abs() < 1e-9, "{command:?}");
    assert!(config.build(&Subject { envelope: Envelope::default(), ..subject }).unwrap_err().to_string().contains("track_width"));
}

#[test]
fn a_model_without_an_equation_for_each_velocity_is_refused() {
    let one = "type = 'expression'\nname = 'one'\ninputs = { v_ref = 'm/s' }\noutputs = { v = 'm/s', omega = 'rad/s' }\n\
        equations = ['v_ref = a*der(v) + b*v + c*omega']\n[parameters]\na = { unit = 's' }\nb = { unit = '1' }\nc = { unit = 'm' }";
    let model = config::tagged::<Box<dyn ModelConfig>>(one.parse::<Table>().unwrap()).unwrap().build().unwrap();
    let subject = Subject { model: Arc::from(model), theta: vec![0.2, 1.0, 0.1], intervals: vec![None; 3], ..pd_subject(&KHEPERA, 0.02) };
    for (controller, settings) in &CONTROLLERS[1..] {
        let refused = config::tagged::<Box<dyn ControllerConfig>>(table(controller, settings)).unwrap().build(&subject).map(drop);
        assert!(refused.unwrap_err().to_string().contains("its number of equations is 1"), "{controller}");
    }
}
