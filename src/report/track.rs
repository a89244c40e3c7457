//! Tracked runs on a page: where the robot was and should have been, how far apart, and what its parameters did.

use std::fmt::Write;

use wheelwright_core::controller::Gravity;
use wheelwright_core::recording::Recording;
use wheelwright_core::tracking::TrackLog;

use crate::control::Outcome;
use crate::report::number::{self, THIN};
use crate::report::page::{self, Page, escape, prose};
use crate::report::plot::{Axis, Panel, Plot, Role, Series, Style, TIME_POINTS, keep_extremes};
use crate::report::table::{Table, facts};

/// Width of a picture of the plane in CSS pixels.
const PLANE: f64 = 560.0;
/// Pictures beside each other where there is room.
const BESIDE: &str = "display:grid;grid-template-columns:repeat(auto-fit,minmax(24em,1fr));gap:0 1.5em";
/// Points that a curve in the plane keeps at most, and how near they are to each other at least [CSS pixels].
const CURVE: f64 = 8000.0;
const NEAR: f64 = 2.0;
/// Width that is left for a label of the plane [CSS pixels].
const LABEL: f64 = 48.0;
/// Rows kept of several runs on one axis.
const SHARED: usize = 1200;
/// Errors below this are not told apart on a logarithmic axis \[m\].
const LEAST: f64 = 1e-4;
/// Colours of runs on one picture, in order.
const ROLES: [Role; 5] = [Role::Before, Role::Command, Role::Residual, Role::Other, Role::Measured];

/// A page of runs.
#[derive(Debug)]
pub struct TrackPage<'a> {
    /// Heading.
    pub title: &'a str,
    /// Line below it.
    pub subtitle: &'a str,
    /// Command line that makes the page again.
    pub command: &'a str,
    /// Runs by name. The first is told in full if there is only one.
    pub runs: &'a [(String, &'a Outcome)],
    /// Settings worth stating.
    pub facts: &'a [(String, String)],
    /// Paragraphs after the tiles.
    pub text: &'a [String],
}

impl TrackPage<'_> {
    /// The page as text.
    pub fn html(&self) -> String {
        let mut page = Page::new(self.title, self.subtitle);
        self.text.iter().for_each(|text| page.push(&format!("<p>{}</p>", prose(text))));
        match self.runs {
            [(_, outcome)] => {
                page.push(&tiles(outcome));
                page.push(&warnings(outcome));
                page.section("trajectory", "Trajectory", &plane(&[("actual", outcome)]));
                page.section("distance", "Distance error", &distance(&outcome.log).html());
                page.section("parameters", "Parameters over time", &parameters(outcome));
                page.section("velocities", "Velocities", &outcome.recording.as_ref().map(velocities).unwrap_or_default());
            }
            runs => {
                page.push(&comparison(runs));
                let named: Vec<(&str, &Outcome)> = runs.iter().map(|(name, o)| (name.as_str(), *o)).collect();
                page.section("distance", "Distance error", &together(&named).html());
                let picture = |(name, o): &(&str, &Outcome)| {
                    format!("<div><h3>{}</h3>\n{}{}</div>", escape(name), plane(&[("actual", o)]), warnings(o))
                };
                let pictures = named.iter().map(picture).collect::<String>();
                page.section("trajectory", "Trajectories", &format!("<div style=\"{BESIDE}\">{pictures}</div>"));
                let adapted = named.iter().map(|(name, o)| (name, parameters(o))).filter(|(_, html)| !html.is_empty());
                let adapted = adapted.map(|(name, html)| format!("<h3>{}</h3>\n{html}", escape(name)));
                page.section("parameters", "Parameters over time", &adapted.collect::<String>());
            }
        }
        page.section("repeat", "To repeat this", &format!("{}<pre>{}</pre>", facts(self.facts), escape(self.command)));
        page.finish(&format!("Made by wheelwright {}.", env!("CARGO_PKG_VERSION")))
    }
}

/// A length as people read it.
pub fn metres(x: f64) -> String {
    if x < 1.0 { format!("{}{THIN}mm", number::significant(1e3 * x, 3)) } else { format!("{}{THIN}m", number::significant(x, 3)) }
}

