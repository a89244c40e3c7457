//! How a run changes with parameters and its initial outputs, carried along beside it.
//!
//! δx' = ∂F/∂x δx + ∂F/∂p δp has the run's own linear part stepped exactly, and the rest by
//!
//! δx⁺ = e^{hL} δx + h φ1(hL) (S ((1 − w) δx + w δx⁺) + ∂F/∂p δp).
//!
//! S is what is left of ∂F/∂x, as secants over what the step moves: a kink that is crossed within it counts by its jump over the time that this
//! takes, as it does for the motion (the saltation of Filippov's theory; di Bernardo and others, Piecewise-smooth Dynamical Systems, 2008, section 2.5).
//! The rule is that of the midpoint, w = 1/2, unless forces hold the outputs so firmly that the step is longer than they take: then it leaves none
//! of a difference that they take away, as w = 1 − 1/z does with z the size of hS.

use nalgebra::DMatrix;

use super::slots::Slots;
use super::step::{RightSide, Work};
use crate::effect::Instant;
use crate::model::ModelError;
use crate::simulation::{row, square_row};

/// Half of the least distance over which a secant is taken, in terms of the outputs' root mean square.
const NEAR: f64 = 1e-5;

/// Steps that it is worth to carry tangents along one, and directions of effects' values that are worth another, as measured (`benches/stepping.rs`).
const EFFORT: (u64, u64) = (2, 2);

/// A direction in which parameters may go.
#[derive(Debug, Clone)]
pub struct Direction {
    /// The model's parameters some way along it.
    pub theta: Vec<f64>,
    /// The effects' values there.
    pub values: Vec<f64>,
    /// How far that is.
    pub by: f64,
}

/// What the outputs of a run change by, along each direction and with each initial output.
#[derive(Debug)]
pub(super) struct Tangents<'a> {
    directions: Vec<Direction>,
    /// The effects along each of them, where they have other values there.
    moved: Vec<Option<Slots<'a>>>,
    /// What carrying them along a step costs, in terms of a step.
    pub(super) effort: u64,
    outputs: usize,
    /// Changes of the outputs now, one tangent after the other, and of the way since the last sample.
    now: Vec<f64>,
    travelled: Vec<f64>,
    /// Those at the samples: one vector an output of each tangent.
    pub(super) series: Vec<Vec<Vec<f64>>>,
    slopes: Vec<f64>,
    /// What brings the sums of a step to its end.
    system: DMatrix<f64>,
    point: Vec<f64>,
    ahead: Vec<f64>,
    behind: Vec<f64>,
    pushed: Vec<f64>,
    /// What the loads leave of the command.
    net: Vec<f64>,
}

/// The step along which tangents are carried.
pub(super) struct Along<'s> {
    /// Its middle.
    pub(super) at: &'s Instant<'s>,
    /// Outputs at its start, in its middle and at its end.
    pub(super) outputs: [&'s [f64]; 3],
    /// The command in its middle.
    pub(super) u: &'s [f64],
    pub(super) state: &'s [f64],
    /// One over the root mean square of each output.
    pub(super) fineness: &'s [f64],
}

impl<'a> Tangents<'a> {
    pub(super) fn new(directions: &[Direction], slots: &Slots<'a>, outputs: usize, rows: usize) -> Self {
        let count = directions.len() + outputs;
        let mut now = vec![0.0; count * outputs];
        (0..outputs).for_each(|i| now[(directions.len() + i) * outputs + i] = 1.0);
        let moved: Vec<Option<Slots<'a>>> = directions.iter().map(|direction| slots.moved(&direction.values)).collect();
        let first = |t: usize| (0..outputs).map(|i| Self::begun(rows, now[t * outputs + i])).collect();
        Self {
            series: (0..count).map(first).collect(),
            travelled: vec![0.0; now.len()],
            now,
            effort: EFFORT.0 + moved.iter().flatten().count() as u64 / EFFORT.1,
            moved,
            directions: directions.to_vec(),
            outputs,
            slopes: vec![0.0; outputs * outputs],
            system: DMatrix::zeros(outputs, outputs),
            point: vec![0.0; outputs],
            ahead: vec![0.0; outputs],
            behind: vec![0.0; outputs],
            pushed: vec![0.0; outputs],
            net: Vec::new(),
        }
    }

    fn begun(rows: usize, first: f64) -> Vec<f64> {
        let mut series = Vec::with_capacity(rows);
        series.push(first);
        series
    }

    /// Records a sample; `over` is the time since the last one where means over it are read.
    pub(super) fn sample(&mut self, over: Option<f64>) {
        let seen = if over.is_some() { &self.travelled } else { &self.now };
        let scale = over.map_or(1.0, |interval| 1.0 / interval);
        self.series.iter_mut().flatten().zip(seen).for_each(|(series, value)| series.push(scale * value));
        self.travelled.fill(0.0);
    }

