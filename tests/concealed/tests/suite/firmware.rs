//! Firmware, sensors and noise against what they are said to do.

use wheelwright_concealed::draw::robot::{Kind, Machine};
use wheelwright_concealed::draw::stream;
use wheelwright_concealed::firmware::Command;
use wheelwright_concealed::firmware::control::Style;
use wheelwright_concealed::firmware::link::{Inbox, Link};
use wheelwright_concealed::firmware::setpoint::{Shaper, Shaping};
use wheelwright_concealed::sensors::noise::Character;
use wheelwright_concealed::sensors::trace::Trace;
use wheelwright_concealed::sensors::{Sensors, Source};

fn step_command(v: f64, omega: f64) -> [Command; 2] {
    [Command { t: 0.0, v, omega }, Command { t: 2.0, v, omega }]
}

#[test]
fn a_plain_robot_answers_a_step_with_its_time_constant() {
    // Of each law: v(t) = S/D (1 - exp(-D t/M)) u, with moved mass M, servo stiffness S and all losses D.
    for style in [Style::Wheels, Style::Twist, Style::Open] {
        for seed in 0..6 {
            let mut machine = Machine::draw(Kind::Random, Some(style), &mut stream(seed, &[1]));
            machine.rig.body.forward = 0.0;
            let feedback = if style == Style::Open { 0.0 } else { 1.0 };
            let trace = Trace::drive(&machine.rig, &machine.firmware, &step_command(machine.typical[0], 0.0), 2.0, 0.0, || 0.5);
            let losses = feedback + machine.drag[0] / machine.servo[0];
            for t in [0.1, 0.3, 1.0] {
                let wanted = machine.typical[0] / losses * (1.0 - (-losses * t / machine.times()[0]).exp());
                let got = trace.at(t).twist[0];
                assert!((got - wanted).abs() < 6e-3 * machine.typical[0], "{style:?} {seed} {t}: {got}, wanted {wanted}");
            }
        }
    }
}

#[test]
fn messages_come_late_in_order_or_not_at_all() {
    let commands: Vec<Command> = (0..20).map(|k| Command { t: 0.1 * f64::from(k), v: f64::from(k), omega: 0.0 }).collect();
    let link = Link { latency: 0.25, variation: 0.0, lost: vec![(0.95, 1.25)], dead_man: None };
    let mut inbox = Inbox::new(&link, &commands, || 0.5);
    assert_eq!(inbox.latest(0.24).v, 0.0);
    assert_eq!(inbox.latest(0.36).v, 1.0);
    assert_eq!(inbox.latest(1.5).v, 9.0, "numbers 10 to 12 are lost");
    assert_eq!(inbox.latest(1.56).v, 13.0);
    let mut guarded = Inbox::new(&Link { dead_man: Some(0.2), ..link }, &commands, || 0.5);
    assert_eq!((guarded.latest(1.3).v, guarded.latest(1.4).v, guarded.latest(1.56).v), (9.0, 0.0, 13.0));
}

#[test]
fn set_points_are_shaped_as_set() {
    let shape = |set: Shaping, v: f64, times: usize| {
        let mut shaper = Shaper::default();
        (0..times).map(|_| shaper.shape(&set, Command { t: 0.0, v, omega: 0.0 }, 0.2, 1e-3)[0]).last().unwrap()
    };
    let plain = Shaping::default();
    assert_eq!(shape(plain, 0.3, 1), 0.3);
    assert!((shape(Shaping { ramp: [0.5, 1.0], ..plain }, 0.3, 100) - 0.05).abs() < 1e-12);
    assert_eq!(shape(Shaping { least: 0.1, ..plain }, 0.09, 1), 0.0);
    assert_eq!(shape(Shaping { least: 0.1, ..plain }, 0.12, 1), 0.12);
    assert!((shape(Shaping { least: 0.1, subtract: true, ..plain }, -0.12, 1) + 0.02).abs() < 1e-12);
    assert_eq!(shape(Shaping { wheel_limit: 0.2, ..plain }, -0.3, 1), -0.2);
    assert_eq!(shape(Shaping { rounding: [0.25, 0.0], ..plain }, 0.3, 1), 0.25);
    let lag = shape(Shaping { smoothing: 0.1, ..plain }, 1.0, 100);
    assert!((lag - (1.0 - (-1.0f64).exp())).abs() < 1e-9, "{lag}");
    let stages = shape(Shaping { smoothing: 0.1, two_stages: true, ..plain }, 1.0, 100);
    assert!((stages - (1.0 - 3.0 * (-2.0f64).exp())).abs() < 0.02, "{stages}");
}

