//! Plots as data: panels of series over one axis, drawn by the page's script. Points that no eye could tell apart are
//! left out here, so that a page of a long recording stays small.

use serde::Serialize;

use crate::report::page::{embed_json, escape};

/// Points that a plot over time keeps.
pub const TIME_POINTS: usize = 4000;
/// Points that a scatter plot keeps.
pub const SCATTER_POINTS: usize = 2000;

/// An axis with its quantity and unit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Axis {
    /// Quantity and unit as printed: `v [m/s]`.
    pub label: String,
    /// True for a logarithmic axis.
    pub log: bool,
}

impl Axis {
    /// A linear axis.
    pub fn linear(quantity: &str, unit: &str) -> Self {
        Self { label: labelled(quantity, unit), log: false }
    }

    /// A logarithmic axis.
    pub fn log(quantity: &str, unit: &str) -> Self {
        Self { label: labelled(quantity, unit), log: true }
    }
}

/// `quantity [unit]`, or the quantity alone where the unit is unknown.
pub fn labelled(quantity: &str, unit: &str) -> String {
    if unit.is_empty() { quantity.to_owned() } else { format!("{quantity} [{unit}]") }
}

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Style {
    /// Joined points.
    Line,
    /// Held from each point to the next.
    Step,
    /// Points alone.
    Points,
}

/// What a series is, which fixes its colour on every plot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Role {
    /// What was measured.
    Measured,
    /// What the model says.
    Model,
    /// Their difference.
    Residual,
    /// What was commanded.
    Command,
    /// What the model said before effects were added.
    Before,
    /// What it says with them.
    After,
    /// One more quantity without a role of its own.
    Other,
}

/// One series of a panel: a column of the plot, or a straight line.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Series {
    /// Name in the legend.
    pub label: String,
    /// How it is drawn.
    pub style: Style,
    /// What it is.
    pub role: Role,
    /// Values, one a point of x; `None` is a gap. Empty for a straight line.
    pub values: Vec<Option<f64>>,
    /// Slope and intercept of a straight line.
    pub line: Option<(f64, f64)>,
}

impl Series {
    /// A series of values.
    pub fn new(label: &str, style: Style, role: Role, values: Vec<Option<f64>>) -> Self {
        Self { label: label.to_owned(), style, role, values, line: None }
    }

    /// A straight line through all of the plot.
    pub fn straight(label: &str, role: Role, slope: f64, intercept: f64) -> Self {
        Self { label: label.to_owned(), style: Style::Line, role, values: Vec::new(), line: Some((slope, intercept)) }
    }
}

/// Series that share a vertical axis.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Panel {
    /// Vertical axis.
    pub y: Axis,
    /// Height in CSS pixels.
    pub height: u32,
    /// What the vertical axis shows at most, so that one wild curve does not flatten the others.
    pub limits: Option<(f64, f64)>,
    /// Series, the last on top.
    pub series: Vec<Series>,
}

/// Panels over one horizontal axis, with cursors and zoom linked.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Plot {
    /// Plots of the same group share cursor and zoom; empty for none but its own panels.
    pub group: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Points, ascending.
    pub points: Vec<f64>,
    /// Panels from top to bottom.
    pub panels: Vec<Panel>,
    /// Breaks between stretches, where the one ends and where the next begins.
    pub breaks: Vec<(f64, f64)>,
    /// Text below, which also names the plot to who cannot see it.
    #[serde(skip)]
    pub caption: String,
}

impl Plot {
    /// The plot as an HTML figure; nothing without points.
    pub fn html(&self) -> String {
        if self.points.is_empty() {
            return String::new();
        }
        let caption = escape(&self.caption);
        format!(
            "<figure class=\"plot\"><div class=\"canvas\" role=\"img\" aria-label=\"{caption}\"></div>{}<figcaption>{caption}</figcaption></figure>\n",
            embed_json(&self.rounded())
        )
    }

    /// The plot with numbers cut to what a screen can show.
    fn rounded(&self) -> Self {
        let mut plot = self.clone();
        round(plot.points.iter_mut(), self.x.log, 7);
        for panel in &mut plot.panels {
            let log = panel.y.log;
            for series in &mut panel.series {
                series.values.iter_mut().for_each(|v| *v = v.filter(|x| x.is_finite()));
                round(series.values.iter_mut().flatten(), log, 5);
            }
        }
        plot
    }
}

/// Rounds to `digits` decimal digits of the range, or of each number where they span orders of magnitude.
fn round<'a>(values: impl Iterator<Item = &'a mut f64>, each: bool, digits: i32) {
    let mut values: Vec<&mut f64> = values.collect();
    let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(**v), h.max(**v)));
    let decimals = |scale: f64| if scale > 0.0 { (digits - scale.log10().floor() as i32).clamp(0, 15) as usize } else { 15 };
    let range = high - low;
    for value in &mut values {
        let text = if each { format!("{:.*e}", digits as usize - 1, **value) } else { format!("{:.*}", decimals(range), **value) };
        // What was just printed from a finite number parses; adding zero makes −0 plain zero.
        **value = text.parse().unwrap_or(**value) + 0.0;
    }
}

