//! Whitened values with the initial outputs taken out: what every fit and every score works on.
//!
//! The initial outputs of a stretch touch no other stretch, so they are eliminated stretch by stretch: values are projected on the
//! complement of the whitened responses to them.

use super::algebra::{add, dot};
use super::layout::Layout;
use super::setting::{Point, Runner};
use crate::noise::Noise;

/// Responses to an initial output below this share of their peak no longer count: they have decayed.
const DECAYED: f64 = 1e-6;

/// Noise model and the responses to the initial outputs.
#[derive(Debug, Clone)]
pub(crate) struct Whitening {
    pub(crate) noise: Noise,
    layout: Layout,
    starts: Vec<StretchStarts>,
}

/// Orthonormal responses to the initial outputs of one stretch, cut where they have decayed.
#[derive(Debug, Clone)]
struct StretchStarts {
    rows: usize,
    /// By basis vector, then output: values of the first rows.
    basis: Vec<Vec<Vec<f64>>>,
    /// Coefficients of the responses in the basis, upper triangular, row-major; by basis vector and then output.
    triangle: Vec<Vec<f64>>,
    /// The output that each basis vector came with.
    source: Vec<usize>,
}

impl Whitening {
    /// Linearises the responses to the initial outputs at a point whose free run is `simulated`.
    pub(crate) fn new(noise: Noise, layout: &Layout, runner: &mut Runner<'_, '_>, point: &Point, simulated: &[f64]) -> Self {
        let raw: Vec<Vec<f64>> = (0..layout.outputs()).map(|c| runner.start_column(point, c, simulated)).collect();
        Self::of(noise, layout, raw, runner.scales())
    }

    /// From the raw responses to the initial outputs, one an output, and the outputs' scales.
    fn of(noise: Noise, layout: &Layout, mut raw: Vec<Vec<f64>>, scales: &[f64]) -> Self {
        raw.iter_mut().for_each(|column| noise.whiten_flat(layout, column));
        let starts = (0..layout.stretches()).map(|s| StretchStarts::of(&raw, layout, s, scales)).collect();
        Self { noise, layout: layout.clone(), starts }
    }

    /// Whitens and projects, in place.
    pub(crate) fn apply(&self, values: &mut [f64]) {
        self.noise.whiten_flat(&self.layout, values);
        self.project(values);
    }

    fn project(&self, values: &mut [f64]) {
        for (s, starts) in self.starts.iter().enumerate() {
            for q in &starts.basis {
                let along = starts.along(q, values, &self.layout, s);
                for (c, q) in q.iter().enumerate() {
                    let start = self.layout.part(c, s).start;
                    add(&mut values[start..start + starts.rows], -along, q);
                }
            }
        }
    }

    /// Whitens a residual, moves the initial outputs to where they fit it best, and projects it.
    pub(crate) fn settle(&self, residual: &mut [f64], starts: &mut [Vec<f64>]) {
        self.noise.whiten_flat(&self.layout, residual);
        for (s, basis) in self.starts.iter().enumerate() {
            let along: Vec<f64> = basis.basis.iter().map(|q| basis.along(q, residual, &self.layout, s)).collect();
            let mut change = vec![0.0; along.len()];
            for i in (0..along.len()).rev() {
                let known: f64 = (i + 1..along.len()).map(|j| basis.triangle[i][j] * change[j]).sum();
                change[i] = (along[i] - known) / basis.triangle[i][i];
                starts[s][basis.source[i]] += change[i];
            }
        }
        self.project(residual);
    }

    /// Initial outputs that the data show: degrees of freedom taken.
    pub(crate) fn taken(&self) -> usize {
        self.starts.iter().map(|s| s.basis.len()).sum()
    }
}

impl StretchStarts {
    fn of(columns: &[Vec<f64>], layout: &Layout, s: usize, scales: &[f64]) -> Self {
        let cut = |column: &[f64], rows: usize| -> Vec<Vec<f64>> {
            (0..layout.outputs()).map(|c| column[layout.part(c, s)][..rows].to_vec()).collect()
        };
        let peak = |column: &[f64]| (0..layout.outputs()).flat_map(|c| &column[layout.part(c, s)]).fold(0.0_f64, |m, x| m.max(x.abs()));
        let last = |column: &[f64]| {
            let least = DECAYED * peak(column);
            (0..layout.outputs()).filter_map(|c| column[layout.part(c, s)].iter().rposition(|x| x.abs() > least)).max().unwrap_or(0)
        };
        let rows = (columns.iter().map(|c| last(c)).max().unwrap_or(0) + 1).min(layout.length(s));
        let mut made = Self { rows, basis: Vec::new(), triangle: Vec::new(), source: Vec::new() };
        for (source, column) in columns.iter().enumerate() {
            let mut left = cut(column, rows);
            let size = norm(&left);
            let mut along = vec![0.0; made.basis.len()];
            for _ in 0..2 {
                for (i, q) in made.basis.iter().enumerate() {
                    let share: f64 = q.iter().zip(&left).map(|(q, x)| dot(q, x)).sum();
                    along[i] += share;
                    left.iter_mut().zip(q).for_each(|(x, q)| add(x, -share, q));
                }
            }
            let rest = norm(&left);
            // A start as far off as outputs ever are that would not be seen keeps its measured value.
            if !rest.is_finite() || rest <= 1e-6 * size || rest * scales[source] < 1.0 {
                continue;
            }
            left.iter_mut().flatten().for_each(|x| *x /= rest);
            made.triangle.iter_mut().zip(&along).for_each(|(row, a)| row.push(*a));
            let mut row = vec![0.0; made.basis.len()];
            row.push(rest);
            made.triangle.push(row);
            made.basis.push(left);
            made.source.push(source);
        }
        made
    }

    fn along(&self, q: &[Vec<f64>], values: &[f64], layout: &Layout, s: usize) -> f64 {
        q.iter().enumerate().map(|(c, q)| dot(q, &values[layout.part(c, s)][..self.rows])).sum()
    }
}

fn norm(column: &[Vec<f64>]) -> f64 {
    column.iter().map(|c| dot(c, c)).sum::<f64>().sqrt()
}
