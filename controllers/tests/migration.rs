//! Gains carried from robot to robot, and what is refused.

#![allow(clippy::unwrap_used)]

mod common;

use common::{KHEPERA, PIONEER, Sampled, figure_eight, pd_subject};
use wheelwright_controllers::InverseDynamicsConfig;
use wheelwright_controllers::law::Sigma;
use wheelwright_controllers::migration::{GainRule, MigrationError, Tuning, migrate};
use wheelwright_core::controller::ControllerConfig;

const TUNING: Tuning = Tuning { k: [0.8, 2.0, 0.8], kv: 1.5, kw: 1.5, sigma: Sigma::Exact };

#[test]
fn retuned_gains_use_the_same_share_and_come_back() {
    let (pioneer, khepera) = (pd_subject(&PIONEER, 0.1), pd_subject(&KHEPERA, 0.02));
    let (there, _) = migrate(&TUNING, &pioneer, &khepera, GainRule::Retuned, 0.25).unwrap();
    assert!(there.kv > 3.0 * TUNING.kv && there.k[2] > 2.0 * TUNING.k[2], "{there:?}");
    let (back, _) = migrate(&there, &khepera, &pioneer, GainRule::Retuned, 4.0).unwrap();
    for (a, b) in [(back.k[0], 0.8), (back.k[1], 2.0), (back.k[2], 0.8), (back.kv, 1.5), (back.kw, 1.5)] {
        assert!((a / b - 1.0).abs() < 1e-6, "{back:?}");
    }
    let (same, margins) = migrate(&TUNING, &pioneer, &pioneer, GainRule::Retuned, 1.0).unwrap();
    assert!((same.kv - 1.5).abs() < 1e-9 && margins.iter().all(|m| m.gain < m.bound));
    let (scaled, _) = migrate(&TUNING, &pioneer, &khepera, GainRule::Scaled, 1.0).unwrap();
    assert!((scaled.kv - 7.5).abs() < 1e-12 && (scaled.k[1] - 50.0).abs() < 1e-9);
    assert_eq!(migrate(&TUNING, &pioneer, &khepera, GainRule::Kept, 1.0).unwrap().0, TUNING);
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
