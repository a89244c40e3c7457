//! `emulate`: a robot's protocol in front of a simulated robot, to be driven by this program or any other.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;
use serde_json::json;
use wheelwright_core::config::{self as core_config, ConfigError};
use wheelwright_core::robot::RobotError;
use wheelwright_robots::EmulatorConfig;

use super::Shared;
use super::console::Console;
use super::halt::{self, Halt};
use super::setup::Setup;
use crate::error::Error;

/// How often the line of progress is written.
const LOOK: Duration = Duration::from_millis(200);

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Configuration with an [emulator] and the [robot] behind it
    #[arg(value_name = "CONFIG.toml")]
    file: PathBuf,
    /// End after so many seconds [default: at ctrl-C]
    #[arg(long, value_name = "SECONDS")]
    duration: Option<f64>,
}

pub(super) fn run(arguments: &Arguments, shared: &Shared, console: &Console) -> Result<(), Error> {
    let setup = Setup::load_file(Some(&arguments.file), shared)?;
    let missing = |what: &str| setup.config.error(ConfigError::new("", what));
    let table = setup.config.sections.emulator.clone();
    let table = table.ok_or_else(|| missing("names no protocol: add [emulator] type = \"pioneer\", \"khepera\" or \"ros2\""))?;
    let emulator: EmulatorConfig = core_config::plain(table).map_err(|e| setup.config.error_in("emulator", e))?;
    let robot = setup.config.sections.robot.clone();
    let robot = robot.ok_or_else(|| missing("names no robot to put behind the protocol: add a [robot]"))?;
    let end = arguments.duration.map(length).transpose()?.map(|length| Instant::now() + length);
    // Ctrl-C ends the emulator, which takes its terminal's link away.
    let _halt = Halt::watch()?;
    let emulator = emulator.start(setup.connect(robot, setup.seed(shared))?).map_err(|error| match error {
        RobotError::Config { key, reason } => setup.config.error_in("emulator", ConfigError::new(key, reason)),
        other => Error::Connect(other),
    })?;
    console.document(&json!({ "schema": "wheelwright.emulate/1", "address": emulator.address() }));
    console.result(&format!("serving at {}; ctrl-C ends it\n", emulator.address()));
    while !halt::asked() && emulator.is_running() && end.is_none_or(|end| Instant::now() < end) {
        std::thread::sleep(LOOK);
        let state = emulator.state();
        let session = if state.open { "open" } else { "closed" };
        console.progress(&format!(
            "{:.1} s, session {session}, {} clients: v_ref {:.3} m/s, omega_ref {:.3} rad/s, v {:.3} m/s, omega {:.3} rad/s",
            state.time,
            emulator.clients(),
            state.v_ref,
            state.omega_ref,
            state.v,
            state.omega
        ));
    }
    console.end_progress();
    emulator.finish().map_err(Error::Connect)
}

fn length(seconds: f64) -> Result<Duration, Error> {
    Duration::try_from_secs_f64(seconds).map_err(|e| Error::Usage(format!("--duration {seconds}: {e}")))
}
