//! Measured and simulated stretches on one time axis.
//!
//! Stretches that nearly fill their recording are drawn over recording time. Scattered ones (whole stretches held out
//! here and there, several recordings, clocks that start anew) are set end to end, so that the page shows data and not
//! the breaks; either way a line does not run across a break, and a border marks it.

use wheelwright_core::Stretch;

use crate::report::plot::{TIME_POINTS, keep_extremes};

/// Share of the time axis that breaks may take before stretches are set end to end.
const MAX_BREAKS: f64 = 0.25;
/// Share of the time axis left between stretches set end to end, so that a line visibly stops there.
const APART: f64 = 0.004;
/// Clock readings above this are dates, not times since a start \[s\].
const DATE: f64 = 1e6;

/// Where each stretch lies on the axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Timeline {
    /// Text of the axis.
    pub label: &'static str,
    /// Time to add to each stretch's own \[s\].
    shifts: Vec<f64>,
}

/// Signals of all stretches brought onto a timeline.
#[derive(Debug, Clone, PartialEq)]
pub struct Joined {
    /// Times \[s\], ascending.
    pub time: Vec<f64>,
    /// Signals in the order given; `None` at breaks and where a signal ended early.
    pub columns: Vec<Vec<Option<f64>>>,
    /// Breaks: where a stretch ends and where the next begins.
    pub breaks: Vec<(f64, f64)>,
    /// Samples there were.
    pub samples: usize,
    /// True if points were left out.
    pub thinned: bool,
}

impl Timeline {
    /// A timeline of stretches.
    pub fn new(stretches: &[&Stretch]) -> Self {
        let ends = |s: &Stretch| Some((*s.time.first()?, *s.time.last()?));
        let spans: Vec<(f64, f64)> = stretches.iter().map(|s| ends(s).unwrap_or_default()).collect();
        let data: f64 = spans.iter().map(|(a, b)| b - a).sum();
        let breaks: f64 = spans.windows(2).map(|w| w[1].0 - w[0].1).sum();
        let ascending = spans.windows(2).all(|w| w[1].0 > w[0].1);
        let start = spans.first().map_or(0.0, |s| s.0);
        if ascending && breaks <= MAX_BREAKS * data {
            let (label, shift) = if start.abs() > DATE { ("time since the first sample", -start) } else { ("time of the recording", 0.0) };
            return Self { label, shifts: vec![shift; spans.len()] };
        }
        let mut next = 0.0;
        let shifts = spans.iter().map(|(a, b)| {
            let shift = next - a;
            next += b - a + APART * data;
            shift
        });
        Self { label: "time of the stretches, one after another", shifts: shifts.collect() }
    }

    /// Brings signals onto the axis, keeping at most about [`TIME_POINTS`] points and every extreme. `signals[s][c]` is
    /// signal `c` of stretch `s`, as long as the stretch or shorter.
    pub fn join(&self, stretches: &[&Stretch], signals: &[Vec<&[f64]>]) -> Joined {
        let samples: usize = stretches.iter().map(|s| s.len()).sum();
        let count = signals.first().map_or(0, Vec::len);
        let mut joined = Joined { time: Vec::new(), columns: vec![Vec::new(); count], breaks: Vec::new(), samples, thinned: false };
        for ((stretch, columns), shift) in stretches.iter().zip(signals).zip(&self.shifts) {
            let rows = stretch.len();
            let budget = TIME_POINTS * rows / samples.max(1);
            // Extremes of different signals often share a row: the finest parts that stay within the budget are taken.
            let kept = (1..=count).map(|share| keep_extremes(columns, rows, budget / (2 * share))).find(|kept| kept.len() <= budget + 2);
            let kept = kept.unwrap_or_else(|| keep_extremes(columns, rows, budget / (2 * count.max(1))));
            joined.thinned |= kept.len() < rows;
            if let (Some(last), Some(first)) = (joined.time.last().copied(), stretch.time.first().map(|t| t + shift)) {
                joined.gap(last, first);
            }
            joined.time.extend(kept.iter().map(|&row| stretch.time[row] + shift));
            for (target, column) in joined.columns.iter_mut().zip(columns) {
                target.extend(kept.iter().map(|&row| column.get(row).copied()));
            }
        }
        joined
    }
}

impl Joined {
    fn gap(&mut self, from: f64, to: f64) {
        self.time.push(0.5 * (from + to));
        self.columns.iter_mut().for_each(|c| c.push(None));
        self.breaks.push((from, to));
    }

    /// What a caption has to say about what is not shown, or nothing.
    pub fn remark(&self) -> String {
        let mut text = String::new();
        if !self.breaks.is_empty() {
            text.push_str(" Dotted lines and grey bands are breaks between stretches; nothing was computed across them.");
        }
        if self.thinned {
            let (shown, all) = (self.time.len(), crate::report::number::count(self.samples));
            text.push_str(&format!(" Drawn are {shown} of {all} samples, every minimum and maximum among them."));
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stretch(start: f64, rows: usize) -> Stretch {
        let time: Vec<f64> = (0..rows).map(|i| start + 0.1 * i as f64).collect();
        let values = time.iter().map(|t| t.sin()).collect();
        Stretch { label: format!("{start}"), time, inputs: Vec::new(), outputs: vec![values] }
    }

    fn join(stretches: &[Stretch]) -> (Timeline, Joined) {
        let all: Vec<&Stretch> = stretches.iter().collect();
        let line = Timeline::new(&all);
        let signals: Vec<Vec<&[f64]>> = stretches.iter().map(|s| vec![s.outputs[0].as_slice()]).collect();
        let joined = line.join(&all, &signals);
        (line, joined)
    }

    #[test]
    fn recording_time_where_it_is_nearly_full() {
        let (line, joined) = join(&[stretch(5.0, 101), stretch(16.0, 101)]);
        assert_eq!(line.label, "time of the recording");
        assert_eq!(joined.time[0], 5.0);
        assert_eq!(joined.breaks, [(15.0, 16.0)]);
        assert!((joined.time[101] - 15.5).abs() < 1e-9 && joined.columns[0][101].is_none());
    }

    #[test]
    fn scattered_stretches_and_fresh_clocks_are_set_end_to_end() {
        for starts in [[0.0, 500.0], [3.0, 0.0]] {
            let (line, joined) = join(&[stretch(starts[0], 101), stretch(starts[1], 101)]);
            assert_eq!(line.label, "time of the stretches, one after another");
            assert!(joined.time.is_sorted() && joined.time[0] == 0.0);
            assert!((joined.time[202] - 20.08).abs() < 1e-9, "{}", joined.time[202]);
        }
    }

    #[test]
    fn dates_become_times() {
        let (line, joined) = join(&[stretch(1.7e9, 11)]);
        assert_eq!((line.label, joined.time[0]), ("time since the first sample", 0.0));
        assert!(joined.breaks.is_empty() && joined.remark().is_empty());
    }

    #[test]
    fn long_recordings_are_thinned_and_say_so() {
        let (_, joined) = join(&[stretch(0.0, 12_000), stretch(1300.0, 12_000)]);
        assert!(joined.time.len() <= TIME_POINTS + 10, "{}", joined.time.len());
        assert!(joined.remark().contains("of 24\u{202f}000 samples"));
    }
}
