//! Structure: is the residual still a function of anything that was going on?
//!
//! A battery of features of motion, command, time and heading is passed through each output's own lag (a force shows only
//! behind it), whitened as the residual was, and cleared of everything the fit could have absorbed. The energy T of the whitened residual in their
//! span has, where nothing is left, as many degrees of freedom as features: z = (T − df)/√(2 df).
//!
//! Misfit makes noise of itself: an autoregression of the residual takes it for slow noise, and whitening with that hides it. So all is
//! whitened once more by the past of what the features leave over, as a Wald test has it and a score test has not. Innovations that are far out are
//! drawn in before: a single one where a feature is large would be structure, and many of them drown it.

use std::ops::Range;

use nalgebra::DMatrix;
use wheelwright_core::Stretch;

use super::Jitter;
use crate::comparison::{Channels, Comparison};
use crate::fit::algebra::{clear, dot, orthonormal};
use crate::noise::whitener;

/// z above which something is left. The law of T is exact for known noise; with an autoregression estimated from what the
/// features leave over, none of a hundred clean recordings exceeds it (documented with the other thresholds).
pub const LIMIT: f64 = 8.0;
/// A feature this much shorter after clearing than before says nothing of its own.
const SPENT: f64 = 1e-4;

/// What is left in the residual.
#[derive(Debug, Clone, PartialEq)]
pub struct Structure {
    /// How many standard deviations more than chance.
    pub z: f64,
    /// Energy above chance: twice a log-likelihood, as scores are.
    pub excess: f64,
    /// Group of features with the most energy beyond the groups before it.
    pub of: &'static str,
    /// Output with the most.
    pub output: usize,
}

impl Structure {
    /// Whether it is more than chance.
    pub fn significant(&self) -> bool {
        self.z > LIMIT
    }
}

