//! Where the search starts: integral regression, and how large each parameter could plausibly be.
//!
//! The equations are summed over windows: accelerations become differences of the outputs over the window, outputs
//! their trapezoids, inputs their exact integrals. That needs no filter and no run of a minimum length. It is biased by
//! noise and by the curvature between samples; the free-run fit takes both out.

use nalgebra::{DMatrix, DVector};
use wheelwright_core::model::Sample;
use wheelwright_core::solver::{Problem, SolveError};

use wheelwright_core::least_squares::{Factor, Limits, constrained_step};

/// Windows \[s\] that give a start each: for quick robots with little noise, and for slow ones with much.
const WINDOWS: [f64; 3] = [1.0, 0.3, 3.0];

/// Rows Φ and y between neighbouring samples, times the interval, summed up from the start of each stretch.
pub(crate) struct Integrals {
    equations: usize,
    parameters: usize,
    /// By stretch: times, then one row of (equations × (parameters + 1)) sums a sample.
    stretches: Vec<(Vec<f64>, Vec<Vec<f64>>)>,
    /// By equation, then parameter: root mean square of Φ.
    size: Vec<Vec<f64>>,
    /// By equation: root mean square of the response y − Φ c of the free parameters.
    response: Vec<f64>,
}

impl Integrals {
    pub(crate) fn new(problem: &Problem<'_>) -> Self {
        let (equations, parameters) = (problem.model.equations(), problem.model.parameters().len());
        let (mut phi, mut y) = (vec![0.0; equations * parameters], vec![0.0; equations]);
        let mut size = vec![vec![0.0; parameters]; equations];
        let mut response = vec![0.0; equations];
        let mut duration = 0.0;
        let mut stretches = Vec::with_capacity(problem.data.stretches.len());
        for stretch in &problem.data.stretches {
            let mut sums = vec![vec![0.0; equations * (parameters + 1)]];
            for k in 1..stretch.len() {
                let interval = stretch.time[k] - stretch.time[k - 1];
                let inputs: Vec<f64> = stretch.inputs.iter().map(|c| c[k - 1]).collect();
                let outputs: Vec<f64> = stretch.outputs.iter().map(|c| 0.5 * (c[k - 1] + c[k])).collect();
                let accelerations: Vec<f64> = stretch.outputs.iter().map(|c| (c[k] - c[k - 1]) / interval).collect();
                problem.model.regressor(Sample { inputs: &inputs, outputs: &outputs, accelerations: &accelerations }, &mut phi, &mut y);
                let mut sum = sums[k - 1].clone();
                for e in 0..equations {
                    for p in 0..parameters {
                        let value = phi[e * parameters + p];
                        sum[e * (parameters + 1) + p] += interval * value;
                        size[e][p] += interval * value * value;
                    }
                    sum[e * (parameters + 1) + parameters] += interval * y[e];
                    let known: f64 = (0..parameters).map(|p| phi[e * parameters + p] * problem.map.offset[p]).sum();
                    response[e] += interval * (y[e] - known).powi(2);
                }
                duration += interval;
                sums.push(sum);
            }
            stretches.push((stretch.time.clone(), sums));
        }
        size.iter_mut().flatten().for_each(|s| *s = (*s / duration).sqrt());
        response.iter_mut().for_each(|r| *r = (*r / duration).sqrt());
        Self { equations, parameters, stretches, size, response }
    }

    /// Free parameters that no recording like this can tell: those that no equation sees, and those of an equation
    /// without response, Φ T z = 0, which every multiple of a solution solves as well.
    pub(crate) fn hidden(&self, transform: &DMatrix<f64>) -> Vec<usize> {
        let (smallest, largest) = (f64::EPSILON, self.response.iter().copied().fold(0.0, f64::max));
        let answered = |e: usize| self.response[e] > smallest * largest;
        let seen = |p: usize| {
            let in_equations: Vec<usize> = (0..self.equations).filter(|&e| self.size[e][p] > 0.0).collect();
            in_equations.iter().any(|&e| answered(e))
        };
        (0..transform.ncols()).filter(|&j| !(0..self.parameters).any(|p| transform[(p, j)] != 0.0 && seen(p))).collect()
    }

    /// Regression over windows of a length \[s\], half overlapping; θ = T z + c.
    fn factor(&self, transform: &DMatrix<f64>, offset: &DVector<f64>, window: f64) -> Factor {
        let free = transform.ncols();
        let mut rows: Vec<f64> = Vec::new();
        for (time, sums) in &self.stretches {
            let span = time[time.len() - 1] - time[0];
            let length = ((window.min(0.5 * span) / span * (time.len() - 1) as f64).round() as usize).max(1);
            for start in (0..time.len() - length).step_by((length / 2).max(1)) {
                for e in 0..self.equations {
                    let at = |p: usize| {
                        let column = e * (self.parameters + 1) + p;
                        sums[start + length][column] - sums[start][column]
                    };
                    let phi = DVector::from_fn(self.parameters, |p, _| at(p));
                    rows.extend((transform.tr_mul(&phi)).iter());
                    rows.push(phi.dot(offset) - at(self.parameters));
                }
            }
        }
        Factor::of(DMatrix::from_row_slice(rows.len() / (free + 1), free + 1, &rows))
    }

    /// One start a window, within the limits.
    pub(crate) fn starts(&self, transform: &DMatrix<f64>, offset: &DVector<f64>, limits: &Limits) -> Result<Vec<DVector<f64>>, SolveError> {
        let origin = DVector::zeros(transform.ncols());
        WINDOWS.iter().map(|w| constrained_step(&self.factor(transform, offset, *w), None, &origin, limits)).collect()
    }

    /// How large each parameter is when its term alone is as large as its whole equation at `theta`; infinite for one
    /// that no equation sees.
    fn scale(&self, theta: &[f64]) -> Vec<f64> {
        let whole: Vec<f64> = self.size.iter().map(|row| row.iter().zip(theta).map(|(s, t)| (s * t).powi(2)).sum::<f64>().sqrt()).collect();
        let of = |p: usize| self.size.iter().zip(&whole).map(|(row, w)| w / row[p]).filter(|s| s.is_finite()).fold(f64::INFINITY, f64::min);
        (0..self.parameters).map(of).collect()
    }

    /// The same for each free parameter z, with θ = T z + c.
    pub(crate) fn free_scale(&self, transform: &DMatrix<f64>, theta: &[f64]) -> Vec<f64> {
        let scale = self.scale(theta);
        let of = |j: usize| scale.iter().zip(transform.column(j).iter()).map(|(s, t)| s / t.abs()).fold(f64::INFINITY, f64::min);
        (0..transform.ncols()).map(of).collect()
    }
}
