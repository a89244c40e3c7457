//! ROS 2: the driver and the emulator against each other and against Eclipse Cyclone DDS, which shares no code with them.
//!
//! Each test runs in a network of its own, so that it neither hears nor moves a robot of whoever runs it. Where the system does not
//! allow one (Linux, unprivileged user namespaces), the tests are skipped and say so; so are those with Cyclone DDS where
//! `WHEELWRIGHT_CYCLONEDDS`, or else `python3`, is no Python with the package `cyclonedds`.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs)]

#[path = "suite/common/wire.rs"]
mod wire;

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde_json::Value;
use wheelwright_core::robot::{Live, RobotError};
use wheelwright_robots::emulator::Emulator;
use wire::{agree, emulate, identify, robot, stands_beside_a_late_law};

/// Set inside a network of its own.
const INSIDE: &str = "WHEELWRIGHT_TEST_NETWORK";
/// A network that has nothing but a loopback that passes multicast, and a program in it.
const NETWORK: &str = "ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo && exec \"$0\" \"$@\"";
const PIONEER: &str = "type = 'simulator'\nrobot = 'pioneer-3dx'";

/// Runs a test by its name again, in a network of its own.
fn alone(name: &str, test: impl FnOnce()) {
    if std::env::var_os(INSIDE).is_some() {
        return test();
    }
    let unshare = |program: &str, arguments: &[&str]| {
        Command::new("unshare").args(["-rn", "sh", "-c", NETWORK, program]).args(arguments).env(INSIDE, "1").output()
    };
    if !unshare("true", &[]).is_ok_and(|done| done.status.success()) {
        println!("skipped: no network namespaces here (unshare -rn, ip)");
        return;
    }
    let this = std::env::current_exe().unwrap();
    let done = unshare(this.to_str().unwrap(), &["--exact", name, "--nocapture"]).unwrap();
    println!("{}{}", String::from_utf8_lossy(&done.stdout), String::from_utf8_lossy(&done.stderr));
    assert!(done.status.success(), "{name} failed in its network");
}

/// The other end, played by Cyclone DDS.
struct Peer {
    child: Child,
    said: Arc<Mutex<Vec<Value>>>,
}

impl Peer {
    /// Starts it and waits until it is ready; `None` where there is no Cyclone DDS.
    fn start(arguments: &str) -> Option<Self> {
        let python = std::env::var("WHEELWRIGHT_CYCLONEDDS").unwrap_or_else(|_| "python3".to_owned());
        let has = Command::new(&python).args(["-c", "import cyclonedds"]).output();
        if !has.is_ok_and(|done| done.status.success()) {
            println!("skipped: {python} is no Python with the package cyclonedds");
            return None;
        }
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/ros2/peer.py");
        let mut command = Command::new(python);
        command.arg(script).args(arguments.split_whitespace()).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let said = Arc::new(Mutex::new(Vec::new()));
        let heard = said.clone();
        std::thread::spawn(move || {
            for line in lines.map_while(Result::ok) {
                heard.lock().unwrap().push(serde_json::from_str(&line).unwrap());
            }
        });
        let peer = Self { child, said };
        peer.wait_for("ready", |_| true);
        Some(peer)
    }

    fn said(&self, key: &str) -> Vec<Value> {
        self.said.lock().unwrap().iter().filter(|line| line.get(key).is_some()).cloned().collect()
    }

