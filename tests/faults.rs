//! The fault table: whatever goes wrong, the robot stands within two control cycles and the recording is readable.
//!
//! The first half injects faults into a robot inside this process, which counts what it was told after the fault. The second half sends
//! signals to the program while it drives the simulator in real time, and looks at the files it leaves. Both drive in both ways: with an
//! excitation, as `record` does, and with a controller on a trajectory, as `track` does. `cargo test --test faults --
//! --nocapture` prints the table.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on fails")]

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use wheelwright::controllers::trajectory::Circle;
use wheelwright::record::RecordingFiles;
use wheelwright::source::Source;
use wheelwright_core::channel::{self, Channel};
use wheelwright_core::controller::{Controller, Observation};
use wheelwright_core::drive::{DeadMan, DriveError, DriveOptions, DriveProgress, Floor, RowSink, Safety, SinkError, Watchdog, drive};
use wheelwright_core::excitation::{Excitation, ExcitationError};
use wheelwright_core::profile::Limits;
use wheelwright_core::recording::{ReadOptions, Recording};
use wheelwright_core::robot::{Live, Robot, RobotError};
use wheelwright_core::tracking::track;

use machine::undisturbed;

static INPUTS: [Channel; 2] = [channel::V_REF, channel::OMEGA_REF];
static OUTPUTS: [Channel; 5] = [channel::V, channel::OMEGA, channel::X, channel::Y, channel::PHI];
const PERIOD: f64 = 0.05;
/// The step at which the fault strikes.
const STRIKE: usize = 20;
/// Most cycles from a fault to the zero command.
const CYCLES: usize = 2;

/// What goes wrong, and where.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
enum Fault {
    None,
    LinkCut,
    HalfPacket,
    ChecksumBurst,
    LateDriver,
    FrozenData,
    NotANumber,
    Infinite,
    ClockStands,
    ClockBack,
    ClockJumps,
    ClockNotANumber,
    DriverPanics,
    StopFails,
    LawPanics,
    LawNotANumber,
    LawLate,
}

/// What decides the commands.
#[derive(Debug, Clone, Copy)]
enum Way {
    Excited,
    Tracked,
}

/// What the robot was told, kept where the test sees it.
#[derive(Debug, Default)]
struct Log {
    commands: Vec<[f64; 2]>,
    /// When each command came, and when its period was over.
    times: Vec<[Instant; 2]>,
    stops: usize,
}

/// A unicycle that follows its command at once, with a fault.
struct Faulty {
    fault: Fault,
    real_time: bool,
    t: f64,
    measured: [f64; 5],
    log: Arc<Mutex<Log>>,
}

impl Robot for Faulty {
    fn inputs(&self) -> &[Channel] {
        &INPUTS
    }
    fn outputs(&self) -> &[Channel] {
        &OUTPUTS
    }
    fn period(&self) -> f64 {
        PERIOD
    }
    fn real_time(&self) -> bool {
        self.real_time
    }
    fn measure(&mut self, measured: &mut [f64]) -> Result<f64, RobotError> {
        measured.copy_from_slice(&self.measured);
        Ok(self.t)
    }
    fn step(&mut self, command: &[f64], measured: &mut [f64]) -> Result<f64, RobotError> {
        let steps = {
            let mut log = self.log.lock().unwrap();
            assert_eq!(log.stops, 0, "commanded after a stop");
            log.commands.push([command[0], command[1]]);
            log.times.push([Instant::now(); 2]);
            log.commands.len()
        };
        if self.real_time {
            std::thread::sleep(Duration::from_secs_f64(PERIOD));
            self.log.lock().unwrap().times[steps - 1][1] = Instant::now();
        }
        let struck = steps >= STRIKE;
        let mut advance = PERIOD;
        if !(struck && self.fault == Fault::FrozenData) {
            let [_, _, x, y, phi] = self.measured;
            self.measured = [
                command[0],
                command[1],
                x + PERIOD * command[0] * phi.cos(),
                y + PERIOD * command[0] * phi.sin(),
                phi + PERIOD * command[1],
            ];
        }
        if struck {
            let timeout = |what: &str| RobotError::Timeout { limit_s: 0.2, what: what.to_owned() };
            match self.fault {
                Fault::LinkCut => return Err(RobotError::Connection("reset by peer".to_owned())),
                Fault::HalfPacket => return Err(timeout("the rest of a packet of 86 bytes, of which 31 came")),
                Fault::ChecksumBurst => return Err(RobotError::Fault("8 packets with a wrong checksum in a row".to_owned())),
                Fault::LateDriver => return Err(timeout("the call of `step` has not returned")),
                Fault::NotANumber => self.measured[1] = f64::NAN,
                Fault::Infinite => self.measured[0] = f64::INFINITY,
                Fault::ClockStands => advance = 0.0,
                Fault::ClockBack => advance = -3.0,
                Fault::ClockJumps => advance = 3600.0,
                Fault::ClockNotANumber => advance = f64::NAN,
                Fault::DriverPanics => panic!("a bug in the driver"),
                _ => {}
            }
        }
        self.t += advance;
        measured.copy_from_slice(&self.measured);
        Ok(self.t)
    }
    fn stop(&mut self) -> Result<(), RobotError> {
        self.log.lock().unwrap().stops += 1;
        if self.fault == Fault::StopFails { Err(RobotError::Connection("the link is down".to_owned())) } else { Ok(()) }
    }
}

