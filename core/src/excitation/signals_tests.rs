use super::*;
use crate::channel::{OMEGA_REF, V_REF};
use crate::config::{names, tagged};

const INPUTS: [Channel; 2] = [V_REF, OMEGA_REF];

fn read(text: &str) -> Result<Box<dyn Excitation>, String> {
    tagged(toml::from_str(text).unwrap()).map_err(|e| e.to_string())
}

fn refused(signal: &str) -> String {
    let text = format!("type = 'signals'\nduration = 10.0\nsignals = [{{ {signal} }}]");
    match read(&text) {
        Ok(excitation) => excitation.check(&INPUTS).unwrap_err().to_string(),
        Err(error) => error,
    }
}

fn at(excitation: &dyn Excitation, t: f64) -> [f64; 2] {
    let mut command = [f64::NAN; 2];
    excitation.command(t, &INPUTS, &mut command);
    command
}

#[test]
fn all_built_in_excitations_are_registered() {
    let registered = names::<Box<dyn Excitation>>();
    for name in ["signals", "thesis-constant", "thesis-khepera", "thesis-multisine", "thesis-pioneer"] {
        assert!(registered.iter().any(|r| r == name), "{name} is not among {registered:?}");
    }
}

#[test]
fn every_kind_adds_up() {
    let excitation = read(
        "type = 'signals'
        duration = 20
        [[signals]]
        channel = 'v_ref'
        kind = 'constant'
        value = 0.5
        [[signals]]
        channel = 'v_ref'
        kind = 'step'
        value = 1
        start = 2
        end = 4
        [[signals]]
        channel = 'omega_ref'
        kind = 'ramp'
        from = 1.0
        to = 3.0
        start = 5.0
        end = 7.0
        [[signals]]
        channel = 'omega_ref'
        kind = 'sine'
        amplitude = 0.25
        frequency_hz = 0.25
        phase_rad = 0.1
        start = 8.0
        end = 10.0",
    )
    .unwrap();
    assert_eq!(excitation.check(&INPUTS), Ok(()));
    assert_eq!(excitation.duration(), 20.0);
    for (t, expected) in [
        (0.0, [0.5, 0.0]),
        (2.0, [1.5, 0.0]),
        (4.0, [0.5, 0.0]),
        (5.0, [0.5, 1.0]),
        (6.5, [0.5, 2.5]),
        (7.5, [0.5, 3.0]),
        // 3 + 0.25 sin(2 pi 0.25 * 1 + 0.1) = 3 + 0.25 cos 0.1
        (9.0, [0.5, 3.0 + 0.25 * 0.1_f64.cos()]),
        (10.0, [0.5, 3.0]),
    ] {
        let found = at(&*excitation, t);
        assert!((found[0] - expected[0]).abs() < 1e-14 && (found[1] - expected[1]).abs() < 1e-14, "t = {t}: {found:?} {expected:?}");
    }
}

#[test]
fn ramps_by_rate_and_to_the_end() {
    let ramp = |to, rate, end| Signal::Ramp(Ramp { channel: "v_ref".into(), from: 0.0, to, rate, start: 0.0, end });
    assert_eq!(ramp(None, Some(0.5), Some(2.0)).at(1.0, 10.0), 0.5);
    assert_eq!(ramp(None, Some(0.5), Some(2.0)).at(3.0, 10.0), 1.0);
    assert_eq!(ramp(Some(1.0), None, None).at(5.0, 10.0), 0.5);
}

#[test]
fn the_thesis_signal_can_be_written() {
    let tone = |channel: &str, amplitude: f64, rate: f64| {
        Signal::Sine(Sine {
            channel: channel.into(),
            amplitude,
            frequency_hz: None,
            omega_rad_s: Some(rate),
            phase_rad: 0.0,
            start: 0.0,
            end: None,
        })
    };
    let constant = |channel: &str, value: f64| Signal::Constant(Constant { channel: channel.into(), value });
    let mut signals = vec![constant("v_ref", 0.4), constant("omega_ref", 0.75)];
    signals.extend([2.0, 1.0, 1.0 / 3.0, 1.0 / 11.0].map(|w| tone("v_ref", 0.1, w)));
    signals.extend([1.5, 1.0, 0.5, 0.2].map(|w| tone("omega_ref", 0.25, w)));
    let written = Signals { duration: 150.0, signals };
    let built_in = crate::excitation::thesis::ThesisPioneer::default();
    for k in 0..150 {
        let (a, b) = (at(&written, f64::from(k)), at(&built_in, f64::from(k)));
        assert!((a[0] - b[0]).abs() < 1e-14 && (a[1] - b[1]).abs() < 1e-14);
    }
}

