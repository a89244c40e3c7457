//! Gains carried from robot to robot, and what is refused.

use crate::common::{KHEPERA, PIONEER, Sampled, figure_eight, pd_subject};
use wheelwright_controllers::InverseDynamicsConfig;
use wheelwright_controllers::law::Sigma;
use wheelwright_controllers::migration::{GainRule, MigrationError, Tuning, migrate};
use wheelwright_core::controller::{ControllerConfig, Subject};
use wheelwright_core::trajectory::course;

const TUNING: Tuning = Tuning { k: [0.8, 2.0, 0.8], kv: 1.5, kw: 1.5, sigma: Sigma::Exact };

#[test]
fn a_robot_that_bears_more_is_given_more() {
    let (pioneer, khepera) = (pd_subject(&PIONEER, 0.1), pd_subject(&KHEPERA, 0.02));
    let (same, here) = migrate(&TUNING, &pioneer, &pioneer, GainRule::Retuned, 1.0).unwrap();
    assert!((same.kv - 1.5).abs() < 1e-9 && here.iter().all(|m| m.gain < m.bound));
    let (retuned, there) = migrate(&TUNING, &pioneer, &khepera, GainRule::Retuned, 0.25).unwrap();
    assert!(retuned.kv > 3.0 * TUNING.kv && retuned.k[2] > 2.0 * TUNING.k[2], "{retuned:?}");
    for (here, there) in here.iter().zip(there) {
        assert!((there.gain / there.bound / (here.gain / here.bound) - 1.0).abs() < 1e-6, "{here:?} {there:?}");
    }
    let (scaled, _) = migrate(&TUNING, &pioneer, &khepera, GainRule::Scaled, 1.0).unwrap();
    assert!((scaled.kv - 7.5).abs() < 1e-12 && (scaled.k[1] - 50.0).abs() < 1e-9);
    assert_eq!(migrate(&TUNING, &pioneer, &khepera, GainRule::Kept, 1.0).unwrap().0, TUNING);
}

/// On the slower robot gains stay that do not make its loop ring; others are lowered to half its bound, where the pole is zero.
#[test]
fn a_robot_that_bears_less_is_given_what_does_not_ring() {
    let (pioneer, khepera) = (pd_subject(&PIONEER, 0.1), pd_subject(&KHEPERA, 0.02));
    let weak = Tuning { k: [1.0, 3.0, 2.0], kv: 2.0, kw: 2.0, ..TUNING };
    let strong = Tuning { k: [8.0, 3.0, 8.0], kv: 16.0, kw: 16.0, ..TUNING };
    for rule in [GainRule::Retuned, GainRule::Scaled] {
        assert_eq!(migrate(&weak, &khepera, &pioneer, rule, 1.0).unwrap().0, weak);
        let (lowered, margins) = migrate(&strong, &khepera, &pioneer, rule, 1.0).unwrap();
        assert!(lowered.kv < 16.0 && lowered.kw < 16.0, "{lowered:?}");
        for (margin, (inertia, damping)) in margins.iter().zip([(PIONEER[0], PIONEER[3]), (PIONEER[1], PIONEER[5])]) {
            let a = (-0.1 * damping / inertia).exp();
            let pole = a + (1.0 - a) * (damping - inertia * margin.gain) / damping;
            assert!(pole.abs() < 1e-6 && (margin.gain / margin.bound - 0.5).abs() < 1e-6, "{margin:?} {pole}");
        }
    }
}

/// On a course four times as large k2 goes with the square, unless it is known that the lateral error stays damped by one half.
#[test]
fn the_heading_loop_keeps_what_its_damping_allows() {
    let (pioneer, khepera) = (pd_subject(&PIONEER, 0.1), pd_subject(&KHEPERA, 0.02));
    let tuned = Tuning { k: [1.0, 30.0, 2.0], kv: 2.0, kw: 2.0, ..TUNING };
    let k2 = |pioneer: &Subject| migrate(&tuned, &khepera, pioneer, GainRule::Retuned, 4.0).unwrap().0.k[1];
    assert!((k2(&pioneer) - 30.0 / 16.0).abs() < 1e-9);
    let course = course(&*figure_eight(0.6, 1.2, 0.3), 60.0);
    let fastest = course.iter().map(|at| at.v).fold(0.0, f64::max);
    let known = k2(&Subject { course, ..pioneer });
    assert!((2.0 / (2.0 * fastest * known.sqrt()) - 0.5).abs() < 1e-9, "{known} {fastest}");
}

#[test]
fn what_would_be_unsafe_is_refused() {
    let (slow, khepera) = (pd_subject(&PIONEER, 0.5), pd_subject(&KHEPERA, 0.02));
    let fast = Tuning { kv: 20.0, ..TUNING };
    let refused = migrate(&fast, &khepera, &slow, GainRule::Kept, 1.0).unwrap_err();
    assert!(matches!(refused, MigrationError::Unstable { axis: "v", .. }), "{refused}");
    let mut theta = PIONEER;
    theta[0] = -0.01;
    let refused = migrate(&TUNING, &khepera, &pd_subject(&theta, 0.1), GainRule::Retuned, 1.0).unwrap_err();
    assert!(
        matches!(refused, MigrationError::Unphysical { which: "target", axis: "v", .. }) && refused.to_string().contains("-0.0100"),
        "{refused}"
    );
}

#[test]
fn a_migrated_controller_tracks_and_an_unmigrated_one_does_not() {
    let (pioneer, khepera) = (pd_subject(&PIONEER, 0.1), pd_subject(&KHEPERA, 0.02));
    let eight = figure_eight(0.15, 0.3, 0.3);
    let rms = |tuning: Tuning, theta: &[f64]| {
        let mut controller = InverseDynamicsConfig::from(tuning).build(&pd_subject(theta, 0.02)).unwrap();
        let robot = Sampled { subject: &khepera, own: &KHEPERA, noise: [0.0; 2], seed: 0, ahead: 0.0 };
        robot.track(&mut *controller, &*eight, 60.0).rms(10.0, 60.0).unwrap()
    };
    let (tuning, _) = migrate(&TUNING, &pioneer, &khepera, GainRule::Retuned, 0.2).unwrap();
    let (migrated, unmigrated) = (rms(tuning, &KHEPERA), rms(TUNING, &PIONEER));
    assert!(migrated < unmigrated / 3.0, "{migrated} {unmigrated}");
}
