//! Whitened values with the initial outputs taken out: what every fit and every score works on.
//!
//! The initial outputs of a stretch touch no other stretch, so they are eliminated stretch by stretch. They were measured, if with errors
//! that are not those of the other samples (a late sensor, a mean over an interval): with deviation τ about the first sample and whitened
//! responses B, values have the covariance I + B τ² Bᵀ, and are whitened by the inverse of its root. Along a direction u of B with
//! singular value s that is the factor 1/√(1 + s²): what the starts can do counts the less, the better the data show them.

use nalgebra::DMatrix;

use super::algebra::{add, dot};
use super::layout::Layout;
use super::setting::{Point, Runner};
use crate::noise::Noise;

/// Responses to an initial output below this share of their peak no longer count: they have decayed.
const DECAYED: f64 = 1e-6;
/// Share of an output's root mean square by which an initial output may differ from the first sample.
const KNOWN: f64 = 0.2;
/// Squared size of a direction below which it moves nothing.
const NOTHING: f64 = 1e-12;

/// Noise model and the responses to the initial outputs.
#[derive(Debug, Clone)]
pub(crate) struct Whitening {
    pub(crate) noise: Noise,
    layout: Layout,
    starts: Vec<StretchStarts>,
}

/// Directions in which the initial outputs of one stretch move its values, cut where they have decayed.
#[derive(Debug, Clone)]
struct StretchStarts {
    rows: usize,
    directions: Vec<Direction>,
    /// First sample of each output, and how far off the initial output may be.
    about: Vec<(f64, f64)>,
}

/// A singular direction of the responses to the initial outputs, these in units of their deviation.
#[derive(Debug, Clone)]
struct Direction {
    /// By output: whitened values of the first rows, of unit length.
    values: Vec<Vec<f64>>,
    /// Share of each initial output in it.
    outputs: Vec<f64>,
    /// Its singular value.
    size: f64,
}

impl Whitening {
    /// Linearises the responses to the initial outputs at a point.
    pub(crate) fn new(noise: Noise, layout: &Layout, runner: &mut Runner<'_, '_>, point: &Point) -> Self {
        let raw = runner.start_columns(point);
        let about = |s: usize| -> Vec<(f64, f64)> {
            runner.firsts(s).into_iter().zip(runner.scales()).map(|(first, scale)| (first, KNOWN * scale)).collect()
        };
        let about: Vec<Vec<(f64, f64)>> = (0..layout.stretches()).map(about).collect();
        Self::of(noise, layout, raw, about)
    }

    /// From the raw responses to the initial outputs, one an output, and what is known of these, by stretch.
    fn of(noise: Noise, layout: &Layout, mut raw: Vec<Vec<f64>>, about: Vec<Vec<(f64, f64)>>) -> Self {
        raw.iter_mut().for_each(|column| noise.whiten_flat(layout, column));
        let starts = about.into_iter().enumerate().map(|(s, about)| StretchStarts::of(&raw, layout, s, about)).collect();
        Self { noise, layout: layout.clone(), starts }
    }

    /// Whitens and projects, in place.
    pub(crate) fn apply(&self, values: &mut [f64]) {
        self.noise.whiten_flat(&self.layout, values);
        self.project(values);
    }

    fn project(&self, values: &mut [f64]) {
        for (s, starts) in self.starts.iter().enumerate() {
            for direction in &starts.directions {
                let along = starts.along(direction, values, &self.layout, s);
                starts.add(direction, (direction.shrinkage() - 1.0) * along, values, &self.layout, s);
            }
        }
    }

    /// Whitens the residual of a run from `starts` and makes it that of a run from the first samples, shrunk along what the starts can do.
    pub(crate) fn settle(&self, residual: &mut [f64], starts: &[Vec<f64>]) {
        self.noise.whiten_flat(&self.layout, residual);
        for (s, known) in self.starts.iter().enumerate() {
            let from = known.from(&starts[s]);
            for direction in &known.directions {
                let along = known.along(direction, residual, &self.layout, s);
                let whole = along + direction.size * dot(&direction.outputs, &from);
                known.add(direction, direction.shrinkage() * whole - along, residual, &self.layout, s);
            }
        }
    }

