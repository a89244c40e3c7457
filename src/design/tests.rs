#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use super::*;
use wheelwright_core::model::ModelConfig;
use wheelwright_core::profile::Limits;
use wheelwright_models::VwPdConfig;

const PIONEER: [f64; 6] = [0.2604, 0.2509, -0.0004, 0.9965, 0.0026, 1.0768];

fn section(text: &str) -> DesignSection {
    wheelwright_core::config::plain(text.parse().unwrap()).unwrap()
}

fn solve(section: &DesignSection, safety: Safety) -> Result<Design, Error> {
    let model = VwPdConfig::default().build().unwrap();
    let map = model.map();
    Task { model: &*model, map: &map, theta: PIONEER.to_vec(), period: 0.1, safety, fitted: 1.0, section, seed: 1 }.solve()
}

fn limits() -> Safety {
    Safety {
        limits: Limits { v: Some(0.6), omega: Some(1.5), v_dot: Some(0.6), omega_dot: Some(2.0), ..Limits::default() },
        ..Safety::default()
    }
}

const WISH: &str =
    "width = 0.05\nabsolute = { theta3 = 0.05, theta5 = 0.1 }\nnoise = { v = 0.005, omega = 0.01 }\nlongest = 120\ntries = 30";

#[test]
fn a_design_keeps_the_limits_and_reaches_the_widths() {
    let design = solve(&section(WISH), limits()).unwrap();
    assert!(design.duration < 60.0, "{}", design.duration);
    assert!(design.widths.iter().all(|(width, wanted)| width <= wanted), "{:?}", design.widths);
    for (column, (most, change)) in design.commands.iter().zip([(0.6, 0.06), (1.5, 0.2)]) {
        assert!(column.iter().all(|c| c.abs() <= most + 1e-9));
        assert!(column.windows(2).all(|w| (w[1] - w[0]).abs() <= change + 1e-9));
    }
    assert_eq!(design, solve(&section(WISH), limits()).unwrap(), "the same seed gives the same design");
}

#[test]
fn wanting_more_takes_longer() {
    let coarse = solve(&section(WISH), limits()).unwrap();
    let fine = solve(&section(&WISH.replace("width = 0.05", "width = 0.03")), limits()).unwrap();
    assert!(fine.duration > coarse.duration, "{} {}", fine.duration, coarse.duration);
}

#[test]
fn what_cannot_be_reached_is_said_with_what_is_short() {
    let error = solve(&section(&WISH.replace("width = 0.05", "width = 0.0001")), limits()).unwrap_err();
    assert_eq!(error.status(), 3);
    assert!(error.to_string().contains("theta1 is known to a width of"), "{error}");
}

#[test]
fn what_is_missing_is_asked_for_by_its_key() {
    let open = Safety::default();
    assert!(solve(&section(WISH), open).unwrap_err().to_string().contains("design.reach.v_ref"));
    let message = solve(&section(&WISH.replace(", omega = 0.01", "")), limits()).unwrap_err().to_string();
    assert!(message.contains("design.noise.omega"), "{message}");
}
