//! Driving a robot from a configuration: what `record`, `run` and `run --autonomous` have in common.
//!
//! Connect, step back, drive within limits while rows go to the files, and stop, whatever happens.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use toml::Table;
use wheelwright_core::Recording;
use wheelwright_core::drive::{Bite, DeadMan, DriveError, DriveOptions, DriveProgress, RowSink, Safety, Watchdog, steer};
use wheelwright_core::excitation::Excitation;
use wheelwright_core::profile::RobotProfile;
use wheelwright_core::robot::Live;

use super::Shared;
use super::console::Console;
use super::halt::{self, Halt};
use super::hold::Hold;
use super::live::{Coverage, View};
use super::setup::Setup;
use crate::error::Error;
use crate::record::RecordingFiles;

/// Countdown before a robot in real time moves \[s\].
const COUNTDOWN: f64 = 3.0;
/// A driver that has not returned for this many control periods, and this many seconds, hangs.
const HANGS: (f64, f64) = (20.0, 5.0);
/// How often a countdown looks at the key and the signals.
const GLANCE: Duration = Duration::from_millis(20);

/// One drive as it is asked for.
pub(super) struct Drive<'a> {
    pub(super) setup: &'a Setup,
    pub(super) robot: Table,
    pub(super) excitation: &'a dyn Excitation,
    pub(super) safety: Safety,
    /// Where the files go; `None` keeps the recording in memory only.
    pub(super) folder: Option<&'a Path>,
    pub(super) seed: u64,
    /// The part of the excitation that is driven: from a time \[s\] on, for so long \[s\], from its beginning again after its end.
    pub(super) part: Option<(f64, f64)>,
    pub(super) countdown: Option<f64>,
    /// Settings of a dead man's switch, if there is to be one.
    pub(super) hold: Option<&'a Hold>,
}

/// What a drive left.
pub(super) struct Driven {
    pub(super) recording: Recording,
    pub(super) files: Option<RecordingFiles>,
    pub(super) bites: Vec<Bite>,
    pub(super) coverage: f64,
}

impl Driven {
    pub(super) fn csv(&self) -> Option<PathBuf> {
        self.files.as_ref().map(|f| f.csv_path.clone())
    }
}

/// What the configuration and a profile allow.
pub(super) fn safety(setup: &Setup, profile: Option<&RobotProfile>) -> Result<Safety, Error> {
    setup.config.sections.limits.safety(profile, setup.config.folder()).map_err(|e| setup.config.error_in("limits", e))
}

/// Listens for a held key if the configuration or an option asks for one.
pub(super) fn hold(setup: &Setup, asked: bool) -> Result<Option<Hold>, Error> {
    let record = &setup.config.sections.record;
    (asked || record.dead_man).then(|| Hold::listen(record.dead_man_timeout)).transpose()
}

/// Folder of a drive's files: option, configuration, or what `otherwise` says.
pub(super) fn folder(setup: &Setup, shared: &Shared, otherwise: Option<&Path>) -> Result<Option<PathBuf>, Error> {
    let configured = setup.folder(shared)?.map(|folder| folder.path(""));
    Ok(configured.or_else(|| otherwise.map(Path::to_owned)))
}

