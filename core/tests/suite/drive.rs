//! Driving robots that behave and robots that do not.

use std::cell::Cell;
use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use wheelwright_core::channel::{self, Channel};
use wheelwright_core::drive::{DriveError, DriveFault, DriveOptions, DriveProgress, Safety, drive, steer};
use wheelwright_core::excitation::{Excitation, ExcitationError};
use wheelwright_core::profile::Limits;
use wheelwright_core::robot::{Live, Robot, RobotError};

static INPUTS: [Channel; 1] = [channel::V_REF];
static OUTPUTS: [Channel; 2] = [channel::V, channel::X];
const PERIOD: f64 = 0.1;

/// What goes wrong at the fifth step.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Flaw {
    None,
    Fails,
    Panics,
    MeasuresNan,
    FreezesClock,
    TurnsClockBack,
    CrawlsClock,
    CannotStop,
    FailsAtOnce,
}

/// Follows its command within one period; x is the path.
struct Fake {
    flaw: Flaw,
    /// Whether it minds how long others take: a busy machine may take any time.
    real_time: bool,
    steps: usize,
    t: f64,
    v: f64,
    x: f64,
    stops: Arc<AtomicUsize>,
    told: Told,
}

/// The commands that a robot was told, one a period.
type Told = Arc<Mutex<Vec<f64>>>;

fn lost() -> RobotError {
    RobotError::Connection("cable cut".to_owned())
}

impl Robot for Fake {
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
        if self.flaw == Flaw::FailsAtOnce {
            return Err(lost());
        }
        measured.copy_from_slice(&[self.v, self.x]);
        Ok(self.t)
    }
    fn step(&mut self, command: &[f64], measured: &mut [f64]) -> Result<f64, RobotError> {
        assert_eq!(self.stops.load(Ordering::Relaxed), 0, "commanded after a stop");
        self.steps += 1;
        self.told.lock().unwrap().push(command[0]);
        if command[0] == 0.0 {
            // Standing takes time, so that work that comes back finds the first period not over.
            std::thread::sleep(Duration::from_millis(20));
        }
        self.v = command[0];
        self.x += PERIOD * self.v;
        let mut advance = PERIOD;
        if self.steps >= 5 {
            match self.flaw {
                Flaw::Fails => return Err(lost()),
                Flaw::Panics => panic!("driver bug"),
                Flaw::MeasuresNan => self.x = f64::NAN,
                Flaw::FreezesClock => advance = 0.0,
                Flaw::TurnsClockBack => advance = -1.0,
                Flaw::CrawlsClock => advance = 1e-6,
                _ => {}
            }
        }
        self.t += advance;
        measured.copy_from_slice(&[self.v, self.x]);
        Ok(self.t)
    }
    fn stop(&mut self) -> Result<(), RobotError> {
        self.stops.fetch_add(1, Ordering::Relaxed);
        if self.flaw == Flaw::CannotStop { Err(lost()) } else { Ok(()) }
    }
}

/// v_ref = 1 + t, or something worse.
#[derive(Debug, Serialize, Deserialize)]
enum Signal {
    Ramp,
    Nan,
    Panic,
    Unfit,
    Endless,
}

#[typetag::serde]
impl Excitation for Signal {
    fn about(&self) -> String {
        "a ramp".to_owned()
    }
    fn duration(&self) -> f64 {
        if matches!(self, Self::Endless) { f64::INFINITY } else { 1.0 }
    }
    fn check(&self, _: &[Channel]) -> Result<(), ExcitationError> {
        match self {
            Self::Unfit => Err(ExcitationError::UnknownChannel { channel: "u_left".to_owned(), available: "v_ref".to_owned() }),
            _ => Ok(()),
        }
    }
    fn command(&self, t: f64, _: &[Channel], command: &mut [f64]) {
        command[0] = match self {
            Self::Nan if t > 0.25 => f64::NAN,
            Self::Panic if t > 0.25 => panic!("excitation bug"),
            _ => 1.0 + t,
        };
    }
}