/// A group of features: what they have in common, and their series over one stretch.
type Group = (&'static str, Vec<Vec<f64>>);

pub(super) fn measure(comparison: &Comparison<'_>, jitter: Option<&Jitter>) -> Structure {
    let stretches = &comparison.data.stretches;
    let groups: Vec<Vec<Group>> = stretches.iter().enumerate().map(|(s, stretch)| features(comparison, s, stretch)).collect();
    let (mut energy, mut df, mut of) = (0.0, 0.0, Vec::<(&'static str, f64)>::new());
    let (mut worst, mut output) = (f64::NEG_INFINITY, 0);
    for i in 0..comparison.outputs() {
        let own = output_energy(comparison, &groups, i, jitter.map(|j| j.weights(comparison, i)));
        let (sum, count) = own.iter().fold((0.0, 0.0), |(e, d), (_, energy, count)| (e + energy, d + count));
        energy += sum;
        df += count;
        if sum - count > worst {
            (worst, output) = (sum - count, i);
        }
        for (name, part, count) in own {
            match of.iter_mut().find(|(n, _)| *n == name) {
                Some(entry) => entry.1 += part - count,
                None => of.push((name, part - count)),
            }
        }
    }
    let most = of.iter().max_by(|a, b| a.1.total_cmp(&b.1)).map_or("", |(name, _)| name);
    Structure { z: (energy - df) / (2.0 * df).sqrt().max(1.0), excess: (energy - df).max(0.0), of: most, output }
}

/// Energy of one output's whitened residual in each group of features, beyond the fit and the groups before: (group, energy, df).
/// Rows count by their weight: where stamps jitter, scatter is large where things change, which is no dependence on what changed.
fn output_energy(
    comparison: &Comparison<'_>,
    groups: &[Vec<Group>],
    output: usize,
    weights: Option<Vec<f64>>,
) -> Vec<(&'static str, f64, f64)> {
    let jacobian = &comparison.jacobian[output];
    let ranges = comparison.ranges();
    let count: usize = groups.first().map_or(0, |g| g.iter().map(|(_, f)| f.len()).sum());
    let (rows, known) = jacobian.shape();
    let mut matrix = DMatrix::zeros(rows, known + count + 1);
    matrix.view_mut((0, 0), (rows, known)).copy_from(jacobian);
    for ((range, groups), stretch) in ranges.iter().zip(groups).zip(&comparison.data.stretches) {
        for (j, feature) in groups.iter().flat_map(|(_, f)| f).enumerate() {
            let mut response = lagged(feature, &stretch.time, comparison.rates[output]);
            (comparison.whiten)(output, &mut response);
            matrix.view_mut((range.start, known + j), (range.len(), 1)).copy_from_slice(&response);
        }
    }
    matrix.column_mut(known + count).copy_from_slice(&comparison.drawn_in(output));
    if let Some(weights) = weights {
        matrix.row_iter_mut().zip(weights).for_each(|(mut row, w)| row *= w);
    }
    rewhiten(&mut matrix, &ranges, comparison.ordinary(output));
    let basis = spanning(&matrix);
    let innovations = &matrix.as_slice()[rows * (known + count)..];
    let mut own = basis.iter().skip(known);
    let names = groups.first().map(|g| g.iter().map(|(name, f)| (*name, f.len())).collect::<Vec<_>>()).unwrap_or_default();
    let mut parts = Vec::with_capacity(names.len());
    for (name, features) in names {
        let (mut energy, mut df) = (0.0, 0.0);
        for column in own.by_ref().take(features).flatten() {
            energy += dot(column, innovations).powi(2);
            df += 1.0;
        }
        parts.push((name, energy, df));
    }
    parts
}

/// Whitens all columns by the past of what the last one has beyond the others, of which nothing below an `ordinary` size is astray; rows in stretches.
fn rewhiten(matrix: &mut DMatrix<f64>, stretches: &[Range<usize>], ordinary: f64) {
    let basis = spanning(matrix);
    let mut rest = matrix.column(matrix.ncols() - 1).as_slice().to_vec();
    basis.iter().flatten().for_each(|known| clear(&mut rest, known));
    let cut = |column: &[f64]| stretches.iter().map(|rows| column[rows.clone()].to_vec()).collect::<Vec<_>>();
    let whiten = whitener(&cut(&rest), &basis.iter().flatten().map(|known| cut(known)).collect::<Vec<_>>(), ordinary);
    for mut column in matrix.column_iter_mut() {
        stretches.iter().for_each(|rows| whiten(&mut column.as_mut_slice()[rows.clone()]));
    }
}

/// Orthonormal columns that span those of a matrix but the last; none for one that says nothing of its own.
fn spanning(matrix: &DMatrix<f64>) -> Vec<Option<Vec<f64>>> {
    orthonormal(matrix.columns(0, matrix.ncols() - 1).column_iter().map(|column| column.as_slice().to_vec()), SPENT, 1)
}

/// A force's response: y' = −rate y + force, with the force held between samples.
fn lagged(force: &[f64], time: &[f64], rate: f64) -> Vec<f64> {
    let mut y = 0.0;
    let mut out = Vec::with_capacity(force.len());
    out.push(0.0);
    for k in 1..force.len() {
        let decay = (-rate.max(1e-3) * (time[k] - time[k - 1])).exp();
        y = decay * y + (1.0 - decay) * 0.5 * (force[k - 1] + force[k]);
        out.push(y);
    }
    out
}

/// The battery over one stretch. Motion is the simulated one: the measured would carry the noise that is to be tested.
fn features(comparison: &Comparison<'_>, s: usize, stretch: &Stretch) -> Vec<Group> {
    let run: &Channels = &comparison.model[s];
    let n = stretch.len();
    let scales = &comparison.scene.scales;
    let x: Vec<Vec<f64>> = run.iter().zip(&scales.outputs).map(|(c, scale)| c.iter().map(|v| v / scale).collect()).collect();
    let u: Vec<Vec<f64>> = stretch.inputs.iter().zip(&scales.inputs).map(|(c, scale)| c.iter().map(|v| v / scale).collect()).collect();
    let slopes: Vec<Vec<f64>> = x.iter().map(|c| super::slope(&stretch.time, c)).collect();
    let sides: Vec<Vec<f64>> = if comparison.scene.frame.has_wheels() {
        (0..2).map(|side| (0..n).map(|k| comparison.scene.frame.wheels(&[run[0][k], run[1][k]])[side] / scales.speed).collect()).collect()
    } else {
        x.clone()
    };
    let each = |series: &[Vec<f64>], f: &dyn Fn(f64) -> f64| -> Vec<Vec<f64>> {
        series.iter().map(|c| c.iter().map(|v| f(*v)).collect()).collect()
    };
    let product = |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a * b).collect() };
    let pairs = |a: &[Vec<f64>], b: &[Vec<f64>]| -> Vec<Vec<f64>> { a.iter().flat_map(|a| b.iter().map(move |b| product(a, b))).collect() };
    let magnitudes = each(&x, &f64::abs);
    let first = scales.time.0;
    let length = (scales.time.1 - first).max(f64::MIN_POSITIVE);
    let clock: Vec<f64> = stretch.time.iter().map(|t| (t - first) / length).collect();
    let mut groups: Vec<Group> = vec![
        (
            "the signs of the wheels' speeds",
            [each(&sides, &|s| (s / 0.02).tanh()), each(&sides, &|s| (s / 0.2).tanh()), each(&sides, &f64::abs)].concat(),
        ),
        (
            "speed beyond proportion",
            [pairs(&x, &magnitudes), each(&x, &|v| v * v), each(&x, &|v| v * v * v), pairs(&pairs(&x, &x), &x)].concat(),
        ),
        ("the command's size", [u.clone(), each(&u, &|v| v / (1.0 + (v / 0.15).powi(2))), each(&u, &|v| v * v * v)].concat()),
        (
            "the command's recent past",
            [0.1, 0.2, 0.4, 0.8]
                .into_iter()
                .flat_map(|lag| u.iter().map(move |c| shifted(c, (lag / scales.period).round() as usize)))
                .collect(),
        ),
        ("acceleration", [slopes.clone(), pairs(&slopes, &magnitudes), each(&slopes, &f64::abs), pairs(&slopes, &x)].concat()),
        (
            "the motion of the last seconds",
            [1.0, 3.0].into_iter().flat_map(|tau| x.iter().map(move |c| lagged(c, &stretch.time, 1.0 / tau))).collect(),
        ),
        ("time", {
            let mut all = vec![vec![1.0; n], clock.clone(), clock.iter().map(|t| t * t).collect()];
            all.extend([0.25, 0.5, 0.75].map(|at| clock.iter().map(|t| f64::from(u8::from(*t > at))).collect()));
            all.extend(x.iter().map(|c| product(c, &clock)));
            all
        }),
    ];
    let heading = &comparison.scene.tracks[s].heading;
    if heading.len() == n {
        let wave = |f: fn(f64) -> f64, k: f64| heading.iter().map(|h| f(k * h)).collect::<Vec<f64>>();
        groups.push(("heading", vec![wave(f64::cos, 1.0), wave(f64::sin, 1.0), wave(f64::cos, 2.0), wave(f64::sin, 2.0)]));
    }
    groups
}

/// The series some samples earlier; its first value before its start.
fn shifted(series: &[f64], lag: usize) -> Vec<f64> {
    (0..series.len()).map(|k| series[k.saturating_sub(lag)]).collect()
}