/// Straight on with a wave, for four seconds, with a fault of its own.
#[derive(Debug, Serialize, Deserialize)]
struct Wave(Fault);

#[typetag::serde(name = "wave-with-a-fault")]
impl Excitation for Wave {
    fn about(&self) -> String {
        "a wave".to_owned()
    }
    fn duration(&self) -> f64 {
        4.0
    }
    fn check(&self, _: &[Channel]) -> Result<(), ExcitationError> {
        Ok(())
    }
    fn command(&self, t: f64, _: &[Channel], command: &mut [f64]) {
        wave(self.0, t, command);
    }
}

fn wave(fault: Fault, t: f64, command: &mut [f64]) {
    let struck = t >= (STRIKE as f64 - 0.5) * PERIOD;
    command.copy_from_slice(&[0.5 + 0.2 * t.sin(), 0.3 * t.cos()]);
    match fault {
        Fault::LawPanics if struck => panic!("a bug in the law"),
        Fault::LawNotANumber if struck => command[1] = f64::NAN,
        Fault::LawLate => be_late(t),
        _ => {}
    }
}

impl Controller for Wave {
    fn inputs(&self) -> &[Channel] {
        &INPUTS
    }
    fn outputs(&self) -> &[Channel] {
        &OUTPUTS
    }
    fn step(&mut self, now: &Observation<'_>, command: &mut [f64]) {
        wave(self.0, now.t, command);
    }
}

/// A disk that is full after so many rows.
struct FullDisk(usize);

impl RowSink for FullDisk {
    fn row(&mut self, _: f64, _: &[f64]) -> Result<(), SinkError> {
        self.0 = self.0.checked_sub(1).ok_or_else(|| SinkError { target: "a.csv".to_owned(), reason: "no space left".to_owned() })?;
        Ok(())
    }
    fn finish(&mut self) -> Result<(), SinkError> {
        Ok(())
    }
}

/// A disk that takes its time over one row.
struct SlowDisk;

impl RowSink for SlowDisk {
    fn row(&mut self, t: f64, _: &[f64]) -> Result<(), SinkError> {
        be_late(t);
        Ok(())
    }
    fn finish(&mut self) -> Result<(), SinkError> {
        Ok(())
    }
}

thread_local! {
    /// Since when the work of this test was late, and by how much more it was when it woke up after two cycles.
    static LATE: Cell<Option<(Instant, Duration)>> = const { Cell::new(None) };
}

/// Takes fourteen cycles, once, from the strike on.
fn be_late(t: f64) {
    if t < (STRIKE as f64 - 0.5) * PERIOD || LATE.get().is_some() {
        return;
    }
    let (begun, two) = (Instant::now(), Duration::from_secs_f64(2.0 * PERIOD));
    std::thread::sleep(two);
    LATE.set(Some((begun, begun.elapsed() - two)));
    std::thread::sleep(6 * two);
}

/// How a faulty drive ended.
struct Ended {
    /// `None` if a panic passed through.
    outcome: Option<Result<Recording, DriveError>>,
    /// Commands that were not zero from the fault on.
    cycles: usize,
    log: Log,
    stops: usize,
    rows: usize,
    /// Segments of the files as they are read.
    segments: Vec<usize>,
}

