//! The effects found, their rivals, and what the recording cannot tell.

use std::fmt::Write;

use wheelwright_core::effect::Place;
use wheelwright_diagnosis::finding::{BaseParameter, Finding, FoundParameter};
use wheelwright_diagnosis::{Diagnosis, Verdict};

use super::Input;
use crate::report::number::{self, NONE, Scale, THIN};
use crate::report::page::{escape, prose};
use crate::report::plot::{Axis, Panel, Plot, Role, Series, Style};
use crate::report::table::Table;

/// Effects of the library that are listed in the ranking.
const LISTED: usize = 12;

pub(super) fn html(input: &Input<'_>) -> String {
    let found = input.found;
    let mut html: String = found.effects.iter().map(card).collect();
    if found.verdict == Verdict::Unexplained && found.partial.is_empty() {
        html.push_str("<p>No effect of the library explains what is missing. Below is where it lies.</p>\n");
    }
    if !found.partial.is_empty() {
        html.push_str(
            "<p>No effects of the library explain all that is missing. A part of it looks like this; the rest does not follow:</p>\n",
        );
        html.extend(found.partial.iter().map(card));
    }
    html
}

/// One effect: its sentence, its numbers, its evidence, and what else it could be.
fn card(finding: &Finding) -> String {
    let place = match finding.place {
        Place::Command => "between command and drive",
        Place::Dynamics => "in the motion",
        Place::Measurement => "in the measurement",
    };
    let mut html = format!(
        "<article class=\"recording\"><h3><code>{}</code> <span class=\"place\">{place}</span></h3><p>{}</p>\n",
        escape(&finding.name),
        sentence(&finding.statement)
    );
    let mut table = Table::new(&["Parameter", "#Value", "95 % interval", "Unit", "Of"]);
    finding.parameters.iter().for_each(|p| table.row(row(p)));
    html.push_str(&table.html());
    let gain = finding.holdout_gain.map_or_else(String::new, |g| format!(", and {} points of held-out fit", number::fixed(g, 2)));
    let _ = writeln!(
        html,
        "<p class=\"note\">Evidence: {} better by the penalised likelihood{gain}, added last.</p>",
        number::significant(finding.delta_bic, 3)
    );
    if !finding.alternatives.is_empty() {
        html.push_str("<p>It could also be</p>\n");
        let mut table = Table::new(&["Effect", "#Worse by", "Why they look alike"]);
        for a in &finding.alternatives {
            table.row(vec![format!("<code>{}</code>", escape(&a.name)), number::significant(a.gap, 2), prose(&a.because)]);
        }
        html.push_str(&table.html());
    }
    html.push_str("</article>\n");
    html
}

/// A statement as a sentence: statements start in lower case, to stand inside others.
pub(super) fn sentence(text: &str) -> String {
    let mut chars = text.chars();
    let first = chars.next().map(|c| c.to_uppercase().to_string()).unwrap_or_default();
    prose(&format!("{first}{}{}", chars.as_str(), if text.ends_with('.') { "" } else { "." }))
}

fn row(p: &FoundParameter) -> Vec<String> {
    let scale = Scale::of(p.value, p.ci95.map(|(low, high)| 0.25 * (high - low)));
    let unit = if p.unit == "1" { String::new() } else { number::unit(&p.unit) };
    let of = p.label.as_ref().map(|(kind, which)| format!("{kind} {which}")).unwrap_or_default();
    vec![escape(&p.name), scale.show(p.value), interval(scale, p.ci95), escape(&unit), escape(&of)]
}

fn interval(scale: Scale, ci95: Option<(f64, f64)>) -> String {
    ci95.map_or_else(|| NONE.to_owned(), |(low, high)| format!("{} … {}", scale.show(low), scale.show(high)))
}

/// The model's parameters without and with the effects.
pub(super) fn base(found: &Diagnosis) -> String {
    let mut table = Table::new(&["Parameter", "#Alone", "#With the effects", "95 % interval", "Unit", "Change"]);
    for p in &found.base {
        let scale = Scale::of(p.after, p.ci95.map(|(low, high)| 0.25 * (high - low)));
        table.row(vec![
            escape(&p.name),
            scale.show(p.before),
            scale.show(p.after),
            interval(scale, p.ci95),
            escape(&number::unit(&p.unit)),
            change(p),
        ]);
    }
    if table.html().is_empty() {
        return String::new();
    }
    format!(
        "<p>Fitted alone, a model takes on what it can of the physics it lacks; with the effects beside it, it is itself again.</p>\n{}",
        table.html()
    )
}

fn change(p: &BaseParameter) -> String {
    let relative = 100.0 * (p.after - p.before) / p.before.abs();
    if relative.is_finite() {
        format!("{}{}{THIN}%", if relative > 0.0 { "+" } else { "" }, number::fixed(relative, 1))
    } else {
        NONE.to_owned()
    }
}

/// What was not excited, with the bound that would have been seen.
pub(super) fn untestable(found: &Diagnosis) -> String {
    let mut table = Table::new(&["Effect", "Why, and what would have been seen"]);
    for u in &found.untestable {
        table.row(vec![format!("<code>{}</code>", escape(&u.name)), prose(&u.because)]);
    }
    table.html()
}

/// The library, best first.
pub(super) fn ranking(found: &Diagnosis) -> String {
    let mut table = Table::new(&["Effect", "#Penalised gain on the base model", ""]);
    let most = found.ranking.iter().map(|r| r.1).fold(0.0_f64, f64::max);
    for (name, gain) in found.ranking.iter().take(LISTED) {
        let share = if most > 0.0 { (gain / most).clamp(0.0, 1.0) } else { 0.0 };
        table.row(vec![
            format!("<code>{}</code>", escape(name)),
            number::significant(*gain, 3),
            format!("<span class=\"meter\" style=\"width:{}%\"></span>", number::fixed(100.0 * share, 1)),
        ]);
    }
    let rest = found.ranking.len().saturating_sub(LISTED);
    let more = if rest > 0 { format!("<p class=\"note\">{rest} more gained less; all are in result.json.</p>\n") } else { String::new() };
    if table.html().is_empty() {
        return String::new();
    }
    format!(
        "<p>Each effect alone beside the refitted model: twice the log-likelihood gained, less what chance would give to the best of so many. Below zero it gains nothing.</p>\n{}{more}",
        table.html()
    )
}

/// The drive that would tell the rivals apart.
pub(super) fn experiment(found: &Diagnosis) -> String {
    let Some(next) = &found.next_experiment else { return String::new() };
    let panels = next.commands.iter().map(|(name, values)| Panel {
        y: Axis::linear(name, wheelwright_core::channel::unit_of(name)),
        height: 150,
        limits: None,
        series: vec![Series::new(name, Style::Step, Role::Command, values.iter().map(|v| Some(*v)).collect())],
    });
    let plot = Plot {
        group: "next".to_owned(),
        x: Axis::linear("time", "s"),
        points: next.time.clone(),
        panels: panels.collect(),
        breaks: Vec::new(),
        caption: "The commands, each held until the next; next_experiment.csv holds them, next_experiment.toml drives them.".to_owned(),
    };
    let mut table = Table::new(&["Between", "And", "#Expected evidence"]);
    for (a, b, by) in &next.separates {
        table.row(vec![format!("<code>{}</code>", escape(a)), format!("<code>{}</code>", escape(b)), number::significant(*by, 3)]);
    }
    format!("<p>{}</p>\n{}{}", sentence(&next.statement), plot.html(), table.html())
}
