//! C plugins: the two examples, and one that misbehaves while it runs.
#![allow(unsafe_code)]

use std::path::Path;
use std::time::{Duration, Instant};

use crate::support::{broken, compile, has_c_compiler, hurried, model, refused, registry, robot, table};
use wheelwright_core::channel::{OMEGA, OMEGA_REF, V, V_REF};
use wheelwright_core::dataset::Stretch;
use wheelwright_core::model::{ModelError, Sample};
use wheelwright_core::robot::{Live, RobotError};
use wheelwright_core::simulation::Simulator;

/// A counter of the misbehaving plugin.
fn count(library: &Path, symbol: &str) -> i32 {
    // SAFETY: the library is loaded already, and its counters are C ints.
    unsafe {
        let library = libloading::Library::new(library).unwrap();
        let symbol = library.get::<*const i32>(symbol).unwrap();
        std::ptr::read_volatile(*symbol)
    }
}

#[test]
fn the_example_robot_in_c_follows_its_references() {
    if !has_c_compiler() {
        return;
    }
    let registry = registry(&compile("examples/plugins/c/robot.c", &[], "robot_c"));
    let mut robot = Live::new(robot(&registry, "type = \"c-base\"\ntau = 0.2\nperiod = 0.1").unwrap());
    assert_eq!(robot.inputs(), [V_REF, OMEGA_REF]);
    assert_eq!(robot.outputs(), [V, OMEGA]);
    assert_eq!((robot.period(), robot.real_time()), (0.1, false));
    let mut measured = [f64::NAN; 2];
    assert_eq!(robot.measure(&mut measured).unwrap(), 0.0);
    assert_eq!(measured, [0.0, 0.0]);
    for _ in 0..3 {
        robot.step(&[0.5, -1.0], &mut measured).unwrap();
    }
    let share = 1.0 - (-0.3_f64 / 0.2).exp();
    assert!((measured[0] - 0.5 * share).abs() < 1e-15 && (measured[1] + share).abs() < 1e-15, "{measured:?}");
    robot.stop().unwrap();
    robot.stop().unwrap();
}

#[test]
fn the_example_robot_in_c_checks_its_table_like_a_built_in() {
    if !has_c_compiler() {
        return;
    }
    let registry = registry(&compile("examples/plugins/c/robot.c", &[], "robot_c_config"));
    for (text, expected) in [
        ("peroid = 0.2", "`peroid`: unknown field `peroid`, expected one of `tau`, `period`; did you mean `period`?"),
        ("tau = \"long\"", "`tau`: must be a number, not \"long\""),
        ("tau = -0.2", "`tau`: must be above 0 s, not -0.2"),
    ] {
        let error = registry.robot(table(&format!("type = \"c-base\"\n{text}"))).unwrap_err();
        assert_eq!(error.to_string(), expected);
    }
    assert_eq!(registry.robot(table("type = \"c-base\"")).unwrap().about(), "a base with a time constant, in C");
}

