//! The emulated Khepera answers as K-Team's own server did, line for line; its traps are the same.

use crate::transcripts::read;
use proptest::prelude::*;
use wheelwright_core::robot::{Live, RobotConfig};
use wheelwright_robots::SimulatorConfig;
use wheelwright_robots::emulator::{KheperaEmulator, KheperaServer, Protocol};
use wheelwright_robots::khepera::dialect::Generation;

fn emulator(generation: Generation) -> KheperaEmulator {
    let server = KheperaServer { generation, ..KheperaServer::default() };
    let simulator = SimulatorConfig::try_from("robot = 'khepera-3'\nperiod = 0.005".parse::<toml::Table>().unwrap()).unwrap();
    KheperaEmulator::new(&server, Live::new(simulator.connect(1).unwrap())).unwrap()
}

fn ask(emulator: &mut KheperaEmulator, sent: &str) -> String {
    let mut answer = Vec::new();
    emulator.receive(sent.as_bytes(), &mut answer).unwrap();
    String::from_utf8(answer).unwrap()
}

fn pass(emulator: &mut KheperaEmulator, seconds: f64) {
    for _ in 0..(seconds / emulator.period()).round() as usize {
        emulator.pass(&mut Vec::new()).unwrap();
    }
}

/// Letter, then the values if they are numbers.
fn parts(answer: &str) -> (String, Vec<f64>) {
    let mut words = answer.trim_end().split(',');
    (words.next().unwrap_or_default().to_owned(), words.filter_map(|w| w.parse().ok()).collect())
}

#[test]
fn the_emulator_answers_as_the_robots_own_server() {
    let Some(entries) = read("khepera3_kh3server.txt") else { return };
    let mut emulator = emulator(Generation::Three);
    let (mut time, mut compared, mut expected) = (0.0, 0, Vec::<u8>::new());
    for entry in entries.iter().filter(|e| !e.bytes.is_empty()) {
        if !entry.from_client {
            let (ours, theirs) =
                (String::from_utf8(std::mem::take(&mut expected)).unwrap(), String::from_utf8(entry.bytes.clone()).unwrap());
            assert!(ours.ends_with("\r\n"), "at {} s: {ours:?} where the server said {theirs:?}", entry.time);
            let (ours, theirs) = (parts(&ours), parts(&theirs));
            assert_eq!((&ours.0, ours.1.len()), (&theirs.0, theirs.1.len()), "at {} s", entry.time);
            if ["e", "r"].contains(&ours.0.as_str()) {
                compare(entry.time, &ours, &theirs);
            }
            compared += 1;
            continue;
        }
        assert!(expected.is_empty(), "at {} s an answer to a command the server was silent about", entry.time);
        pass(&mut emulator, entry.time - time);
        time = entry.time;
        emulator.receive(&entry.bytes, &mut expected).unwrap();
    }
    assert!(compared > 40 && expected.is_empty(), "{compared} answers");
}

/// Both robots are driven alike and settle at the same speed; how soon is each robot's own affair.
fn compare(time: f64, ours: &(String, Vec<f64>), theirs: &(String, Vec<f64>)) {
    for (ours, theirs) in ours.1.iter().zip(&theirs.1) {
        let settled = (0.5..1.02).contains(&time);
        let allowed = match theirs {
            _ if !settled => 25_000.0,
            speed if speed.abs() > 10_000.0 => 0.01 * speed.abs(),
            _ => 450.0,
        };
        assert!((ours - theirs).abs() <= allowed, "at {time} s: {ours} where the server said {theirs}");
    }
}

#[test]
fn the_first_character_of_an_argument_is_blanked_whatever_it_is() {
    let mut emulator = emulator(Generation::Three);
    for (sent, v_ref) in [
        ("D,l21872,l21872\n", 0.1),
        ("D,20000,20000\n", 0.0),
        ("D,l-21872,l-21872\n", -0.1),
        ("D,121872,121872\n", 0.1),
        ("D,d0,d0\n", 0.0),
    ] {
        assert_eq!(ask(&mut emulator, sent), "d\r\n");
        assert!((emulator.state().v_ref - v_ref).abs() < 1e-5, "{sent}: {:?}", emulator.state());
    }
}