/// A robot that waits for others, with its clock at 100 s, and the count of its stops.
fn fake(flaw: Flaw) -> (Live, Arc<AtomicUsize>) {
    let (robot, stops, _) = overheard(flaw, false);
    (robot, stops)
}

/// The same or one in real time, and what it is told.
fn overheard(flaw: Flaw, real_time: bool) -> (Live, Arc<AtomicUsize>, Told) {
    let (stops, told) = (Arc::new(AtomicUsize::new(0)), Told::default());
    let robot = Fake { flaw, real_time, steps: 0, t: 100.0, v: 0.0, x: 0.0, stops: stops.clone(), told: told.clone() };
    (Live::new(Box::new(robot)), stops, told)
}

/// Drives a flawed robot: the error, and how often it was stopped before the guard went.
fn failing(flaw: Flaw, signal: &Signal) -> (DriveError, usize) {
    let (mut robot, stops) = fake(flaw);
    let error = drive(&mut robot, signal, DriveOptions::default()).unwrap_err();
    (error, stops.load(Ordering::Relaxed))
}

fn rows(error: &DriveError) -> usize {
    error.recorded.as_ref().map_or(0, |r| r.rows())
}

#[test]
fn a_row_holds_the_measurement_and_the_command_that_follows_it() {
    let (mut robot, stops) = fake(Flaw::None);
    let recording = drive(&mut robot, &Signal::Ramp, DriveOptions::default()).unwrap();
    assert_eq!(stops.load(Ordering::Relaxed), 1);
    assert_eq!(recording.rows(), 11);
    assert_eq!(recording.columns().iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["v_ref", "v", "x"]);
    let (t, v_ref, v) = (recording.time(), recording.column("v_ref").unwrap(), recording.column("v").unwrap());
    assert_eq!((t[0], v[0]), (0.0, 0.0));
    for k in 0..11 {
        assert!((t[k] - 0.1 * k as f64).abs() < 1e-9);
        assert!((v_ref[k] - 1.0 - t[k]).abs() < 1e-9);
        assert!(k == 0 || v[k] == v_ref[k - 1]);
    }
}

#[test]
fn duration_and_observer_are_the_callers() {
    let (mut robot, _) = fake(Flaw::None);
    let mut seen = Vec::new();
    let mut observer = |p: &DriveProgress<'_>| seen.push((p.t, p.duration, p.command[0], p.measured[0]));
    let options = DriveOptions { duration: Some(0.3), observer: Some(&mut observer), ..DriveOptions::default() };
    let recording = drive(&mut robot, &Signal::Ramp, options).unwrap();
    assert_eq!(recording.rows(), 4);
    assert_eq!(seen.len(), 4);
    assert_eq!(seen[3], (recording.time()[3], 0.3, recording.column("v_ref").unwrap()[3], recording.column("v").unwrap()[3]));
}

#[test]
fn a_fault_keeps_the_rows_before_it_and_stops_the_robot() {
    for (flaw, kept, message) in [
        (Flaw::Fails, 5, "no connection to the robot: cable cut; 5 rows were kept; the robot was stopped"),
        (Flaw::MeasuresNan, 5, "the robot measured `x` = NaN at t = 0.500 s; 5 rows"),
        (Flaw::FreezesClock, 5, "the robot's clock does not advance: 0.400000 s after 0.400000 s"),
        (Flaw::TurnsClockBack, 5, "the robot's clock does not advance: -0.600000 s after 0.400000 s"),
        (Flaw::FailsAtOnce, 0, "cable cut; 0 rows were kept"),
    ] {
        let (error, stops) = failing(flaw, &Signal::Ramp);
        assert_eq!((rows(&error), stops), (kept, 1), "{flaw:?}");
        assert!(error.to_string().contains(message), "{error}");
    }
}

#[test]
fn a_clock_that_crawls_does_not_drive_for_ever() {
    let (error, stops) = failing(Flaw::CrawlsClock, &Signal::Ramp);
    assert!(matches!(error.fault, DriveFault::SlowClock { steps: 100, .. }), "{error}");
    assert_eq!((rows(&error), stops), (101, 1));
}

