//! Every derivative a trajectory or a law states is the difference quotient of what it differentiates.

use crate::common::figure_eight;
use proptest::prelude::*;
use toml::Table;
use wheelwright_controllers::kinematic::KinematicGains;
use wheelwright_core::config;
use wheelwright_core::trajectory::{Envelope, Reference, TrajectoryConfig};

const H: f64 = 1e-5;

/// Every trajectory there is, dithers of each direction included.
const TRAJECTORIES: [&str; 9] = [
    "type = 'figure-eight'\nax = 0.7\nay = 1.3\nfrequency = 0.4",
    "type = 'figure-eight'\nax = -0.7\nay = 1.3\nfrequency = 0.4",
    "type = 'figure-eight'\nax = 0.7\nay = -1.3\nfrequency = 0.4",
    "type = 'figure-eight'\nax = 1\nay = 1\nfrequency = 0.4\ndither = { amplitude = 0.03, h = 3.0, k = 0.8, growth = -0.01 }",
    "type = 'figure-eight'\nax = 1\nay = 1\nfrequency = 0.4\ndither = { amplitude = 0.03, h = 3.0, k = 0.8, growth = 0.01, direction = 'lateral' }",
    "type = 'figure-eight'\nax = 1\nay = 1\nfrequency = 0.4\ndither = { amplitude = 0.03, h = 3.0, direction = 'thesis' }",
    "type = 'circle'\nradius = -0.8\nspeed = 0.3",
    "type = 'line'\nlength = 2\nspeed = 0.3",
    "type = 'waypoints'\npoints = [[0, 0], [1, 0.1], [1.5, 1], [0, 2], [-1, 0.3]]\nspeed = 0.5\nacceleration = 0.4\nangular_speed = 1.0",
];

fn build(text: &str) -> Box<dyn wheelwright_core::Trajectory> {
    let table: Table = text.parse().unwrap();
    config::tagged::<Box<dyn TrajectoryConfig>>(table).unwrap().build(&Envelope::default()).unwrap()
}

#[test]
fn every_registered_trajectory_is_among_them() {
    for name in config::names::<Box<dyn TrajectoryConfig>>() {
        assert!(TRAJECTORIES.iter().any(|t| t.contains(&format!("'{name}'"))), "{name}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn a_trajectory_states_its_own_motion(which in 0..TRAJECTORIES.len(), share in 0.001..0.999f64) {
        let trajectory = build(TRAJECTORIES[which]);
        let t = 2.0 * H + share * (trajectory.duration() - 4.0 * H);
        let (a, r, b) = (trajectory.at(t - H), trajectory.at(t), trajectory.at(t + H));
        let rate = |pick: fn(&Reference) -> f64| (pick(&b) - pick(&a)) / (2.0 * H);
        prop_assert!((rate(|r| r.x) - r.v * r.phi.cos()).abs() < 1e-7);
        prop_assert!((rate(|r| r.y) - r.v * r.phi.sin()).abs() < 1e-7);
        prop_assert!((rate(|r| r.phi) - r.omega).abs() < 1e-6, "{} {}", rate(|r| r.phi), r.omega);
        // Planned courses have kinks in their accelerations, where a difference has the mean of both sides.
        let kink = if which == 8 { 1e-3 } else { 1e-6 };
        prop_assert!((rate(|r| r.v) - r.v_dot).abs() < kink, "{} {}", rate(|r| r.v), r.v_dot);
        prop_assert!((rate(|r| r.omega) - r.omega_dot).abs() < kink * 10.0, "{} {}", rate(|r| r.omega), r.omega_dot);
    }

    #[test]
    fn the_wanted_velocities_change_as_stated(
        pose in prop::array::uniform3(-2.0..2.0f64), v in -0.5..0.5f64, omega in -1.0..1.0f64, t in 0.0..15.0f64,
        k in prop::array::uniform3(0.1..3.0f64)
    ) {
        let trajectory = figure_eight(0.7, 1.3, 0.4);
        let gains = KinematicGains::new(k).unwrap();
        // The robot moves on for a moment with the velocities it has.
        let at = |h: f64| {
            let phi = pose[2] + omega * h;
            let middle = pose[2] + 0.5 * omega * h;
            gains.wanted(&trajectory.at(t + h), [pose[0] + v * h * middle.cos(), pose[1] + v * h * middle.sin(), phi], [v, omega])
        };
        let (a, now, b) = (at(-H), at(0.0), at(H));
        // Where the heading error passes half a turn the law jumps.
        prop_assume!((b.omega - a.omega).abs() < 0.1);
        let (v_dot, omega_dot) = ((b.v - a.v) / (2.0 * H), (b.omega - a.omega) / (2.0 * H));
        prop_assert!((v_dot - now.v_dot).abs() < 1e-6 * (1.0 + v_dot.abs()), "{v_dot} {}", now.v_dot);
        prop_assert!((omega_dot - now.omega_dot).abs() < 1e-6 * (1.0 + omega_dot.abs()), "{omega_dot} {}", now.omega_dot);
    }
}

#[test]
fn a_heading_never_jumps() {
    for text in TRAJECTORIES {
        let trajectory = build(text);
        let n = 5000;
        let phi = |i: i32| trajectory.at(trajectory.duration() * f64::from(i) / f64::from(n)).phi;
        assert!((1..=n).all(|i| (phi(i) - phi(i - 1)).abs() < 0.5), "{text}");
    }
}
