//! A step of the adaptive controller allocates nothing, the trajectory included.

#![allow(clippy::unwrap_used)]

#[path = "suite/common/mod.rs"]
mod common;
#[path = "../../core/tests/support/counting.rs"]
mod counting;

use common::{KHEPERA, adaptive, pd_subject};
use counting::allocations;
use toml::Table;
use wheelwright_controllers::adaptation::Projection;
use wheelwright_controllers::law::Sigma;
use wheelwright_controllers::{AdaptiveConfig, InverseDynamicsConfig, KinematicConfig};
use wheelwright_core::config;
use wheelwright_core::controller::{ControllerConfig, Observation, Subject};
use wheelwright_core::profile::Limits;
use wheelwright_core::trajectory::{Envelope, TrajectoryConfig};

#[test]
fn a_step_allocates_nothing() {
    let limits = Limits { v: Some(0.2), wheel_speed: Some(8.0), ..Limits::default() };
    let envelope = Envelope { limits, track_width: Some(0.089), wheel_radius: Some(0.0205) };
    let subject = Subject { envelope, ..pd_subject(&KHEPERA, 0.02) };
    let projection = Some(Projection { relative: Some(0.5), ..Projection::default() });
    let (k, sigma) = ([1.0, 30.0, 2.0], Sigma::Exact);
    let controllers: [Box<dyn ControllerConfig>; 3] = [
        Box::new(AdaptiveConfig { saturation: true, projection, noise: [0.002, 0.05], leak: 0.02, ..adaptive(k, [2.0; 2], sigma, 1.0) }),
        Box::new(InverseDynamicsConfig { k, kv: 2.0, kw: 2.0, sigma, saturation: true }),
        Box::new(KinematicConfig { k, saturation: true }),
    ];
    let trajectories = [
        "type = 'figure-eight'\nax = 1\nay = 1\nfrequency = 0.4\ndither = { amplitude = 0.01, h = 3.0 }",
        "type = 'waypoints'\npoints = [[0, 0], [1, 0.1], [1.5, 1]]\nspeed = 0.2\nacceleration = 0.4",
    ];
    for controller in controllers {
        for trajectory in trajectories {
            let trajectory = config::tagged::<Box<dyn TrajectoryConfig>>(trajectory.parse::<Table>().unwrap()).unwrap();
            let trajectory = trajectory.build(&envelope).unwrap();
            let mut controller = controller.build(&subject).unwrap();
            let (mut command, pose) = ([0.0; 2], [0.1, 0.2, 0.3]);
            let outputs = vec![0.1; controller.outputs().len()];
            let made = allocations(|| {
                for k in 0..1000 {
                    let t = 0.02 * f64::from(k);
                    controller.step(&Observation { t, reference: trajectory.at(t), pose, outputs: &outputs }, &mut command);
                }
            });
            assert_eq!(made, 0);
        }
    }
}