    /// The likeliest initial outputs, by the residual of a run from `starts`, flat.
    pub(crate) fn likeliest(&self, mut residual: Vec<f64>, starts: &[Vec<f64>]) -> Vec<Vec<f64>> {
        self.noise.whiten_flat(&self.layout, &mut residual);
        let of = |(s, known): (usize, &StretchStarts)| {
            let from = known.from(&starts[s]);
            let mut likeliest: Vec<f64> = known.about.iter().map(|(first, _)| *first).collect();
            for direction in &known.directions {
                let whole = known.along(direction, &residual, &self.layout, s) + direction.size * dot(&direction.outputs, &from);
                let back = direction.size / (1.0 + direction.size * direction.size) * whole;
                let moved = direction.outputs.iter().zip(&known.about).map(|(share, (_, deviation))| back * share * deviation);
                likeliest.iter_mut().zip(moved).for_each(|(x, by)| *x += by);
            }
            likeliest
        };
        self.starts.iter().enumerate().map(of).collect()
    }

    /// How much of the data the initial outputs take: degrees of freedom.
    pub(crate) fn taken(&self) -> f64 {
        self.starts.iter().flat_map(|s| &s.directions).map(|d| 1.0 - d.shrinkage().powi(2)).sum()
    }
}

impl Direction {
    /// What is left of values along it.
    fn shrinkage(&self) -> f64 {
        1.0 / (1.0 + self.size * self.size).sqrt()
    }
}

impl StretchStarts {
    fn of(columns: &[Vec<f64>], layout: &Layout, s: usize, about: Vec<(f64, f64)>) -> Self {
        let cut = |column: &[f64], rows: usize| -> Vec<Vec<f64>> {
            (0..layout.outputs()).map(|c| column[layout.part(c, s)][..rows].to_vec()).collect()
        };
        let peak = |column: &[f64]| (0..layout.outputs()).flat_map(|c| &column[layout.part(c, s)]).fold(0.0_f64, |m, x| m.max(x.abs()));
        let last = |column: &[f64]| {
            let least = DECAYED * peak(column);
            (0..layout.outputs()).filter_map(|c| column[layout.part(c, s)].iter().rposition(|x| x.abs() > least)).max().unwrap_or(0)
        };
        let rows = (columns.iter().map(|c| last(c)).max().unwrap_or(0) + 1).min(layout.length(s));
        let columns: Vec<Vec<Vec<f64>>> = columns
            .iter()
            .zip(&about)
            .map(|(column, (_, deviation))| {
                let mut cut = cut(column, rows);
                cut.iter_mut().flatten().for_each(|x| *x *= deviation);
                cut
            })
            .collect();
        let product = |i: usize, j: usize| columns[i].iter().zip(&columns[j]).map(|(a, b)| dot(a, b)).sum::<f64>();
        let gram = DMatrix::from_fn(columns.len(), columns.len(), product);
        if gram.iter().any(|x| !x.is_finite()) {
            return Self { rows: 0, directions: Vec::new(), about };
        }
        let eigen = gram.symmetric_eigen();
        let largest = eigen.eigenvalues.max();
        let directions = (0..columns.len()).filter(|i| eigen.eigenvalues[*i] > NOTHING * largest.max(1.0)).map(|i| {
            let size = eigen.eigenvalues[i].sqrt();
            let outputs: Vec<f64> = eigen.eigenvectors.column(i).iter().copied().collect();
            let mut values = vec![vec![0.0; rows]; columns.len()];
            for (column, share) in columns.iter().zip(&outputs) {
                values.iter_mut().zip(column).for_each(|(x, c)| add(x, share / size, c));
            }
            Direction { values, outputs, size }
        });
        Self { rows, directions: directions.collect(), about }
    }

    /// Distances of initial outputs from the first samples, in units of how far off they may be.
    fn from(&self, starts: &[f64]) -> Vec<f64> {
        starts.iter().zip(&self.about).map(|(x, (first, deviation))| (x - first) / deviation).collect()
    }

    /// Component of values along a direction.
    fn along(&self, direction: &Direction, values: &[f64], layout: &Layout, s: usize) -> f64 {
        direction.values.iter().enumerate().map(|(c, u)| dot(u, &values[layout.part(c, s)][..self.rows])).sum()
    }

    /// Adds so much of a direction to values.
    fn add(&self, direction: &Direction, by: f64, values: &mut [f64], layout: &Layout, s: usize) {
        for (c, u) in direction.values.iter().enumerate() {
            let start = layout.part(c, s).start;
            add(&mut values[start..start + self.rows], by, u);
        }
    }
}
