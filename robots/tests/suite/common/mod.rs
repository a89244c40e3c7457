//! What the simulator's tests share: the golden parameter sets, the thesis' excitations, a loop that records.
#![allow(dead_code, unreachable_pub, missing_docs, clippy::unwrap_used, clippy::panic)]

pub mod wire;

use toml::Table;
use wheelwright_core::robot::Robot;
use wheelwright_robots::SimulatorConfig;

pub const PIONEER_LIKE: &str = "
    mass = 9.0
    yaw_inertia = 0.21
    com_offset = -0.035
    track_width = 0.34
    wheel_radius = 0.0975
    tyre_radius = 0.0965
    wheel_inertia = 0.012
    wheel_friction = 0.03
    resistance = 1.2
    torque_constant = 0.9
    emf_constant = 0.85
";
pub const KHEPERA_LIKE: &str = "
    mass = 0.742
    yaw_inertia = 0.0016
    com_offset = 0.008
    track_width = 0.089
    wheel_radius = 0.0205
    tyre_radius = 0.0205
    wheel_inertia = 4e-5
    wheel_friction = 0.0002
    resistance = 8.0
    torque_constant = 0.25
    emf_constant = 0.24
";
pub const PIONEER_WHEEL: &str = "kp = 6.0\nkd = 0.9";
pub const PIONEER_VW: &str = "kpt = 30.0\nkdt = 4.0\nkpr = 7.0\nkdr = 1.1";
pub const KHEPERA_WHEEL: &str = "kp = 2.0\nkd = 0.02";
pub const KHEPERA_VW: &str = "kpt = 90.0\nkdt = 1.0\nkpr = 4.0\nkdr = 0.05";

/// A simulator of a golden parameter set; `law` is `wheel-pd` or `vw-pd`.
pub fn golden(plant: &str, law: &str, gains: &str, period: f64) -> SimulatorConfig {
    config(&format!("period = {period}\n[plant]\n{plant}\n[controller.{law}]\n{gains}"))
}

pub fn config(text: &str) -> SimulatorConfig {
    SimulatorConfig::try_from(text.parse::<Table>().unwrap()).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

/// The thesis' excitation of the Pioneer.
pub fn pioneer_excitation(t: f64) -> [f64; 2] {
    [
        0.4 + 0.1 * ((2.0 * t).sin() + t.sin() + (t / 3.0).sin() + (t / 11.0).sin()),
        0.75 + 0.25 * ((1.5 * t).sin() + t.sin() + (t / 2.0).sin() + (t / 5.0).sin()),
    ]
}

/// The thesis' excitation of the Khepera.
pub fn khepera_excitation(t: f64) -> [f64; 2] {
    [
        0.1 + 0.05 * ((2.0 * t).sin() + t.sin() + (t / 3.0).sin() + (t / 11.0).sin()),
        1.5 + 0.5 * (1.5 * t).sin() + 0.5 * t.sin() + 0.25 * (t / 2.0).sin() + 0.25 * (t / 5.0).sin(),
    ]
}

/// Rows of a run: time, command, measurement.
#[derive(Default)]
pub struct Run {
    pub time: Vec<f64>,
    pub commands: [Vec<f64>; 2],
    pub measured: Vec<[f64; 7]>,
}

impl Run {
    pub fn column(&self, channel: usize) -> Vec<f64> {
        self.measured.iter().map(|row| row[channel]).collect()
    }
}

/// Drives for `steps` periods; row k holds the command from its time on.
pub fn run(robot: &mut dyn Robot, steps: usize, command: impl Fn(f64) -> [f64; 2]) -> Run {
    let mut run = Run::default();
    let mut row = [0.0; 7];
    let mut t = robot.measure(&mut row).unwrap();
    for _ in 0..steps {
        let held = command(t);
        push(&mut run, t, held, row);
        t = robot.step(&held, &mut row).unwrap();
    }
    push(&mut run, t, command(t), row);
    run
}

fn push(run: &mut Run, t: f64, command: [f64; 2], row: [f64; 7]) {
    run.time.push(t);
    run.commands[0].push(command[0]);
    run.commands[1].push(command[1]);
    run.measured.push(row);
}