#[test]
fn an_excitation_that_is_wrong_sends_nothing() {
    let (error, stops) = failing(Flaw::None, &Signal::Nan);
    assert!(error.to_string().contains("command `v_ref` is NaN at t = 0.300 s"), "{error}");
    assert_eq!((rows(&error), stops), (3, 1));
    let (error, stops) = failing(Flaw::None, &Signal::Unfit);
    assert!(matches!(error.fault, DriveFault::Excitation(_)));
    assert_eq!((rows(&error), stops), (0, 1));
    let (error, _) = failing(Flaw::None, &Signal::Endless);
    assert!(error.to_string().contains("the drive's duration is inf s"), "{error}");
}

#[test]
fn a_panic_stops_the_robot() {
    let safety = Safety { deadline: Some(60.0), ..Safety::default() };
    for (flaw, signal) in [(Flaw::Panics, Signal::Ramp), (Flaw::None, Signal::Panic)] {
        for real_time in [false, true] {
            let (mut robot, stops, _) = overheard(flaw, real_time);
            let options = DriveOptions { safety, ..DriveOptions::default() };
            let outcome = catch_unwind(AssertUnwindSafe(|| drive(&mut robot, &signal, options).map(drop)));
            assert!(outcome.is_err());
            drop(robot);
            assert_eq!(stops.load(Ordering::Relaxed), 1, "{flaw:?}, in real time: {real_time}");
        }
    }
}