    /// Carries them along a step.
    pub(super) fn carry<const N: usize, const DIAGONAL: bool>(
        &mut self,
        right: &RightSide<'_, '_>,
        along: &Along<'_>,
        work: &mut Work,
        h: f64,
    ) -> Result<(), ModelError> {
        self.secants::<N, DIAGONAL>(right, along, work)?;
        let n = self.outputs::<N>();
        let [_, _, full, start, middle] = right.linear.weights(if DIAGONAL { n } else { n * n });
        let w = (1.0 - 1.0 / (h * self.firmness::<N>(along.fineness))).max(0.5);
        let forced = |values: &[f64], i: usize| row::<DIAGONAL>(start, i, values) + row::<DIAGONAL>(middle, i, values);
        let Self { slopes, system, point, ahead, behind, pushed, .. } = self;
        let (slopes, point, ahead, behind, pushed) =
            (&slopes[..n * n], &mut point[..n], &mut ahead[..n], &mut behind[..n], &mut pushed[..n]);
        for k in 0..n {
            point.iter_mut().enumerate().for_each(|(i, value)| *value = slopes[i * n + k]);
            (0..n).for_each(|i| system[(i, k)] = f64::from(u8::from(i == k)) - w * forced(point, i));
        }
        if !system.try_inverse_mut() {
            return Err(ModelError::Singular { model: right.model.name().to_owned() });
        }
        let (at, mid, u, state) = (along.at, along.outputs[1], along.u, along.state);
        right.left::<N>(at, mid, u, state, work);
        self.net.clone_from(&work.net);
        right.model.accelerations(right.theta, &self.net, mid, behind)?;
        let tangents = self.now.chunks_exact_mut(n).zip(self.travelled.chunks_exact_mut(n));
        for (t, (now, travelled)) in tangents.enumerate() {
            match self.directions.get(t).zip(self.moved.get(t)) {
                Some((Direction { theta, by, .. }, moved)) => {
                    match moved {
                        Some(slots) => RightSide { theta, slots, ..*right }.accelerations::<N>(at, mid, u, state, work, ahead)?,
                        None => right.model.accelerations(theta, &self.net, mid, ahead)?,
                    }
                    (0..n).for_each(|i| pushed[i] = (ahead[i] - behind[i]) / by);
                }
                None => pushed.fill(0.0),
            }
            (0..n).for_each(|i| pushed[i] += (1.0 - w) * square_row(slopes, i, now));
            (0..n).for_each(|i| point[i] = row::<DIAGONAL>(full, i, now) + forced(pushed, i));
            for i in 0..n {
                let end: f64 = (0..n).map(|k| system[(i, k)] * point[k]).sum();
                travelled[i] += 0.5 * h * (now[i] + end);
                now[i] = end;
            }
        }
        Ok(())
    }

    /// What is not the linear part's of how the accelerations change with the outputs, over what the step moves.
    fn secants<const N: usize, const DIAGONAL: bool>(
        &mut self,
        right: &RightSide<'_, '_>,
        along: &Along<'_>,
        work: &mut Work,
    ) -> Result<(), ModelError> {
        let (n, [from, mid, to]) = (self.outputs::<N>(), along.outputs);
        let Self { slopes, point, ahead, behind, .. } = self;
        let (slopes, point, ahead, behind) = (&mut slopes[..n * n], &mut point[..n], &mut ahead[..n], &mut behind[..n]);
        for k in 0..n {
            let half = (0.5 * (to[k] - from[k]).abs()).max(NEAR / along.fineness[k]);
            for (sign, out) in [(1.0, &mut *ahead), (-1.0, &mut *behind)] {
                point.copy_from_slice(mid);
                point[k] += sign * half;
                right.accelerations::<N>(along.at, point, along.u, along.state, work, out)?;
                (0..n).for_each(|i| out[i] -= row::<DIAGONAL>(&right.linear.part, i, point));
            }
            let over = 0.5 / half;
            (0..n).for_each(|i| slopes[i * n + k] = (ahead[i] - behind[i]) * over);
        }
        Ok(())
    }

    #[inline(always)]
    fn outputs<const N: usize>(&self) -> usize {
        if N == 0 { self.outputs } else { N }
    }

    /// The largest rate at which they take differences away, each output in terms of its root mean square.
    fn firmness<const N: usize>(&self, fineness: &[f64]) -> f64 {
        let n = self.outputs::<N>();
        let of = |i: usize| (0..n).map(|k| (self.slopes[i * n + k] * fineness[i] / fineness[k]).abs()).sum::<f64>();
        (0..n).map(of).fold(0.0, f64::max)
    }
}