impl Drive<'_> {
    /// Drives. A panic on the way passes through, and stops the robot as it does.
    pub(super) fn run(self, console: &Console) -> Result<Driven, Error> {
        let _halt = Halt::watch()?;
        let mut robot = self.setup.connect(self.robot.clone(), self.seed)?;
        self.excitation.check(robot.inputs())?;
        let (offset, duration) = self.part.unwrap_or_else(|| (0.0, self.excitation.duration()));
        let switch = self.hold.map(|hold| &*hold.switch);
        self.count_down(&mut robot, switch, console)?;
        let mut files = self.files(&robot)?;
        let planned = self.safety.time.map_or(duration, |longest| longest.min(duration));
        let coverage = Coverage::plan(self.excitation, planned, robot.period(), robot.inputs());
        let mut view = View::new(console, robot.inputs(), robot.outputs(), coverage, switch.is_some());
        let watchdog = watchdog(&robot);
        let mut bites = Vec::new();
        let mut observer = |progress: &DriveProgress<'_>| {
            if let Some(watchdog) = &watchdog {
                watchdog.feed();
            }
            progress.bites.clone_into(&mut bites);
            view.update(progress);
        };
        let sinks = files.as_mut().map(RecordingFiles::sinks).unwrap_or_default();
        let outcome = self.steer(&mut robot, (offset, duration), switch, sinks, &mut observer);
        let coverage = view.coverage.share();
        // The terminal is put in order before anything else is said.
        drop(view);
        match outcome {
            Ok(recording) => Ok(Driven { recording, files, bites, coverage }),
            Err(error) => Err(Error::Drive { error: Box::new(error), kept: files.map(|f| f.csv_path) }),
        }
    }

    fn steer<'b>(
        &self,
        robot: &mut Live,
        (offset, duration): (f64, f64),
        dead_man: Option<&'b DeadMan>,
        sinks: Vec<&'b mut (dyn RowSink + 'b)>,
        observer: &'b mut dyn FnMut(&DriveProgress<'_>),
    ) -> Result<Recording, DriveError> {
        let inputs = robot.inputs().to_vec();
        let whole = self.excitation.duration();
        let mut law = |t: f64, _: &[f64], command: &mut [f64]| {
            let at = if self.part.is_some() { (offset + t) % whole } else { t };
            self.excitation.command(at, &inputs, command);
            Ok(ControlFlow::Continue(()))
        };
        let options =
            DriveOptions { duration: None, safety: self.safety, stop: Some(&halt::STOP), dead_man, sinks, observer: Some(observer) };
        steer(robot, duration, &mut law, options)
    }

    fn files(&self, robot: &Live) -> Result<Option<RecordingFiles>, Error> {
        let channels = || robot.inputs().iter().chain(robot.outputs());
        self.folder.map(|folder| RecordingFiles::create(folder, channels())).transpose()
    }

    /// Time to step back. With a dead man's switch it begins when the key is held, and again whenever it was let go.
    fn count_down(&self, robot: &mut Live, switch: Option<&DeadMan>, console: &Console) -> Result<(), Error> {
        let standard = if robot.real_time() { COUNTDOWN } else { 0.0 };
        let length = Duration::try_from_secs_f64(self.countdown.unwrap_or(standard))
            .map_err(|e| Error::setting("record.countdown", format!("must be a number of seconds: {e}")))?;
        let mut begun = Instant::now();
        if switch.is_some_and(|s| !s.held()) {
            console.note("hold a key (such as space) to drive; let it go to stop");
        }
        loop {
            if halt::asked() {
                console.end_progress();
                return Err(Error::Usage("interrupted before the robot moved".to_owned()));
            }
            if switch.is_some_and(|s| !s.held()) {
                begun = Instant::now();
                console.progress("waiting for a key to be held");
            } else if begun.elapsed() >= length {
                console.end_progress();
                return Ok(());
            } else {
                console.progress(&format!("the robot moves in {:.1} s; ctrl-C stops", (length - begun.elapsed()).as_secs_f64()));
            }
            std::thread::sleep(GLANCE);
        }
    }
}

/// Ends the program if the driver hangs in a call: the link goes down with it, and the robot's own watchdog stops the robot.
fn watchdog(robot: &Live) -> Option<Watchdog> {
    let limit = Duration::try_from_secs_f64((HANGS.0 * robot.period()).max(HANGS.1)).ok().filter(|_| robot.real_time())?;
    Some(Watchdog::start(limit, move || {
        eprintln!("error: the robot's driver has not returned for {} s; the program ends so that the link goes down", limit.as_secs_f64());
        wheelwright_plugin::exit(5);
    }))
}
