//! The page of a diagnosis: the sentence, the picture where it hurts, the picture after; then everything that stands behind.

mod effects;
mod first;
mod pictures;
mod place;
mod proof;

#[cfg(test)]
pub(crate) mod tests;

use wheelwright_diagnosis::Diagnosis;
use wheelwright_diagnosis::finding::Replay;

use crate::inquiry::Comparison;
use crate::report::RecordingFacts;
use crate::report::page::{Page, escape, notes};
use crate::report::{provenance, table};

/// Everything the page shows.
#[derive(Debug, Clone, Copy)]
pub struct Input<'a> {
    /// Heading, such as the name of the recording.
    pub title: &'a str,
    /// Command line that makes this page again.
    pub command: &'a str,
    /// Version of the program.
    pub version: &'a str,
    /// Name of the base model.
    pub model: &'a str,
    /// The answer.
    pub found: &'a Diagnosis,
    /// The comparison with a simulation, if one was given.
    pub comparison: Option<&'a Comparison>,
    /// The recordings.
    pub recordings: &'a [RecordingFacts],
    /// What a user should know, besides the diagnosis' own warnings.
    pub warnings: &'a [String],
    /// Settings worth stating, by name.
    pub facts: &'a [(String, String)],
}

impl<'a> Input<'a> {
    /// The data that prove, and their name: held out, or all there is.
    fn proof(&self) -> (&'a Replay, &'static str) {
        self.found.held_out.as_ref().map_or((&self.found.training, "diagnosed"), |r| (r, "held-out"))
    }

    /// What stands before the effects: the base model, or the user's simulation.
    fn simulation(&self) -> &'static str {
        if self.comparison.is_some() { "the simulation" } else { "base model" }
    }
}

/// The page as text: the same bytes for the same input.
pub fn html(input: &Input<'_>) -> String {
    let found = input.found;
    let mut page = Page::new(input.title, &format!("{} diagnosed against {}", input.model, compared_with(input)));
    page.push(&first::html(input));
    let all: Vec<String> = found.warnings.iter().chain(input.warnings).cloned().collect();
    page.push(&notes("warnings", "Worth knowing", &all));
    page.section("effects", "What was left out", &effects::html(input));
    page.section("simulation", "The simulation against the robot", &proof::comparison(input));
    page.section("proof", "The proof", &proof::html(input));
    page.section("where", "Where they differ", &place::html(input));
    page.section("all", &format!("All of the {} data", input.proof().1), &pictures::whole(input));
    page.section("next", "The next experiment", &effects::experiment(found));
    page.section("model", "The model's parameters", &effects::base(found));
    page.section("untestable", "What this recording cannot speak of", &effects::untestable(found));
    page.section("library", "Every effect that was tried", &effects::ranking(found));
    page.section("recordings", "Recordings", &provenance::recordings(input.recordings));
    page.section("repeat", "To repeat this", &repeat(input));
    page.finish(&format!("Made by wheelwright {}.", input.version))
}

fn compared_with(input: &Input<'_>) -> String {
    match input.comparison.and_then(|c| c.document.get("path")).and_then(serde_json::Value::as_str) {
        Some(path) => path.to_owned(),
        None => "itself: the simulation is the base model identified on the same data".to_owned(),
    }
}

fn repeat(input: &Input<'_>) -> String {
    let mut pairs = vec![("model".to_owned(), input.model.to_owned())];
    pairs.extend(input.facts.iter().cloned());
    pairs.push(("version".to_owned(), input.version.to_owned()));
    format!("<pre>{}</pre>\n{}", escape(input.command), table::facts(&pairs))
}

/// Measured less simulated of an output, by stretch.
fn residuals(replay: &Replay, run: &[Vec<Vec<f64>>], output: usize) -> Vec<Vec<f64>> {
    let each = |(s, simulated): (&wheelwright_core::Stretch, &Vec<Vec<f64>>)| -> Vec<f64> {
        s.outputs[output].iter().zip(&simulated[output]).map(|(y, m)| y - m).collect()
    };
    replay.measured.stretches.iter().zip(run).map(each).collect()
}