fn tiles(outcome: &Outcome) -> String {
    let Some(d) = outcome.distances() else { return String::new() };
    let tile = |what: &str, big: String, small: String| {
        format!(
            "<div class=\"tile\"><span class=\"what\">{what}</span><span class=\"big\">{big}</span><span class=\"small\">{small}</span></div>"
        )
    };
    let end = outcome.log.time.last().copied().unwrap_or_default();
    let windows: Vec<String> = d.windows.iter().map(|(from, to, rms)| format!("{} from {from} to {to} s", metres(*rms))).collect();
    let run = format!("of {} s at {} s a cycle", number::significant(outcome.duration, 4), number::significant(outcome.period, 3));
    format!(
        "<div class=\"tiles\">{}{}{}</div>\n",
        tile("distance error, root mean square", metres(d.rms), page::enumerate(&windows)),
        tile("largest", metres(d.max), format!("{} at the end", metres(d.last))),
        tile("driven", format!("{}{THIN}s", number::significant(end, 4)), run),
    )
}

fn warnings(outcome: &Outcome) -> String {
    let mut texts: Vec<String> = outcome.ended.iter().map(|e| format!("The drive ended early: {e}.")).collect();
    texts.extend(outcome.concerns.iter().filter(|c| c.gravity > Gravity::Note).map(|c| format!("Foreseen: {}.", c.message)));
    let notes: Vec<String> = outcome.concerns.iter().filter(|c| c.gravity == Gravity::Note).map(|c| format!("{}.", c.message)).collect();
    page::notes("warnings", "To know", &texts) + &page::notes("evidence-notes", "Foreseen", &notes)
}

/// A table of runs, in their order.
pub fn comparison(runs: &[(String, &Outcome)]) -> String {
    let mut table = Table::new(&["Run", "#Error after a third", "#Whole run", "#Largest", "#Saturated", "Ended"]);
    for (name, outcome) in runs {
        let Some(d) = outcome.distances() else { continue };
        let settled = outcome.settled();
        table.row(vec![
            escape(name),
            if settled.is_finite() { metres(settled) } else { number::NONE.to_owned() },
            metres(d.rms),
            metres(d.max),
            number::percent(100.0 * outcome.saturated()),
            outcome.ended.as_ref().map_or_else(|| "as planned".to_owned(), |e| escape(&e.fault.to_string())),
        ]);
    }
    table.html()
}

/// The plane: desired broad, actual on top, equal scales.
pub fn plane(runs: &[(&str, &Outcome)]) -> String {
    let Some((_, first)) = runs.first() else { return String::new() };
    let desired: Vec<[f64; 2]> = first.log.reference.iter().map(|r| [r.x, r.y]).collect();
    let actual: Vec<Vec<[f64; 2]>> = runs.iter().map(|(_, o)| o.log.pose.iter().map(|p| [p[0], p[1]]).collect()).collect();
    let Some(frame) = Frame::around(desired.iter().chain(actual.iter().flatten())) else { return String::new() };
    let mut curves = frame.curve(&desired, "--command", "stroke-width:5;opacity:.45");
    let colours = ["--residual", "--before", "--after", "--model"];
    for (points, colour) in actual.iter().zip(colours) {
        curves.push_str(&frame.curve(points, colour, "stroke-width:1.6"));
    }
    let names: Vec<String> = runs.iter().map(|(name, _)| (*name).to_owned()).collect();
    frame.figure(&curves, &format!("Desired trajectory (broad, grey) and {}.", page::enumerate(&names)))
}

/// A part of the plane on a picture.
struct Frame {
    low: [f64; 2],
    size: [f64; 2],
    scale: f64,
}

