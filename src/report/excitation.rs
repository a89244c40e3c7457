//! What the data holds over frequency and over the space of inputs, and what the model leaves of it.

use wheelwright_core::channel::Channel;
use wheelwright_core::identification::Identification;
use wheelwright_core::{RegressorModel, Stretch};

use crate::report::Outcome;
use crate::report::fit::{period, residual};
use crate::report::number;
use crate::report::plot::{Axis, Cloud, Panel, Plot, Role, Series, Style, keep_every, scatter};
use crate::report::spectrum::{Spectrum, welch};

const HEIGHT: u32 = 260;

/// A figure an output: the measurement and what the model leaves of it.
pub(super) fn spectra(model: &dyn RegressorModel, found: &Identification) -> String {
    let (proof, data) = found.held_out.as_ref().map_or((&found.train, "training"), |v| (v, "held-out"));
    let stretches: Vec<&Stretch> = proof.comparisons.iter().map(|c| &c.measured).collect();
    let step = period(&stretches);
    let figure = |(i, output): (usize, &Channel)| {
        let measured: Vec<(&[f64], &[f64])> = stretches.iter().map(|s| (s.time.as_slice(), s.outputs[i].as_slice())).collect();
        let residuals: Vec<Vec<f64>> = proof.comparisons.iter().map(|c| residual(c, i)).collect();
        let left: Vec<(&[f64], &[f64])> = stretches.iter().zip(&residuals).map(|(s, r)| (s.time.as_slice(), r.as_slice())).collect();
        let measured = welch(&measured, step)?;
        let mut curves = vec![("measured", Role::Measured, &measured)];
        // A residual cut short by a diverging simulation has other windows and is no comparison.
        let left = welch(&left, step).filter(|l| proof.failure.is_none() && l.window == measured.window);
        curves.extend(left.as_ref().map(|l| ("residual", Role::Residual, l)));
        let caption = format!(
            "{}, {data} data. Where the residual comes up to the measurement, what was measured is noise or motion the model leaves out. {}.",
            output.name,
            method(&measured)
        );
        Some(density_plot(&output.name, &output.unit, &curves, caption).html())
    };
    grid(&model.outputs().iter().enumerate().filter_map(figure).collect::<String>())
}

/// Spectra of the inputs, and the pairs of values they took.
pub(super) fn html(model: &dyn RegressorModel, outcome: &Outcome<'_>) -> String {
    let stretches = outcome.stretches();
    let all: Vec<&Stretch> = stretches.iter().map(|(s, _)| *s).collect();
    let step = period(&all);
    let spectrum = |(i, input): (usize, &Channel)| {
        let signal: Vec<(&[f64], &[f64])> = all.iter().map(|s| (s.time.as_slice(), s.inputs[i].as_slice())).collect();
        let density = welch(&signal, step).filter(|s| s.density.iter().skip(1).any(|d| *d > 0.0))?;
        let caption = format!("Spectrum of {}, all data: the frequencies that were excited. {}.", input.name, method(&density));
        Some(density_plot(&input.name, &input.unit, &[(&*input.name, Role::Command, &density)], caption).html())
    };
    let spectra: String = model.inputs().iter().enumerate().filter_map(spectrum).collect();
    grid(&format!("{spectra}{}", coverage(model, &stretches)))
}

/// Two channels of a stretch.
type Pair<'p> = &'p dyn for<'s> Fn(&'s Stretch) -> (&'s [f64], &'s [f64]);

/// Scatter plots of each input against the next, or of a single input against the first output.
fn coverage(model: &dyn RegressorModel, stretches: &[(&Stretch, bool)]) -> String {
    let inputs = model.inputs();
    if let (1, Some(output)) = (inputs.len(), model.outputs().first()) {
        return cloud(stretches, &inputs[0], output, &|s| (&s.inputs[0], &s.outputs[0]));
    }
    (1..inputs.len()).map(|i| cloud(stretches, &inputs[i - 1], &inputs[i], &|s| (&s.inputs[i - 1], &s.inputs[i]))).collect()
}

fn cloud(stretches: &[(&Stretch, bool)], x: &Channel, y: &Channel, pair: Pair<'_>) -> String {
    let points = |held_out: bool| -> Vec<(f64, f64)> {
        let of = stretches.iter().filter(|(_, held)| *held == held_out);
        let all: Vec<(f64, f64)> = of
            .flat_map(|(s, _)| {
                let (x, y) = pair(s);
                x.iter().copied().zip(y.iter().copied())
            })
            .collect();
        keep_every(all.len()).map(|i| all[i]).collect()
    };
    let mut clouds = vec![
        Cloud { label: "fitted", role: Role::Measured, points: points(false) },
        Cloud { label: "held out", role: Role::Model, points: points(true) },
    ];
    clouds.retain(|c| !c.points.is_empty());
    let (points, series) = scatter(&clouds);
    let plot = Plot {
        group: String::new(),
        x: Axis::linear(&x.name, &x.unit),
        points,
        panels: vec![Panel { y: Axis::linear(&y.name, &y.unit), height: HEIGHT, limits: None, series }],
        breaks: Vec::new(),
        caption: format!("Where {} and {} have been together: the model is proven there and extrapolates elsewhere.", x.name, y.name),
    };
    plot.html()
}

/// Densities over a logarithmic frequency axis, the mean left out.
pub(super) fn density_plot(quantity: &str, unit: &str, curves: &[(&str, Role, &Spectrum)], caption: String) -> Plot {
    let points = curves.first().map(|(_, _, s)| s.frequency[1..].to_vec()).unwrap_or_default();
    let values = |s: &Spectrum| s.density.iter().skip(1).map(|d| (*d > 0.0).then_some(*d)).collect();
    let series = curves.iter().map(|(label, role, s)| Series::new(label, Style::Line, *role, values(s))).collect();
    let unit = if unit.is_empty() { String::new() } else { format!("({unit})²/Hz") };
    Plot {
        group: String::new(),
        x: Axis::log("frequency", "Hz"),
        points,
        panels: vec![Panel { y: Axis::log(&format!("density of {quantity}"), &unit), height: HEIGHT, limits: None, series }],
        breaks: Vec::new(),
        caption,
    }
}

/// How a spectrum was computed, for captions.
pub(super) fn method(spectrum: &Spectrum) -> String {
    let skipped = match spectrum.skipped {
        0 => String::new(),
        1 => ", one stretch too short for a window left out".to_owned(),
        n => format!(", {} stretches too short for a window left out", number::count(n)),
    };
    format!("Welch's method, {} Hann windows of {} samples{skipped}", number::count(spectrum.windows), spectrum.window)
}

pub(super) fn grid(figures: &str) -> String {
    if figures.is_empty() { String::new() } else { format!("<div class=\"grid\">{figures}</div>\n") }
}
