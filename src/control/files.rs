//! What a tracked run leaves: the thesis' plain files, CSV and MCAP.

use std::fmt::Write;

use wheelwright_core::tracking::TrackLog;

use super::run::Outcome;
use crate::error::Error;
use crate::output::Folder;

/// Writes `desired` and `actual` (a row a cycle: x, y, φ), `track.csv` and `track.mcap`.
///
/// # Errors
/// [`Error::Io`] or [`Error::Recording`] with the path.
pub fn write(outcome: &Outcome, folder: &Folder) -> Result<(), Error> {
    folder.write("desired", &desired(&outcome.log))?;
    folder.write("actual", &actual(&outcome.log))?;
    let Some(recording) = &outcome.recording else { return Ok(()) };
    let path = folder.path("track.csv");
    wheelwright_recordings::write_csv(&path, recording).map_err(|error| Error::Recording { path: path.clone(), error })?;
    let path = folder.path("track.mcap");
    // A simulation of the model alone has no commands, and MCAP's messages cannot do without.
    if recording.column("v_ref").is_ok() && recording.column("omega_ref").is_ok() {
        wheelwright_recordings::write_mcap(&path, recording)
            .map_err(|error| Error::Write { path: path.clone(), reason: error.to_string() })?;
    }
    Ok(())
}

/// The desired poses, a row a cycle: x, y, φ.
pub fn desired(log: &TrackLog) -> String {
    rows(log.reference.iter().map(|r| [r.x, r.y, r.phi]))
}

/// The actual poses in the same form.
pub fn actual(log: &TrackLog) -> String {
    rows(log.pose.iter().copied())
}

fn rows(poses: impl Iterator<Item = [f64; 3]>) -> String {
    let mut text = String::new();
    for [x, y, phi] in poses {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "{x} {y} {phi}");
    }
    text
}
