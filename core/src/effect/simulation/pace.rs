//! How finely a run is stepped, and where its steps end, kept for others near by: their differences are then those of the motion, not of where a step was halved.

use std::ops::Range;

/// How finely a run is stepped.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Measure {
    /// What a step may miss of an output, relative to its root mean square.
    pub(super) allowed: f64,
    /// How often the longest step may be halved.
    pub(super) deepest: u32,
    /// The shortest step in terms of the longest, 2^−deepest.
    pub(super) finest: f64,
}

/// Where the steps of a stretch end, in parts of its intervals.
#[derive(Debug, Default)]
pub(super) struct Steps {
    ends: Vec<u32>,
    /// Those of each interval, by the row that it begins at.
    intervals: Vec<Range<usize>>,
}

impl Steps {
    /// Begins anew.
    pub(super) fn clear(&mut self) {
        self.ends.clear();
        self.intervals.clear();
    }

    /// Begins the interval after a row.
    pub(super) fn begin(&mut self, row: usize) {
        self.intervals.resize(row, self.ends.len()..self.ends.len());
        self.intervals.push(self.ends.len()..self.ends.len());
    }

    /// Adds where a step of the last interval ends.
    pub(super) fn push(&mut self, end: usize) {
        self.ends.push(end as u32);
        if let Some(last) = self.intervals.last_mut() {
            last.end += 1;
        }
    }

    /// Where the step that is taken at a place of an interval ended; `None` where none was kept.
    pub(super) fn end(&self, row: usize, place: usize) -> Option<usize> {
        let ends = self.ends.get(self.intervals.get(row)?.clone())?;
        ends.iter().map(|end| *end as usize).find(|end| *end > place)
    }
}
