//! Signals to the program while it drives the simulator in real time, and disks that fill up under it.

use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use wheelwright_core::recording::ReadOptions;

use crate::machine::undisturbed;

/// A slow robot, so that a machine that is busy for a moment does not count as a late program.
const PERIOD: f64 = 0.1;
/// Rows of a drive that is well on its way.
const ON_ITS_WAY: usize = 15;
/// A key counts as held for so long after it was pressed \[s\].
pub(super) const HELD: f64 = 2.0;
/// Long after which a program that should have ended has not.
pub(super) const PATIENCE: Duration = Duration::from_secs(60);

/// A robot without a wire, and a deadline that only a program that hangs misses.
const SIMULATOR: &str = r#"
[robot]
type = "simulator"
robot = "pioneer-3dx"
realtime = true
period = 0.1

[limits]
deadline = 10.0
"#;

/// What each of the program's ways asks for beside a robot and a course.
const WAYS: &str = r#"
[excitation]
type = "thesis-pioneer"

[model]
type = "vw-pd"
theta = [0.2183, 0.1918, -0.0050, 0.9993, -0.0279, 1.0142]

[source]
period = 0.1
model = { type = "vw-pd", theta = [0.2183, 0.1918, -0.0050, 0.9993, -0.0279, 1.0142] }
controller = { type = "inverse-dynamics", k = [0.8, 2.0, 0.8], kv = 1.5, kw = 1.5 }

[migrate]
compare = false
"#;

/// A course longer than any test, begun at once.
pub(super) const COURSE: &str = r#"
[trajectory]
type = "circle"
radius = 1.0
speed = 0.2

[controller]
type = "inverse-dynamics"
k = [0.8, 2.0, 0.8]
kv = 1.5
kw = 1.5

[track]
duration = 60.0

[record]
countdown = 0.0
"#;

/// A configuration for every way to drive the simulator.
pub(super) fn simulated() -> String {
    format!("{SIMULATOR}{WAYS}{COURSE}")
}

/// The program's ways to drive a robot, with the folder below `out` in which each leaves its first recording.
pub(super) const RECORD: Way = ("record", "");
pub(super) const TRACK: Way = ("track", "");
const MIGRATE: Way = ("migrate", "migrated");

pub(super) type Way = (&'static str, &'static str);

/// A program that a test which fails does not leave running.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The program at work, with its folder and that of its recording.
pub(super) struct Driving {
    child: Running,
    pub(super) folder: tempfile::TempDir,
    pub(super) out: PathBuf,
}

impl Driving {
    /// Starts driving.
    fn start(way: Way, before: &str, more: &str) -> Self {
        Self::start_with(&simulated(), way, before, more)
    }

