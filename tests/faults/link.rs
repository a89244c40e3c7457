//! Faults on the line to a Pioneer while the program records over real TCP. The emulated robot is in this process and tells, in its own
//! time, when zero reached it or when its watchdog made it stand.

use std::time::Instant;

use wheelwright_core::config::tagged;
use wheelwright_core::robot::{Live, RobotConfig};
use wheelwright_robots::emulator::{Emulator, EmulatorConfig};

use super::machine::undisturbed;
use super::signals::{Driving, PATIENCE, RECORD, readable};

/// Time between two packets of the robot \[s\].
const CYCLE: f64 = 0.1;
/// Packets of a session before the fault.
const AFTER: u32 = 25;
/// Silence after which the firmware stops here \[s\].
const WATCHDOG: f64 = 0.6;
/// From the fastest speed of the excitation to rest: the firmware's ramp and five time constants of the loop behind it \[s\].
const BRAKING: f64 = 0.8 / 2.0 + 5.0 * 0.22;
/// Slower than this the robot stands \[m/s\].
const STANDING: f64 = 0.01;

/// The program recording an emulated robot.
struct Session {
    emulator: Emulator,
    driving: Driving,
}

impl Session {
    /// A drive with a fault after [`AFTER`] packets, or with none.
    fn start(fault: Option<&str>) -> Self {
        let fault = fault.map_or(String::new(), |fault| format!("[[fault]]\nafter = {AFTER}\n{fault}"));
        let server = format!("type = 'pioneer'\nlisten = '127.0.0.1:0'\nwatchdog = {WATCHDOG}\n{fault}");
        let server: EmulatorConfig = server.parse::<toml::Table>().unwrap().try_into().unwrap();
        let robot: Box<dyn RobotConfig> = tagged("type = 'simulator'\nrobot = 'pioneer-3dx'".parse().unwrap()).unwrap();
        let emulator = server.start(Live::new(robot.connect(1).unwrap())).unwrap();
        let config = format!(
            "[robot]\ntype = 'pioneer'\ntcp = '{}'\n[robot.limits]\nv_dot = 2.0\nomega_dot = 5.0\n[limits]\ndeadline = 5.0\n\
             [excitation]\ntype = 'thesis-pioneer'\nduration = 20.0\n[record]\ncountdown = 0.0\n",
            emulator.address()
        );
        Self { emulator, driving: Driving::start_with(&config, RECORD, "", "") }
    }

    /// The robot's time of the first packet that the fault spoils: the first of a session comes a cycle after it was opened.
    fn fault(&self) -> f64 {
        let opened = self.emulator.commands().into_iter().find(|command| command.state.open).unwrap();
        opened.state.time + CYCLE * f64::from(AFTER + 1)
    }

    /// Cycles from a time of the robot to the command that made it stand.
    fn cycles_to_zero(&self, from: f64) -> usize {
        let stand = |c: &wheelwright_robots::emulator::Command| {
            c.state.time >= from - 0.5 * CYCLE && c.state.v_ref == 0.0 && c.state.omega_ref == 0.0
        };
        let zero = self.emulator.commands().into_iter().find(stand).unwrap_or_else(|| panic!("zero never reached the robot"));
        ((zero.state.time - from) / CYCLE).round() as usize
    }