#[test]
fn the_example_model_in_c_simulates_as_its_closed_form() {
    if !has_c_compiler() {
        return;
    }
    let registry = registry(&compile("examples/plugins/c/model.c", &[], "model_c"));
    let model = model(&registry, "type = \"c-lag\"").unwrap();
    assert_eq!((model.inputs(), model.outputs()), ([V_REF, OMEGA_REF].as_slice(), [V, OMEGA].as_slice()));
    let bounds: Vec<_> = model.parameters().iter().map(|p| (p.name.as_str(), p.unit.as_str(), p.bounds)).collect();
    let (inf, time, none) = (f64::INFINITY, "s", (f64::NEG_INFINITY, f64::INFINITY));
    assert_eq!(bounds, [("tau_v", time, (0.0, inf)), ("k_v", "1", none), ("tau_omega", time, (0.0, inf)), ("k_omega", "1", none)]);
    assert_eq!(model.parameters()[0].excitation, "changes of v_ref");

    let (mut phi, mut y) = ([0.0; 8], [0.0; 2]);
    model.regressor(Sample { inputs: &[1.0, 2.0], outputs: &[3.0, 4.0], accelerations: &[5.0, 6.0] }, &mut phi, &mut y);
    assert_eq!((phi, y), ([5.0, -1.0, 0.0, 0.0, 0.0, 0.0, 6.0, -2.0], [-3.0, -4.0]));

    let time: Vec<f64> = (0..50).map(|k| 0.05 * f64::from(k)).collect();
    let inputs = vec![vec![1.0; 50], vec![-1.0; 50]];
    let stretch = Stretch { label: String::new(), time, inputs, outputs: vec![vec![0.0; 50]; 2] };
    let mut simulated = vec![Vec::new(), Vec::new()];
    Simulator::new(&*model, &[0.3, 0.9, 0.2, 1.1]).unwrap().run(&stretch, &[0.0, 0.0], &mut simulated).unwrap();
    for (k, t) in stretch.time.iter().enumerate() {
        assert!((simulated[0][k] - 0.9 * (1.0 - (-t / 0.3).exp())).abs() < 1e-12);
        assert!((simulated[1][k] + 1.1 * (1.0 - (-t / 0.2).exp())).abs() < 1e-12);
    }
}

#[test]
fn what_open_says_is_checked() {
    if !has_c_compiler() {
        return;
    }
    for (define, expected) in [
        ("NO_OUTPUTS", "it measures nothing (n_outputs is 0)"),
        ("NULL_CHANNELS", "outputs is NULL"),
        ("HUGE_COUNT", "outputs: 18446744073709551615 entries"),
        ("TWIN_CHANNELS", "outputs: the name \"x\" appears twice"),
        ("BAD_PERIOD", "its period is NaN s"),
    ] {
        let path = broken(&[define]);
        match refused(robot(&registry(&path), "type = \"mock\"")) {
            RobotError::Driver(text) => assert!(text.contains(expected) && text.starts_with("plugin robot `mock`: "), "{define}: {text}"),
            other => panic!("{define}: {other}"),
        }
        assert_eq!(count(&path, "ww_test_closes"), 1, "{define}: a handle that is refused is closed");
    }
}

#[test]
fn statuses_arrive_as_errors_of_their_class_and_stop_the_robot() {
    if !has_c_compiler() {
        return;
    }
    let path = broken(&[]);
    let registry = registry(&path);
    for (status, expected) in [
        (1, "`type`: command 1 (plugin robot `mock`)"),
        (2, "no connection to the robot: plugin robot `mock`: command 2"),
        (3, "the robot did not answer within 8 s: plugin robot `mock`: command 3"),
        (4, "the robot reported a fault: plugin robot `mock`: command 4"),
        (5, "the robot's driver failed: plugin robot `mock`: command 5"),
        (42, "the robot's driver failed: plugin robot `mock`: unknown status 42 (command 42)"),
    ] {
        let mut robot = robot(&registry, "type = \"mock\"").unwrap();
        let (stops, closes) = (count(&path, "ww_test_stops"), count(&path, "ww_test_closes"));
        let error = robot.step(&[f64::from(status)], &mut [0.0; 2]).unwrap_err();
        assert_eq!(error.to_string(), expected);
        assert_eq!(count(&path, "ww_test_stops"), stops + 1, "an error stops the robot");
        let after = robot.step(&[0.0], &mut [0.0; 2]).unwrap_err();
        assert!(after.to_string().contains("it was stopped after an error; connect it again"), "{after}");
        drop(robot);
        assert_eq!(count(&path, "ww_test_closes"), closes + 1);
    }
    let error = refused(robot(&registry, "type = \"mock\"\nopen_status = 2"));
    assert_eq!(error, RobotError::Connection("plugin robot `mock`: opening gave 2".to_owned()));
    let error = model(&registry, "type = \"mock\"\nopen_status = 1").unwrap_err();
    assert_eq!(error, ModelError::Config { key: "type".to_owned(), reason: "opening gave 1".to_owned() });
}