impl Frame {
    fn around<'a>(points: impl Iterator<Item = &'a [f64; 2]>) -> Option<Self> {
        let start = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let (low, high) = points
            .filter(|p| p.iter().all(|x| x.is_finite()))
            .fold(start, |(low, high), p| ([low[0].min(p[0]), low[1].min(p[1])], [high[0].max(p[0]), high[1].max(p[1])]));
        let size = [high[0] - low[0], high[1] - low[1]];
        let largest = size[0].max(size[1]);
        if !(largest.is_finite() && largest > 0.0) {
            return None;
        }
        let margin = 0.06 * largest;
        let size = size.map(|s| s + 2.0 * margin);
        Some(Self { low: low.map(|l| l - margin), size, scale: PLANE / size[0].max(size[1]) })
    }

    fn at(&self, p: [f64; 2]) -> (f64, f64) {
        (self.scale * (p[0] - self.low[0]), self.scale * (self.low[1] + self.size[1] - p[1]))
    }

    fn curve(&self, points: &[[f64; 2]], colour: &str, style: &str) -> String {
        let places: Vec<(f64, f64)> = points.iter().filter(|p| p.iter().all(|x| x.is_finite())).map(|p| self.at(*p)).collect();
        let far = |a: &(f64, f64), b: &(f64, f64)| (a.0 - b.0).hypot(a.1 - b.1);
        let length: f64 = places.windows(2).map(|pair| far(&pair[0], &pair[1])).sum();
        let apart = (length / CURVE).max(NEAR);
        let mut kept: Option<&(f64, f64)> = None;
        let mut path = String::new();
        for (i, place) in places.iter().enumerate() {
            if i + 1 == places.len() || kept.is_none_or(|kept| far(kept, place) >= apart) {
                // Writing to a String cannot fail.
                let _ = write!(path, "{:.1},{:.1} ", place.0, place.1);
                kept = Some(place);
            }
        }
        format!("<polyline points=\"{}\" style=\"fill:none;stroke:var({colour});{style}\"/>", path.trim_end())
    }

    /// Grid, curves and caption.
    fn figure(&self, curves: &str, caption: &str) -> String {
        let (width, height) = (self.scale * self.size[0], self.scale * self.size[1]);
        let step = round_step(self.size[0].max(self.size[1]) / 5.0);
        let mut grid = String::new();
        for (axis, (low, size)) in self.low.into_iter().zip(self.size).enumerate() {
            let first = (low / step).ceil() as i64;
            let last = ((low + size) / step).floor() as i64;
            for i in first..=last {
                let value = i as f64 * step;
                let label = number::significant(value, 3);
                let (x, y) = self.at(if axis == 0 { [value, self.low[1]] } else { [self.low[0], value] });
                let (line, place) = match axis {
                    0 => (format!("M{x:.1},0V{height:.1}"), format!("x=\"{:.1}\" y=\"{:.1}\"", x + 3.0, height - 4.0)),
                    _ => (format!("M0,{y:.1}H{width:.1}"), format!("x=\"3\" y=\"{:.1}\"", y - 3.0)),
                };
                let _ = write!(grid, "<path d=\"{line}\" style=\"stroke:var(--rule);stroke-width:1\"/>");
                if axis == 1 || x + LABEL < width {
                    let _ = write!(grid, "<text {place} style=\"fill:var(--soft);font-size:11px\">{label}{THIN}m</text>");
                }
            }
        }
        let caption = escape(caption);
        format!(
            "<figure class=\"plane\"><svg viewBox=\"0 0 {width:.0} {height:.0}\" style=\"max-width:{width:.0}px;width:100%\" role=\"img\" \
             aria-label=\"{caption}\">{grid}{curves}</svg><figcaption>{caption}</figcaption></figure>\n"
        )
    }
}

/// 1, 2 or 5 times a power of ten, near a length.
fn round_step(length: f64) -> f64 {
    let power = 10f64.powf(length.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|s| *s >= length).unwrap_or(power)
}

/// The distance error of one run.
pub fn distance(log: &TrackLog) -> Plot {
    let distances = log.distances();
    let kept = keep_extremes(&[&distances], log.rows(), TIME_POINTS / 2);
    let values = kept.iter().map(|i| Some(distances[*i])).collect();
    Plot {
        group: "track".to_owned(),
        x: Axis::linear("time", "s"),
        points: kept.iter().map(|i| log.time[*i]).collect(),
        panels: vec![Panel {
            y: Axis::linear("distance", "m"),
            height: 220,
            limits: None,
            series: vec![Series::new("distance error", Style::Line, Role::Residual, values)],
        }],
        breaks: Vec::new(),
        caption: "Distance between desired and actual position.".to_owned(),
    }
}

