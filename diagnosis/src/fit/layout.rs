//! All values of a data set in one vector: by output, then stretch, then row, so that an output is one slice.

use std::ops::Range;

use wheelwright_core::Dataset;

use crate::residuals::Series;

/// Where in the flat vector things are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Layout {
    offsets: Vec<usize>,
    lengths: Vec<usize>,
    rows: usize,
    outputs: usize,
}

impl Layout {
    pub(crate) fn of(data: &Dataset) -> Self {
        let lengths: Vec<usize> = data.stretches.iter().map(|s| s.len()).collect();
        let offsets = lengths.iter().scan(0, |sum, n| {
            *sum += n;
            Some(*sum - n)
        });
        Self { offsets: offsets.collect(), rows: lengths.iter().sum(), lengths, outputs: data.outputs.len() }
    }

    /// Length of the flat vector.
    pub(crate) fn len(&self) -> usize {
        self.rows * self.outputs
    }

    /// Rows of all stretches.
    pub(crate) fn rows(&self) -> usize {
        self.rows
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