#[test]
fn a_message_longer_than_the_buffer_is_cut() {
    if !has_c_compiler() {
        return;
    }
    let mut robot = robot(&registry(&broken(&[])), "type = \"mock\"").unwrap();
    assert!(robot.real_time(), "a robot that says nothing is taken for real");
    match robot.step(&[99.0], &mut [0.0; 2]) {
        Err(RobotError::Fault(text)) => assert_eq!(text, format!("plugin robot `mock`: {}", "a".repeat(1023))),
        other => panic!("{other:?}"),
    }
}

#[test]
fn values_that_cannot_be_are_faults() {
    if !has_c_compiler() {
        return;
    }
    for (define, expected) in [
        ("NAN_OUTPUT", "the robot reported a fault: plugin robot `mock`: `z` is NaN at t = 0 s"),
        ("FORGOTTEN_OUTPUT", "the robot reported a fault: plugin robot `mock`: `z` is NaN at t = 0 s (not written by the plugin?)"),
        ("OVERRUN", "the robot's driver failed: plugin robot `mock`: it wrote more than 2 values to `measure`, and memory is damaged"),
    ] {
        let path = broken(&[define]);
        let registry = registry(&path);
        let mut robot = robot(&registry, "type = \"mock\"").unwrap();
        let error = robot.measure(&mut [0.0; 2]).unwrap_err().to_string();
        assert!(error.starts_with(expected), "{define}: {error}");
        assert_eq!(count(&path, "ww_test_stops"), 1, "{define}");
        let error = model(&registry, "type = \"mock\"").unwrap_err().to_string();
        let expected = match define {
            "OVERRUN" => "it wrote more than 1 values to `y`",
            _ => "equation 1: the coefficient of `b` is NaN with every channel at 0.37",
        };
        assert!(error.starts_with("model plugin `mock`: ") && error.contains(expected), "{define}: {error}");
    }
    let mut robot = robot(&registry(&broken(&["TIME_BACK"])), "type = \"mock\"").unwrap();
    robot.measure(&mut [0.0; 2]).unwrap();
    let error = robot.step(&[0.0], &mut [0.0; 2]).unwrap_err().to_string();
    assert!(error.ends_with("time -0.01 s after 0 s"), "{error}");
}

#[test]
fn the_host_sends_neither_nan_nor_arrays_of_another_size() {
    if !has_c_compiler() {
        return;
    }
    let mut robot = robot(&registry(&broken(&[])), "type = \"mock\"").unwrap();
    let error = robot.step(&[f64::NAN], &mut [0.0; 2]).unwrap_err().to_string();
    assert!(error.ends_with("the command `u` is NaN; nothing was sent"), "{error}");
    assert!(robot.step(&[0.0, 0.0], &mut [0.0; 2]).unwrap_err().to_string().ends_with("room for 2 commands, but there are 1"));
    assert!(robot.step(&[0.0], &mut [0.0; 3]).unwrap_err().to_string().ends_with("room for 3 measurements, but there are 2"));
    assert_eq!(robot.step(&[0.0], &mut [0.0; 2]), Ok(0.01));
}

#[test]
fn a_step_that_does_not_return_times_out_and_the_robot_is_stopped_beside_it() {
    if !has_c_compiler() {
        return;
    }
    let path = broken(&["HANG_IN_STEP"]);
    let mut robot = Live::new(robot(&hurried(&path), "type = \"mock\"").unwrap());
    robot.step(&[0.0], &mut [0.0; 2]).unwrap();
    let begin = Instant::now();
    let error = robot.step(&[1.0], &mut [0.0; 2]).unwrap_err();
    let expected =
        "the robot did not answer within 0.3 s: plugin robot `mock`: the call of `step` has not returned; the robot was told to stop";
    assert_eq!(error.to_string(), expected);
    assert!(begin.elapsed() < Duration::from_secs(2));
    assert_eq!(count(&path, "ww_test_stops"), 1);
    robot.stop().unwrap();
    drop(robot);
    assert_eq!((count(&path, "ww_test_stops"), count(&path, "ww_test_closes")), (3, 0), "a handle in use is not closed");
}

