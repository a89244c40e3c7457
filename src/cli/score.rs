//! `score`: how good the answers of a blind trial are, for whoever holds the key.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;

use super::Shared;
use super::browser;
use super::console::Console;
use super::page::command_line;
use super::setup::Setup;
use crate::error::Error;
use crate::report;
use crate::score::{Header, RATES, Rate, Score, Summary, read_answers, read_key};
use crate::source::digest;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Folder of answers, as `trial` writes them
    #[arg(value_name = "ANSWERS")]
    answers: PathBuf,
    /// What was hidden in each case
    #[arg(long, value_name = "KEY.json")]
    key: PathBuf,
}

pub(super) fn run(arguments: &Arguments, shared: &Shared, console: &Console) -> Result<(), Error> {
    let setup = Setup::load(shared)?;
    let key = read_key(&arguments.key)?;
    let (header, answers) = read_answers(&arguments.answers)?;
    let seal = check_seal(header.as_ref(), &arguments.key)?;
    let header = header.unwrap_or_default();
    let score = Score::new(&key, &answers, &header.without);
    let document = score.document(Some(&header), seal);
    if let Some(folder) = setup.folder(shared)? {
        folder.write("result.json", &format!("{document:#}\n"))?;
        let title = format!("Score of {}", arguments.answers.display());
        let path = folder.write("report.html", &report::score::html(&score, &title, &header, seal, &command_line()))?;
        console.note(&format!("wrote {} beside result.json", path.display()));
        if shared.open {
            browser::open(&path, console);
        }
    }
    console.document(&document);
    console.result(&text(&score));
    if seal.is_none() {
        console.note("note: the answers carry no seal: nothing shows that this key was fixed before them");
    }
    for stray in &score.strays {
        console.note(&format!("warning: the key has no case `{stray}`: its answer is left out"));
    }
    Ok(())
}

/// Compares the key with the hash that the answers were sealed with; `None` without a seal.
fn check_seal(header: Option<&Header>, key: &std::path::Path) -> Result<Option<bool>, Error> {
    let Some(sealed) = header.and_then(|h| h.sealed_key_sha256.as_ref()) else { return Ok(None) };
    let found = digest(key).map_err(|error| Error::Io { path: key.to_owned(), error })?;
    if !sealed.eq_ignore_ascii_case(&found) {
        let path = key.display();
        return Err(Error::Gate(format!(
            "{path} is not the key that the answers were sealed with: its SHA-256 is {found}, the seal {sealed}"
        )));
    }
    Ok(Some(true))
}

/// Tables for a terminal.
fn text(score: &Score<'_>) -> String {
    let mut text = String::new();
    let _ = writeln!(text, "{} cases\n", score.cases.len());
    for summary in score.by_class() {
        block(&mut text, &summary);
    }
    for (name, rows) in score.by() {
        let _ = writeln!(text, "by {name:<28}{:>5}  {:<34}{:<34}", "n", "exact or equivalent", "in set");
        for row in rows {
            let rate = |name: &str| row.rate(name);
            let (equal, within) = (rate("exact_or_equivalent"), rate("in_set"));
            let false_alarms = rate("false_alarm");
            let alarms = if equal.of == 0 && false_alarms.of > 0 { format!("false alarms {}", false_alarms.text()) } else { String::new() };
            let _ = writeln!(text, "  {:<29}{:>5}  {:<34}{:<34}{alarms}", row.name, row.cases, equal.text(), within.text());
        }
        text.push('\n');
    }
    let _ = writeln!(text, "hidden → said");
    for (truth, said) in score.confusion() {
        let mut said: Vec<(&str, usize)> = said.into_iter().collect();
        said.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(b.0)));
        let list: Vec<String> = said.iter().map(|(name, n)| format!("{name} {n}")).collect();
        let _ = writeln!(text, "  {truth:<40} {}", list.join(", "));
    }
    text
}

fn block(text: &mut String, s: &Summary) {
    let _ = writeln!(text, "{} ({})", s.name, s.cases);
    let mut line = |name: &str, value: String| {
        let _ = writeln!(text, "  {name:<24} {value}");
    };
    for ((name, _, _), rate) in RATES.iter().zip(&s.rates).filter(|(_, r): &(_, &Rate)| r.of > 0) {
        line(&name.replace('_', " "), rate.text());
    }
    if let Some(size) = s.set_size {
        line("effects reported", format!("{size:.2} a case"));
    }
    if let Some([low, median, high]) = s.gap_closed {
        line("gap closed", format!("{:.1} % in the median (quarters {:.1} and {:.1})", 100.0 * median, 100.0 * low, 100.0 * high));
    }
    if let Some(f1) = s.times.f1() {
        line("F1 in time", format!("{f1:.3}"));
    }
    if let Some(f1) = s.regions.f1() {
        line("F1 of regions", format!("{f1:.3}"));
    }
    if let Some((median, rate)) = s.payload {
        line("time of payload", format!("{median:.2} s off in the median, within 1 s {}", rate.text()));
    }
    if let Some((most, median)) = s.seconds {
        line("seconds a case", format!("{median:.2} in the median, {most:.2} at most"));
    }
    text.push('\n');
}