#[test]
fn impossible_settings_name_their_key() {
    for (signal, message) in [
        ("channel = 'v', kind = 'constant', value = 1.0", "the robot has no command `v`; it takes `v_ref` and `omega_ref`"),
        ("channel = 'v_ref', kind = 'constant', value = inf", "`signals[0].value`: must be a finite number, not inf"),
        (
            "channel = 'v_ref', kind = 'step', value = 1.0, start = 10.0",
            "`signals[0].start`: 10 s does not lie within the excitation's 0 to 10 s",
        ),
        (
            "channel = 'v_ref', kind = 'step', value = 1.0, start = -1.0",
            "`signals[0].start`: -1 s does not lie within the excitation's 0 to 10 s",
        ),
        (
            "channel = 'v_ref', kind = 'step', value = 1.0, start = 3.0, end = 3.0",
            "`signals[0].end`: 3 s does not lie after the start at 3 s",
        ),
        ("channel = 'v_ref', kind = 'ramp'", "`signals[0].to`: is missing: give `to` or `rate`"),
        ("channel = 'v_ref', kind = 'ramp', to = 1.0, rate = 1.0", "`signals[0].rate`: give `to` or `rate`, not both"),
        ("channel = 'v_ref', kind = 'ramp', rate = nan", "`signals[0].rate`: must be a finite number, not NaN"),
        (
            "channel = 'v_ref', kind = 'sine', amplitude = 1.0",
            "`signals[0].frequency_hz`: is missing: give `frequency_hz` or `omega_rad_s`",
        ),
        (
            "channel = 'v_ref', kind = 'sine', amplitude = 1.0, omega_rad_s = 0.0",
            "`signals[0].omega_rad_s`: must be above zero; a constant is kind = \"constant\"",
        ),
    ] {
        assert_eq!(refused(signal), message);
    }
    let empty = Signals { duration: 1.0, signals: Vec::new() }.check(&INPUTS).unwrap_err();
    assert_eq!(empty.to_string(), "`signals`: is empty: give at least one [[excitation.signals]]");
}

#[test]
fn unknown_keys_and_kinds_are_refused() {
    let error = refused("channel = 'v_ref', kind = 'sine', amplitud = 1.0");
    assert!(error.starts_with("`signals[0]") && error.contains("unknown field `amplitud`") && error.contains("`amplitude`?"), "{error}");
    let error = refused("channel = 'v_ref', kind = 'sinus', amplitude = 1.0");
    assert!(error.starts_with("`signals[0]") && error.contains("unknown variant `sinus`") && error.ends_with("`sine`?"), "{error}");
    let error = read("type = 'thesis-pioneer'\nduraton = 3.0").unwrap_err();
    assert!(error.starts_with("`duraton`: unknown field `duraton`") && error.ends_with("did you mean `duration`?"), "{error}");
}

#[test]
fn a_plain_configuration_survives_a_round_trip() {
    let excitation = Signals { duration: 5.0, signals: vec![Signal::Constant(Constant { channel: "v_ref".into(), value: 1.0 })] };
    let text = toml::to_string(&excitation).unwrap();
    assert_eq!(toml::from_str::<Signals>(&text).unwrap(), excitation);
}

#[test]
fn the_configurations_of_the_document_are_accepted() {
    let document = include_str!("../../../docs/excitations.md");
    let blocks: Vec<&str> = document.split("```toml\n").skip(1).filter_map(|rest| rest.split("```").next()).collect();
    assert_eq!(blocks.len(), 3);
    for block in blocks {
        let mut table: toml::Table = toml::from_str(block).unwrap();
        let Some(toml::Value::Table(table)) = table.remove("excitation") else { panic!("no [excitation] in {block}") };
        let excitation: Box<dyn Excitation> = tagged(table).unwrap();
        assert_eq!(crate::conformance::check_excitation(&*excitation, &INPUTS), Ok(()), "{block}");
    }
}
