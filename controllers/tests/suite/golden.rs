//! Reference values of an independent replication in numpy (`golden.json` beside the notes on the thesis).

use crate::common::{INITIAL, TRUE_THETA, adaptive, figure_eight, pd_subject};
use serde_json::Value;
use wheelwright_controllers::continuous::Continuous;
use wheelwright_controllers::kinematic::KinematicGains;
use wheelwright_controllers::law::Sigma;
use wheelwright_controllers::trajectory::{Direction, Dither, FigureEight, Formulas};
use wheelwright_core::trajectory::{Envelope, TrajectoryConfig};

fn golden() -> Option<Value> {
    let shared = std::env::var("WHEELWRIGHT_SHARED").unwrap_or_else(|_| concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared").to_owned());
    let path = std::path::Path::new(&shared).join("thesis/golden.json");
    let Ok(text) = std::fs::read_to_string(&path) else {
        println!("skipped: {} is not there", path.display());
        return None;
    };
    Some(serde_json::from_str(&text).unwrap())
}

/// The entry whose key begins so.
fn entry<'a>(golden: &'a Value, begin: &str) -> &'a Value {
    golden.as_object().unwrap().iter().find(|(key, _)| key.starts_with(begin)).map(|(_, value)| value).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

#[test]
fn trajectories_and_dithers() {
    let Some(golden) = golden() else { return };
    for case in entry(&golden, "trajectory").as_array().unwrap() {
        let p = numbers(&case["tp"]);
        let direction = match p[7] as u8 {
            1 => Direction::Thesis,
            2 => Direction::Longitudinal,
            _ => Direction::Lateral,
        };
        let dither = Dither { amplitude: p[3], h: p[4], k: p[5], growth: p[6], direction, formulas: Formulas::Exact };
        let eight = FigureEight { ax: p[0], ay: p[1], frequency: p[2], dither: (p[7] > 0.0).then_some(dither) };
        let r = eight.build(&Envelope::default()).unwrap().at(case["t"].as_f64().unwrap());
        let expected = numbers(&case["out_xd_yd_phid_vd_omd_vdotd_alphad"]);
        let turn = std::f64::consts::TAU;
        let heading = expected[2] + turn * ((r.phi - expected[2]) / turn).round();
        let found = [r.x, r.y, r.phi, r.v, r.omega, r.v_dot, r.omega_dot];
        let expected = [expected[0], expected[1], heading, expected[3], expected[4], expected[5], expected[6]];
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-10, "{case}: {found} {expected}");
        }
    }
}

#[test]
fn the_kinematic_law_and_its_derivative() {
    let Some(golden) = golden() else { return };
    let expected = numbers(entry(&golden, "kinctl"));
    let eight = FigureEight { ax: 0.7, ay: 1.3, frequency: 0.4, dither: None };
    let reference = eight.build(&Envelope::default()).unwrap().at(2.0);
    let wanted = KinematicGains { k1: 1.1, k2: 2.0, k3: 0.9 }.wanted(&reference, [0.1, 0.2, 0.3], [0.25, -0.4]);
    for (found, expected) in [wanted.v, wanted.omega, wanted.v_dot, wanted.omega_dot].iter().zip(expected) {
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }
}

#[test]
fn eleven_states_after_two_hundred_seconds() {
    let Some(golden) = golden() else { return };
    let eight = figure_eight(1.0, 1.0, 0.0896);
    for (sigma, key) in
        [(Sigma::Exact, "adaptive11_T200_dt.02_RK4_sigmavariant0"), (Sigma::DesiredAccel, "adaptive11_T200_dt.02_RK4_sigmavariant1")]
    {
        let controller = adaptive([0.5; 3], [2.0; 2], sigma, 1.0);
        let start = Continuous::perfect_start(&*eight);
        let mut simulation = Continuous::new(&controller, &pd_subject(&INITIAL, 0.02), &TRUE_THETA, &*eight, start).unwrap();
        simulation.run(200.0, 0.02, 100).unwrap();
        for (i, (found, expected)) in simulation.state().iter().zip(numbers(entry(&golden, key))).enumerate() {
            assert!((found - expected).abs() < 1e-8, "{sigma:?}, state {i}: {found} {expected}");
        }
    }
}