/// Drives with a fault into files, and reads both back.
fn drive_into(folder: &Path, way: Way, fault: Fault, real_time: bool, options: impl FnOnce(DriveOptions<'_>) -> DriveOptions<'_>) -> Ended {
    let log = Arc::new(Mutex::new(Log::default()));
    let mut files = RecordingFiles::create(folder, INPUTS.iter().chain(&OUTPUTS)).unwrap();
    let paths: Vec<_> = files.paths().map(Path::to_owned).collect();
    let robot = Faulty { fault, real_time, t: 7.0, measured: [0.0; 5], log: log.clone() };
    let outcome = {
        let files = &mut files;
        catch_unwind(AssertUnwindSafe(move || {
            let mut robot = Live::new(Box::new(robot));
            // A closure that takes and gives options cannot name the lifetime of the files, so these come last.
            let mut options = options(DriveOptions::default());
            let mut sinks = files.sinks();
            sinks.append(&mut options.sinks);
            let options = DriveOptions { sinks, ..options };
            match way {
                Way::Excited => drive(&mut robot, &Wave(fault), options),
                Way::Tracked => {
                    let circle = Circle { radius: 2.0, speed: 0.5 };
                    track(&mut robot, &mut Wave(fault), &circle, 4.0, f64::INFINITY, options).unwrap().outcome
                }
            }
        }))
    };
    let log = std::mem::take(&mut *log.lock().unwrap());
    let read: Vec<Recording> =
        paths.iter().map(|p| Source::open(p, &ReadOptions::default()).unwrap_or_else(|e| panic!("{fault:?}: {e}")).recording).collect();
    assert_eq!(read[0].rows(), read[1].rows(), "{fault:?}: CSV and MCAP hold the same rows");
    let cycles = log.commands.iter().skip(STRIKE - 1).filter(|command| **command != [0.0; 2]).count();
    let segments = read.iter().map(|recording| recording.segments().len()).collect();
    Ended { outcome: outcome.ok(), cycles, stops: log.stops, log, rows: read[0].rows(), segments }
}

fn line(name: &str, cycles: usize, rows: usize, why: &str) {
    println!("| {name:<34} | {cycles} cycles | {rows:>3} rows readable | {why} |");
}

/// A fault of robot or excitation: the drive ends with words that say so.
fn expect(name: &str, way: Way, fault: Fault, says: &str) {
    let folder = tempfile::tempdir().unwrap();
    let ended = drive_into(folder.path(), way, fault, false, |options| options);
    let why = match &ended.outcome {
        Some(Err(error)) => error.to_string(),
        Some(Ok(_)) => panic!("{name}: the drive went on"),
        None => "a panic passed through".to_owned(),
    };
    assert!(why.contains(says), "{name}: {why}");
    assert!(ended.stops >= 1, "{name}: the robot was not stopped");
    // Frozen data are known for what they are after the patience, not before.
    let known = if fault == Fault::FrozenData { (0.5 / PERIOD) as usize } else { 0 };
    assert!(ended.cycles <= known + CYCLES, "{name}: {} cycles to the zero command", ended.cycles);
    assert!(ended.rows >= STRIKE - 1, "{name}: {} rows", ended.rows);
    line(name, ended.cycles.saturating_sub(known), ended.rows, &why);
}

#[test]
fn faults_of_robot_and_law() {
    for (name, fault, says) in [
        ("link cut", Fault::LinkCut, "reset by peer"),
        ("half a packet", Fault::HalfPacket, "the rest of a packet"),
        ("burst of bad checksums", Fault::ChecksumBurst, "wrong checksum"),
        ("driver or plugin late", Fault::LateDriver, "has not returned"),
        ("data frozen", Fault::FrozenData, "nothing measured has changed since"),
        ("NaN measured", Fault::NotANumber, "`omega` = NaN"),
        ("infinity measured", Fault::Infinite, "`v` = inf"),
        ("clock stands", Fault::ClockStands, "does not advance"),
        ("clock goes back", Fault::ClockBack, "does not advance"),
        ("clock leaps ahead", Fault::ClockJumps, "the robot's clock jumped"),
        ("clock is NaN", Fault::ClockNotANumber, "does not advance"),
        ("panic in the driver", Fault::DriverPanics, "a panic passed through"),
        ("panic in the law", Fault::LawPanics, "a panic passed through"),
        ("NaN from the law", Fault::LawNotANumber, "command `omega_ref` is NaN"),
    ] {
        expect(name, Way::Excited, fault, says);
        expect(&format!("{name}, tracking"), Way::Tracked, fault, says);
    }
}

/// A drive without a fault of its own that something from outside ends. It tracks: there all options are handed on to the loop that
/// an excitation drives in directly.
fn ended_by(name: &str, says: &str, options: impl FnOnce(DriveOptions<'_>) -> DriveOptions<'_>) -> Ended {
    let folder = tempfile::tempdir().unwrap();
    let ended = drive_into(folder.path(), Way::Tracked, Fault::None, false, options);
    let why = match &ended.outcome {
        Some(Err(error)) => error.to_string(),
        Some(Ok(_)) => "the drive ended in order".to_owned(),
        None => "a panic passed through".to_owned(),
    };
    assert!(why.contains(says), "{name}: {why}");
    assert!(ended.stops >= 1 && ended.rows >= 2, "{name}: {} stops, {} rows", ended.stops, ended.rows);
    line(name, ended.cycles.min(CYCLES), ended.rows, &why);
    ended
}

fn at_strike(progress: &DriveProgress<'_>) -> bool {
    progress.t >= (STRIKE as f64 - 0.5) * PERIOD
}

#[test]
fn a_stop_that_is_asked_for_comes_before_the_next_command() {
    let flag: &'static AtomicBool = Box::leak(Box::new(AtomicBool::new(false)));
    let observer: &'static mut dyn FnMut(&DriveProgress<'_>) =
        Box::leak(Box::new(|p: &DriveProgress<'_>| flag.store(at_strike(p), Ordering::Relaxed)));
    let ended = ended_by("stop asked for", "stopped by request", |o| DriveOptions { stop: Some(flag), observer: Some(observer), ..o });
    assert!(ended.cycles <= CYCLES, "{}", ended.cycles);
}

#[test]
fn a_key_let_go_stops_before_the_next_command() {
    let switch: &'static DeadMan = Box::leak(Box::new(DeadMan::new(Duration::from_secs(60))));
    switch.press();
    let observer: &'static mut dyn FnMut(&DriveProgress<'_>) = Box::leak(Box::new(|p: &DriveProgress<'_>| {
        if at_strike(p) {
            switch.release();
        }
    }));
    let ended =
        ended_by("dead man's switch released", "dead man", |o| DriveOptions { dead_man: Some(switch), observer: Some(observer), ..o });
    assert!(ended.cycles <= CYCLES, "{}", ended.cycles);
}

#[test]
fn a_panic_in_the_observer_stops() {
    let observer: &'static mut dyn FnMut(&DriveProgress<'_>) =
        Box::leak(Box::new(|p: &DriveProgress<'_>| assert!(!at_strike(p), "a bug in the view")));
    let ended = ended_by("panic in the observer", "a panic passed through", |o| DriveOptions { observer: Some(observer), ..o });
    assert!(ended.cycles <= CYCLES, "{}", ended.cycles);
}

/// The law, the disk or the view does not come back for fourteen cycles of a robot in real time. Gives the drive, the cycles from the
/// measurement that nobody answered to the zero command, less what the machine took to wake the test itself, and the commands to move
/// that came after.
fn late(name: &str, way: Way, deadline: f64) -> (Ended, usize, usize) {
    LATE.set(None);
    let fault = if name == "law" { Fault::LawLate } else { Fault::None };
    let view: &'static mut dyn FnMut(&DriveProgress<'_>) = Box::leak(Box::new(|p: &DriveProgress<'_>| be_late(p.t)));
    let disk: &'static mut SlowDisk = Box::leak(Box::new(SlowDisk));
    let safety = Safety { deadline: Some(deadline), ..Safety::default() };
    let folder = tempfile::tempdir().unwrap();
    let ended = drive_into(folder.path(), way, fault, true, |mut o| {
        if name == "disk" {
            o.sinks.push(disk);
        }
        DriveOptions { safety, observer: (name == "view").then_some(view), ..o }
    });
    let (begun, own) = LATE.get().unwrap_or_else(|| panic!("{name}: never late"));
    let Log { commands, times, .. } = &ended.log;
    let first = times.iter().position(|[sent, _]| *sent > begun).unwrap_or_else(|| panic!("{name}: the robot was left alone"));
    assert_eq!(commands[first], [0.0; 2], "{name}");
    let waited = (times[first][0] - times[first - 1][1]).saturating_sub(own);
    let moved = commands[first..].iter().filter(|command| **command != [0.0; 2]).count();
    let cycles = (waited.as_secs_f64() / PERIOD).round() as usize;
    (ended, cycles, moved)
}

#[test]
fn a_robot_stands_two_cycles_after_a_measurement_that_nobody_answers() {
    for (name, way) in [("law", Way::Excited), ("law", Way::Tracked), ("disk", Way::Tracked), ("view", Way::Tracked)] {
        undisturbed(|| stands(name, way));
    }
}

fn stands(name: &str, way: Way) {
    let (ended, cycles, moved) = late(name, way, 10.0 * PERIOD);
    let why = ended.outcome.unwrap().unwrap_err().to_string();
    assert!(why.contains("deadline missed"), "{name}: {why}");
    assert!(cycles <= CYCLES && moved == 0 && ended.stops >= 1, "{name}: {cycles} cycles, {moved} commands");
    line(&format!("{name} hangs, real time"), cycles, ended.rows, &why);
}

#[test]
fn a_drive_goes_on_when_what_was_late_comes_back_and_its_files_show_a_gap() {
    for name in ["law", "disk", "view"] {
        undisturbed(|| goes_on(name));
    }
}

fn goes_on(name: &str) {
    let (ended, cycles, moved) = late(name, Way::Excited, 1000.0 * PERIOD);
    let recording = ended.outcome.unwrap().unwrap_or_else(|e| panic!("{name}: {e}"));
    let remark = recording.warnings.iter().find(|w| w.contains("the next command was late")).unwrap();
    assert!(cycles <= CYCLES && moved > 40, "{name}: {cycles} cycles, {moved} commands");
    let segments = recording.segments().len();
    assert!(segments >= 2 && ended.segments == [segments; 2], "{name}: {segments} and, in the files, {:?}", ended.segments);
    line(&format!("{name} late, real time"), cycles, ended.rows, remark);
}

#[test]
fn a_full_disk_stops_before_the_command_whose_row_was_not_kept() {
    let disk = Box::leak(Box::new(FullDisk(STRIKE - 1)));
    let ended = ended_by("disk full", "no space left", |mut o| {
        o.sinks.push(disk);
        o
    });
    assert!(ended.cycles <= CYCLES, "{}", ended.cycles);
}

#[test]
fn the_floor_is_not_left() {
    let floor = Floor { x: [-0.5, 1.2], y: [-1.0, 1.0], margin: 0.1, deceleration: Some(0.5), reaction: 0.0 };
    let safety = Safety { floor: Some(floor), ..Safety::default() };
    let folder = tempfile::tempdir().unwrap();
    let ended = drive_into(folder.path(), Way::Excited, Fault::None, false, |o| DriveOptions { safety, ..o });
    let why = ended.outcome.unwrap().unwrap_err().to_string();
    assert!(why.contains("would leave its floor"), "{why}");
    let recording = wheelwright::recordings::open(&folder.path().join("recording.csv"), &ReadOptions::default()).unwrap();
    let farthest = recording.column("x").unwrap().iter().copied().fold(0.0, f64::max);
    // What it needs to stop from half a metre a second, at least, is left.
    assert!(farthest > 0.3 && farthest < 1.1 - 0.5 * 0.5 / (2.0 * 0.5), "{farthest}");
    line("floor reached", 0, recording.rows(), &why);
}

#[test]
fn a_time_limit_and_limits_are_kept_and_said() {
    let limits = Limits { v: Some(0.4), v_dot: Some(1.0), ..Limits::default() };
    let safety = Safety { limits, time: Some(1.5), ..Safety::default() };
    let folder = tempfile::tempdir().unwrap();
    let ended = drive_into(folder.path(), Way::Excited, Fault::None, false, |o| DriveOptions { safety, ..o });
    ended.outcome.unwrap().unwrap();
    assert_eq!((ended.rows, ended.stops >= 1), (31, true));
    line("time limit", 0, ended.rows, "the drive ended in order");
}

#[test]
fn a_robot_that_cannot_be_told_is_shouted_about() {
    let folder = tempfile::tempdir().unwrap();
    let ended = drive_into(folder.path(), Way::Excited, Fault::StopFails, false, |o| o);
    let why = ended.outcome.unwrap().unwrap_err().to_string();
    assert!(why.contains("COULD NOT BE STOPPED") && ended.rows == 81, "{why}");
    line("stop cannot be told", 0, ended.rows, &why);
}

#[test]
fn a_driver_that_hangs_wakes_the_watchdog() {
    let (acted, acts) = std::sync::mpsc::channel();
    let dog = Watchdog::start(Duration::from_millis(200), move || acted.send(()).unwrap());
    dog.feed();
    // Nothing feeds it any more, as when a call does not return.
    acts.recv_timeout(Duration::from_secs(20)).unwrap();
    println!("| {:<34} | the program ends within its limit; the link goes down, the robot's own watchdog stops it |", "driver hangs");
}

#[cfg(unix)]
#[path = "faults/hanging.rs"]
mod hanging;
#[cfg(unix)]
#[path = "suite/library.rs"]
mod library;
#[cfg(unix)]
#[path = "faults/link.rs"]
mod link;
#[path = "suite/machine.rs"]
mod machine;
#[cfg(unix)]
#[path = "faults/signals.rs"]
mod signals;
#[cfg(target_os = "linux")]
#[path = "faults/terminal.rs"]
mod terminal;
