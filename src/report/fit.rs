//! Free run against measurement over time, with the residual below.

use wheelwright_core::channel::Channel;
use wheelwright_core::recording::median;
use wheelwright_core::validation::{Comparison, Validation};
use wheelwright_core::{Dataset, RegressorModel, Stretch};

use crate::report::page::enumerate;
use crate::report::plot::{Axis, Panel, Plot, Role, Series, Style};
use crate::report::timeline::{Joined, Timeline};

/// Heights of the panels in CSS pixels.
const OVERLAY: u32 = 240;
const RESIDUAL: u32 = 120;

/// One figure an output. `data` names the part of the data in captions.
pub(super) fn html(model: &dyn RegressorModel, validation: &Validation, data: &str) -> String {
    let stretches: Vec<&Stretch> = validation.comparisons.iter().map(|c| &c.measured).collect();
    if stretches.is_empty() {
        return String::new();
    }
    let timeline = Timeline::new(&stretches);
    let figure = |(i, output): (usize, &Channel)| {
        let residuals: Vec<Vec<f64>> = validation.comparisons.iter().map(|c| residual(c, i)).collect();
        let command = command_of(model, output);
        let signals: Vec<Vec<&[f64]>> = validation
            .comparisons
            .iter()
            .zip(&residuals)
            .map(|(c, residual)| {
                let three = [c.measured.outputs[i].as_slice(), c.simulated[i].as_slice(), residual.as_slice()];
                three.into_iter().chain(command.map(|k| c.measured.inputs[k].as_slice())).collect()
            })
            .collect();
        overlay(model, i, data, &timeline, timeline.join(&stretches, &signals), command).html()
    };
    model.outputs().iter().enumerate().map(figure).collect()
}

fn overlay(model: &dyn RegressorModel, i: usize, data: &str, timeline: &Timeline, joined: Joined, command: Option<usize>) -> Plot {
    let output = &model.outputs()[i];
    let remark = joined.remark();
    let mut columns = joined.columns.into_iter();
    let mut column = || columns.next().unwrap_or_default();
    let (measured, simulated, residual) = (column(), column(), column());
    let limits = limits(&measured);
    let mut series = command_series(model, command, column());
    series.push(Series::new("measured", Style::Line, Role::Measured, measured));
    series.push(Series::new("simulated", Style::Line, Role::Model, simulated));
    let cut = cut_off(&series, limits);
    let strip = vec![Series::new("measured − simulated", Style::Line, Role::Residual, residual)];
    let strip_limits = limits.map(|(low, high)| (low - high, high - low));
    Plot {
        group: data.to_owned(),
        x: Axis::linear(timeline.label, "s"),
        points: joined.time,
        panels: vec![
            Panel { y: Axis::linear(&output.name, &output.unit), height: OVERLAY, limits, series },
            Panel { y: Axis::linear("residual", &output.unit), height: RESIDUAL, limits: strip_limits, series: strip },
        ],
        breaks: joined.breaks,
        caption: format!(
            "{}, {data} data: measured, and simulated from the first sample of each stretch with the recorded inputs alone.{cut}{remark}",
            output.name
        ),
    }
}

/// The range of a measurement with half of it added above and below.
fn limits(measured: &[Option<f64>]) -> Option<(f64, f64)> {
    let values = || measured.iter().flatten().copied().filter(|v| v.is_finite());
    let (low, high) = (values().reduce(f64::min)?, values().reduce(f64::max)?);
    (high > low).then_some((1.5 * low - 0.5 * high, 1.5 * high - 0.5 * low))
}

/// Names the series that go beyond the limits, for the caption.
fn cut_off(series: &[Series], limits: Option<(f64, f64)>) -> String {
    let Some((low, high)) = limits else { return String::new() };
    let beyond = |s: &&Series| s.values.iter().flatten().any(|v| *v < low || *v > high);
    let names: Vec<String> = series.iter().filter(beyond).map(|s| s.label.clone()).collect();
    if names.is_empty() { String::new() } else { format!(" Beyond the axis, and cut off there: parts of {}.", enumerate(&names)) }
}

/// One figure an output of what was measured, for when there is nothing to compare with.
pub(super) fn measured_html(model: &dyn RegressorModel, data: &Dataset) -> String {
    let stretches: Vec<&Stretch> = data.stretches.iter().collect();
    let timeline = Timeline::new(&stretches);
    let figure = |(i, output): (usize, &Channel)| {
        let command = command_of(model, output);
        let of = |s: &&'_ Stretch| -> Vec<Vec<f64>> {
            std::iter::once(s.outputs[i].clone()).chain(command.map(|k| s.inputs[k].clone())).collect()
        };
        let owned: Vec<Vec<Vec<f64>>> = stretches.iter().map(of).collect();
        let signals: Vec<Vec<&[f64]>> = owned.iter().map(|columns| columns.iter().map(Vec::as_slice).collect()).collect();
        let joined = timeline.join(&stretches, &signals);
        let remark = joined.remark();
        let mut columns = joined.columns.into_iter();
        let measured = columns.next().unwrap_or_default();
        let mut series = command_series(model, command, columns.next().unwrap_or_default());
        let limits = limits(&measured);
        series.push(Series::new("measured", Style::Line, Role::Measured, measured));
        let cut = cut_off(&series, limits);
        let panel = Panel { y: Axis::linear(&output.name, &output.unit), height: OVERLAY, limits, series };
        let (x, caption) = (Axis::linear(timeline.label, "s"), format!("{} as measured.{cut}{remark}", output.name));
        Plot { group: "measured".to_owned(), x, points: joined.time, panels: vec![panel], breaks: joined.breaks, caption }.html()
    };
    if stretches.is_empty() { String::new() } else { model.outputs().iter().enumerate().map(figure).collect() }
}

/// The input that commands an output, by the naming rule of recordings: `v_ref` for `v`.
fn command_of(model: &dyn RegressorModel, output: &Channel) -> Option<usize> {
    let name = format!("{}_ref", output.name);
    model.inputs().iter().position(|c| c.name == name && c.unit == output.unit)
}

fn command_series(model: &dyn RegressorModel, command: Option<usize>, values: Vec<Option<f64>>) -> Vec<Series> {
    command.map(|k| Series::new(&model.inputs()[k].name, Style::Step, Role::Command, values)).into_iter().collect()
}

/// Measured less simulated, as far as the simulation went.
pub(super) fn residual(comparison: &Comparison, output: usize) -> Vec<f64> {
    comparison.measured.outputs[output].iter().zip(&comparison.simulated[output]).map(|(y, s)| y - s).collect()
}

/// Root mean square of the residual of an output over all stretches; `None` if the simulation ended early.
pub(super) fn rms(validation: &Validation, output: usize) -> Option<f64> {
    if validation.failure.is_some() {
        return None;
    }
    let residuals: Vec<f64> = validation.comparisons.iter().flat_map(|c| residual(c, output)).collect();
    (!residuals.is_empty()).then(|| (residuals.iter().map(|r| r * r).sum::<f64>() / residuals.len() as f64).sqrt())
}

/// Median step between samples \[s\].
pub(super) fn period(stretches: &[&Stretch]) -> f64 {
    let mut steps: Vec<f64> = stretches.iter().flat_map(|s| s.time.windows(2).map(|w| w[1] - w[0])).collect();
    median(&mut steps)
}
