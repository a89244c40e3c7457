//! Estimates over time, each with its band, and the innovation below.

use wheelwright_core::Dataset;

use crate::online::{Part, Trace};
use crate::report::page::prose;
use crate::report::plot::{Axis, Panel, Plot, Role, Series, Style};
use crate::report::timeline::{Joined, Timeline};

/// Heights of the panels in CSS pixels.
const ESTIMATE: u32 = 160;
const INNOVATION: u32 = 120;
/// Share of the samples, from the end, that decides what a panel shows: estimates start wild.
const SHOWN: f64 = 0.75;

/// One figure a parameter and one an innovation. `data` is what was replayed.
pub fn html(trace: &Trace, data: &Dataset) -> String {
    let stretches: Vec<_> = data.stretches.iter().collect();
    let timeline = Timeline::new(&stretches);
    let join = |columns: &dyn Fn(&Part) -> Vec<Vec<f64>>| {
        let owned: Vec<Vec<Vec<f64>>> = trace.parts.iter().map(columns).collect();
        let signals: Vec<Vec<&[f64]>> = owned.iter().map(|part| part.iter().map(Vec::as_slice).collect()).collect();
        timeline.join(&stretches, &signals)
    };
    let mut html = format!(
        "<p>Each sample was given to the recursive estimator as it would have come on the robot; {}.</p>\n",
        prose(&trace.statement())
    );
    for (i, (name, unit)) in trace.parameters.iter().enumerate() {
        let joined = join(&|p| vec![p.value[i].clone(), p.low[i].clone(), p.high[i].clone()]);
        let caption = format!("{name} while running: estimate and 95 % interval.");
        let names =
            [("estimate", Style::Line, Role::Model), ("95 % from", Style::Line, Role::Other), ("95 % to", Style::Line, Role::Other)];
        html.push_str(&figure(timeline.label, joined, Axis::linear(name, unit), ESTIMATE, &names, caption).html());
    }
    for (e, name) in trace.equations.iter().enumerate() {
        let joined = join(&|p| vec![p.innovation[e].clone()]);
        let caption = format!("Innovation of {name}: what the last {} intervals held beyond the prediction.", trace.settings.window);
        let names = [("innovation", Style::Line, Role::Residual)];
        html.push_str(&figure(timeline.label, joined, Axis::linear("innovation", ""), INNOVATION, &names, caption).html());
    }
    html
}

fn figure(label: &str, joined: Joined, y: Axis, height: u32, names: &[(&str, Style, Role)], caption: String) -> Plot {
    let caption = format!("{caption}{}", joined.remark());
    let columns: Vec<Vec<Option<f64>>> =
        joined.columns.into_iter().map(|c| c.into_iter().map(|v| v.filter(|x| x.is_finite())).collect()).collect();
    let limits = limits(&columns);
    let series = names.iter().zip(columns).rev().map(|((label, style, role), values)| Series::new(label, *style, *role, values)).collect();
    let panels = vec![Panel { y, height, limits, series }];
    Plot { group: "online".to_owned(), x: Axis::linear(label, "s"), points: joined.time, panels, breaks: joined.breaks, caption }
}

/// The range of the later samples with half of it added above and below.
fn limits(columns: &[Vec<Option<f64>>]) -> Option<(f64, f64)> {
    let later = columns.iter().flat_map(|c| c[((1.0 - SHOWN) * c.len() as f64) as usize..].iter().flatten().copied());
    let (low, high) = later.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
    (high > low).then_some((1.5 * low - 0.5 * high, 1.5 * high - 0.5 * low))
}