/// Rows to keep of `rows` so that no extreme of any column is lost: the first, the last, and of each of `buckets` equal
/// parts the rows of every column's smallest and largest value. Ascending.
pub fn keep_extremes(columns: &[&[f64]], rows: usize, buckets: usize) -> Vec<usize> {
    let buckets = buckets.max(1);
    if rows <= 2 * columns.len().max(1) * buckets + 2 {
        return (0..rows).collect();
    }
    let mut kept = vec![0, rows - 1];
    for bucket in 0..buckets {
        let range = bucket * rows / buckets..(bucket + 1) * rows / buckets;
        for column in columns {
            // A simulation that diverged is shorter than its stretch.
            let here = || range.clone().take_while(|&i| i < column.len());
            kept.extend(here().min_by(|&a, &b| column[a].total_cmp(&column[b])));
            kept.extend(here().max_by(|&a, &b| column[a].total_cmp(&column[b])));
        }
    }
    kept.sort_unstable();
    kept.dedup();
    kept
}

/// Every k-th of `rows` so that at most [`SCATTER_POINTS`] are left.
pub fn keep_every(rows: usize) -> impl Iterator<Item = usize> + Clone {
    (0..rows).step_by(rows.div_ceil(SCATTER_POINTS).max(1))
}

/// Points of a scatter plot that belong together.
#[derive(Debug, Clone, PartialEq)]
pub struct Cloud<'a> {
    /// Name in the legend.
    pub label: &'a str,
    /// What they are.
    pub role: Role,
    /// Pairs of x and y.
    pub points: Vec<(f64, f64)>,
}

/// Clouds brought onto one ascending axis, a series each; points that are not finite are left out.
pub fn scatter(clouds: &[Cloud<'_>]) -> (Vec<f64>, Vec<Series>) {
    let mut points: Vec<(f64, usize, f64)> =
        clouds.iter().enumerate().flat_map(|(i, cloud)| cloud.points.iter().map(move |&(x, y)| (x, i, y))).collect();
    points.retain(|(x, _, y)| x.is_finite() && y.is_finite());
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let column = |cloud: usize| points.iter().map(|&(_, i, y)| (i == cloud).then_some(y)).collect();
    let series = clouds.iter().enumerate().map(|(i, cloud)| Series::new(cloud.label, Style::Points, cloud.role, column(i))).collect();
    (points.iter().map(|p| p.0).collect(), series)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimation_keeps_every_extreme() {
        let wave: Vec<f64> = (0..24_000).map(|i| (i as f64 * 0.01).sin()).collect();
        let mut spikes = vec![0.0; 24_000];
        spikes[12_345] = 5.0;
        spikes[12_347] = -7.0;
        spikes[20_001] = 0.5;
        let kept = keep_extremes(&[&wave, &spikes], 24_000, 1000);
        assert!(kept.len() <= 4002 && kept.is_sorted());
        for row in [0, 12_345, 12_347, 20_001, 23_999] {
            assert!(kept.contains(&row), "row {row}");
        }
        assert_eq!(keep_extremes(&[&wave[..50]], 50, 25), (0..50).collect::<Vec<_>>());
        // A column that ends early does not hide the others.
        assert!(keep_extremes(&[&wave[..10], &spikes], 24_000, 100).contains(&20_001));
    }

    #[test]
    fn numbers_are_cut_to_what_can_be_seen() {
        let values = vec![Some(0.123_456_789_123), Some(-0.000_000_01), None, Some(f64::NAN), Some(1.2)];
        let plot = Plot {
            group: String::new(),
            x: Axis::linear("time", "s"),
            points: vec![0.0, 0.05, 0.100_000_000_000_01, 0.15, 0.2],
            panels: vec![Panel {
                y: Axis::linear("v", "m/s"),
                height: 200,
                limits: None,
                series: vec![Series::new("v", Style::Line, Role::Measured, values)],
            }],
            breaks: Vec::new(),
            caption: "</figcaption>".to_owned(),
        };
        let html = plot.html();
        assert!(html.contains("[0.0,0.05,0.1,0.15,0.2]"), "{html}");
        assert!(html.contains("[0.12346,0.0,null,null,1.2]"), "{html}");
        assert_eq!(html.matches("</figcaption>").count(), 1);
    }

    #[test]
    fn scatter_is_sorted_and_keeps_clouds_apart() {
        let cloud = |label, role, points: &[(f64, f64)]| Cloud { label, role, points: points.to_vec() };
        let (x, series) =
            scatter(&[cloud("a", Role::Measured, &[(2.0, 1.0), (0.0, 3.0)]), cloud("b", Role::Model, &[(1.0, 5.0), (f64::NAN, 0.0)])]);
        assert_eq!(x, [0.0, 1.0, 2.0]);
        assert_eq!(series[0].values, [Some(3.0), None, Some(1.0)]);
        assert_eq!(series[1].values, [None, Some(5.0), None]);
        assert!(keep_every(24_000).count() <= SCATTER_POINTS);
        assert_eq!(keep_every(3).collect::<Vec<_>>(), [0, 1, 2]);
    }
}
