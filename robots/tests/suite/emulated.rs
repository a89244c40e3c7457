//! The drivers against the emulators over real sockets and terminals: theta through the wire, and what goes wrong on it.

use std::fs::File;
use std::net::TcpStream;
use std::time::{Duration, Instant};

use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

use crate::common::wire::{agree, emulate, identify, robot, stands_beside_a_late_law};
use crate::machine::undisturbed;
use wheelwright_core::robot::{Live, RobotError};
use wheelwright_robots::emulator::Emulator;

const PIONEER: &str = "type = 'simulator'\nrobot = 'pioneer-3dx'";
const STEPPED_PIONEER: &str = "type = 'pioneer'\nlisten = '127.0.0.1:0'\nclock = 'stepped'";

/// A driver with ramps that no command is slower than.
fn stepped_pioneer(emulator: &Emulator, limits: &str, more: &str) -> Live {
    stepped_pioneer_at(&format!("tcp = '{}'", emulator.address()), limits, more)
}

fn stepped_pioneer_at(place: &str, limits: &str, more: &str) -> Live {
    let text = format!("type = 'pioneer'\n{place}\nclock = 'stepped'\n{more}\n[limits]\nv_dot = 20\nomega_dot = 60\n{limits}");
    robot(&text).unwrap()
}

/// A terminal whose other end is the emulator, as a serial line's is the robot. Gives its name.
fn serial_line(emulator: &Emulator) -> String {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let name = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
    let (line, server) = (File::from(master), TcpStream::connect(emulator.address()).unwrap());
    let (mut heard, mut said) = (line.try_clone().unwrap(), server.try_clone().unwrap());
    std::thread::spawn(move || std::io::copy(&mut heard, &mut said));
    std::thread::spawn(move || std::io::copy(&mut &server, &mut &line));
    name
}

#[test]
fn a_pioneer_over_tcp_or_a_serial_line_has_the_same_theta_as_without_a_wire() {
    let (direct, _) = identify(&mut robot(PIONEER).unwrap(), "vw-pd", "thesis-pioneer", 60.0);
    for (command, serial) in [("vel", false), ("vel2", false), ("vel", true)] {
        let emulator = emulate(STEPPED_PIONEER, PIONEER);
        let place = if serial { format!("serial = '{}'", serial_line(&emulator)) } else { format!("tcp = '{}'", emulator.address()) };
        let mut robot = stepped_pioneer_at(&place, "", &format!("command = '{command}'"));
        let begin = Instant::now();
        let (through, warnings) = identify(&mut robot, "vw-pd", "thesis-pioneer", 60.0);
        println!("{command}, {place}: {warnings:?} {:?}", begin.elapsed());
        agree(command, &direct, &through, 0.002, 0.0005);
    }
}

#[test]
fn a_khepera_on_a_terminal_has_the_same_theta_as_without_a_wire() {
    const KHEPERA: &str = "type = 'simulator'\nrobot = 'khepera-3'";
    let (direct, _) = identify(&mut robot(KHEPERA).unwrap(), "wheel-pd", "thesis-khepera", 20.0);
    let folder = tempfile::tempdir().unwrap();
    for generation in ["khepera-3-old", "khepera-3", "khepera-4"] {
        let link = folder.path().join(generation);
        let server = format!("type = 'khepera'\npty = '{}'\nclock = 'stepped'\ngeneration = '{generation}'", link.display());
        let emulator = emulate(&server, KHEPERA);
        let config = format!("type = 'khepera'\nserial = '{}'\nclock = 'stepped'", emulator.address());
        let begin = Instant::now();
        let (through, warnings) = identify(&mut robot(&config).unwrap(), "wheel-pd", "thesis-khepera", 20.0);
        println!("{generation}: {warnings:?} {:?}", begin.elapsed());
        agree(generation, &direct, &through, 0.002, 0.0005);
        emulator.finish().unwrap();
        assert!(!link.exists() && link.symlink_metadata().is_err(), "the link to the terminal is removed");
    }
}

