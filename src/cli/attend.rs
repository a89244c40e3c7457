//! What watches over a robot that a command drives, the same for `record`, `run`, `track` and `migrate`: signals, time to step back, a
//! held key, a watchdog over the driver, files that grow row by row, and a view.

use std::path::Path;
use std::time::{Duration, Instant};

use clap::Args;
use toml::Table;
use wheelwright_core::drive::{Bite, DeadMan, DriveOptions, DriveProgress, Safety, Watchdog};
use wheelwright_core::profile::RobotProfile;
use wheelwright_core::robot::Live;

use super::console::Console;
use super::halt::{self, Halt};
use super::hold::Hold;
use super::live::{Coverage, View};
use super::setup::Setup;
use crate::error::Error;
use crate::record::RecordingFiles;

/// Countdown before a robot in real time moves \[s\].
const COUNTDOWN: f64 = 3.0;
/// A drive without a new row for this many control periods, and this many seconds, hangs.
const HANGS: (f64, f64) = (20.0, 5.0);
/// How often a countdown looks at the key and the signals.
const GLANCE: Duration = Duration::from_millis(20);

/// Options of every command that moves a robot.
#[derive(Debug, Clone, Default, Args)]
pub(super) struct AttendArguments {
    /// Drive only while a key is held
    #[arg(long)]
    dead_man: bool,
    /// Seconds to step back before the robot moves [default: 3 on a real robot]
    #[arg(long, value_name = "SECONDS")]
    countdown: Option<f64>,
}

/// What the configuration and a profile allow.
pub(super) fn safety(setup: &Setup, profile: Option<&RobotProfile>) -> Result<Safety, Error> {
    setup.config.sections.limits.safety(profile, setup.config.folder()).map_err(|e| setup.config.error_in("limits", e))
}

/// Watches over the drives of one command.
pub(super) struct Attendant<'a> {
    setup: &'a Setup,
    console: &'a Console,
    pub(super) safety: Safety,
    countdown: Option<f64>,
    hold: Option<Hold>,
}

/// A robot, and the signals that stop it.
pub(super) struct Connected {
    pub(super) robot: Live,
    _halt: Halt,
}

/// What a drive left beside its own outcome.
pub(super) struct Attended<T> {
    pub(super) outcome: T,
    pub(super) files: Option<RecordingFiles>,
    pub(super) bites: Vec<Bite>,
    /// Share of the planned commands that were visited.
    pub(super) visited: Option<f64>,
}

impl<'a> Attendant<'a> {
    /// Listens for a held key if the configuration or an option asks for one.
    pub(super) fn new(setup: &'a Setup, arguments: &AttendArguments, safety: Safety, console: &'a Console) -> Result<Self, Error> {
        let record = &setup.config.sections.record;
        let hold = (arguments.dead_man || record.dead_man).then(|| Hold::listen(record.dead_man_timeout)).transpose()?;
        Ok(Self { setup, console, safety, countdown: arguments.countdown.or(record.countdown), hold })
    }

    /// Connects a robot. From here on signals stop it.
    pub(super) fn connect(&self, robot: &Table, seed: u64) -> Result<Connected, Error> {
        let halt = Halt::watch()?;
        Ok(Connected { robot: self.setup.connect(robot.clone(), seed)?, _halt: halt })
    }

    /// Lets `motion` drive, after time to step back, with everything that may end it. The files lie in `folder`; without one rows are
    /// kept in memory only. A panic on the way passes through, and stops the robot as it does.
    pub(super) fn drive<T>(
        &self,
        robot: &mut Live,
        folder: Option<&Path>,
        coverage: Option<Coverage>,
        motion: impl FnOnce(&mut Live, DriveOptions<'_>) -> T,
    ) -> Result<Attended<T>, Error> {
        let dead_man = self.hold.as_ref().map(|hold| &*hold.switch);
        self.count_down(robot, dead_man)?;
        let channels = || robot.inputs().iter().chain(robot.outputs());
        let mut files = folder.map(|folder| RecordingFiles::create(folder, channels())).transpose()?;
        let mut view = View::new(self.console, robot.inputs(), robot.outputs(), coverage, dead_man.is_some());
        let watchdog = watchdog(robot);
        let mut bites = Vec::new();
        let mut observer = |progress: &DriveProgress<'_>| {
            if let Some(watchdog) = &watchdog {
                watchdog.feed();
            }
            progress.bites.clone_into(&mut bites);
            view.update(progress);
        };
        let sinks = files.as_mut().map(RecordingFiles::sinks).unwrap_or_default();
        let (safety, stop, observer) = (self.safety, Some(&halt::STOP), Some(&mut observer as &mut dyn FnMut(&DriveProgress<'_>)));
        let outcome = motion(robot, DriveOptions { duration: None, safety, stop, dead_man, sinks, observer });
        let visited = view.visited();
        // The terminal is put in order before anything else is said.
        drop(view);
        Ok(Attended { outcome, files, bites, visited })
    }

    /// Time to step back. With a dead man's switch it begins when the key is held, and again whenever it was let go.
    fn count_down(&self, robot: &Live, switch: Option<&DeadMan>) -> Result<(), Error> {
        let console = self.console;
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

/// Ends the program if the driver, or what decides the commands, hangs in a call: the link goes down with it, and the robot's own watchdog stops the robot.
fn watchdog(robot: &Live) -> Option<Watchdog> {
    let limit = Duration::try_from_secs_f64((HANGS.0 * robot.period()).max(HANGS.1)).ok().filter(|_| robot.real_time())?;
    Some(Watchdog::start(limit, move || {
        let silent = limit.as_secs_f64();
        eprintln!(
            "error: the robot's driver or its controller has not returned for {silent} s; the program ends so that the link goes down"
        );
        wheelwright_plugin::exit(5);
    }))
}