    /// Seconds from a time of the robot until it stands, which nobody tells it to do.
    fn seconds_to_rest(&self, from: f64) -> f64 {
        let begun = Instant::now();
        while self.emulator.state().v.abs() > STANDING {
            assert!(begun.elapsed() < PATIENCE, "the robot does not stop");
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        self.emulator.state().time - from
    }
}

/// A fault that the program sees: it says what, keeps the rows, and zero is commanded.
fn commanded(name: &str, fault: &str, known_after: usize, says: &str) {
    let mut session = Session::start(Some(fault));
    let (status, said) = session.driving.wait();
    assert_eq!(status.code(), Some(5), "{name}: {said}");
    assert!(said.contains(says), "{name}: {said}");
    let cycles = session.cycles_to_zero(session.fault()).saturating_sub(known_after);
    assert!(cycles <= super::CYCLES, "{name}: {cycles} cycles to the zero command");
    let rows = readable(&session.driving.out);
    assert!(rows >= 10, "{name}: {rows} rows");
    super::line(&format!("{name}, TCP"), cycles, rows, said.trim());
}

#[test]
fn a_robot_that_cannot_be_understood_is_commanded_to_stand() {
    // Frozen data are known for what they are after half a second.
    let patience = (0.5 / CYCLE) as usize;
    for (name, fault, known_after, says) in [
        ("burst of bad checksums", "kind = 'bad-checksum'", 0, "its information packet"),
        ("silence", "kind = 'silent'", 0, "its information packet"),
        ("frozen packets", "kind = 'frozen'", patience, "nothing measured has changed"),
        ("motors switched off", "kind = 'motors-off'", 0, "motors went off"),
    ] {
        undisturbed(|| commanded(name, fault, known_after, says));
    }
}

/// A burst shorter than the driver's patience: the robot is told to stand, and the drive goes on with the cycles counted.
#[test]
fn a_short_burst_of_bad_checksums_is_survived() {
    undisturbed(short_burst);
}

fn short_burst() {
    let mut session = Session::start(Some("kind = 'bad-checksum'\npackets = 4"));
    session.driving.wait_for_rows(AFTER as usize + 10);
    session.driving.send("INT");
    let (status, said) = session.driving.wait();
    assert_eq!(status.code(), Some(1), "{said}");
    let cycles = session.cycles_to_zero(session.fault());
    assert!(cycles <= super::CYCLES, "{cycles} cycles to the zero command");
    let rows = readable(&session.driving.out);
    super::line("burst of four, then on, TCP", cycles, rows, said.trim());
}

/// The line is gone and nothing can be commanded: the program ends with what it has, the firmware stops the robot.
#[test]
fn a_cut_line_leaves_the_robot_to_its_watchdog() {
    for (name, fault) in [("line cut", "kind = 'cut'"), ("half a packet", "kind = 'half-packet'")] {
        undisturbed(|| cut(name, fault));
    }
}

fn cut(name: &str, fault: &str) {
    let mut session = Session::start(Some(fault));
    let (status, said) = session.driving.wait();
    assert_eq!(status.code(), Some(5), "{name}: {said}");
    assert!(said.contains("closed") && said.contains("rows were kept"), "{name}: {said}");
    watchdog(name, &session, session.fault(), &said);
}

/// A program that no longer runs: killed, which closes the line, or stopped, which leaves it open and silent.
#[test]
fn a_program_that_no_longer_runs_leaves_the_robot_to_its_watchdog() {
    for (name, signal) in [("kill -9", "KILL"), ("program suspended", "STOP")] {
        undisturbed(|| gone(name, signal));
    }
}

fn gone(name: &str, signal: &str) {
    let mut session = Session::start(None);
    session.driving.wait_for_rows(AFTER as usize);
    session.driving.send(signal);
    let from = session.emulator.state().time;
    watchdog(name, &session, from, "");
}

fn watchdog(name: &str, session: &Session, from: f64, said: &str) {
    let seconds = session.seconds_to_rest(from);
    assert!(seconds <= WATCHDOG + BRAKING, "{name}: the robot stood after {seconds} s");
    let rows = readable(&session.driving.out);
    assert!(rows >= 10, "{name}: {rows} rows");
    println!(
        "| {:<34} | stood after {seconds:.1} s | {rows:>3} rows readable | {} |",
        format!("{name}, TCP, watchdog {WATCHDOG} s"),
        said.trim()
    );
}

#[test]
fn ctrl_c_reaches_the_robot_through_the_line() {
    undisturbed(interrupted);
}

fn interrupted() {
    let mut session = Session::start(None);
    session.driving.wait_for_rows(AFTER as usize);
    let before = session.emulator.state().time;
    session.driving.send("INT");
    // Sending a signal takes the test a while of its own.
    let own = ((session.emulator.state().time - before) / CYCLE).ceil() as usize;
    let (status, said) = session.driving.wait();
    assert_eq!(status.code(), Some(1), "{said}");
    let cycles = session.cycles_to_zero(before).saturating_sub(own);
    assert!(cycles <= super::CYCLES, "{cycles} cycles to the zero command");
    session.seconds_to_rest(before);
    assert!(!session.emulator.state().enabled, "the motors are without power");
    super::line("ctrl-C, TCP", cycles, readable(&session.driving.out), said.trim());
}