#[test]
fn odometry_and_encoders_show_the_way() {
    let emulator = emulate(STEPPED_PIONEER, PIONEER);
    let mut robot = stepped_pioneer(&emulator, "", "encoders = true");
    let names: Vec<_> = robot.outputs().iter().map(|c| c.name.to_string()).collect();
    assert_eq!(names, ["v", "omega", "x", "y", "phi", "vel_left", "vel_right", "battery", "pos_left", "pos_right"]);
    let mut measured = vec![0.0; 10];
    // So far that every counter goes round several times: 40 m and six turns.
    for _ in 0..400 {
        robot.step(&[1.0, 0.0], &mut measured).unwrap();
    }
    let ([x, y], [left, right]) = ([measured[2], measured[3]], [measured[8], measured[9]]);
    assert!((39.0..40.5).contains(&x) && y.abs() < 0.1, "{measured:?}");
    assert!((left - x).abs() < 0.01 && (right - x).abs() < 0.01, "{measured:?}");
    for _ in 0..200 {
        robot.step(&[0.0, 2.0], &mut measured).unwrap();
    }
    assert!((38.0..41.0).contains(&measured[4]), "{} rad", measured[4]);
    assert!((measured[9] - measured[8] - measured[4] * 0.357).abs() < 0.05, "{measured:?}");
    assert!((measured[7] - 13.0).abs() < 1e-9);
}

#[test]
fn limits_and_rounding_happen_below_whatever_calls() {
    let emulator = emulate(STEPPED_PIONEER, PIONEER);
    let mut robot = stepped_pioneer(&emulator, "v = 0.5\nomega = 1.0", "");
    let mut held = [3.0, -2.0];
    robot.executed(&mut held);
    assert_eq!(held, [0.5, -(57.0_f64).to_radians()], "1 rad/s is 57.3 degrees a second");
    robot.step(&[3.0, -2.0], &mut [0.0; 8]).unwrap();
    let state = emulator.state();
    assert!((state.v_ref - 0.5).abs() < 1e-9 && (state.omega_ref + 57.0_f64.to_radians()).abs() < 1e-9, "{state:?}");
    assert!(robot.warnings().iter().any(|w| w.contains("1 of 1 commands were cut")), "{:?}", robot.warnings());
    assert!(matches!(robot.step(&[f64::NAN, 0.0], &mut [0.0; 8]), Err(RobotError::Fault(_))));
    assert!(matches!(robot.step(&[0.1, 0.0], &mut [0.0; 8]), Err(RobotError::Fault(_))), "nothing is driven after an error");
}

#[test]
fn a_step_that_the_ramp_cannot_follow_is_named() {
    let emulator = emulate(STEPPED_PIONEER, PIONEER);
    let mut robot = robot(&format!("type = 'pioneer'\ntcp = '{}'\nclock = 'stepped'", emulator.address())).unwrap();
    for v in [0.02, 0.5, 0.5] {
        robot.step(&[v, 0.0], &mut [0.0; 8]).unwrap();
    }
    let warnings = robot.warnings().join("\n");
    assert!(warnings.contains("1 of 3 steps of v_ref") && warnings.contains("0.30 m/s²"), "{warnings}");
}

#[test]
fn stop_can_be_called_any_time_and_again() {
    undisturbed(|| {
        let emulator = emulate(STEPPED_PIONEER, PIONEER);
        let mut robot = stepped_pioneer(&emulator, "", "");
        for _ in 0..10 {
            robot.step(&[0.5, 0.5], &mut [0.0; 8]).unwrap();
        }
        for _ in 0..3 {
            robot.stop().unwrap();
        }
        // The last packet is on its way when `stop` returns.
        std::thread::sleep(Duration::from_millis(100));
        let state = emulator.state();
        assert!(!state.enabled && state.v_ref == 0.0 && state.v.abs() < 0.01, "{state:?}");
        drop(robot);
        std::thread::sleep(Duration::from_millis(100));
        assert!(!emulator.state().open, "the session is closed at the end");
    });
}

