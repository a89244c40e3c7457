//! Motion summed up over spans of a second: noise is small in that, and what is late shows where a span begins and ends.

use nalgebra::{SMatrix, SVector};
use wheelwright_core::{Dataset, Stretch};

use crate::comparison::{blocks, wrapped};
use crate::diagnose::DECISIVE;

/// Seconds over which motion is summed up.
const SPAN: f64 = 1.0;
/// Fewest spans that say anything.
pub(crate) const FEWEST: usize = 20;
/// By how much one way of measuring may be later than another \[s\]: nobody drives on records that are later.
const LATEST: f64 = 0.5;
/// Steps in which that is looked for \[s\], some to either side of the best so far.
const STEPS: [f64; 3] = [0.1, 0.02, 0.004];
const EITHER_SIDE: i32 = 5;

/// A part of a stretch.
pub(crate) struct Span {
    pub(crate) stretch: usize,
    /// When it begins and ends \[s\].
    pub(crate) start: f64,
    pub(crate) end: f64,
}

impl Span {
    /// How far something that was summed up since a stretch began has come over this span, so much earlier \[s\].
    pub(crate) fn covered(&self, stretch: &Stretch, sum: &[f64], by: f64) -> f64 {
        at(&stretch.time, sum, self.end - by) - at(&stretch.time, sum, self.start - by)
    }
}

/// The spans of a recording that lie within their stretches even so much earlier and so much later \[s\].
pub(crate) fn spans(data: &Dataset, earlier: f64, later: f64) -> Vec<Span> {
    let inside = |(s, rows): (usize, std::ops::Range<usize>)| {
        let time = &data.stretches[s].time;
        let (start, end) = (time[rows.start], *time.get(rows.end)?);
        (start - earlier >= time[0] && end + later <= time[time.len() - 1]).then_some(Span { stretch: s, start, end })
    };
    blocks(data, SPAN).into_iter().filter_map(inside).collect()
}

/// A regression over spans of `M` values on `N` others.
pub(crate) struct Regression<const N: usize, const M: usize> {
    /// What a unit of each of the others (rows) makes of each value (columns).
    pub(crate) found: SMatrix<f64, N, M>,
    /// Inverse of the others' products.
    inverse: SMatrix<f64, N, N>,
    /// Squares that are left of each value.
    left: SVector<f64, M>,
    spans: usize,
}

impl<const N: usize, const M: usize> Regression<N, M> {
    fn over(spans: &[Span], row: impl Fn(&Span) -> (SVector<f64, N>, SVector<f64, M>)) -> Option<Self> {
        if spans.len() < FEWEST {
            return None;
        }
        let rows: Vec<_> = spans.iter().map(row).collect();
        let square = rows.iter().fold(SMatrix::<f64, N, N>::zeros(), |sum, (x, _)| sum + x * x.transpose());
        let right = rows.iter().fold(SMatrix::<f64, N, M>::zeros(), |sum, (x, y)| sum + x * y.transpose());
        let inverse = square.try_inverse()?;
        let found = inverse * right;
        let left = rows.iter().fold(SVector::zeros(), |sum, (x, y)| sum + (y - found.transpose() * x).map(|r| r * r));
        Some(Self { found, inverse, left, spans: rows.len() })
    }

    /// Over the spans of a recording, the one way of measuring so much later than the other (the argument of `row`, in seconds) that they leave
    /// decisively less of one another than on one clock, if there is such.
    pub(crate) fn in_step(data: &Dataset, row: impl Fn(&Span, f64) -> (SVector<f64, N>, SVector<f64, M>)) -> Option<Self> {
        let inner = spans(data, LATEST, LATEST);
        let at = |by: f64| Some((by, Self::over(&inner, |span| row(span, by))?.misfit()));
        let lesser = |a: (f64, f64), b: (f64, f64)| if b.1 < a.1 { b } else { a };
        let around = |from: (f64, f64), step: f64| {
            let steps = (-EITHER_SIDE..=EITHER_SIDE).map(|k| (from.0 + step * f64::from(k)).clamp(-LATEST, LATEST));
            steps.filter_map(at).fold(from, lesser)
        };
        let later = at(0.0).map_or(0.0, |none| {
            let best = STEPS.into_iter().fold(none, around);
            if best.1 + DECISIVE < none.1 { best.0 } else { 0.0 }
        });
        Self::over(&spans(data, later, -later), |span| row(span, later))
    }

    /// Less twice the log-likelihood, but for what is the same over the same spans.
    fn misfit(&self) -> f64 {
        self.spans as f64 * self.left.iter().map(|squares| squares.max(f64::MIN_POSITIVE).ln()).sum::<f64>()
    }

    /// Standard error of what is found.
    pub(crate) fn error(&self, i: usize, j: usize) -> f64 {
        let variance = self.left[j] / (self.spans - N) as f64;
        (variance * self.inverse[(i, i)]).sqrt().max(f64::MIN_POSITIVE)
    }
}

/// A heading without its jumps of a whole turn.
pub(crate) fn unwrapped(heading: &[f64]) -> Vec<f64> {
    let first = heading.first().copied();
    let angles = heading.windows(2).scan(first.unwrap_or(0.0), |angle, pair| {
        *angle += wrapped(pair[1] - pair[0]);
        Some(*angle)
    });
    first.into_iter().chain(angles).collect()
}

/// A series at a time, straight between samples.
fn at(time: &[f64], series: &[f64], t: f64) -> f64 {
    let next = time.partition_point(|other| *other < t).clamp(1, time.len() - 1);
    let share = (t - time[next - 1]) / (time[next] - time[next - 1]);
    series[next - 1] + share * (series[next] - series[next - 1])
}
