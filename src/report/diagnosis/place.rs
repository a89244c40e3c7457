//! Where they differ: channels, wheels, time, regions of state, frequency.

use std::fmt::Write;

use wheelwright_core::Channel;
use wheelwright_diagnosis::finding::Replay;

use super::{Input, residuals};
use crate::report::excitation::{density_plot, grid, method};
use crate::report::number::{self, THIN};
use crate::report::page::{escape, notes, prose};
use crate::report::plot::{Axis, Panel, Plot, Role, Series, Style};
use crate::report::spectrum::welch;
use crate::report::table::Table;
use crate::report::timeline::Timeline;

/// Stretches of time that a caption names; all of them are in the result.
const NAMED: usize = 4;
/// Most blocks of the time line.
const BLOCKS: usize = 300;

pub(super) fn html(input: &Input<'_>) -> String {
    let place = &input.found.location;
    let mut html = String::new();
    if !place.statement.is_empty() {
        let _ = writeln!(html, "<p>{}</p>", prose(&place.statement));
    }
    html.push_str(&shares(input));
    html.push_str(&timeline(input));
    html.push_str(&regions(input));
    html.push_str(&spectra(input));
    html.push_str(&notes("evidence-notes", "Tests that need no library", &place.tests));
    html
}

/// Shares of the excess error, a bar each.
fn shares(input: &Input<'_>) -> String {
    let place = &input.found.location;
    let mut rows: Vec<(String, f64)> = place.channels.clone();
    if let Some((left, right)) = place.wheels {
        rows.extend([("left wheel".to_owned(), left), ("right wheel".to_owned(), right)]);
    }
    rows.retain(|_| place.channels.iter().any(|(_, share)| *share > 0.0));
    let mut table = Table::new(&["Of the error beyond noise", "#Share", ""]);
    for (name, share) in &rows {
        table.row(vec![escape(name), percent(*share), meter(*share)]);
    }
    table.html()
}

fn percent(share: f64) -> String {
    format!("{}{THIN}%", number::fixed(100.0 * share, 0))
}

fn meter(share: f64) -> String {
    format!("<span class=\"meter\" style=\"width:{}%\"></span>", number::fixed(100.0 * share.clamp(0.0, 1.0), 1))
}

/// Regions of state with more than their share.
fn regions(input: &Input<'_>) -> String {
    let mut table = Table::new(&["Region", "Range", "#Of the error", "#Of the samples", ""]);
    for r in &input.found.location.regions {
        let end = |x: f64| if x.is_finite() { number::significant(x, 3) } else { "…".to_owned() };
        table.row(vec![
            escape(&r.words),
            format!("{} from {} to {}", escape(&r.of), end(r.from), end(r.to)),
            percent(r.share),
            percent(r.expected),
            meter(r.share),
        ]);
    }
    let changes: String = input
        .found
        .location
        .changes
        .iter()
        .map(|c| {
            let (low, high) = c.interval;
            let when =
                format!("{} s ({} to {} s)", number::significant(c.time, 4), number::significant(low, 4), number::significant(high, 4));
            format!("<li>At {}: {}.</li>", escape(&when), prose(c.words.trim_end_matches('.')))
        })
        .collect();
    let changes = if changes.is_empty() { changes } else { format!("<ul class=\"evidence\">{changes}</ul>\n") };
    format!("{changes}{}", table.html())
}