#[test]
fn a_session_left_open_is_closed_and_opened_again() {
    undisturbed(|| {
        let emulator = emulate("type = 'pioneer'\nlisten = '127.0.0.1:0'", PIONEER);
        leave_open(emulator.address());
        let mut second = robot(&format!("type = 'pioneer'\ntcp = '{}'", emulator.address())).unwrap();
        let t = second.measure(&mut [0.0; 8]).unwrap();
        assert!(t > 0.0 && emulator.clients() == 2);
    });
}

/// Opens a session by hand and goes away.
fn leave_open(address: &str) {
    use std::io::{Read, Write};
    use wheelwright_robots::pioneer::command::{integer, number, plain};
    let mut stream = std::net::TcpStream::connect(address).unwrap();
    for packet in [plain(number::SYNC0), plain(number::SYNC1), plain(number::SYNC2), integer(number::OPEN, 1)] {
        stream.write_all(&packet).unwrap();
    }
    stream.write_all(&[integer(number::ENABLE, 1), integer(number::VEL, 300)].concat()).unwrap();
    let _ = stream.read(&mut [0; 64]);
    std::thread::sleep(Duration::from_millis(150));
}

#[test]
fn the_watchdog_stops_a_robot_whose_host_is_gone() {
    undisturbed(|| {
        let emulator = emulate("type = 'pioneer'\nlisten = '127.0.0.1:0'\nwatchdog = 0.5\nacceleration = 2000", PIONEER);
        leave_open(emulator.address());
        let moving = emulator.state();
        assert!(moving.v > 0.01 && moving.open, "{moving:?}");
        std::thread::sleep(Duration::from_millis(1800));
        let state = emulator.state();
        assert!(state.v.abs() < 0.01, "it stands: {state:?}");
        assert!((state.v_ref - 0.3).abs() < 1e-9, "and remembers what it was told: {state:?}");
    });
}

/// Drives until something goes wrong; returns the error and the time from then to the zero command at the robot.
fn drive_into(fault: &str) -> (RobotError, Emulator, Instant) {
    let server = format!("type = 'pioneer'\nlisten = '127.0.0.1:0'\n[[fault]]\nafter = 8\n{fault}");
    let emulator = emulate(&server, PIONEER);
    let mut robot = robot(&format!("type = 'pioneer'\ntcp = '{}'\ntimeout = 0.6", emulator.address())).unwrap();
    let mut last = Instant::now();
    let error = loop {
        match robot.step(&[0.2, 0.1], &mut [0.0; 8]) {
            Ok(_) => last = Instant::now(),
            Err(error) => break error,
        }
    };
    assert!(matches!(robot.step(&[0.2, 0.1], &mut [0.0; 8]), Err(RobotError::Fault(_))));
    let begin = Instant::now();
    for _ in 0..2 {
        let _ = robot.stop();
    }
    assert!(begin.elapsed() < Duration::from_secs(5), "stopping took {:?}", begin.elapsed());
    (error, emulator, last)
}

#[test]
fn a_cut_line_and_half_a_packet_are_lost_connections() {
    undisturbed(|| {
        for kind in ["cut", "half-packet"] {
            let (error, ..) = drive_into(&format!("kind = '{kind}'"));
            assert!(matches!(error, RobotError::Connection(_)), "{kind}: {error}");
        }
    });
}

#[test]
fn a_silent_robot_is_told_to_stand_within_two_cycles() {
    undisturbed(|| {
        for kind in ["silent", "bad-checksum"] {
            let (error, emulator, last) = drive_into(&format!("kind = '{kind}'"));
            assert!(matches!(error, RobotError::Timeout { .. }), "{kind}: {error}");
            let zero = emulator.commands().into_iter().find(|c| c.arrival > last && c.state.v_ref == 0.0).unwrap();
            let waited = zero.arrival - last;
            assert!(waited < Duration::from_millis(260), "{kind}: zero was commanded {waited:?} after the last packet");
        }
    });
}

