//! Measured against simulated, before and after.

use wheelwright_core::{Channel, Stretch};
use wheelwright_diagnosis::finding::Replay;

use super::{Input, residuals};
use crate::report::plot::{Axis, Panel, Plot, Role, Series, Style};
use crate::report::timeline::Timeline;

/// Heights of panels in CSS pixels.
const CLOSE: u32 = 250;
const OVERLAY: u32 = 220;
const RESIDUAL: u32 = 110;
/// Time shown of the worst stretch \[s\].
const WINDOW: f64 = 15.0;

/// A window of a replay: a stretch and its rows.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Window {
    pub(super) stretch: usize,
    pub(super) rows: std::ops::Range<usize>,
    /// The output that misses most, in standard deviations of its noise.
    pub(super) output: usize,
}

/// Where the simulation misses most: the window with the largest squared error, and in it the output.
pub(super) fn worst(replay: &Replay, run: &[Vec<Vec<f64>>], noise: &[f64]) -> Option<Window> {
    let outputs = replay.measured.outputs.len();
    let errors: Vec<Vec<Vec<f64>>> = (0..outputs).map(|i| residuals(replay, run, i)).collect();
    let weight = |i: usize| noise.get(i).filter(|n| **n > 0.0).map_or(1.0, |n| 1.0 / (n * n));
    let square = |i: usize, s: usize, k: usize| errors[i][s].get(k).map_or(0.0, |e| weight(i) * e * e);
    let mut best: Option<(f64, Window)> = None;
    for (s, stretch) in replay.measured.stretches.iter().enumerate() {
        let sum = |rows: std::ops::Range<usize>, i: usize| rows.map(|k| square(i, s, k)).sum::<f64>();
        let mut from = 0;
        while from < stretch.len() {
            let to = stretch.time.partition_point(|t| *t <= stretch.time[from] + WINDOW);
            let each: Vec<f64> = (0..outputs).map(|i| sum(from..to, i)).collect();
            let total: f64 = each.iter().sum();
            if best.as_ref().is_none_or(|(most, _)| total > *most) {
                let output = (0..outputs).max_by(|&a, &b| each[a].total_cmp(&each[b]).then(b.cmp(&a))).unwrap_or(0);
                best = Some((total, Window { stretch: s, rows: from..to, output }));
            }
            if to >= stretch.len() {
                break;
            }
            // A fifth of a window at a time: finer steps move the picture, not what it shows.
            from = stretch.time.partition_point(|t| *t < stretch.time[from] + WINDOW / 5.0).max(from + 1);
        }
    }
    best.map(|(_, window)| window)
}

/// A close-up: the measurement and one simulation of an output over a window, within `limits`.
pub(super) fn close(input: &Input<'_>, window: &Window, run: (&[Vec<Vec<f64>>], &str, Role), caption: String) -> String {
    let (replay, _) = input.proof();
    let Some(stretch) = replay.measured.stretches.get(window.stretch) else { return String::new() };
    let output = &replay.measured.outputs[window.output];
    let cut = |values: &[f64]| window.rows.clone().map(|k| values.get(k).copied()).collect::<Vec<_>>();
    let measured = cut(&stretch.outputs[window.output]);
    let mut series: Vec<Series> = command(replay, output)
        .map(|k| Series::new(&replay.measured.inputs[k].name, Style::Step, Role::Command, cut(&stretch.inputs[k])))
        .into_iter()
        .collect();
    series.push(Series::new("measured", Style::Line, Role::Measured, measured));
    let (simulated, name, role) = run;
    if let Some(values) = simulated.get(window.stretch).and_then(|s| s.get(window.output)) {
        series.push(Series::new(name, Style::Line, role, cut(values)));
    }
    Plot {
        group: "close".to_owned(),
        x: Axis::linear("time", "s"),
        points: stretch.time[window.rows.clone()].to_vec(),
        panels: vec![Panel { y: Axis::linear(&output.name, &output.unit), height: CLOSE, limits: None, series }],
        breaks: Vec::new(),
        caption,
    }
    .html()
}

/// Every output over all of the proof's data.
pub(super) fn whole(input: &Input<'_>) -> String {
    let (replay, data) = input.proof();
    let stretches: Vec<&Stretch> = replay.measured.stretches.iter().collect();
    if stretches.is_empty() {
        return String::new();
    }
    let timeline = Timeline::new(&stretches);
    let changed = replay.before != replay.after;
    let figure = |(i, output): (usize, &Channel)| {
        let (before, after) = (residuals(replay, &replay.before, i), residuals(replay, &replay.after, i));
        let command = command(replay, output);
        let signals: Vec<Vec<&[f64]>> = (0..stretches.len())
            .map(|s| {
                let mut columns: Vec<&[f64]> = vec![&stretches[s].outputs[i], &replay.before[s][i], &before[s]];
                if changed {
                    columns.extend([replay.after[s][i].as_slice(), &after[s]]);
                }
                columns.extend(command.map(|k| stretches[s].inputs[k].as_slice()));
                columns
            })
            .collect();
        let joined = timeline.join(&stretches, &signals);
        let remark = joined.remark();
        let mut columns = joined.columns.into_iter();
        let mut column = || columns.next().unwrap_or_default();
        let line = |name: &str, role: Role, values| Series::new(name, Style::Line, role, values);
        let (measured, simulated, missed) = (column(), column(), column());
        let mut above = vec![line("measured", Role::Measured, measured), line(input.simulation(), Role::Before, simulated)];
        let mut below = vec![line("measured − before", Role::Before, missed)];
        if changed {
            above.push(line("with the effects", Role::After, column()));
            below.push(line("measured − after", Role::After, column()));
        }
        if let Some(k) = command {
            above.insert(0, Series::new(&replay.measured.inputs[k].name, Style::Step, Role::Command, column()));
        }
        let caption = format!(
            "{}, {data} data: free runs from the first sample of each stretch with the recorded commands alone.{remark}",
            output.name
        );
        Plot {
            group: "whole".to_owned(),
            x: Axis::linear(timeline.label, "s"),
            points: joined.time,
            panels: vec![
                Panel { y: Axis::linear(&output.name, &output.unit), height: OVERLAY, limits: None, series: above },
                Panel { y: Axis::linear("residual", &output.unit), height: RESIDUAL, limits: None, series: below },
            ],
            breaks: joined.breaks,
            caption,
        }
        .html()
    };
    replay.measured.outputs.iter().enumerate().map(figure).collect()
}

/// The input that commands an output, by the naming rule of recordings: `v_ref` for `v`.
fn command(replay: &Replay, output: &Channel) -> Option<usize> {
    let name = format!("{}_ref", output.name);
    replay.measured.inputs.iter().position(|c| c.name == name && c.unit == output.unit)
}
