//! `run`: a whole identification from a configuration, from robot or recording to report.

use std::path::{Path, PathBuf};

use clap::Args;
use toml::Table;
use wheelwright_core::identifiability;

use super::Shared;
use super::attend::{AttendArguments, Attendant, safety};
use super::console::Console;
use super::drive::{Drive, Driven};
use super::identify::conclude;
use super::setup::{ReadArguments, Setup, StudyArguments};
use crate::autonomous::{Missing, WantedSection, fixed};
use crate::error::Error;
use crate::output::Folder;
use crate::source::Source;
use crate::study::{Findings, Study};

/// A round shorter than this share of the planned one is left out at the end of the longest time.
const LEAST_ROUND: f64 = 0.2;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Configuration of the run
    #[arg(value_name = "CONFIG.toml")]
    file: PathBuf,
    /// Excite and identify in turn, unattended, until the intervals are as narrow as [autonomous] wants
    #[arg(long)]
    autonomous: bool,
    #[command(flatten)]
    attend: AttendArguments,
    #[command(flatten)]
    study: StudyArguments,
}

pub(super) fn run(arguments: &Arguments, shared: &Shared, console: &Console) -> Result<(), Error> {
    let setup = Setup::load_file(Some(&arguments.file), shared)?;
    let study = setup.study(shared, &arguments.study, setup.read_options(&ReadArguments::default())?)?;
    let place = setup.folder(shared)?;
    let run = Run { arguments, shared, setup: &setup, study: &study, folder: place.as_ref(), console };
    match (setup.config.sections.robot.clone(), setup.recording_paths()) {
        (Some(robot), paths) if paths.is_empty() && arguments.autonomous => run.autonomous(robot),
        (Some(robot), paths) if paths.is_empty() => {
            let driven = run.drive(&run.attendant()?, &robot, study.seed, None)?;
            run.conclude(&[run.source(driven)?])
        }
        (None, paths) if !paths.is_empty() && !arguments.autonomous => run.conclude(&study.open(&paths)?),
        (Some(_), _) => Err(setup.config.error(both_or_neither("names a robot and recordings: keep one of them"))),
        (None, _) if arguments.autonomous => Err(setup.config.error(both_or_neither("--autonomous needs a [robot] to drive"))),
        (None, _) => {
            Err(setup.config.error(both_or_neither("names nothing to identify from: add a [robot] to drive, or [recording] paths = [...]")))
        }
    }
}

fn both_or_neither(message: &str) -> wheelwright_core::config::ConfigError {
    wheelwright_core::config::ConfigError::new("", message)
}

/// What every step of a run needs.
struct Run<'a> {
    arguments: &'a Arguments,
    shared: &'a Shared,
    setup: &'a Setup,
    study: &'a Study,
    folder: Option<&'a Folder>,
    console: &'a Console,
}

impl Run<'_> {
    /// What watches over the robot.
    fn attendant(&self) -> Result<Attendant<'_>, Error> {
        Attendant::new(self.setup, &self.arguments.attend, safety(self.setup, self.study.robot.as_ref())?, self.console)
    }

    /// Drives the configured robot with the configured excitation, or a part of it, and keeps what it measured.
    fn drive(&self, attendant: &Attendant<'_>, robot: &Table, seed: u64, part: Option<(f64, f64)>) -> Result<Driven, Error> {
        let place = self.folder.map(|folder| folder.path(""));
        let excitation = self.setup.excitation()?;
        let drive = Drive { attendant, excitation: &*excitation, folder: place.as_deref(), part };
        drive.run(&mut attendant.connect(robot, seed)?.robot)
    }

    fn source(&self, driven: Driven) -> Result<Source, Error> {
        let path: Option<PathBuf> = driven.csv();
        Source::driven(driven.recording, path.as_deref().map(Path::new))
    }

    fn conclude(&self, sources: &[Source]) -> Result<(), Error> {
        self.finish(self.identify(sources)?)
    }

    fn identify(&self, sources: &[Source]) -> Result<Findings, Error> {
        let validation = self.study.open(&self.setup.validation_paths(&self.arguments.study))?;
        self.study.identify(sources, &validation)
    }

    fn finish(&self, findings: Findings) -> Result<(), Error> {
        conclude(self.study, findings, self.folder, &self.arguments.study.require, self.shared, self.console)
    }

    /// Excite, identify, look at the intervals, and again, until they are as narrow as wanted or the time is up. The robot stands
    /// while the computer thinks. Every round is a recording of its own.
    fn autonomous(&self, robot: Table) -> Result<(), Error> {
        let wanted = self.wanted()?;
        let attendant = self.attendant()?;
        let mut sources = Vec::new();
        let mut driven_s = 0.0;
        loop {
            let length = wanted.round.min(wanted.longest - driven_s);
            let seed = self.study.seed.wrapping_add(sources.len() as u64);
            sources.push(self.source(self.drive(&attendant, &robot, seed, Some((driven_s, length)))?)?);
            driven_s += length;
            let findings = self.identify(&sources)?;
            let missing = self.missing(&wanted, &findings);
            let over = wanted.longest - driven_s < LEAST_ROUND * wanted.round;
            let gaps = match &missing {
                Ok(gaps) if gaps.is_empty() => {
                    self.console.note(&format!("after {driven_s:.0} s of driving every interval is as narrow as wanted"));
                    return self.finish(findings);
                }
                Ok(gaps) => gaps.iter().map(Missing::statement).collect::<Vec<_>>().join("; "),
                Err(reason) => reason.clone(),
            };
            if over {
                self.finish(findings)?;
                return Err(Error::TooLittle(format!(
                    "after {driven_s:.0} s of driving, all that [autonomous] allows: {gaps}; allow more time, a stronger excitation, or want less"
                )));
            }
            self.console.note(&format!("after {driven_s:.0} s of driving: {gaps}; driving on"));
        }
    }

    fn wanted(&self) -> Result<WantedSection, Error> {
        let config = &self.setup.config;
        let missing = || Error::setting("autonomous", "is missing: [autonomous] says which intervals are wanted, as in width = 0.1");
        let wanted = config.sections.autonomous.clone().ok_or_else(missing)?;
        let names: Vec<String> = self.study.model.parameters().iter().map(|p| p.name.clone()).collect();
        wanted.check(&names).map_err(|e| config.error_in("autonomous", e))?;
        Ok(wanted)
    }

    /// What is still missing, or why nothing is known yet.
    fn missing(&self, wanted: &WantedSection, findings: &Findings) -> Result<Vec<Missing>, String> {
        let found = findings.identification.as_ref().map_err(ToString::to_string)?;
        let map = &self.study.freedom.map;
        let judged = identifiability::assess(&*self.study.model, map, Some(&found.solution.theta), &findings.train).ok();
        Ok(wanted.missing(found, judged.as_ref(), &fixed(map)))
    }
}
