//! What the tests of drivers and emulators share: robots from their configuration, and theta through a wire.
#![allow(dead_code, unreachable_pub, missing_docs, clippy::unwrap_used, clippy::panic)]

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use toml::Table;
use wheelwright_core::config::tagged;
use wheelwright_core::dataset::Dataset;
use wheelwright_core::drive::{DriveOptions, Safety, drive, steer};
use wheelwright_core::excitation::Excitation;
use wheelwright_core::model::ModelConfig;
use wheelwright_core::robot::{Live, RobotConfig, RobotError};
use wheelwright_core::solver::{Problem, Solution, Solver};
use wheelwright_robots::emulator::{Emulator, EmulatorConfig};
use wheelwright_solvers::OutputError;

// Registrations of a crate that nothing mentions vanish.
use wheelwright_models as _;

pub fn table(text: &str) -> Table {
    text.parse().unwrap_or_else(|e| panic!("{e}\n{text}"))
}

pub fn robot(text: &str) -> Result<Live, RobotError> {
    let config: Box<dyn RobotConfig> = tagged(table(text)).unwrap_or_else(|e| panic!("{e}\n{text}"));
    config.connect(1).map(Live::new)
}

pub fn emulate(emulator: &str, simulator: &str) -> Emulator {
    let config: EmulatorConfig = table(emulator).try_into().unwrap();
    config.start(robot(simulator).unwrap()).unwrap()
}

pub fn identify(robot: &mut Live, model: &str, excitation: &str, duration: f64) -> (Solution, Vec<String>) {
    let excitation: Box<dyn Excitation> = tagged(table(&format!("type = '{excitation}'"))).unwrap();
    let options = DriveOptions { duration: Some(duration), ..DriveOptions::default() };
    let recording = drive(robot, &*excitation, options).unwrap();
    let model: Box<dyn ModelConfig> = tagged(table(&format!("type = '{model}'"))).unwrap();
    let model = model.build().unwrap();
    let data = Dataset::new(&recording, &*model).unwrap();
    (OutputError::default().solve(&Problem::new(&*model, &data)).unwrap(), recording.warnings)
}

/// Both estimates agree within what rounding leaves: `share` of each parameter, or `absolute` where it is near zero; and the interval that
/// is reported through the wire is wide enough for what rounding did: two half widths are four standard errors. Prints both estimates with their 95 % intervals.
pub fn agree(name: &str, direct: &Solution, through: &Solution, share: f64, absolute: f64) {
    let half = |solution: &Solution| -> Vec<f64> { solution.ci95.iter().flatten().map(|(low, high)| 0.5 * (high - low)).collect() };
    let (exact, wide) = (half(direct), half(through));
    for (i, (a, b)) in direct.theta.iter().zip(&through.theta).enumerate() {
        let off = b - a;
        println!(
            "{name}: theta{} {a:10.6} ± {:.1e} directly, {b:10.6} ± {:.1e} through the wire: {off:+.1e}, {:+.2} %, {:.1} half widths",
            i + 1,
            exact[i],
            wide[i],
            100.0 * off / a,
            off.abs() / wide[i]
        );
        assert!(off.abs() <= 2.0 * wide[i], "{name}, theta{}: {a} directly, {b} ± {} through the wire", i + 1, wide[i]);
        assert!(off.abs() <= (share * a.abs()).max(absolute), "{name}, theta{}: {a} directly, {b} through the wire", i + 1);
    }
}

/// Drives a robot in real time whose law, once, does not come back until the robot holds zero: the driver tells it so beside the law, and
/// goes on. `held` is the command that the robot at the other end holds.
pub fn stands_beside_a_late_law(name: &str, robot: &mut Live, held: impl Fn() -> [f64; 2]) {
    let mut rows = 0;
    let mut law = |_: f64, _: &[f64], command: &mut [f64]| {
        command.copy_from_slice(&[0.1, 0.2]);
        rows += 1;
        let begun = Instant::now();
        while rows == 30 && held() != [0.0; 2] {
            assert!(begun.elapsed() < Duration::from_secs(20), "{name}: nobody told the robot to stand");
            std::thread::sleep(Duration::from_millis(1));
        }
        Ok(ControlFlow::Continue(()))
    };
    let safety = Safety { deadline: Some(60.0), ..Safety::default() };
    let duration = 60.0 * robot.period();
    let recording = steer(robot, duration, &mut law, DriveOptions { safety, ..DriveOptions::default() }).unwrap();
    println!("{name}: {:?}", recording.warnings);
    assert!(recording.warnings.iter().any(|w| w.contains("the next command was late")), "{name}: {:?}", recording.warnings);
    assert!(recording.segments().len() >= 2, "{name}");
    let last = &recording.segments()[recording.segments().len() - 1].rows;
    let v = recording.column("v").unwrap();
    assert!((v[last.end - 1] - 0.1).abs() < 0.03, "{name}: it drives again: {:?}", &v[last.clone()]);
}