#[test]
fn a_stop_that_does_not_return_is_reported_once_and_not_waited_for_again() {
    if !has_c_compiler() {
        return;
    }
    let path = broken(&["HANG_IN_STEP", "HANG_IN_STOP"]);
    let mut robot = robot(&hurried(&path), "type = \"mock\"").unwrap();
    let error = robot.step(&[1.0], &mut [0.0; 2]).unwrap_err().to_string();
    assert!(error.contains("; it could not be told to stop: the robot did not answer within 0.3 s"), "{error}");
    let begin = Instant::now();
    assert!(robot.stop().is_err());
    assert!(begin.elapsed() < Duration::from_millis(200));
    drop(robot);
    assert_eq!(count(&path, "ww_test_stops"), 1);
}

#[test]
fn calls_that_open_and_do_not_return_time_out() {
    if !has_c_compiler() {
        return;
    }
    let hanging = hurried(&broken(&["HANG_IN_OPEN"]));
    let error = refused(robot(&hanging, "type = \"mock\""));
    assert_eq!(error.to_string(), "the robot did not answer within 1 s: plugin robot `mock`: the call of `open` has not returned");
    let error = model(&hanging, "type = \"mock\"").unwrap_err();
    assert_eq!(error.to_string(), "model plugin `mock`: opening it has not returned within 1 s");
    let error = hurried(&broken(&["HANG_IN_CHECK"])).robot(table("type = \"mock\"")).unwrap_err();
    assert_eq!(error.to_string(), "`type`: plugin robot `mock`: checking this table has not returned within 1 s");
}

#[test]
fn a_model_that_fails_on_the_way_ends_the_simulation_with_its_reason() {
    if !has_c_compiler() {
        return;
    }
    let registry = registry(&broken(&[]));
    for (input, expected) in [
        (7.0, "model plugin `mock`: equation 1: the coefficient of `b` is NaN at inputs [7.0], outputs [0.0], accelerations [0.0]"),
        (8.0, "model plugin `mock`: eight is too many"),
    ] {
        let model = model(&registry, "type = \"mock\"").unwrap();
        assert_eq!(model.failure(), None);
        let mut acceleration = [0.0];
        model.accelerations(&[0.5, 1.0], &[3.0], &[0.0], &mut acceleration).unwrap();
        assert!((acceleration[0] - 6.0).abs() < 1e-14);
        let error = model.accelerations(&[0.5, 1.0], &[input], &[0.0], &mut acceleration).unwrap_err();
        assert_eq!(error.to_string(), expected);
        assert_eq!(model.failure(), Some(error));
    }
    let model = model(&registry, "type = \"mock\"").unwrap();
    let singular = model.accelerations(&[0.0, 1.0], &[1.0], &[0.0], &mut [0.0]).unwrap_err();
    assert_eq!(singular, ModelError::Singular { model: "mock".to_owned() });
    let (mut phi, mut y) = ([0.0; 2], [0.0]);
    model.regressor(Sample { inputs: &[f64::INFINITY], outputs: &[1.0], accelerations: &[0.0] }, &mut phi, &mut y);
    assert_eq!(model.failure(), None, "a simulation that diverges is not the model's fault");
}

#[test]
fn bounds_that_exclude_everything_are_refused() {
    if !has_c_compiler() {
        return;
    }
    let error = model(&registry(&broken(&["BAD_BOUNDS"])), "type = \"mock\"").unwrap_err();
    assert!(error.to_string().ends_with("parameter `a`: its bounds are 1 and -1"), "{error}");
}
