//! Rust plugins: the example, and one that panics.

use std::thread::sleep;
use std::time::Duration;

use crate::support::{hurried, model, panicking, refused, registry, robot, rust_example, table};
use wheelwright_core::channel::{OMEGA, OMEGA_REF, V, V_REF};
use wheelwright_core::model::{ModelError, Sample};
use wheelwright_core::robot::{Live, Robot, RobotError};

#[test]
fn the_example_plugin_looks_like_a_built_in() {
    let registry = registry(&rust_example());
    let library = &registry.libraries()[0];
    assert_eq!((library.name(), library.version()), ("wheelwright-example-plugin", env!("CARGO_PKG_VERSION")));
    let list = registry.list();
    let own: Vec<_> = list.iter().filter(|l| l.library.is_some()).map(|l| (l.kind.word(), l.name.as_str(), l.about.as_str())).collect();
    let expected = [
        ("robot", "second-order-base", "a base with second-order velocity loops, from the example plugin"),
        ("model", "lag", "a time constant and a gain for each velocity, from the example plugin"),
        ("effect", "bus_period", "commands pass at the ticks of a slow bus, from the example plugin"),
    ];
    assert_eq!(own, expected);
    let error = registry.robot(table("type = \"second-order-base\"\nbandwith = 3")).unwrap_err();
    assert_eq!(error.path, "bandwith");
    assert!(error.message.ends_with("; did you mean `bandwidth`?"), "{error}");
    let error = registry.robot(table("type = \"second-order-base\"\nperiod = \"slow\"")).unwrap_err();
    assert_eq!((error.path.as_str(), error.message.contains("invalid type: string \"slow\"")), ("period", true), "{error}");
    let error = refused(robot(&registry, "type = \"second-order-base\"\ndamping = -1"));
    assert_eq!(error.to_string(), "`damping`: must be above 0, not -1 (plugin robot `second-order-base`)");
}

#[test]
fn the_example_robot_settles_on_its_references() {
    let registry = registry(&rust_example());
    let mut robot = Live::new(robot(&registry, "type = \"second-order-base\"\nbandwidth = 12").unwrap());
    assert_eq!((robot.inputs(), robot.outputs()), ([V_REF, OMEGA_REF].as_slice(), [V, OMEGA].as_slice()));
    assert!(!robot.real_time(), "a simulation says across the boundary that it is one");
    let mut measured = [f64::NAN; 2];
    assert_eq!(robot.measure(&mut measured), Ok(0.0));
    let mut time = 0.0;
    for _ in 0..100 {
        time = robot.step(&[0.4, -0.7], &mut measured).unwrap();
    }
    assert!((time - 5.0).abs() < 1e-9);
    assert!((measured[0] - 0.4).abs() < 1e-9 && (measured[1] + 0.7).abs() < 1e-9, "{measured:?}");
    robot.stop().unwrap();
    assert!(robot.measure(&mut measured).is_ok());
    assert_eq!(measured, [0.0, 0.0]);
}

#[test]
fn the_example_model_keeps_bounds_and_equalities_across_the_boundary() {
    let registry = registry(&rust_example());
    let free = model(&registry, "type = \"lag\"").unwrap();
    assert_eq!(free.map().free, ["tau_v", "k_v", "tau_omega", "k_omega"]);
    assert_eq!(free.parameters()[0].bounds, (0.0, f64::INFINITY));
    assert_eq!(free.parameters()[1].bounds, (f64::NEG_INFINITY, f64::INFINITY));
    let tied = model(&registry, "type = \"lag\"\nunit_gain = true").unwrap();
    assert_eq!(tied.map().theta(&[0.3, 0.2]), [0.3, 1.0, 0.2, 1.0]);
    let mut accelerations = [0.0; 2];
    free.accelerations(&[0.5, 1.0, 0.25, 2.0], &[1.0, 1.0], &[0.5, 0.0], &mut accelerations).unwrap();
    assert!((accelerations[0] - 1.0).abs() < 1e-14 && (accelerations[1] - 8.0).abs() < 1e-14, "{accelerations:?}");
    let error = free.accelerations(&[0.0, 1.0, 0.25, 2.0], &[1.0, 1.0], &[0.5, 0.0], &mut accelerations).unwrap_err();
    assert_eq!(error, ModelError::Singular { model: "lag".to_owned() });
}

#[test]
fn a_model_may_be_used_by_many_threads() {
    let registry = registry(&rust_example());
    let model = model(&registry, "type = \"lag\"").unwrap();
    std::thread::scope(|scope| {
        for n in 0..4 {
            let model = &*model;
            scope.spawn(move || {
                for k in 0..1000 {
                    let a = f64::from(n * 1000 + k);
                    let (mut phi, mut y) = ([0.0; 8], [0.0; 2]);
                    model.regressor(Sample { inputs: &[a, a], outputs: &[a, a], accelerations: &[a, a] }, &mut phi, &mut y);
                    assert_eq!((phi[0], phi[7], y[1]), (a, -a, -a));
                }
            });
        }
    });
    assert_eq!(model.failure(), None);
}

/// With limits that leave time to print a backtrace.
fn panicking_robot(when: &str) -> Result<Box<dyn Robot>, RobotError> {
    robot(&registry(&panicking()), &format!("type = \"panicking\"\nwhen = \"{when}\""))
}

#[test]
fn panics_become_driver_errors() {
    let said = |text: &str| RobotError::Driver(format!("plugin robot `panicking`: panicked: {text}"));
    assert_eq!(refused(panicking_robot("open")), said("at open"));
    assert_eq!(refused(panicking_robot("open, bomb")), said("without a text"));
    assert_eq!(panicking_robot("measure").unwrap().measure(&mut [0.0]), Err(said("at measure")));
    let mut robot = panicking_robot("step").unwrap();
    assert_eq!(robot.step(&[0.0], &mut [0.0]), Err(said("at step")));
    assert_eq!(robot.stop(), Ok(()), "a robot can be stopped after a panic");
    assert_eq!(panicking_robot("stop").unwrap().stop(), Err(said("at stop")));
    drop(panicking_robot("drop").unwrap());
}

#[test]
fn a_panic_in_a_model_is_remembered() {
    let model = model(&registry(&panicking()), "type = \"panicking\"\nwhen = 5.0").unwrap();
    let (mut phi, mut y) = ([0.0], [0.0]);
    model.regressor(Sample { inputs: &[5.0], outputs: &[0.0], accelerations: &[0.0] }, &mut phi, &mut y);
    assert!(phi[0].is_nan() && y[0].is_nan());
    let expected = ModelError::Plugin { model: "panicking".to_owned(), reason: "panicked: at input 5".to_owned() };
    assert_eq!(model.failure(), Some(expected.clone()));
    assert_eq!(model.accelerations(&[1.0], &[5.0], &[0.0], &mut [0.0]), Err(expected));
}

#[test]
fn a_rust_robot_that_hangs_is_stopped_when_its_call_returns() {
    let mut robot = robot(&hurried(&panicking()), "type = \"panicking\"\nwhen = \"step, hang\"").unwrap();
    let error = robot.step(&[0.0], &mut [0.0]).unwrap_err().to_string();
    assert!(error.contains("has not returned; it could not be told to stop: "), "{error}");
    assert!(error.ends_with("a call has not returned; the robot is stopped when it does"), "{error}");
    sleep(Duration::from_secs(3));
    assert_eq!(robot.stop(), Ok(()), "the call has returned, so the robot can be stopped directly");
}
