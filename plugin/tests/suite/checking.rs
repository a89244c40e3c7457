//! `plugins check`: good libraries pass, others are told what they break.

use std::sync::mpsc;
use std::time::Duration;

use crate::support::{broken, compile, has_c_compiler, load, load_hurried, model, panicking, registry, rust_example, table};
use wheelwright_core::model::{RegressorModel, Sample};
use wheelwright_plugin::check::{Outcome, Report, check};
use wheelwright_plugin::watch_models;

fn report(path: &std::path::Path) -> Report {
    check(load(path).unwrap(), &[]).unwrap()
}

#[test]
fn the_examples_pass() {
    let example = rust_example();
    let rust = report(&example);
    assert!(rust.passed());
    let version = env!("CARGO_PKG_VERSION");
    let expected = format!(
        "wheelwright-example-plugin {version} ({})\n  \
         robot \"second-order-base\" (a base with second-order velocity loops, from the example plugin): ok\n  \
         model \"lag\" (a time constant and a gain for each velocity, from the example plugin): ok\n  \
         effect \"bus_period\" (commands pass at the ticks of a slow bus, from the example plugin): ok\n",
        example.display()
    );
    assert_eq!(rust.to_string(), expected);
    if has_c_compiler() {
        for name in ["robot", "model", "effect"] {
            let c = report(&compile(&format!("examples/plugins/c/{name}.c"), &[], &format!("check_{name}")));
            assert_eq!(c.checked.iter().map(|c| &c.outcome).collect::<Vec<_>>(), [&Outcome::Kept], "{c}");
        }
    }
}

#[test]
fn what_is_broken_is_said() {
    if !has_c_compiler() {
        return;
    }
    for (define, robot, model) in [
        ("NAN_OUTPUT", "`z` is NaN", "the coefficient of `b` is NaN"),
        ("HANG_IN_OPEN", "the call of `open` has not returned", "opening it has not returned within 1 s"),
        ("BAD_PERIOD", "its period is NaN s", "ok"),
        ("NOT_AFFINE", "ok", "is not affine in the accelerations"),
    ] {
        let report = check(load_hurried(&broken(&[define])).unwrap(), &[]).unwrap();
        assert!(!report.passed());
        for (checked, expected) in report.checked.iter().zip([robot, model]) {
            match &checked.outcome {
                Outcome::Broken(reasons) => assert!(reasons[0].contains(expected), "{define}: {reasons:?}"),
                other => assert_eq!((other, expected), (&Outcome::Kept, "ok"), "{define}"),
            }
        }
    }
}

#[test]
fn a_panic_is_said_in_its_own_words_and_settings_are_used() {
    let tables = [table("type = \"panicking\"\nwhen = \"measure\"")];
    let text = check(load(&panicking()).unwrap(), &tables).unwrap().to_string();
    assert!(text.contains("robot \"panicking\" (panics): "), "{text}");
    assert!(text.contains("plugin robot `panicking`: panicked: at measure"), "{text}");
    assert!(text.contains("model \"panicking\" (panics): not checked, it needs settings: `when`: "), "{text}");
}

#[test]
fn a_model_that_hangs_is_told_to_the_watcher() {
    if !has_c_compiler() {
        return;
    }
    let model: Box<dyn RegressorModel> = model(&registry(&broken(&[])), "type = \"mock\"").unwrap();
    let (sender, told) = mpsc::channel();
    watch_models(Duration::from_millis(400), move |name| sender.send(name.to_owned()).unwrap());
    let evaluate = move |input: f64| {
        let (mut phi, mut y) = ([0.0; 2], [0.0]);
        model.regressor(Sample { inputs: &[input], outputs: &[0.0], accelerations: &[0.0] }, &mut phi, &mut y);
    };
    for _ in 0..20 {
        evaluate(1.0);
        std::thread::sleep(Duration::from_millis(50));
    }
    assert!(told.try_recv().is_err(), "a model between calls does not hang");
    std::thread::spawn(move || evaluate(9.0));
    assert_eq!(told.recv_timeout(Duration::from_secs(30)).unwrap(), "mock");
}
