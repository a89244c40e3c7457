//! The first screen: verdict, sentence, fits before and after, and the worst seconds before and after.

use std::fmt::Write;

use wheelwright_diagnosis::Verdict;
use wheelwright_diagnosis::finding::Finding;

use super::Input;
use super::effects::sentence;
use super::pictures::{close, worst};
use crate::report::number::{self, NONE};
use crate::report::page::{enumerate, escape};
use crate::report::plot::Role;

/// Headlines of more characters are set smaller, so that the pictures stay on the first screen.
const LONG: usize = 160;

pub(super) fn html(input: &Input<'_>) -> String {
    let found = input.found;
    let (class, words) = badge(found.verdict);
    format!(
        "<div class=\"headline\"><p><span class=\"badge {class}\">{words}</span></p><p class=\"verdict{}\">{}</p>\n\
         <div class=\"tiles\">{}</div></div>\n{}",
        if found.headline.chars().count() > LONG { " long" } else { "" },
        sentence(&found.headline),
        tiles(input),
        pictures(input)
    )
}

fn badge(verdict: Verdict) -> (&'static str, &'static str) {
    match verdict {
        Verdict::NoMismatch => ("good", "nothing beyond noise"),
        Verdict::Explained => ("named", "explained"),
        Verdict::Ambiguous => ("open", "ambiguous"),
        Verdict::Unexplained => ("bad", "unexplained"),
    }
}

/// A tile an output: fit before and after, and the most that any model could reach.
fn tiles(input: &Input<'_>) -> String {
    let found = input.found;
    let (replay, data) = input.proof();
    let mut html = String::new();
    for (i, channel) in replay.measured.outputs.iter().enumerate() {
        let percent = |values: &[f64]| values.get(i).copied().filter(|f| f.is_finite()).map_or_else(|| NONE.to_owned(), number::percent);
        let (before, after) = (percent(&found.fit.before), percent(&found.fit.after));
        let big = if before == after { after } else { format!("<span class=\"was\">{before}</span> → {after}") };
        let mut small = Vec::new();
        if let Some(ceiling) = &found.fit.noise_ceiling {
            small.push(format!("noise allows {}", percent(ceiling)));
        }
        if let Some(narx) = &found.fit.narx {
            small.push(format!("black box {}", percent(narx)));
        }
        // Writing to a String cannot fail.
        let _ = write!(
            html,
            "<div class=\"tile\"><span class=\"what\">{}, {data} fit</span><span class=\"big\">{big}</span><span class=\"small\">{}</span></div>",
            escape(&channel.name),
            small.join(" · ")
        );
    }
    html.push_str("<p class=\"scale\">Free run from the commands alone: 100&nbsp;% is a perfect copy of the measurement, 0&nbsp;% no better than its mean.</p>");
    html
}

/// The worst seconds: before, and after where something was added.
fn pictures(input: &Input<'_>) -> String {
    let found = input.found;
    let (replay, data) = input.proof();
    let Some(window) = worst(replay, &replay.before, &found.noise) else { return String::new() };
    let span = {
        let time = &replay.measured.stretches[window.stretch].time;
        let last = window.rows.end.saturating_sub(1);
        format!("{} to {} s", number::fixed(time[window.rows.start], 1), number::fixed(time[last], 1))
    };
    let output = &replay.measured.outputs[window.output].name;
    let here = match found.verdict {
        Verdict::NoMismatch => format!("The worst seconds of the {data} data ({output}, {span}): even here what is left is noise."),
        _ => format!("Where it hurts: the worst seconds of the {data} data ({output}, {span}), {} as it is.", input.simulation()),
    };
    let before = close(input, &window, (&replay.before, input.simulation(), Role::Before), here);
    if replay.before == replay.after {
        return before;
    }
    let names = |of: &[Finding]| of.iter().map(|f| f.name.clone()).collect::<Vec<_>>();
    let (all, part) = (names(&found.effects), names(&found.partial));
    let (label, with) = match (all.is_empty(), part.is_empty()) {
        (false, _) => ("with the effects", format!("with {}", enumerate(&all))),
        (true, false) => ("with what explains a part", format!("with {}, which explains a part", enumerate(&part))),
        (true, true) => ("refitted", "with the parameters fitted to the recording".to_owned()),
    };
    let after = close(input, &window, (&replay.after, label, Role::After), format!("The same seconds {with}."));
    format!("<div class=\"grid\">{before}{after}</div>\n")
}
