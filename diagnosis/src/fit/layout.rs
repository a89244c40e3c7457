//! All values of a data set in one vector: by output, then stretch, then row, so that an output is one slice.

use std::ops::Range;

use wheelwright_core::effect::Scene;
use wheelwright_core::{Dataset, Stretch};

use crate::residuals::Series;

/// Time at the start of a stretch that neither fit nor proof counts \[s\]: what came before it is still at work in delays, lags and loops, and
/// nobody recorded it. Before a robot that stands still there was nothing.
const UNSETTLED: f64 = 1.0;
/// Share of a stretch that this may take at most.
const MOST_UNSETTLED: f64 = 0.1;

/// Rows at the start of a stretch that nothing counts.
pub(crate) fn unsettled(scene: &Scene, stretch: &Stretch) -> usize {
    if scene.from_rest(stretch) {
        return 0;
    }
    let most = (MOST_UNSETTLED * stretch.len() as f64) as usize;
    stretch.time.partition_point(|t| *t < stretch.time[0] + UNSETTLED).min(most)
}

/// Where in the flat vector things are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Layout {
    offsets: Vec<usize>,
    lengths: Vec<usize>,
    /// Rows at the start of each stretch that nothing counts.
    unsettled: Vec<usize>,
    rows: usize,
    outputs: usize,
}

impl Layout {
    pub(crate) fn of(data: &Dataset, scene: &Scene) -> Self {
        let lengths: Vec<usize> = data.stretches.iter().map(|s| s.len()).collect();
        let offsets = lengths.iter().scan(0, |sum, n| {
            *sum += n;
            Some(*sum - n)
        });
        let unsettled = data.stretches.iter().map(|s| unsettled(scene, s));
        Self {
            offsets: offsets.collect(),
            rows: lengths.iter().sum(),
            unsettled: unsettled.collect(),
            lengths,
            outputs: data.outputs.len(),
        }
    }

    /// Leaves nothing where nothing counts.
    pub(crate) fn settle(&self, values: &mut [f64]) {
        for c in 0..self.outputs {
            for s in 0..self.stretches() {
                values[self.before_settled(c, s)].fill(0.0);
            }
        }
    }

    /// Length of the flat vector.
    pub(crate) fn len(&self) -> usize {
        self.rows * self.outputs
    }

    /// Rows of all stretches.
    pub(crate) fn rows(&self) -> usize {
        self.rows
    }

    /// Rows of all stretches that count.
    pub(crate) fn counted(&self) -> usize {
        self.rows - self.unsettled.iter().sum::<usize>()
    }

    /// Values that are explained: those rows of all outputs.
    pub(crate) fn values(&self) -> f64 {
        (self.counted() * self.outputs()) as f64
    }

    /// Rows at the start of a stretch that do not count.
    pub(crate) fn unsettled(&self, stretch: usize) -> usize {
        self.unsettled[stretch]
    }

    /// One output over one stretch, what counts of it.
    pub(crate) fn settled(&self, output: usize, stretch: usize) -> Range<usize> {
        let part = self.part(output, stretch);
        part.start + self.unsettled[stretch]..part.end
    }

    /// One output over one stretch, what does not count of it.
    pub(crate) fn before_settled(&self, output: usize, stretch: usize) -> Range<usize> {
        let start = self.part(output, stretch).start;
        start..start + self.unsettled[stretch]
    }

    pub(crate) fn outputs(&self) -> usize {
        self.outputs
    }

    pub(crate) fn stretches(&self) -> usize {
        self.lengths.len()
    }

    pub(crate) fn length(&self, stretch: usize) -> usize {
        self.lengths[stretch]
    }

    /// Everything of one output.
    pub(crate) fn output(&self, output: usize) -> Range<usize> {
        output * self.rows..(output + 1) * self.rows
    }

    /// One output over one stretch.
    pub(crate) fn part(&self, output: usize, stretch: usize) -> Range<usize> {
        let start = output * self.rows + self.offsets[stretch];
        start..start + self.lengths[stretch]
    }

    pub(crate) fn flat(&self, measured: &Dataset) -> Vec<f64> {
        (0..self.outputs).flat_map(|c| measured.stretches.iter().flat_map(move |s| s.outputs[c].iter().copied())).collect()
    }

    pub(crate) fn series(&self, flat: &[f64]) -> Series {
        (0..self.stretches()).map(|s| (0..self.outputs).map(|c| flat[self.part(c, s)].to_vec()).collect()).collect()
    }
}