/// Does not come back before something has happened to the robot.
fn hang_until(what: &str, happened: impl Fn() -> bool) {
    let begun = Instant::now();
    while !happened() {
        assert!(begun.elapsed() < Duration::from_secs(20), "{what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_robot_is_stopped_at_the_deadline_beside_a_law_or_a_view_that_does_not_return() {
    let safety = Safety { deadline: Some(2.0), ..Safety::default() };
    for law_hangs in [true, false] {
        let (mut robot, stops, _) = overheard(Flaw::None, true);
        let (told_once, shown) = (Cell::new(false), Cell::new(0));
        let wait = |hangs: bool, t: f64| {
            if hangs && t > 0.25 {
                hang_until("nobody stopped the robot", || stops.load(Ordering::Relaxed) > 0);
                told_once.set(stops.load(Ordering::Relaxed) == 1);
            }
        };
        let mut law = |t: f64, _: &[f64], command: &mut [f64]| {
            command[0] = 1.0;
            wait(law_hangs, t);
            Ok(ControlFlow::Continue(()))
        };
        let mut observer = |p: &DriveProgress<'_>| {
            shown.set(shown.get() + 1);
            wait(!law_hangs, p.t);
        };
        let options = DriveOptions { safety, observer: Some(&mut observer), ..DriveOptions::default() };
        let error = steer(&mut robot, 1.0, &mut law, options).unwrap_err();
        assert!(told_once.get(), "the law hangs: {law_hangs}");
        assert!(matches!(error.fault, DriveFault::Deadline { limit_s: 2.0, .. }), "{error}");
        assert_eq!(rows(&error), shown.get(), "every row that was shown, and no other");
    }
}

/// The robot counts its periods, so that each row can be held against what it was told then. Stands that a busy machine causes are like
/// the one that the test causes.
#[test]
fn a_robot_stands_beside_late_work_and_no_row_claims_another_command_for_that_time() {
    let limits = Limits { v_dot: Some(2.0), ..Limits::default() };
    let safety = Safety { limits, deadline: Some(60.0), ..Safety::default() };
    for law_is_late in [true, false] {
        let (mut robot, stops, told) = overheard(Flaw::None, true);
        let (late, mut asked) = (Cell::new(true), Vec::new());
        let wait = |is_late: bool, t: f64| {
            if is_late && t > 0.85 && late.take() {
                hang_until("nobody told the robot to stand", || told.lock().unwrap().last() == Some(&0.0));
            }
        };
        let mut law = |t: f64, _: &[f64], command: &mut [f64]| {
            command[0] = 1.0 + t;
            asked.push(t);
            wait(law_is_late, t);
            Ok(ControlFlow::Continue(()))
        };
        let mut observer = |p: &DriveProgress<'_>| wait(!law_is_late, p.t);
        let options = DriveOptions { safety, observer: Some(&mut observer), ..DriveOptions::default() };
        let recording = steer(&mut robot, 2.0, &mut law, options).unwrap();
        assert_eq!(stops.load(Ordering::Relaxed), 1, "the drive went on until its end");
        assert!(recording.warnings.iter().any(|w| w.contains("the next command was late")), "{:?}", recording.warnings);
        assert_eq!(asked.len(), 21);
        assert!(asked.windows(2).all(|pair| (pair[1] - pair[0] - PERIOD).abs() < 1e-9), "the plan waits: {asked:?}");

        let told = told.lock().unwrap();
        let (t, v_ref) = (recording.time(), recording.column("v_ref").unwrap());
        let period = |row: usize| (t[row] / PERIOD).round() as usize;
        assert!(recording.segments().len() >= 2);
        for segment in recording.segments() {
            for row in segment.rows.start..segment.rows.end - 1 {
                assert_eq!((period(row + 1), v_ref[row]), (period(row) + 1, told[period(row)]), "row {row}");
            }
            assert!(v_ref[segment.rows.start] <= 2.0 * PERIOD + 1e-9, "from rest it starts within its limits");
        }
        for again in recording.segments()[1..].iter().map(|segment| segment.rows.start) {
            assert!(told[period(again - 1)..period(again)].iter().all(|command| *command == 0.0), "{told:?}");
        }
    }
}

#[test]
fn who_is_late_again_and_again_does_not_drive() {
    let (mut robot, stops, told) = overheard(Flaw::None, true);
    let mut law = |_: f64, _: &[f64], command: &mut [f64]| {
        command[0] = 1.0;
        let before = told.lock().unwrap().len();
        // The third time it is stopped and not told to stand.
        hang_until("nobody minds the robot", || told.lock().unwrap().len() > before || stops.load(Ordering::Relaxed) > 0);
        Ok(ControlFlow::Continue(()))
    };
    let safety = Safety { deadline: Some(60.0), ..Safety::default() };
    let error = steer(&mut robot, 2.0, &mut law, DriveOptions { safety, ..DriveOptions::default() }).unwrap_err();
    assert!(matches!(error.fault, DriveFault::TooLate { times: 3, commands: 0, .. }), "{error}");
    assert!(stops.load(Ordering::Relaxed) >= 1 && told.lock().unwrap().iter().all(|command| *command == 0.0));
}

#[test]
fn the_stop_flag_ends_the_drive_before_the_next_command() {
    let (mut robot, stops) = fake(Flaw::None);
    let flag = AtomicBool::new(false);
    let mut observer = |p: &DriveProgress<'_>| flag.store(p.t > 0.25, Ordering::Relaxed);
    let options = DriveOptions { stop: Some(&flag), observer: Some(&mut observer), ..DriveOptions::default() };
    let error = drive(&mut robot, &Signal::Ramp, options).unwrap_err();
    assert!(matches!(error.fault, DriveFault::Interrupted { .. }));
    let recorded = error.recorded.unwrap();
    assert_eq!((recorded.rows(), stops.load(Ordering::Relaxed)), (4, 1));
    assert_eq!(recorded.column("v").unwrap()[3], recorded.column("v_ref").unwrap()[2], "no command after the flag");
}

#[test]
fn a_robot_that_cannot_be_stopped_is_reported_with_the_whole_recording() {
    let (error, _) = failing(Flaw::CannotStop, &Signal::Ramp);
    assert_eq!(rows(&error), 11);
    assert!(error.to_string().contains("COULD NOT BE STOPPED"), "{error}");
}
