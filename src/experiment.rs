//! The next experiment as files that `run` drives: the commands row by row, and a configuration around them.

use std::fmt::Write;

use wheelwright_diagnosis::finding::Experiment;

use crate::inquiry::Inquiry;

/// Name of the file of commands.
pub const COMMANDS: &str = "next_experiment.csv";

/// The commands: `t` and a column a channel, each row held until the next.
pub fn csv(next: &Experiment) -> String {
    let mut text = std::iter::once("t").chain(next.commands.iter().map(|c| c.0.as_str())).collect::<Vec<_>>().join(",") + "\n";
    for (k, time) in next.time.iter().enumerate() {
        // Writing to a String cannot fail.
        let _ = write!(text, "{time}");
        for (_, column) in &next.commands {
            let _ = write!(text, ",{}", column.get(k).copied().unwrap_or_default());
        }
        text.push('\n');
    }
    text
}

/// A configuration that drives the commands; the robot is for the user to fill in.
pub fn config(next: &Experiment, inquiry: &Inquiry) -> String {
    let mut text = String::new();
    for line in wrapped(&next.statement, 110) {
        let _ = writeln!(text, "# {line}");
    }
    let model = toml::to_string(&inquiry.model_table).unwrap_or_default();
    let _ = write!(
        text,
        "#\n# Fill in [robot], then: wheelwright run next_experiment.toml --out next/\n\
         # and diagnose the old recording and the new one together.\n\
         \n# [robot]\n# type = \"...\"\n\n[excitation]\ntype = \"table\"\nfile = \"{COMMANDS}\"\n\n[model]\n{model}"
    );
    text
}

/// Lines of at most about `width` characters.
fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let fits = lines.last().is_some_and(|l| l.is_empty() || l.len() + word.len() < width);
        if !fits {
            lines.push(String::new());
        }
        if let Some(line) = lines.last_mut() {
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(word);
        }
    }
    lines
}