    pub(super) fn start_with(config: &str, (verb, below): Way, before: &str, more: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("c.toml"), config).unwrap();
        let program = env!("CARGO_BIN_EXE_wheelwright");
        let script = format!("{before} exec '{program}' {verb} c.toml --out out {more}");
        let mut command = Command::new("sh");
        command.arg("-c").arg(script).current_dir(folder.path());
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        let out = folder.path().join("out").join(below);
        Self { child: Running(command.spawn().unwrap()), folder, out }
    }

    fn csv(&self) -> PathBuf {
        self.out.join("recording.csv")
    }

    /// Whole rows in the file now.
    fn rows(&self) -> usize {
        std::fs::read(self.csv()).map_or(0, |bytes| bytes.iter().filter(|b| **b == b'\n').count().saturating_sub(1))
    }

    pub(super) fn wait_for_rows(&mut self, rows: usize) {
        let begun = Instant::now();
        while self.rows() < rows {
            if self.child.0.try_wait().unwrap().is_some() {
                panic!("the program ended before {rows} rows: {}", self.wait().1);
            }
            assert!(begun.elapsed() < PATIENCE, "{} of {rows} rows came", self.rows());
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    pub(super) fn send(&self, signal: &str) {
        let sent = Command::new("kill").arg(format!("-{signal}")).arg(self.child.0.id().to_string()).status().unwrap();
        assert!(sent.success());
    }

    pub(super) fn wait(&mut self) -> (ExitStatus, String) {
        let begun = Instant::now();
        let status = loop {
            if let Some(status) = self.child.0.try_wait().unwrap() {
                break status;
            }
            if begun.elapsed() > PATIENCE {
                self.child.0.kill().unwrap();
                panic!("the program did not end");
            }
            std::thread::sleep(Duration::from_millis(5));
        };
        let mut said = String::new();
        self.child.0.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        (status, said)
    }
}

/// Both files read back; their rows.
pub(super) fn readable(folder: &Path) -> usize {
    let open = |name: &str| wheelwright::recordings::open(&folder.join(name), &ReadOptions::default()).unwrap();
    let (csv, mcap) = (open("recording.csv"), open("recording.mcap"));
    assert!(csv.rows().abs_diff(mcap.rows()) <= 1, "{} and {}", csv.rows(), mcap.rows());
    csv.rows()
}

/// A signal while the robot drives: rows that came after it, counted against the time that the test itself took.
fn signalled(way: Way, name: &str, signal: &str, says: &str) -> Driving {
    let name = &format!("{name}, {}", way.0);
    let mut driving = Driving::start(way, "", "");
    driving.wait_for_rows(ON_ITS_WAY);
    let asked = Instant::now();
    let before = driving.rows();
    driving.send(signal);
    let own = (asked.elapsed().as_secs_f64() / PERIOD).ceil() as usize;
    let (status, said) = driving.wait();
    let rows = readable(&driving.out);
    let cycles = rows.saturating_sub(before + own);
    assert!(cycles <= super::CYCLES, "{name}: {cycles} cycles after the signal");
    assert!(says.is_empty() || said.contains(says), "{name}: {said}");
    if says.is_empty() {
        assert_eq!(status.code(), None, "{name}: it was killed");
    } else {
        assert_eq!(status.code(), Some(1), "{name}: {said}");
    }
    super::line(name, cycles, rows, said.trim());
    driving
}

#[test]
fn ctrl_c_sigterm_and_a_closed_terminal_stop_the_robot() {
    for way in [RECORD, TRACK] {
        for (name, signal) in [("ctrl-C", "INT"), ("SIGTERM", "TERM"), ("terminal closed (SIGHUP)", "HUP")] {
            undisturbed(|| drop(signalled(way, name, signal, "stopped by request")));
        }
    }
}

/// What was driven is kept; the page and the numbers tell of it.
#[test]
fn ctrl_c_ends_a_migration_and_not_only_one_of_its_runs() {
    undisturbed(|| {
        let driving = signalled(MIGRATE, "ctrl-C", "INT", "stopped by request");
        let out = driving.folder.path().join("out");
        assert!(!out.join("migrated-adapting").exists(), "another run was begun");
        assert!(out.join("result.json").exists() && out.join("report.html").exists());
    });
}

#[test]
fn kill_9_leaves_every_row_whole() {
    for way in [RECORD, TRACK] {
        undisturbed(|| drop(signalled(way, "kill -9", "KILL", "")));
    }
}

#[test]
fn a_program_that_was_asleep_does_not_go_on_driving() {
    for way in [RECORD, TRACK] {
        undisturbed(|| asleep(way));
    }
}

fn asleep(way: Way) {
    let mut driving = Driving::start(way, "", "--set limits.deadline=0.5");
    driving.wait_for_rows(ON_ITS_WAY);
    driving.send("STOP");
    std::thread::sleep(Duration::from_millis(1600));
    let before = driving.rows();
    driving.send("CONT");
    let (status, said) = driving.wait();
    assert_eq!(status.code(), Some(5), "{said}");
    assert!(said.contains("the robot took") || said.contains("deadline missed"), "{said}");
    let rows = readable(&driving.out);
    assert!(rows <= before + super::CYCLES, "{rows} after {before}");
    super::line("program suspended", rows - before, rows, said.trim());
}

/// The shell counts blocks of 512 bytes, or of 1024 where it is bash: some rows fit into either, the whole drive into neither.
#[test]
fn a_full_disk_stops_the_robot_and_leaves_whole_rows() {
    undisturbed(full_disk);
}

fn full_disk() {
    let mut driving = Driving::start(TRACK, "trap '' XFSZ; ulimit -f 40;", "--set robot.period=0.05");
    let (status, said) = driving.wait();
    assert_eq!(status.code(), Some(1), "{said}");
    assert!(said.contains("the recording cannot be written") && said.contains("the robot was stopped"), "{said}");
    let out = &driving.out;
    let rows = readable(out);
    assert!(rows >= 10, "{rows}");
    let text = std::fs::read_to_string(out.join("recording.csv")).unwrap();
    assert!(text.ends_with('\n'), "the cut line was taken back");
    super::line("file size limit", 1, rows, said.trim());
}

#[test]
fn a_hand_that_lets_go_stops_the_robot() {
    for way in [RECORD, TRACK, MIGRATE] {
        undisturbed(|| let_go(way));
    }
}

fn let_go(way: Way) {
    let mut driving = Driving::start(way, "", &format!("--dead-man --set record.dead_man_timeout={HELD}"));
    let mut hand = driving.child.0.stdin.take().unwrap();
    let begun = Instant::now();
    while driving.rows() < ON_ITS_WAY {
        assert!(begun.elapsed() < PATIENCE, "nothing moves though the key is held");
        if hand.write_all(b" ").is_err() {
            panic!("the program ended though the key was held: {}", driving.wait().1);
        }
        std::thread::sleep(Duration::from_millis(30));
    }
    let let_go = Instant::now();
    let before = driving.rows();
    let (status, said) = driving.wait();
    assert_eq!(status.code(), Some(1), "{said}");
    assert!(said.contains("dead man"), "{said}");
    let rows = readable(&driving.out);
    let held = (let_go.elapsed().as_secs_f64().min(HELD) / PERIOD).ceil() as usize;
    assert!(rows <= before + held + super::CYCLES, "{rows} rows, {before} when it let go");
    super::line("key let go", rows.saturating_sub(before + held), rows, said.trim());
}

#[test]
fn nobody_holds_the_key_and_nothing_moves() {
    for way in [RECORD, TRACK] {
        undisturbed(|| unheld(way));
    }
}

fn unheld(way: Way) {
    let mut driving = Driving::start(way, "", "--dead-man");
    let mut asked = String::new();
    let mut stderr = BufReader::new(driving.child.0.stderr.take().unwrap());
    stderr.read_line(&mut asked).unwrap();
    assert!(asked.contains("hold a key"), "{asked}");
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(driving.rows(), 0);
    driving.send("INT");
    driving.child.0.stderr = Some(stderr.into_inner());
    let (status, said) = driving.wait();
    assert_ne!(status.code(), Some(0));
    assert!(said.contains("before the robot moved"), "{said}");
    assert!(!driving.csv().exists());
}

#[test]
fn a_countdown_comes_before_tracking_and_a_signal_in_it_moves_nothing() {
    undisturbed(counted_down);
}

fn counted_down() {
    let mut driving = Driving::start(TRACK, "", "--countdown 30");
    std::thread::sleep(Duration::from_millis(1500));
    assert_eq!(driving.rows(), 0);
    driving.send("INT");
    let (status, said) = driving.wait();
    assert_ne!(status.code(), Some(0));
    assert!(said.contains("before the robot moved") && !driving.csv().exists(), "{said}");
}

/// The robot, here an emulated one, is gone in the middle of a run.
#[test]
fn a_link_that_is_lost_while_tracking_is_said_and_the_rows_are_kept() {
    undisturbed(link_lost);
}

fn link_lost() {
    // A port that was free a moment ago.
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let (emulated, listen) = ("examples/emulate_pioneer.toml", format!("emulator.listen=\"127.0.0.1:{port}\""));
    let mut emulator = Command::new(env!("CARGO_BIN_EXE_wheelwright"));
    emulator.args(["emulate", emulated, "--set", &listen]).current_dir(env!("CARGO_MANIFEST_DIR"));
    let emulator = Running(emulator.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap());
    let listening = Instant::now();
    while std::net::TcpStream::connect(("127.0.0.1", port)).is_err() {
        assert!(listening.elapsed() < PATIENCE, "the emulator does not listen");
        std::thread::sleep(Duration::from_millis(20));
    }
    let config = format!("[robot]\ntype = \"pioneer\"\ntcp = \"127.0.0.1:{port}\"\n[limits]\ndeadline = 5.0\n{WAYS}{COURSE}");
    let mut driving = Driving::start_with(&config, TRACK, "", "");
    driving.wait_for_rows(ON_ITS_WAY);
    drop(emulator);
    let before = driving.rows();
    let (status, said) = driving.wait();
    assert_eq!(status.code(), Some(5), "{said}");
    assert!(said.contains("rows were kept"), "{said}");
    let rows = readable(&driving.out);
    assert!(rows >= ON_ITS_WAY && rows <= before + super::CYCLES, "{rows} rows, {before} when the link went");
    super::line("link lost over TCP, track", rows - before, rows, said.trim());
}

#[test]
fn a_second_recording_leaves_the_first_alone() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("c.toml"), simulated().replace("realtime = true", "realtime = false")).unwrap();
    let record = || {
        let program = env!("CARGO_BIN_EXE_wheelwright");
        let arguments = ["record", "c.toml", "--out", "out", "--quiet", "--set", "excitation.duration=5.0"];
        let output = Command::new(program).args(arguments).current_dir(folder.path()).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    };
    record();
    let first = std::fs::read(folder.path().join("out/recording.csv")).unwrap();
    record();
    assert_eq!(std::fs::read(folder.path().join("out/recording.csv")).unwrap(), first);
    assert_eq!(std::fs::read(folder.path().join("out/recording-2.csv")).unwrap(), first, "the same seed");
    assert!(folder.path().join("out/recording-2.mcap").exists());
}