#[test]
fn sensors_are_late_coarse_and_unsteady_as_set() {
    let machine = Machine::draw(Kind::Pioneer, None, &mut stream(3, &[1]));
    let trace = Trace::drive(&machine.rig, &machine.firmware, &step_command(0.4, 0.5), 2.0, 0.0, || 0.5);
    let stamps: Vec<f64> = (0..40).map(|k| 0.05 * f64::from(k)).collect();
    let sensors = Sensors::ideal(Source::Body, machine.firmware.radius, machine.firmware.half_track);
    let plain = sensors.foreseen(&trace, &stamps);
    let late = Sensors { delay: [0.1, 0.05], ..sensors.clone() }.foreseen(&trace, &stamps);
    assert!((late.v[10] - plain.v[8]).abs() < 1e-9 && (late.omega[10] - plain.omega[9]).abs() < 1e-9);
    let wheels = Sensors { source: Source::Wheels, ..sensors.clone() }.foreseen(&trace, &stamps);
    assert!(wheels.v.iter().zip(&plain.v).all(|(a, b)| (a - b).abs() < 1e-9), "rolling without slip, both are one");
    let counting = Sensors { source: Source::Wheels, tick: 1e-3, ..sensors.clone() };
    let counted = counting.measured(&trace, &stamps, &mut stream(1, &[1]));
    let lattice = 0.5 * 1e-3 / 0.05;
    assert!(counted.v.iter().all(|v| ((v / lattice).round() * lattice - v).abs() < 1e-9), "speeds sit on the counts' lattice");
    // A count over a row is the mean speed over that row.
    let mean = (trace.at(1.0).angle[0] - trace.at(0.95).angle[0]) * machine.firmware.radius / 0.05;
    let foreseen = counting.foreseen(&trace, &stamps);
    assert!((foreseen.wheel[0][20] * machine.firmware.radius - mean).abs() < 1e-9);
    let jittery = Sensors { jitter: 0.02, ..sensors }.measured(&trace, &stamps, &mut stream(1, &[2]));
    assert!(jittery.v.iter().zip(&plain.v).skip(1).take(10).any(|(a, b)| (a - b).abs() > 1e-3));
}

#[test]
fn noise_has_its_size_and_character() {
    let count = 60_000;
    let drawn = |character: Character| {
        // On a signal that moves, so that rounding has something to round.
        let signal: Vec<f64> = (0..count).map(|k| (1.37 * k as f64).sin() * 5.0).collect();
        let mut values = signal.clone();
        character.add(&mut values, 0.2, &mut stream(5, &[9]));
        values.iter().zip(&signal).map(|(y, x)| y - x).collect::<Vec<f64>>()
    };
    let mean = |f: &dyn Fn(usize) -> f64, n: usize| (0..n).map(f).sum::<f64>() / n as f64;
    for character in [Character::White, Character::Coloured(0.7), Character::Heavy, Character::Quantised] {
        let y = drawn(character);
        let variance = mean(&|k| y[k] * y[k], count);
        // Three degrees of freedom have no fourth moment: their sample variance scatters more.
        let tolerance = if character == Character::Heavy { 0.15 } else { 0.04 };
        assert!((variance.sqrt() / 0.2 - 1.0).abs() < tolerance, "{character:?}: {}", variance.sqrt());
        let memory = mean(&|k| y[k] * y[k + 1], count - 1) / variance;
        assert!((memory - character.memory()).abs() < 0.02, "{character:?}: {memory}");
    }
    let heavy = drawn(Character::Heavy);
    let far = heavy.iter().filter(|y| y.abs() > 0.8).count();
    assert!(far > 200, "of Gaussian values 4 in {count} would be beyond four standard deviations, here {far}");
}
