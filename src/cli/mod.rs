//! The command line: one file a command, the options they share, and what they print.

mod attend;
mod browser;
mod console;
mod design;
mod diagnose;
mod drive;
mod emulate;
mod export;
mod halt;
mod hold;
mod identify;
mod inspect;
mod live;
mod migrate;
mod page;
mod plugins;
mod record;
mod run;
mod score;
mod setup;
mod simulate;
mod text;
mod track;
mod trial;

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, Parser, Subcommand};
use wheelwright_core::model::ModelError;
use wheelwright_plugin::watch_models;

use crate::documents;
use crate::error::Error;
use console::Console;

/// A model plugin answers within microseconds; one that is silent for this long hangs.
const MODEL_CALL: Duration = Duration::from_secs(10);

/// Learns the dynamics of wheeled mobile robots from recordings, and says what a simulation leaves out.
#[derive(Debug, Parser)]
#[command(name = "wheelwright", version, about, max_term_width = 100, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    shared: Shared,
}

/// Options of every command.
#[derive(Debug, Clone, Args)]
struct Shared {
    /// Configuration file (TOML); options on the command line come before it
    #[arg(long, global = true, value_name = "FILE.toml")]
    config: Option<PathBuf>,
    /// Folder for result.json, report.html, model.toml and the simulated series
    #[arg(long, global = true, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Open the report in the browser
    #[arg(long, global = true)]
    open: bool,
    /// Print exactly one JSON document on standard output
    #[arg(long, global = true)]
    json: bool,
    /// Seed of whatever is random
    #[arg(long, global = true, value_name = "N")]
    seed: Option<u64>,
    /// Print no progress and no notes
    #[arg(long, global = true)]
    quiet: bool,
    /// Set a configuration key, as in --set model.static_friction=true (may be repeated)
    #[arg(long, global = true, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// A whole run from a configuration: robot or recording, identify, validate, report
    Run(run::Arguments),
    /// Serve a robot's protocol with a simulated robot behind it
    Emulate(emulate::Arguments),
    /// Drive a robot with an excitation, safely, and record
    Record(record::Arguments),
    /// An excitation as short as the wanted accuracy and the limits allow
    Design(design::Arguments),
    /// Identify a model's parameters from recordings
    Identify(identify::Arguments),
    /// Where a recording differs from its simulation, what physics was left out, and the proof
    Diagnose(diagnose::Arguments),
    /// Free-run simulation of an identified model
    Simulate(simulate::Arguments),
    /// Follow a trajectory with the kinematic, inverse-dynamic or adaptive controller
    Track(track::Arguments),
    /// Carry a controller from one robot to another and show the tracking error before and after
    Migrate(migrate::Arguments),
    /// Hand an identified model to other tools
    Export(export::Arguments),
    /// Diagnose every case of a folder without any key, one answer file a case
    Trial(trial::Arguments),
    /// Score the answers of a trial against the key
    Score(score::Arguments),
    /// What is in a recording: columns, topics, rate, gaps, jitter, excitation
    Inspect(inspect::Arguments),
    /// List models, robots, solvers, excitations and effects, built in and loaded; check a plugin
    Plugins(plugins::Arguments),
}

/// Runs the program on its arguments and returns the exit status of the contract.
pub fn main() -> u8 {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version are no errors; nothing can be done about a closed terminal.
            let _ = error.print();
            return if error.use_stderr() { 2 } else { 0 };
        }
    };
    let console = Console::new(cli.shared.json, cli.shared.quiet);
    let (json, quiet) = (cli.shared.json, cli.shared.quiet);
    watch_models(MODEL_CALL, move |model| {
        let reason = format!("a call has not returned within {} s", MODEL_CALL.as_secs());
        let error = Error::Identify(ModelError::Plugin { model: model.to_owned(), reason }.into());
        report_failure(&error, &Console::new(json, quiet));
        wheelwright_plugin::exit(i32::from(error.status()));
    });
    let outcome = match &cli.command {
        Command::Run(arguments) => run::run(arguments, &cli.shared, &console),
        Command::Emulate(arguments) => emulate::run(arguments, &cli.shared, &console),
        Command::Record(arguments) => record::run(arguments, &cli.shared, &console),
        Command::Design(arguments) => design::run(arguments, &cli.shared, &console),
        Command::Identify(arguments) => identify::run(arguments, &cli.shared, &console),
        Command::Diagnose(arguments) => diagnose::run(arguments, &cli.shared, &console),
        Command::Simulate(arguments) => simulate::run(arguments, &cli.shared, &console),
        Command::Track(arguments) => track::run(arguments, &cli.shared, &console),
        Command::Migrate(arguments) => migrate::run(arguments, &cli.shared, &console),
        Command::Export(arguments) => export::run(arguments, &cli.shared, &console),
        Command::Trial(arguments) => trial::run(arguments, &cli.shared, &console),
        Command::Score(arguments) => score::run(arguments, &cli.shared, &console),
        Command::Inspect(arguments) => inspect::run(arguments, &cli.shared, &console),
        Command::Plugins(arguments) => plugins::run(arguments, &cli.shared, &console),
    };
    match outcome {
        Ok(()) => 0,
        Err(error) => {
            report_failure(&error, &console);
            error.status()
        }
    }
}

/// Failures whose result was printed keep it; any other failure is the one document that `--json` promises.
fn report_failure(error: &Error, console: &Console) {
    if !matches!(error, Error::Gate(_) | Error::Nonconforming { .. }) {
        console.document(&documents::error(error));
    }
    console.error(&error.to_string());
}
