//! Fits effect by effect against what noise leaves, and the simulation's parameters beside the robot's.

use std::fmt::Write;

use super::Input;
use crate::report::number::{self, NONE, Scale};
use crate::report::page::{escape, prose};
use crate::report::table::Table;

/// The waterfall: a row a step, a bar an output.
pub(super) fn html(input: &Input<'_>) -> String {
    let found = input.found;
    let (replay, data) = input.proof();
    let names: Vec<&str> = replay.measured.outputs.iter().map(|c| c.name.as_ref()).collect();
    let mut steps: Vec<(String, &[f64], &str)> = vec![(input.simulation().to_owned(), found.fit.before.as_slice(), "before")];
    for rung in found.waterfall.iter().filter(|r| !r.effects.is_empty()) {
        steps.push((format!("+ {}", rung.effects.last().map(String::as_str).unwrap_or_default()), &rung.fit, "after"));
    }
    if found.waterfall.is_empty() && found.fit.after != found.fit.before {
        steps.push(("with the effects".to_owned(), &found.fit.after, "after"));
    }
    steps.extend(found.fit.noise_ceiling.iter().map(|c| ("noise ceiling".to_owned(), c.as_slice(), "most")));
    steps.extend(found.fit.narx.iter().map(|c| ("black box (NARX)".to_owned(), c.as_slice(), "box")));
    let seen = if found.held_out.is_some() {
        "which no estimate saw. They had a say only where the diagnosed data leave a choice: between rivals, and on effects that stand in for others"
    } else {
        "which no estimate but these saw"
    };
    let mut html = format!("<p>Free-run fit on the {data} data, {seen}.</p>\n");
    for (i, name) in names.iter().enumerate() {
        html.push_str(&bars(name, i, &steps));
    }
    html
}

/// Bars from the lowest value shown to 100 %, so that the last points can be seen.
fn bars(name: &str, output: usize, steps: &[(String, &[f64], &str)]) -> String {
    const LABEL: f64 = 225.0;
    const WIDTH: f64 = 605.0;
    const ROW: f64 = 26.0;
    let values: Vec<f64> = steps.iter().map(|s| s.1.get(output).copied().unwrap_or(f64::NAN)).collect();
    let low = values.iter().copied().filter(|v| v.is_finite()).fold(100.0_f64, f64::min).max(0.0);
    // The scale starts at a round number below the lowest, never so high that a point of fit fills the bar.
    let from = (((low - 0.25 * (100.0 - low)).min(95.0) / 5.0).floor() * 5.0).max(0.0);
    let place = |v: f64| (v.clamp(from, 100.0) - from) / (100.0 - from) * WIDTH;
    let height = ROW * steps.len() as f64 + 20.0;
    let mut svg = format!(
        "<figure><h3>{}</h3><svg class=\"waterfall\" viewBox=\"0 0 {} {height}\" role=\"img\" aria-label=\"held-out fit of {} step by step\">",
        escape(name),
        LABEL + WIDTH + 70.0,
        escape(name)
    );
    for (k, ((label, _, class), value)) in steps.iter().zip(&values).enumerate() {
        let y = ROW * k as f64;
        let shown = if value.is_finite() { number::percent(*value) } else { NONE.to_owned() };
        let length = if value.is_finite() { place(*value) } else { 0.0 };
        // Writing to a String cannot fail.
        let _ = write!(
            svg,
            "<text class=\"label\" x=\"{}\" y=\"{}\">{}</text><rect class=\"{class}\" x=\"{LABEL}\" y=\"{}\" width=\"{}\" height=\"16\" rx=\"2\"/>\
             <text class=\"value\" x=\"{}\" y=\"{}\">{shown}</text>",
            LABEL - 8.0,
            y + 14.0,
            escape(label),
            y + 2.0,
            number_plain(length),
            number_plain(LABEL + length + 6.0),
            y + 14.0
        );
    }
    let _ = writeln!(
        svg,
        "<text class=\"tick\" x=\"{LABEL}\" y=\"{y}\">{from} %</text><text class=\"tick\" x=\"{}\" y=\"{y}\">100 %</text></svg></figure>",
        LABEL + WIDTH - 30.0,
        y = height - 4.0
    );
    svg
}

/// A coordinate.
fn number_plain(x: f64) -> String {
    format!("{x:.1}")
}

/// Parameters of the simulation beside those of the robot.
pub(super) fn comparison(input: &Input<'_>) -> String {
    let Some(comparison) = input.comparison else { return String::new() };
    let mut html: String = comparison.sentences.iter().map(|s| format!("<p>{}</p>\n", prose(s))).collect();
    let mut table = Table::new(&["Parameter", "#Simulation", "#Robot", "95 % interval", "#Chance", "Points to"]);
    for c in &comparison.changes {
        let scale = Scale::of(c.recorded, c.recorded_ci95.map(|(low, high)| 0.25 * (high - low)));
        let chance = c.p.map_or_else(|| NONE.to_owned(), |p| if p < 1e-4 { "&lt; 0.0001".to_owned() } else { number::significant(p, 2) });
        let points = if c.changed { c.points_to.join(", ") } else { "no difference beyond noise".to_owned() };
        table.row(vec![
            escape(&c.parameter),
            scale.show(c.simulated),
            scale.show(c.recorded),
            c.recorded_ci95.map_or_else(|| NONE.to_owned(), |(low, high)| format!("{} … {}", scale.show(low), scale.show(high))),
            chance,
            escape(&points),
        ]);
    }
    html.push_str(&table.html());
    html
}