    /// Waits for a line with a key.
    fn wait_for(&self, key: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let begin = Instant::now();
        loop {
            if let Some(found) = self.said(key).into_iter().find(&wanted) {
                return found;
            }
            assert!(begin.elapsed() < Duration::from_secs(30), "nothing with `{key}` came: {:?}", self.said.lock().unwrap().last());
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Ends it in order and returns its last words.
    fn finish(mut self) -> Value {
        drop(self.child.stdin.take());
        self.child.wait().unwrap();
        self.wait_for("published", |_| true)
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn pair(value: &Value) -> [f64; 2] {
    [0, 1].map(|i| value[i].as_f64().unwrap())
}

/// A driver of this network.
fn driver(more: &str) -> Result<Live, RobotError> {
    robot(&format!("type = 'ros2'\ndomain = 0\n{more}"))
}

fn emulator(more: &str) -> Emulator {
    emulate(&format!("type = 'ros2'\ndomain = 0\n{more}"), &format!("{PIONEER}\nperiod = 0.02"))
}

#[test]
fn theta_through_the_emulator_is_that_of_the_simulator() {
    alone("theta_through_the_emulator_is_that_of_the_simulator", || {
        let (direct, _) = identify(&mut robot(PIONEER).unwrap(), "vw-pd", "thesis-pioneer", 60.0);
        for kind in ["twist", "twist-stamped"] {
            let server = format!("type = 'ros2'\ndomain = 0\nclock = 'stepped'\ncycle = 0.1\ncommand_type = '{kind}'");
            let _emulator = emulate(&server, PIONEER);
            let begin = Instant::now();
            let mut robot = driver("clock = 'stepped'\nperiod = 0.1").unwrap();
            let (through, warnings) = identify(&mut robot, "vw-pd", "thesis-pioneer", 60.0);
            println!("{kind}: {warnings:?} {:?}", begin.elapsed());
            agree(kind, &direct, &through, 1e-4, 1e-5);
        }
    });
}

#[test]
fn a_robot_of_cyclone_dds_is_identified() {
    alone("a_robot_of_cyclone_dds_is_identified", || {
        for arguments in ["--type twist --best-effort", "--type twist-stamped"] {
            let Some(peer) = Peer::start(&format!("robot --lockstep {arguments}")) else { return };
            let mut robot = driver("clock = 'stepped'\nperiod = 0.02").unwrap();
            let (found, warnings) = identify(&mut robot, "vw-pd", "thesis-pioneer", 30.0);
            println!("{arguments}: {:?} {warnings:?}", found.theta);
            for (theta, lag) in found.theta.iter().zip([0.2, 0.15, 0.0, 1.0, 0.0, 1.0]) {
                assert!((theta - lag).abs() <= 1e-4, "{:?}", found.theta);
            }
            drop(robot);
            let last = peer.finish();
            assert!(pair(&last["velocity"]).iter().all(|speed| speed.abs() < 0.05), "it stands: {last}");
        }
    });
}

#[test]
fn a_robot_of_cyclone_dds_is_driven_and_stopped() {
    alone("a_robot_of_cyclone_dds_is_driven_and_stopped", || {
        for arguments in ["robot --type twist --best-effort", "robot --type twist-stamped"] {
            let Some(peer) = Peer::start(arguments) else { return };
            let mut robot = driver("").unwrap();
            assert_eq!((robot.period(), robot.inputs().len(), robot.outputs().len()), (0.02, 2, 5));
            let mut measured = [0.0; 5];
            let first = robot.measure(&mut measured).unwrap();
            let last = (0..150).map(|_| robot.step(&[0.3, 0.2], &mut measured).unwrap()).last().unwrap();
            let cycles = (last - first) / 0.02;
            assert!((cycles - cycles.round()).abs() < 1e-3, "times are those of the stamps: {first} to {last}");
            let [v, omega, x, _, phi] = measured;
            assert!((v - 0.3).abs() < 0.01 && (omega - 0.2).abs() < 0.01 && x > 0.5 && phi > 0.3, "{measured:?}");
            drop(robot);
            let last = peer.finish();
            assert!(pair(&last["velocity"]).iter().all(|speed| speed.abs() < 0.05), "it stands: {last}");
        }
    });
}

#[test]
fn zero_is_commanded_several_times_and_stamps_are_of_the_robots_clock() {
    alone("zero_is_commanded_several_times_and_stamps_are_of_the_robots_clock", || {
        let Some(peer) = Peer::start("robot --type twist-stamped --clock 1000000") else { return };
        let mut robot = driver("").unwrap();
        let mut measured = [0.0; 5];
        for _ in 0..50 {
            robot.step(&[0.3, 0.2], &mut measured).unwrap();
        }
        robot.stop().unwrap();
        robot.stop().unwrap();
        peer.wait_for("command", |said| pair(&said["command"]) == [0.0; 2]);
        std::thread::sleep(Duration::from_millis(100));
        let commands = peer.said("command");
        let zeros = commands.iter().rev().take_while(|said| pair(&said["command"]) == [0.0; 2]).count();
        assert!(zeros >= 3, "zero came {zeros} times at the end");
        let oldest = commands.iter().map(|said| said["age"].as_f64().unwrap().abs()).fold(0.0, f64::max);
        assert!(oldest < 0.5, "a command was {oldest} s off, which the robot would have ignored");
    });
}

#[test]
fn a_robot_is_told_to_stand_beside_a_law_that_is_late_and_drives_on() {
    alone("a_robot_is_told_to_stand_beside_a_law_that_is_late_and_drives_on", || {
        let Some(peer) = Peer::start("robot --type twist --best-effort") else { return };
        let told = || peer.said("command").last().map_or([0.0; 2], |said| pair(&said["command"]));
        stands_beside_a_late_law("Cyclone DDS", &mut driver("period = 0.1").unwrap(), told);
    });
}

#[test]
fn the_emulator_is_told_to_stand_beside_a_law_that_is_late_and_drives_on() {
    alone("the_emulator_is_told_to_stand_beside_a_law_that_is_late_and_drives_on", || {
        let emulator = emulator("command_type = 'twist'");
        let held = || [emulator.state().v_ref, emulator.state().omega_ref];
        stands_beside_a_late_law("emulator", &mut driver("period = 0.1").unwrap(), held);
    });
}

#[test]
fn a_client_of_cyclone_dds_drives_the_emulator() {
    alone("a_client_of_cyclone_dds_drives_the_emulator", || {
        for kind in ["twist", "twist-stamped"] {
            let emulator = emulator(&format!("command_type = '{kind}'"));
            let Some(peer) = Peer::start(&format!("client --type {kind}")) else { return };
            let moving = peer.wait_for("velocity", |said| said["velocity"][0].as_f64().unwrap() > 0.28);
            assert_eq!(moving["frames"], serde_json::json!(["odom", "base_link"]));
            // Its fifty commands take a second; half a second after the last the robot stands, of itself.
            let moved = |said: &Value| said["x"].as_f64().unwrap() > 0.2 && said["velocity"][0].as_f64().unwrap().abs() < 0.01;
            let resting = peer.wait_for("velocity", moved);
            assert!(resting["phi"].as_f64().unwrap() > 0.1, "{resting}");
            let times: Vec<f64> = peer.said("t").iter().map(|said| said["t"].as_f64().unwrap()).collect();
            let cycles = times.windows(2).map(|pair| (pair[1] - pair[0]) / 0.02);
            assert!(cycles.clone().all(|cycles| cycles > 0.5 && (cycles - cycles.round()).abs() < 1e-3), "{times:?}");
            assert_eq!((emulator.state().v_ref, emulator.clients()), (0.0, 1));
        }
        // A stamp that is older than the timeout is not obeyed.
        let emulator = emulator("command_type = 'twist-stamped'");
        let peer = Peer::start("client --type twist-stamped --old 0.6").unwrap();
        peer.wait_for("velocity", |_| true);
        std::thread::sleep(Duration::from_millis(800));
        assert_eq!((emulator.state().v_ref, emulator.clients()), (0.0, 1));
    });
}

#[test]
fn each_silent_mismatch_is_named() {
    alone("each_silent_mismatch_is_named", || {
        let reason = |more: &str| match driver(&format!("discovery = 1.5\n{more}")) {
            Err(RobotError::Connection(reason)) => reason,
            other => panic!("{more}: {:?}", other.map(drop)),
        };
        assert!(reason("").contains("no other ROS 2 program is seen in domain 0"));
        let _emulator = emulator("command_type = 'twist-stamped'\ncommand_topic = '/base/cmd_vel'");
        assert!(reason("").contains("nobody subscribes /cmd_vel, but there is /base/cmd_vel: set `command_topic`"));
        let other = "command_topic = '/base/cmd_vel'";
        let words = reason(&format!("{other}\ncommand_type = 'twist'"));
        assert!(
            words.contains("/base/cmd_vel as geometry_msgs/msg/TwistStamped, not as geometry_msgs/msg/Twist: leave `command_type` out"),
            "{words}"
        );
        let words = reason(&format!("{other}\nodometry_topic = '/odometry'"));
        assert!(words.starts_with("nobody publishes /odometry, but there is /odom: set `odometry_topic`"), "{words}");
        let error = driver(&format!("{other}\nperiod = 0.03")).err().unwrap();
        assert!(matches!(&error, RobotError::Config { key, .. } if key == "period"), "{error}");
        assert!(driver(other).is_ok());
    });
}

/// Drives a peer until something goes wrong.
fn drive_into(arguments: &str, mut trouble: impl FnMut(usize, &mut Peer)) -> Option<(RobotError, Peer)> {
    let mut peer = Peer::start(arguments)?;
    let mut robot = driver("timeout = 0.6").unwrap();
    let mut measured = [0.0; 5];
    robot.measure(&mut measured).unwrap();
    let error = (0..500).find_map(|step| {
        trouble(step, &mut peer);
        robot.step(&[0.2, 0.1], &mut measured).err()
    });
    assert!(matches!(robot.step(&[0.2, 0.1], &mut measured), Err(RobotError::Fault(_))), "nothing is driven after an error");
    let begin = Instant::now();
    for _ in 0..2 {
        let _ = robot.stop();
    }
    assert!(begin.elapsed() < Duration::from_secs(5), "stopping took {:?}", begin.elapsed());
    Some((error.unwrap(), peer))
}

#[test]
fn a_silent_robot_is_told_to_stand_before_its_own_watchdog_does_it() {
    alone("a_silent_robot_is_told_to_stand_before_its_own_watchdog_does_it", || {
        let Some((error, peer)) = drive_into("robot --fault silent --after 50", |_, _| {}) else { return };
        assert!(matches!(error, RobotError::Timeout { .. }), "{error}");
        let zero = peer.wait_for("command", |said| said["faulty"] == true && pair(&said["command"]) == [0.0; 2]);
        let silence = zero["silence"].as_f64().unwrap();
        assert!(silence < 0.5, "zero came {silence} s after the last odometry");
    });
}

#[test]
fn a_robot_whose_driver_dies_is_a_lost_connection() {
    alone("a_robot_whose_driver_dies_is_a_lost_connection", || {
        let end = |step: usize, peer: &mut Peer| {
            if step == 50 {
                drop(peer.child.stdin.take());
            }
        };
        let Some((error, _)) = drive_into("robot", end) else { return };
        assert!(matches!(&error, RobotError::Connection(reason) if reason.contains("any more")), "{error}");
        let kill = |step: usize, peer: &mut Peer| {
            if step == 50 {
                peer.child.kill().unwrap();
            }
        };
        let Some((error, _)) = drive_into("robot", kill) else { return };
        assert!(matches!(error, RobotError::Timeout { .. }), "{error}");
    });
}

#[test]
fn stamps_that_stand_still_are_replaced_by_arrivals() {
    alone("stamps_that_stand_still_are_replaced_by_arrivals", || {
        let Some(_peer) = Peer::start("robot --no-stamps") else { return };
        let mut robot = driver("").unwrap();
        assert!((robot.period() - 0.02).abs() < 0.005, "{}", robot.period());
        let mut measured = [0.0; 5];
        let begin = Instant::now();
        let first = robot.measure(&mut measured).unwrap();
        let last = (0..50).map(|_| robot.step(&[0.2, 0.0], &mut measured).unwrap()).last().unwrap();
        assert!((last - first - begin.elapsed().as_secs_f64()).abs() < 0.1, "{} s", last - first);
        assert!(robot.warnings().iter().any(|w| w.contains("stamps of the odometry do not advance")), "{:?}", robot.warnings());
    });
}

#[test]
fn frozen_odometry_ends_a_drive() {
    use wheelwright_core::drive::{DriveOptions, drive};
    use wheelwright_core::excitation::Excitation;
    alone("frozen_odometry_ends_a_drive", || {
        let Some(peer) = Peer::start("robot --fault frozen --after 50") else { return };
        let mut robot = driver("").unwrap();
        let excitation: Box<dyn Excitation> = wheelwright_core::config::tagged(wire::table("type = 'thesis-pioneer'")).unwrap();
        let error = drive(&mut robot, &*excitation, DriveOptions { duration: Some(20.0), ..DriveOptions::default() }).unwrap_err();
        assert!(error.to_string().contains("nothing measured has changed"), "{error}");
        peer.wait_for("command", |said| said["faulty"] == true && pair(&said["command"]) == [0.0; 2]);
    });
}

#[test]
fn a_long_period_is_kept_alive_and_limits_hold() {
    alone("a_long_period_is_kept_alive_and_limits_hold", || {
        let Some(peer) = Peer::start("robot") else { return };
        let mut robot = driver("period = 0.2\nlimits = { v = 0.3 }").unwrap();
        let mut held = [1.0, 0.1];
        robot.executed(&mut held);
        assert_eq!(held, [0.3, 0.1]);
        let mut measured = [0.0; 5];
        let mut t = robot.measure(&mut measured).unwrap();
        for _ in 0..5 {
            let next = robot.step(&[1.0, 0.1], &mut measured).unwrap();
            assert!((next - t - 0.2).abs() < 0.041, "{t} to {next}");
            t = next;
        }
        let commands = peer.said("command").iter().filter(|said| pair(&said["command"]) == [0.3, 0.1]).count();
        assert!(commands >= 15, "{commands} commands in a second");
        assert!(robot.warnings().iter().any(|w| w.contains("5 of 5 commands were cut")), "{:?}", robot.warnings());
    });
}