#[test]
fn what_is_sent_before_the_answer_is_lost() {
    let mut emulator = emulator(Generation::Three);
    assert_eq!(ask(&mut emulator, "E\nR\n"), "e,0,0\r\n");
    assert_eq!(ask(&mut emulator, "R"), "", "half a line is no command");
    assert_eq!(ask(&mut emulator, "\r\n"), "r,0,0\r\n");
    assert_eq!(ask(&mut emulator, "R\r"), "", "nor is one that ends otherwise");
    assert_eq!(ask(&mut emulator, "Z\n"), "r,0,0\r\n");
    assert_eq!(ask(&mut emulator, "D,l1234567890,l0\n"), "", "an argument beyond the buffer is not answered");
    assert_eq!(ask(&mut emulator, "Q\n"), "$\r\n");
    assert_eq!(ask(&mut emulator, "Y,l20000\n"), "$\r\n", "time cannot be asked for on a real clock");
}

/// Bytes of `kh3server` and `kh4server`, asked one after the other.
#[test]
fn answers_are_those_of_k_teams_servers() {
    let asked = |generation, dialogue: &[(&str, &str)]| {
        let mut emulator = emulator(generation);
        for (sent, answer) in dialogue {
            assert_eq!(ask(&mut emulator, sent), *answer, "{generation:?}: {sent:?}");
        }
    };
    let both = [("\n", ""), ("\r\n", ""), ("Q\n", "$\r\n"), ("M\n", "m\r\n"), ("H,d0,d620,d10,d3\n", "h\r\n"), ("Z\n", "z\r\n")];
    asked(Generation::Three, &both);
    asked(Generation::Four, &both);
    asked(Generation::Three, &[("B\n", "b,3,0\r\n"), ("K,0,1\n", "k\r\n"), ("C,0,d3\n", "c\r\n"), ("E\nR\n", "e,0,0\r\n")]);
    asked(Generation::Four, &[("B\r\n", "b,A,1\r\n"), ("C,0,d3\n", "$\r\n"), ("D,-100,100\n", "d\r\n"), ("D,0,0\n", "d\r\n")]);
}

#[test]
fn every_generation_has_its_own_words_and_units() {
    for (generation, version, sent, speed) in [
        (Generation::ThreeOld, "b,2,0\r\n", "D,l14401,l14401\n", 14_401.0),
        (Generation::Three, "b,3,0\r\n", "D,l21872,l21872\n", 21_872.0),
        (Generation::Four, "b,A,1\r\n", "D,147,147\n", 147.0),
    ] {
        let mut emulator = emulator(generation);
        assert_eq!(ask(&mut emulator, "B\n"), version);
        assert_eq!(Generation::of_version(version[2..].split(',').next().unwrap()), Some(generation));
        ask(&mut emulator, sent);
        pass(&mut emulator, 2.0);
        let (v, measured) = (emulator.state().v, parts(&ask(&mut emulator, "E\n")).1);
        assert!((v - 0.1).abs() < 0.002, "{generation:?}: {v} m/s");
        assert!((measured[0] / speed - 1.0).abs() < 0.01, "{generation:?}: {measured:?}");
        let pulses = parts(&ask(&mut emulator, "R\n")).1[0];
        let way = pulses * generation.dialect().pulse;
        assert!((0.17..0.2).contains(&way), "{generation:?}: {way} m");
        assert_eq!(ask(&mut emulator, if generation == Generation::Four { "I\n" } else { "I,l0,l0\n" }), "i\r\n");
        assert_eq!(ask(&mut emulator, "R\n"), "r,0,0\r\n");
    }
    for unknown in ["0", "5", "", "AB", "?"] {
        assert_eq!(Generation::of_version(unknown), None, "{unknown}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]
    #[test]
    fn no_bytes_break_the_server(lines in proptest::collection::vec("[A-Za-z0-9,ld\\-\r\n$ ]{0,40}|\\PC{0,12}", 0..20)) {
        let mut emulator = emulator(Generation::Three);
        for line in lines {
            let _ = ask(&mut emulator, &line);
            pass(&mut emulator, 0.005);
        }
        prop_assert!(emulator.state().v.is_finite());
        // Whatever came before, a newline and a question are answered.
        ask(&mut emulator, "\n");
        prop_assert!(ask(&mut emulator, "B\n").starts_with("b,3,0"));
    }
}
