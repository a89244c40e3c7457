//! Sensitivities of a free-run simulation to parameters and initial state, by central differences of whole simulations.
//!
//! Both runs of a difference take the same steps, so the difference is that of two smooth functions and good to about
//! 1e-9 of its size. This serves any model, closed form, expression or plugin alike; integrating the forward sensitivity
//! equations would need the model's Jacobians, and many more steps for the same accuracy, because their forcing is not
//! held between samples.

use std::borrow::Cow;

use super::Simulator;
use crate::dataset::Stretch;
use crate::model::ModelError;

/// Relative size of a difference step: its truncation error is the square of it, its rounding error 1e-16 over it.
pub const DIFFERENCE: f64 = 1e-5;
/// Rows between two looks at whether the initial state is forgotten.
const BLOCK: usize = 64;

/// A direction in parameter space with the length of the difference step along it.
#[derive(Debug, Clone, PartialEq)]
pub struct Direction {
    /// dθ/dz, one entry a parameter.
    pub along: Vec<f64>,
    /// Step in z to either side, positive.
    pub step: f64,
}

/// dŷ/dz and dŷ/dx0 over a stretch.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Sensitivities {
    /// By direction, then output, then row.
    pub parameters: Vec<Vec<Vec<f64>>>,
    /// By initial state, then output, then row.
    pub initial: Vec<Vec<Vec<f64>>>,
}

impl Simulator<'_> {
    /// Sensitivities over a stretch about the current parameters and `initial`. The steps are those of
    /// [`with_max_step`](Self::with_max_step), or chosen once for all runs.
    ///
    /// # Errors
    /// [`ModelError`] if a run to either side fails.
    pub fn sensitivities(&mut self, stretch: &Stretch, initial: &[f64], directions: &[Direction]) -> Result<Sensitivities, ModelError> {
        self.differences(stretch, initial, directions, None)
    }

    /// The same at half the cost and good to about 1e-5 of its size, enough for a step of a search: differences to one side of
    /// `run`, which is the free run at the current parameters with the same steps. Those to `initial` are central.
    ///
    /// # Errors
    /// As [`sensitivities`](Self::sensitivities).
    pub(crate) fn slopes(
        &mut self,
        stretch: &Stretch,
        initial: &[f64],
        directions: &[Direction],
        run: &[Vec<f64>],
    ) -> Result<Sensitivities, ModelError> {
        self.differences(stretch, initial, directions, Some(run))
    }

    fn differences(
        &mut self,
        stretch: &Stretch,
        initial: &[f64],
        directions: &[Direction],
        base: Option<&[Vec<f64>]>,
    ) -> Result<Sensitivities, ModelError> {
        self.max_step = match self.fixed_step {
            Some(step) => step,
            None => self.chosen_step(stretch)?,
        };
        let centre = self.theta.clone();
        let mut shifted = centre.clone();
        let mut parameters = Vec::with_capacity(directions.len());
        for direction in directions {
            let mut side = |simulator: &mut Self, step: f64| {
                for ((s, c), d) in shifted.iter_mut().zip(&centre).zip(&direction.along) {
                    *s = c + step * d;
                }
                simulator.set_theta(&shifted)?;
                let mut run = vec![Vec::new(); initial.len()];
                simulator.begin(stretch.len(), initial, &mut run);
                simulator.proceed(stretch, 1..stretch.len(), &mut run).map(|()| run)
            };
            let sides = side(self, direction.step).and_then(|up| match base {
                Some(base) => Ok((up, Cow::Borrowed(base), direction.step)),
                None => Ok((up, Cow::Owned(side(self, -direction.step)?), 2.0 * direction.step)),
            });
            if sides.is_err() {
                self.set_theta(&centre)?;
            }
            let (mut up, down, apart) = sides?;
            difference(&mut up, &down, 0, apart);
            parameters.push(up);
        }
        self.set_theta(&centre)?;
        let initial = self.initial_sensitivities(stretch, initial)?;
        Ok(Sensitivities { parameters, initial })
    }

    /// The initial state is forgotten within a few time constants: the two runs end where they differ by less
    /// than 1e-9 of the step.
    fn initial_sensitivities(&mut self, stretch: &Stretch, initial: &[f64]) -> Result<Vec<Vec<Vec<f64>>>, ModelError> {
        let n = initial.len();
        let size = stretch.outputs.iter().flatten().chain(initial).fold(0.0_f64, |m, x| m.max(x.abs())).max(f64::MIN_POSITIVE);
        let step = DIFFERENCE * size;
        let mut columns = Vec::with_capacity(n);
        for j in 0..n {
            let mut runs = [vec![Vec::new(); n], vec![Vec::new(); n]];
            let mut states = [initial.to_vec(), initial.to_vec()];
            states[0][j] += step;
            states[1][j] -= step;
            for (run, state) in runs.iter_mut().zip(&states) {
                self.begin(stretch.len(), state, run);
            }
            let mut row = 1;
            while row < stretch.len() {
                let end = (row + BLOCK).min(stretch.len());
                for (run, state) in runs.iter_mut().zip(&mut states) {
                    self.stages.state.copy_from_slice(state);
                    self.proceed(stretch, row..end, run)?;
                    state.copy_from_slice(&self.stages.state);
                }
                let [up, down] = &runs;
                let apart = up.iter().zip(down).flat_map(|(u, d)| u[row..].iter().zip(&d[row..])).any(|(u, d)| (u - d).abs() > 1e-9 * step);
                row = end;
                if !apart {
                    break;
                }
            }
            let [mut up, down] = runs;
            difference(&mut up, &down, stretch.len(), 2.0 * step);
            columns.push(up);
        }
        Ok(columns)
    }
}

/// (up − down) / apart in place, padded with zeros to `rows`.
fn difference(up: &mut [Vec<f64>], down: &[Vec<f64>], rows: usize, apart: f64) {
    for (u, d) in up.iter_mut().zip(down) {
        u.iter_mut().zip(d).for_each(|(u, d)| *u = (*u - d) / apart);
        let padded = u.len().max(rows);
        u.resize(padded, 0.0);
    }
}
