//! Signals to the program while it drives the simulator in real time, and disks that fill up under it.

use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use wheelwright_core::recording::ReadOptions;

const PERIOD: f64 = 0.05;
/// Long after which a program that should have ended has not.
const PATIENCE: Duration = Duration::from_secs(60);

const CONFIG: &str = r#"
[robot]
type = "simulator"
robot = "pioneer-3dx"
realtime = true
period = 0.05

[excitation]
type = "thesis-pioneer"

[record]
countdown = 0.0
"#;

/// The program at work, with its folder.
struct Driving {
    child: Child,
    folder: tempfile::TempDir,
}

impl Driving {
    /// Starts `record` and waits until rows come.
    fn start(before: &str, more: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("c.toml"), CONFIG).unwrap();
        let program = env!("CARGO_BIN_EXE_wheelwright");
        let script = format!("{before} exec '{program}' record c.toml --out out {more}");
        let mut command = Command::new("sh");
        command.arg("-c").arg(script).current_dir(folder.path());
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        Self { child: command.spawn().unwrap(), folder }
    }

    fn csv(&self) -> PathBuf {
        self.folder.path().join("out/recording.csv")
    }

    /// Whole rows in the file now.
    fn rows(&self) -> usize {
        std::fs::read(self.csv()).map_or(0, |bytes| bytes.iter().filter(|b| **b == b'\n').count().saturating_sub(1))
    }

    fn wait_for_rows(&self, rows: usize) {
        let begun = Instant::now();
        while self.rows() < rows {
            assert!(begun.elapsed() < PATIENCE, "no rows come");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn send(&self, signal: &str) {
        let sent = Command::new("kill").arg(format!("-{signal}")).arg(self.child.id().to_string()).status().unwrap();
        assert!(sent.success());
    }

    fn wait(&mut self) -> (ExitStatus, String) {
        let begun = Instant::now();
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            if begun.elapsed() > PATIENCE {
                self.child.kill().unwrap();
                panic!("the program did not end");
            }
            std::thread::sleep(Duration::from_millis(5));
        };
        let mut said = String::new();
        self.child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        (status, said)
    }
}

/// Both files read back; their rows.
fn readable(folder: &Path) -> usize {
    let open = |name: &str| wheelwright::recordings::open(&folder.join(name), &ReadOptions::default()).unwrap();
    let (csv, mcap) = (open("recording.csv"), open("recording.mcap"));
    assert!(csv.rows().abs_diff(mcap.rows()) <= 1, "{} and {}", csv.rows(), mcap.rows());
    csv.rows()
}

/// A signal while the robot drives: rows that came after it, counted against the time that the test itself took.
fn signalled(name: &str, signal: &str, says: &str) {
    let mut driving = Driving::start("", "");
    driving.wait_for_rows(20);
    let asked = Instant::now();
    let before = driving.rows();
    driving.send(signal);
    let own = (asked.elapsed().as_secs_f64() / PERIOD).ceil() as usize;
    let (status, said) = driving.wait();
    let rows = readable(&driving.folder.path().join("out"));
    let cycles = rows.saturating_sub(before + own);
    assert!(cycles <= super::CYCLES, "{name}: {cycles} cycles after the signal");
    assert!(says.is_empty() || said.contains(says), "{name}: {said}");
    if says.is_empty() {
        assert_eq!(status.code(), None, "{name}: it was killed");
    } else {
        assert_eq!(status.code(), Some(1), "{name}: {said}");
    }
    super::line(name, cycles, rows, said.trim());
}

#[test]
fn ctrl_c_sigterm_and_a_closed_terminal_stop_the_robot() {
    std::thread::scope(|scope| {
        for (name, signal) in [("ctrl-C", "INT"), ("SIGTERM", "TERM"), ("terminal closed (SIGHUP)", "HUP")] {
            scope.spawn(move || signalled(name, signal, "stopped by request"));
        }
    });
}

#[test]
fn kill_9_leaves_every_row_whole() {
    signalled("kill -9", "KILL", "");
}

#[test]
fn a_program_that_was_asleep_does_not_go_on_driving() {
    let mut driving = Driving::start("", "");
    driving.wait_for_rows(10);
    driving.send("STOP");
    std::thread::sleep(Duration::from_millis(1600));
    let before = driving.rows();
    driving.send("CONT");
    let (status, said) = driving.wait();
    assert_eq!(status.code(), Some(5), "{said}");
    assert!(said.contains("the robot took") || said.contains("deadline missed"), "{said}");
    let rows = readable(&driving.folder.path().join("out"));
    assert!(rows <= before + super::CYCLES, "{rows} after {before}");
    super::line("program suspended", rows - before, rows, said.trim());
}

/// The shell counts blocks of 512 bytes, or of 1024 where it is bash: some rows fit into either, the whole drive into neither.
#[test]
fn a_full_disk_stops_the_robot_and_leaves_whole_rows() {
    let mut driving = Driving::start("trap '' XFSZ; ulimit -f 40;", "");
    let (status, said) = driving.wait();
    assert_eq!(status.code(), Some(1), "{said}");
    assert!(said.contains("the recording cannot be written") && said.contains("the robot was stopped"), "{said}");
    let out = driving.folder.path().join("out");
    let rows = readable(&out);
    assert!(rows >= 10, "{rows}");
    let text = std::fs::read_to_string(out.join("recording.csv")).unwrap();
    assert!(text.ends_with('\n'), "the cut line was taken back");
    super::line("file size limit", 1, rows, said.trim());
}

#[test]
fn a_hand_that_lets_go_stops_the_robot() {
    let mut driving = Driving::start("", "--dead-man --set record.dead_man_timeout=0.3");
    let mut hand = driving.child.stdin.take().unwrap();
    let begun = Instant::now();
    while driving.rows() < 20 {
        assert!(begun.elapsed() < PATIENCE, "nothing moves though the key is held");
        hand.write_all(b" ").unwrap();
        std::thread::sleep(Duration::from_millis(30));
    }
    let let_go = Instant::now();
    let before = driving.rows();
    let (status, said) = driving.wait();
    assert_eq!(status.code(), Some(1), "{said}");
    assert!(said.contains("dead man"), "{said}");
    let rows = readable(&driving.folder.path().join("out"));
    let held = (let_go.elapsed().as_secs_f64().min(0.3) / PERIOD).ceil() as usize;
    assert!(rows <= before + held + super::CYCLES, "{rows} rows, {before} when it let go");
    super::line("key let go", rows.saturating_sub(before + held), rows, said.trim());
}

#[test]
fn nobody_holds_the_key_and_nothing_moves() {
    let mut driving = Driving::start("", "--dead-man");
    let mut asked = String::new();
    let mut stderr = BufReader::new(driving.child.stderr.take().unwrap());
    stderr.read_line(&mut asked).unwrap();
    assert!(asked.contains("hold a key"), "{asked}");
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(driving.rows(), 0);
    driving.send("INT");
    driving.child.stderr = Some(stderr.into_inner());
    let (status, said) = driving.wait();
    assert_ne!(status.code(), Some(0));
    assert!(said.contains("before the robot moved"), "{said}");
    assert!(!driving.csv().exists());
}

#[test]
fn a_second_recording_leaves_the_first_alone() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("c.toml"), CONFIG.replace("realtime = true", "realtime = false")).unwrap();
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
