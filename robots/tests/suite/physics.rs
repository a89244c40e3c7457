//! The ways of commands into the simulated robot and of measurements out of it.

use crate::common::{PIONEER_LIKE, PIONEER_WHEEL, config};
use wheelwright_core::robot::Robot;
use wheelwright_robots::SimulatedRobot;

fn robot(physics: &str, seed: u64) -> SimulatedRobot {
    let text = format!("period = 0.1\n[plant]\n{PIONEER_LIKE}\n[controller.wheel-pd]\n{PIONEER_WHEEL}\n[physics]\n{physics}");
    config(&text).build(seed).unwrap()
}

/// Times and measurements of `steps` periods under a command of the step's number.
fn drive(robot: &mut SimulatedRobot, steps: usize, command: impl Fn(usize) -> [f64; 2]) -> Vec<(f64, [f64; 7])> {
    let mut measured = [0.0; 7];
    let mut rows = Vec::new();
    for k in 0..steps {
        let t = robot.step(&command(k), &mut measured).unwrap();
        rows.push((t, measured));
    }
    rows
}

fn wave(k: usize) -> [f64; 2] {
    [0.4 + 0.2 * (0.3 * k as f64).sin(), 0.5 * (0.2 * k as f64).cos()]
}

#[test]
fn a_command_that_arrives_late_moves_the_robot_late() {
    let prompt = drive(&mut robot("", 1), 60, wave);
    let late = drive(&mut robot("link.delay = 0.3", 1), 60, wave);
    // The delay is three periods: the same motion, three rows later.
    for k in 3..60 {
        assert!((late[k].1[0] - prompt[k - 3].1[0]).abs() < 1e-9, "row {k}: {} {}", late[k].1[0], prompt[k - 3].1[0]);
    }
    assert_eq!(late[1].1[0], 0.0);
    // Half a period: the motion begins in the middle of the first one.
    let half = drive(&mut robot("link.delay = 0.05", 1), 1, wave)[0].1[0];
    assert!(half > 0.0 && half < prompt[0].1[0], "{half} {}", prompt[0].1[0]);
}

#[test]
fn small_commands_are_ignored_and_others_come_in_steps() {
    let still = drive(&mut robot("link = { v_dead_zone = 0.05, omega_dead_zone = 0.1 }", 1), 20, |_| [0.05, -0.1]);
    assert_eq!(still[19].1[..2], [0.0, 0.0]);
    let stepped = drive(&mut robot("link = { v_step = 0.1, omega_step = 0.2 }", 1), 20, |_| [0.34, 0.29]);
    let exact = drive(&mut robot("", 1), 20, |_| [0.30000000000000004, 0.2]);
    assert_eq!(stepped, exact);
}

#[test]
fn an_old_measurement_is_that_of_then() {
    for extra in ["", "\nbody = {}"] {
        let now = drive(&mut robot(extra, 1), 60, wave);
        let old = drive(&mut robot(&format!("sensing.delay = 0.2{extra}"), 1), 60, wave);
        for k in 2..60 {
            for channel in [0, 1, 2, 5] {
                // Between two steps of 2 ms the past is a straight line.
                let (a, b) = (old[k].1[channel], now[k - 2].1[channel]);
                assert!((a - b).abs() < 1e-5, "row {k} channel {channel}: {a} {b}");
            }
        }
        assert_eq!(old[0].1[0], 0.0);
    }
}

#[test]
fn stamps_err_but_never_go_back_and_the_motion_does_not_know() {
    let exact = drive(&mut robot("", 5), 400, wave);
    let jittered = drive(&mut robot("sensing.stamp_jitter = 0.01", 5), 400, wave);
    assert!(jittered.iter().zip(&exact).all(|(a, b)| a.1 == b.1));
    assert!(jittered.windows(2).all(|w| w[1].0 > w[0].0));
    let errors: Vec<f64> = jittered.iter().zip(&exact).map(|(a, b)| a.0 - b.0).collect();
    let mean = errors.iter().sum::<f64>() / 400.0;
    let std = (errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / 399.0).sqrt();
    // 400 numbers tell a standard deviation to 3.5 %: three of those.
    assert!((std / 0.01 - 1.0).abs() < 0.11 && mean.abs() < 3.0 * 0.01 / 20.0, "{std} {mean}");
}

#[test]
fn every_part_at_once_still_drives() {
    let all = "
        battery = { open_circuit = 12.6, resistance = 0.1, capacity = 7.0, nominal = 12.0 }
        body = { com_left = 0.01, air_drag = 0.5 }
        castor = { x = -0.18, trail = 0.03, drag = 0.5, swivel = 0.01 }
        contact = { rolling_resistance = 0.01, scrub = 0.1, load_share = 0.7, slip = { friction = 0.7, stiffness = 800.0 } }
        firmware = { period = 0.01, kp = 1.5, ki = 5.0, ticks_per_revolution = 76600.0 }
        friction = { coulomb = 0.05, breakaway = 0.07 }
        gear = { play = 0.01 }
        link = { delay = 0.03, v_step = 0.001, omega_step = 0.0174 }
        motors = { left = 1.02, right = 0.98, current_limit = 6.0 }
        payload = { mass = 3.0, time = 3.0 }
        sensing = { delay = 0.01, stamp_jitter = 0.001 }
        terrain = { slope = 0.02 }
        wheels = { left = 1.01, left_eccentricity = 0.01 }";
    let rows = drive(&mut robot(all, 2), 100, |_| [0.4, 0.3]);
    let last = rows[99].1;
    assert!((last[0] - 0.4).abs() < 0.05 && (last[1] - 0.3).abs() < 0.05, "{last:?}");
    assert_eq!(rows, drive(&mut robot(all, 2), 100, |_| [0.4, 0.3]), "the same seed gives the same drive");
}

#[test]
fn real_time_takes_its_time() {
    let text = format!("period = 0.05\nrealtime = true\n[plant]\n{PIONEER_LIKE}\n[controller.wheel-pd]\n{PIONEER_WHEEL}");
    let mut slow = config(&text).build(1).unwrap();
    assert!(slow.real_time() && !robot("", 1).real_time());
    let begun = std::time::Instant::now();
    drive(&mut slow, 6, wave);
    assert!(begun.elapsed().as_secs_f64() >= 0.299, "{:?}", begun.elapsed());
}