#[test]
fn each_robot_is_told_to_stand_beside_a_law_that_is_late_and_drives_on() {
    undisturbed(|| {
        let pioneer = emulate("type = 'pioneer'\nlisten = '127.0.0.1:0'\nacceleration = 2000", PIONEER);
        let khepera = emulate("type = 'khepera'\nlisten = '127.0.0.1:0'", "type = 'simulator'\nrobot = 'khepera-3'");
        for (name, emulator, more) in
            [("pioneer", pioneer, "[limits]\nv_dot = 2.0\nomega_dot = 5.0"), ("khepera", khepera, "period = 0.05")]
        {
            let mut robot = robot(&format!("type = '{name}'\ntcp = '{}'\n{more}", emulator.address())).unwrap();
            stands_beside_a_late_law(name, &mut robot, || [emulator.state().v_ref, emulator.state().omega_ref]);
        }
    });
}

#[test]
fn a_burst_of_bad_checksums_is_survived_and_counted_in_time() {
    undisturbed(|| {
        let server = "type = 'pioneer'\nlisten = '127.0.0.1:0'\n[[fault]]\nafter = 8\nkind = 'bad-checksum'\npackets = 1";
        let emulator = emulate(server, PIONEER);
        let mut robot = robot(&format!("type = 'pioneer'\ntcp = '{}'", emulator.address())).unwrap();
        let mut measured = [0.0; 8];
        let times: Vec<f64> = (0..10).map(|_| robot.step(&[0.1, 0.0], &mut measured).unwrap()).collect();
        let steps: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).collect();
        let long = steps.iter().filter(|s| (*s - 0.2).abs() < 1e-9).count();
        let usual = steps.iter().filter(|s| (*s - 0.1).abs() < 1e-9).count();
        assert!(long == 1 && usual == steps.len() - 1, "{steps:?}");
    });
}

#[test]
fn motors_that_go_off_are_a_fault() {
    undisturbed(|| {
        let (error, ..) = drive_into("kind = 'motors-off'");
        assert!(matches!(&error, RobotError::Fault(reason) if reason.contains("motors went off")), "{error}");
    });
}

#[test]
fn a_missing_answer_of_a_khepera_is_asked_for_again() {
    undisturbed(|| {
        let server = "type = 'khepera'\nlisten = '127.0.0.1:0'\nsilent_after = 30";
        let emulator = emulate(server, "type = 'simulator'\nrobot = 'khepera-3'");
        let mut robot = robot(&format!("type = 'khepera'\ntcp = '{}'\ntimeout = 0.05", emulator.address())).unwrap();
        let mut measured = [0.0; 7];
        for _ in 0..20 {
            robot.step(&[0.1, 0.0], &mut measured).unwrap();
        }
        assert!((measured[0] - 0.1).abs() < 0.01, "{measured:?}");
        assert!(robot.warnings().iter().any(|w| w.starts_with("1 answers")), "{:?}", robot.warnings());
        drop(robot);
        std::thread::sleep(Duration::from_millis(200));
        assert_eq!((emulator.state().v_ref, emulator.state().v < 0.01), (0.0, true), "a robot without a watchdog is stopped at the end");
    });
}

#[test]
fn an_unknown_robot_and_a_dead_address_are_refused() {
    let emulator = emulate(STEPPED_PIONEER, PIONEER);
    let address = emulator.address().to_owned();
    emulator.finish().unwrap();
    let error = robot(&format!("type = 'pioneer'\ntcp = '{address}'")).err().unwrap();
    assert!(matches!(error, RobotError::Connection(_)), "{error}");
    let error = robot("type = 'pioneer'").err().unwrap();
    assert!(matches!(&error, RobotError::Config { key, .. } if key == "tcp"), "{error}");
    let error = robot("type = 'khepera'\nserial = '/dev/null'").err().unwrap();
    assert!(matches!(error, RobotError::Connection(_)), "{error}");
}
