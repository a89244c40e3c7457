//! `report.html`: what was found, the proof on data no estimate saw, and everything needed to judge and repeat it, on one
//! self-contained page.
//!
//! [`html`] lays out the page of an identification, or of an attempt at one. Other pages are laid out from the same
//! blocks: [`page`] (shell), [`plot`] and [`timeline`] (figures), [`table`], [`number`], [`spectrum`].

pub mod diagnosis;
pub mod number;
pub mod page;
pub mod plot;
pub mod score;
pub mod spectrum;
pub mod table;
pub mod terms;
pub mod timeline;
pub mod track;

mod excitation;
mod fit;
mod headline;
pub mod online;
mod parameters;
mod provenance;
mod regression;

#[cfg(test)]
mod tests;

use wheelwright_core::identification::Identification;
use wheelwright_core::recording::ClockReport;
use wheelwright_core::{Dataset, Recording, RegressorModel, Stretch};

/// Everything a page of an identification shows.
#[derive(Debug, Clone, Copy)]
pub struct ReportInput<'a> {
    /// Heading, such as the name of the recording.
    pub title: &'a str,
    /// Line below the heading.
    pub subtitle: &'a str,
    /// Command line that makes this page again.
    pub command: &'a str,
    /// Version of the program.
    pub version: &'a str,
    /// The model.
    pub model: &'a dyn RegressorModel,
    /// One line on what the model is.
    pub model_about: &'a str,
    /// What came of it.
    pub outcome: Outcome<'a>,
    /// The recordings it came from.
    pub recordings: &'a [RecordingFacts],
    /// What was done to the data before the solver, a sentence a step.
    pub steps: &'a [String],
    /// What surrounds the result, a sentence each: noise ceiling, lag, sampling, agreement of the runs.
    pub evidence: &'a [String],
    /// What a user should know, besides what the solver and the recordings themselves warn of.
    pub warnings: &'a [String],
    /// Settings worth stating, by name: share held out, seed, period.
    pub facts: &'a [(String, String)],
}

/// What came of an identification.
#[derive(Debug, Clone, Copy)]
pub enum Outcome<'a> {
    /// Parameters with their proof.
    Identified(&'a Identification),
    /// No parameters.
    Failed {
        /// Why, and what to do.
        error: &'a str,
        /// The data that was to be fitted, which is shown all the same.
        data: &'a Dataset,
    },
}

impl Outcome<'_> {
    /// All stretches, those fitted first, with whether each was held out.
    fn stretches(&self) -> Vec<(&Stretch, bool)> {
        match self {
            Self::Failed { data, .. } => data.stretches.iter().map(|s| (s, false)).collect(),
            Self::Identified(found) => {
                let train = found.train.comparisons.iter().map(|c| (&c.measured, false));
                train.chain(found.held_out.iter().flat_map(|v| &v.comparisons).map(|c| (&c.measured, true))).collect()
            }
        }
    }
}

/// One recording as the page states it.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordingFacts {
    /// Path as the user named it.
    pub path: String,
    /// What it was used for: `identification` or `validation`.
    pub used_for: String,
    /// Format found.
    pub format: String,
    /// Rows.
    pub samples: usize,
    /// Segments.
    pub segments: usize,
    /// Time covered by the segments \[s\].
    pub duration_s: f64,
    /// Rows a second, from the median step; zero if there is none.
    pub rate_hz: f64,
    /// SHA-256 of the file's bytes in hexadecimal digits; empty if it is not known.
    pub sha256: String,
    /// Clock findings.
    pub clock: ClockReport,
    /// Warnings of the reader.
    pub warnings: Vec<String>,
}

impl RecordingFacts {
    /// The facts of a recording as read.
    pub fn new(recording: &Recording, used_for: &str, sha256: &str) -> Self {
        let period = recording.period();
        Self {
            path: recording.source.path.display().to_string(),
            used_for: used_for.to_owned(),
            format: recording.source.format.clone(),
            samples: recording.rows(),
            segments: recording.segments().len(),
            duration_s: recording.duration(),
            rate_hz: if period > 0.0 { 1.0 / period } else { 0.0 },
            sha256: sha256.to_owned(),
            clock: recording.clock.clone(),
            warnings: recording.warnings.clone(),
        }
    }
}

/// The page as text: the same bytes for the same input.
pub fn html(input: &ReportInput<'_>) -> String {
    html_with(input, &[])
}

/// What an identification did with its data: the free run beside the measurement and, where the solver made one, the regression.
pub fn figures(model: &dyn RegressorModel, found: &Identification) -> String {
    fit::html(model, &found.train, "training") + &regression::html(model, &found.solution)
}

/// A part of a page: anchor, heading and body, which is HTML.
pub type Section<'a> = (&'a str, &'a str, String);

/// The same with parts of its own after the parameters.
pub fn html_with(input: &ReportInput<'_>, sections: &[Section<'_>]) -> String {
    let mut page = page::Page::new(input.title, input.subtitle);
    page.push(&headline::html(input));
    match input.outcome {
        Outcome::Identified(found) => {
            if let Some(held_out) = &found.held_out {
                page.section("held-out", "Measured against simulated: held-out data", &fit::html(input.model, held_out, "held-out"));
            }
            page.section("training", "Measured against simulated: training data", &fit::html(input.model, &found.train, "training"));
            page.section("parameters", "Parameters", &parameters::html(found));
            sections.iter().for_each(|(anchor, heading, body)| page.section(anchor, heading, body));
            page.section("evidence", "How far to trust it", &provenance::evidence(input.evidence));
            page.section("regression", "Regression", &regression::html(input.model, &found.solution));
            page.section("spectra", "Spectra", &excitation::spectra(input.model, found));
        }
        Outcome::Failed { data, .. } => page.section("measured", "What was measured", &fit::measured_html(input.model, data)),
    }
    page.section("excitation", "Excitation", &excitation::html(input.model, &input.outcome));
    page.section("data", "What was done to the data", &provenance::steps(input));
    page.section("recordings", "Recordings", &provenance::recordings(input.recordings));
    page.section("repeat", "To repeat this", &provenance::repeat(input));
    page.finish(&format!("Made by wheelwright {}.", input.version))
}