/// The error over time in standard deviations of the noise: before and after, one figure an output.
fn timeline(input: &Input<'_>) -> String {
    let found = input.found;
    // The places found are on the clock of the data that were diagnosed.
    let replay = &found.training;
    let stretches: Vec<_> = replay.measured.stretches.iter().collect();
    if stretches.is_empty() {
        return String::new();
    }
    let line = Timeline::new(&stretches);
    let figure = |(i, output): (usize, &Channel)| {
        let noise = found.noise.get(i).copied().filter(|n| *n > 0.0)?;
        let (before, after) = (levels(replay, &replay.before, i, noise), levels(replay, &replay.after, i, noise));
        let both: Vec<Vec<&[f64]>> = before.iter().zip(&after).map(|(b, a)| vec![b.as_slice(), a.as_slice()]).collect();
        let joined = line.join(&stretches, &both);
        let remark = joined.remark();
        let mut columns = joined.columns.into_iter();
        let mut series = vec![Series::new("before", Style::Line, Role::Before, columns.next().unwrap_or_default())];
        if replay.before != replay.after {
            series.push(Series::new("after", Style::Line, Role::After, columns.next().unwrap_or_default()));
        }
        series.push(Series::straight("noise alone", Role::Command, 0.0, 1.0));
        let times = found.location.times.iter().take(NAMED);
        let marked: Vec<String> = times.map(|(a, b)| format!("{} to {} s", number::fixed(*a, 1), number::fixed(*b, 1))).collect();
        let more = match found.location.times.len().saturating_sub(NAMED) {
            0 => String::new(),
            n => format!(" and {n} more stretches"),
        };
        let marked = if marked.is_empty() { String::new() } else { format!(" What was found shows at {}{more}.", marked.join(", ")) };
        Some(
            Plot {
                group: "levels".to_owned(),
                x: Axis::linear(line.label, "s"),
                points: joined.time,
                panels: vec![Panel { y: Axis::linear("error / noise", ""), height: 170, limits: None, series }],
                breaks: joined.breaks,
                caption: format!("{}, diagnosed data: error of the free run, root mean square over about a second, in units of the noise.{marked}{remark}", output.name),
            }
            .html(),
        )
    };
    replay.measured.outputs.iter().enumerate().filter_map(figure).collect()
}

/// The running root mean square of an error over about a second, in units of the noise.
fn levels(replay: &Replay, run: &[Vec<Vec<f64>>], output: usize, noise: f64) -> Vec<Vec<f64>> {
    let period = replay.measured.period().max(1e-6);
    let width = ((1.0 / period).round() as usize).max(replay.measured.samples() / BLOCKS).max(1);
    let smooth = |errors: Vec<f64>| -> Vec<f64> {
        let mut sums = vec![0.0];
        errors.iter().for_each(|e| sums.push(sums[sums.len() - 1] + e * e));
        (0..errors.len())
            .map(|k| {
                let (from, to) = (k.saturating_sub(width / 2), (k + width.div_ceil(2)).min(errors.len()));
                ((sums[to] - sums[from]) / (to - from) as f64).sqrt() / noise
            })
            .collect()
    };
    residuals(replay, run, output).into_iter().map(smooth).collect()
}

/// The error over frequency, before and after, beside the measurement.
fn spectra(input: &Input<'_>) -> String {
    let (replay, data) = input.proof();
    let step = replay.measured.period();
    let density = |values: &[Vec<f64>]| {
        let pairs: Vec<(&[f64], &[f64])> =
            replay.measured.stretches.iter().zip(values).map(|(s, v)| (&s.time[..v.len()], v.as_slice())).collect();
        welch(&pairs, step)
    };
    let figure = |(i, output): (usize, &Channel)| {
        let measured: Vec<Vec<f64>> = replay.measured.stretches.iter().map(|s| s.outputs[i].clone()).collect();
        let measured = density(&measured)?;
        let left = density(&residuals(replay, &replay.before, i)).filter(|s| s.window == measured.window);
        let after = density(&residuals(replay, &replay.after, i)).filter(|s| s.window == measured.window && replay.before != replay.after);
        let mut curves = vec![("measured", Role::Measured, &measured)];
        curves.extend(left.as_ref().map(|s| ("error before", Role::Before, s)));
        curves.extend(after.as_ref().map(|s| ("error after", Role::After, s)));
        let caption = format!("{}, {data} data, over frequency. {}.", output.name, method(&measured));
        Some(density_plot(&output.name, &output.unit, &curves, caption).html())
    };
    grid(&replay.measured.outputs.iter().enumerate().filter_map(figure).collect::<String>())
}