/// The distance errors of several runs on one axis, each row the latest of its run; logarithmic, as they differ by powers.
fn together(runs: &[(&str, &Outcome)]) -> Plot {
    let end = runs.iter().filter_map(|(_, o)| o.log.time.last()).copied().fold(0.0, f64::max);
    let points: Vec<f64> = (0..=SHARED).map(|i| end * i as f64 / SHARED as f64).collect();
    let series = runs.iter().zip(ROLES.into_iter().cycle()).map(|((name, outcome), role)| {
        let distances = outcome.log.distances();
        let last = outcome.log.time.last().copied().unwrap_or(0.0);
        let value = |t: &f64| {
            let passed = outcome.log.time.partition_point(|time| time <= t);
            (passed > 0 && *t <= last).then(|| distances[passed - 1].max(LEAST))
        };
        Series::new(name, Style::Line, role, points.iter().map(value).collect())
    });
    let panels = vec![Panel { y: Axis::log("distance", "m"), height: 300, limits: None, series: series.collect() }];
    let caption = "Distance between desired and actual position, run by run.".to_owned();
    Plot { group: "track".to_owned(), x: Axis::linear("time", "s"), points, panels, breaks: Vec::new(), caption }
}

/// A panel a parameter; nothing if none of them ever changed.
pub fn parameters(outcome: &Outcome) -> String {
    let log = &outcome.log;
    let changed = |s: &Vec<f64>| s.iter().any(|v| Some(v) != s.first());
    if !log.theta.iter().any(changed) {
        return String::new();
    }
    let columns: Vec<&[f64]> = log.theta.iter().map(Vec::as_slice).collect();
    let kept = keep_extremes(&columns, log.rows(), TIME_POINTS / 12);
    let panel = |(name, series): (&String, &Vec<f64>)| Panel {
        y: Axis::linear(name, ""),
        height: 130,
        limits: None,
        series: vec![Series::new(name, Style::Line, Role::Model, kept.iter().map(|i| Some(series[*i])).collect())],
    };
    let plot = Plot {
        group: "track".to_owned(),
        x: Axis::linear("time", "s"),
        points: kept.iter().map(|i| log.time[*i]).collect(),
        panels: outcome.parameters.iter().zip(&log.theta).map(panel).collect(),
        breaks: Vec::new(),
        caption: "The controller's parameters.".to_owned(),
    };
    plot.html()
}

/// Commanded, desired and measured velocities.
fn velocities(recording: &Recording) -> String {
    let axis = |quantity: &str, unit: &str| {
        let column = |suffix: &str| recording.column(&format!("{quantity}{suffix}")).ok();
        let (measured, command, desired) = (column("")?, column("_ref")?, column("_desired")?);
        let kept = keep_extremes(&[measured, command], recording.rows(), TIME_POINTS / 4);
        let series =
            |name: &str, role: Role, values: &[f64]| Series::new(name, Style::Line, role, kept.iter().map(|i| Some(values[*i])).collect());
        let panel = Panel {
            y: Axis::linear(quantity, unit),
            height: 200,
            limits: None,
            series: vec![
                series("measured", Role::Measured, measured),
                series("command", Role::Command, command),
                series("desired", Role::Model, desired),
            ],
        };
        let time = recording.time();
        let plot = Plot {
            group: "track".to_owned(),
            x: Axis::linear("time", "s"),
            points: kept.iter().map(|i| time[*i]).collect(),
            panels: vec![panel],
            breaks: Vec::new(),
            caption: format!("{quantity}: desired, commanded and measured."),
        };
        Some(plot.html())
    };
    axis("v", "m/s").unwrap_or_default() + &axis("omega", "rad/s").unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fifty_rounds_of_a_circle_stay_round() {
        let points: Vec<[f64; 2]> =
            (0..150_000).map(|i| (i as f64 / 3000.0 * std::f64::consts::TAU).sin_cos()).map(|(s, c)| [c, s]).collect();
        let frame = Frame::around(points.iter()).unwrap();
        let drawn = frame.curve(&points, "--x", "");
        let text = drawn.split('"').nth(1).unwrap();
        let read = |pair: &str| pair.split_once(',').map(|(x, y)| [x, y].map(|t| t.parse::<f64>().unwrap())).unwrap();
        let kept: Vec<[f64; 2]> = text.split_whitespace().map(read).collect();
        assert!(kept.len() as f64 <= CURVE + 2.0, "{}", kept.len());
        let (centre, radius) = (frame.at([0.0, 0.0]), frame.scale);
        for pair in kept.windows(2) {
            let middle = [0, 1].map(|i| 0.5 * (pair[0][i] + pair[1][i]));
            let off = (middle[0] - centre.0).hypot(middle[1] - centre.1) - radius;
            assert!(off.abs() < 0.5, "a chord is {off} pixels off");
        }
    }
}
