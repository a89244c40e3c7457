//! Driving a robot with an excitation: what `record`, `run`, `run --autonomous` and `migrate` have in common.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use wheelwright_core::Recording;
use wheelwright_core::drive::{Bite, DriveError, DriveOptions, steer};
use wheelwright_core::excitation::Excitation;
use wheelwright_core::robot::Live;

use super::attend::Attendant;
use super::live::Coverage;
use crate::error::Error;
use crate::record::RecordingFiles;

/// One drive as it is asked for.
pub(super) struct Drive<'a> {
    pub(super) attendant: &'a Attendant<'a>,
    pub(super) excitation: &'a dyn Excitation,
    /// Where the files go; `None` keeps the recording in memory only.
    pub(super) folder: Option<&'a Path>,
    /// The part of the excitation that is driven: from a time \[s\] on, for so long \[s\], from its beginning again after its end.
    pub(super) part: Option<(f64, f64)>,
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

impl Drive<'_> {
    /// Drives a connected robot and stops it.
    pub(super) fn run(&self, robot: &mut Live) -> Result<Driven, Error> {
        self.excitation.check(robot.inputs())?;
        let (offset, duration) = self.part.unwrap_or_else(|| (0.0, self.excitation.duration()));
        let planned = self.attendant.safety.time.map_or(duration, |longest| longest.min(duration));
        let coverage = Coverage::plan(self.excitation, planned, robot.period(), robot.inputs());
        let motion = |robot: &mut Live, options: DriveOptions<'_>| self.steer(robot, offset, duration, options);
        let attended = self.attendant.drive(robot, self.folder, Some(coverage), motion)?;
        let (files, bites, coverage) = (attended.files, attended.bites, attended.visited.unwrap_or_default());
        match attended.outcome {
            Ok(recording) => Ok(Driven { recording, files, bites, coverage }),
            Err(error) => Err(Error::Drive { error: Box::new(error), kept: files.map(|f| f.csv_path) }),
        }
    }

    fn steer(&self, robot: &mut Live, offset: f64, duration: f64, options: DriveOptions<'_>) -> Result<Recording, DriveError> {
        let inputs = robot.inputs().to_vec();
        let whole = self.excitation.duration();
        let mut law = |t: f64, _: &[f64], command: &mut [f64]| {
            let at = if self.part.is_some() { (offset + t) % whole } else { t };
            self.excitation.command(at, &inputs, command);
            Ok(ControlFlow::Continue(()))
        };
        steer(robot, duration, &mut law, options)
    }
}
