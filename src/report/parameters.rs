//! The table of parameters, each with its uncertainty where there is an honest one.

use wheelwright_core::identification::{Estimate, Identification};

use crate::report::number::{self, NONE, Scale};
use crate::report::page::escape;
use crate::report::table::Table;

pub(super) fn html(found: &Identification) -> String {
    let mut table = Table::new(&["Parameter", "#Value", "#Std. error", "95 % interval", "Unit", "Meaning"]);
    for estimate in &found.estimates {
        table.row(row(estimate));
    }
    let mut text = table.html();
    if found.estimates.iter().any(|e| e.ci95.is_some()) {
        text.push_str("<p class=\"note\">Bars show the 95 % interval against zero (the tick), each on its own scale.</p>\n");
    }
    if found.estimates.iter().any(|e| e.std.is_none() && e.ci95.is_none()) {
        let reason =
            format!("{NONE}: solver {} states no uncertainty here, because none that it could compute would be honest.", found.solver);
        text.push_str(&format!("<p class=\"note\">{}</p>\n", escape(&reason)));
    }
    let condition = found.solution.condition;
    if condition.is_finite() {
        text.push_str(&format!(
            "<p class=\"note\">Condition number of the scaled problem: {} (1 is best; above about 1000 parameters are hard to tell apart).</p>\n",
            number::significant(condition, 3)
        ));
    }
    text
}

fn row(estimate: &Estimate) -> Vec<String> {
    let half = estimate.ci95.map(|(low, high)| 0.25 * (high - low));
    let scale = Scale::of(estimate.value, estimate.std.or(half));
    let interval = estimate.ci95.filter(|(low, high)| low.is_finite() && high.is_finite());
    let interval = interval.map_or_else(
        || NONE.to_owned(),
        |(low, high)| {
            format!(
                "<span class=\"ci\">{}<span class=\"interval\">{} … {}</span></span>",
                bar(estimate.value, low, high),
                scale.show(low),
                scale.show(high)
            )
        },
    );
    let mut meaning = escape(&estimate.parameter.meaning);
    for mark in marks(estimate) {
        meaning.push_str(&format!(" <span class=\"mark\">{mark}</span>"));
    }
    vec![
        escape(&estimate.parameter.name),
        scale.show(estimate.value),
        estimate.std.map_or_else(|| NONE.to_owned(), |std| scale.show(std)),
        interval,
        escape(&number::unit(&estimate.parameter.unit)),
        meaning,
    ]
}

fn marks(estimate: &Estimate) -> Vec<&'static str> {
    let mut marks = Vec::new();
    if estimate.at_bound {
        marks.push("at its bound");
    }
    if estimate.ci95.is_some_and(|(low, high)| low <= 0.0 && high >= 0.0) && !estimate.at_bound {
        marks.push("could be zero");
    }
    marks
}

/// An interval as a bar on an axis that reaches from zero to beyond it.
fn bar(value: f64, low: f64, high: f64) -> String {
    const WIDTH: f64 = 120.0;
    const MARGIN: f64 = 6.0;
    let (from, to) = (low.min(value).min(0.0), high.max(value).max(0.0));
    let span = if to > from { to - from } else { 1.0 };
    let place = |x: f64| number::fixed(MARGIN + (WIDTH - 2.0 * MARGIN) * (x - from) / span, 1);
    format!(
        "<svg class=\"bar\" viewBox=\"0 0 120 14\" aria-hidden=\"true\"><path class=\"rule\" d=\"M0 7H120M{zero} 1V13\"/>\
         <path class=\"range\" d=\"M{low} 7H{high}\"/><circle cx=\"{value}\" cy=\"7\" r=\"3\"/></svg>",
        zero = place(0.0),
        low = place(low),
        high = place(high),
        value = place(value),
    )
}
