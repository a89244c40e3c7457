//! The model's own lag as a filter, and what comes through it: instruments and measured regressors.
//!
//! About a free run x_s the equation error Φ(u, x, x') θ − y of any other course x = x_s + δ is M δ' + K δ to first order,
//! with M and K its derivatives with respect to accelerations and outputs along the run. Solving
//!
//! M δ' + K δ = −Φ T                                                                                   (1)
//!
//! over a stretch, one column a free parameter, turns columns of an equation into columns of the outputs: the prefilter
//! 1/A of SRIVC (Young and Jakeman, Int. J. Control 31, 1980; Garnier and Young 2008), here with coefficients that follow
//! the motion, so that products and friction in a model are served as well. With Φ taken on the run itself the columns
//! are instruments, free of the measurement's noise; with Φ taken on the measurement, joined by straight lines, they are
//! regressors. The filter integrates, so accelerations are slopes between samples, and stamps may be as they like.
//!
//! (1) is stepped by the implicit midpoint rule, stable for every step: an error in it costs a little efficiency, never
//! consistency, because estimates rest on the free run itself (see [`iv`](crate::iv)).

use nalgebra::{DMatrix, DVectorView};
use wheelwright_core::Stretch;
use wheelwright_core::model::{ModelError, RegressorModel, Sample};
use wheelwright_core::simulation::{Readout, Simulator};

use crate::output_error::Channels;

/// Steps of the filter in its shortest time constant: the midpoint rule then errs by half a percent.
const STEPS: f64 = 4.0;
/// Most steps between two samples.
const MOST: usize = 32;
/// Share of an output's largest value over which K is differenced: exact for equations of second degree, and wide enough
/// to make a finite slope of dry friction.
const SPAN: f64 = 0.01;

/// Columns over one stretch, by column, then output, then row.
pub(crate) struct Columns {
    /// Response to each output's start.
    pub(crate) initial: Vec<Channels>,
    /// One a free parameter, Φ on the free run.
    pub(crate) instruments: Vec<Channels>,
    /// One a free parameter, Φ on the measurement.
    pub(crate) regressors: Vec<Channels>,
}

/// The filter at one θ.
pub(crate) struct Prefilter<'a> {
    model: &'a dyn RegressorModel,
    theta: Vec<f64>,
    transform: &'a DMatrix<f64>,
    readout: Readout,
    simulator: Simulator<'a>,
    phi: Vec<f64>,
    y: Vec<f64>,
}

impl<'a> Prefilter<'a> {
    /// `step` bounds that of the free run \[s\].
    pub(crate) fn new(
        model: &'a dyn RegressorModel,
        theta: &[f64],
        transform: &'a DMatrix<f64>,
        readout: Readout,
        step: f64,
    ) -> Result<Self, ModelError> {
        let (equations, parameters) = (model.equations(), theta.len());
        let simulator = Simulator::new(model, theta)?.with_max_step(step);
        let (phi, y) = (vec![0.0; equations * parameters], vec![0.0; equations]);
        Ok(Self { model, theta: theta.to_vec(), transform, readout, simulator, phi, y })
    }

    /// The columns over a stretch whose free run starts at `start`.
    pub(crate) fn columns(&mut self, stretch: &Stretch, start: &[f64]) -> Result<Columns, ModelError> {
        let (n, free) = (start.len(), self.transform.ncols());
        let largest: Vec<f64> = stretch.outputs.iter().map(|c| c.iter().fold(0.0_f64, |m, x| m.max(x.abs()))).collect();
        let spans: Vec<f64> = largest.iter().map(|l| if *l > 0.0 { SPAN * l } else { SPAN }).collect();
        let parts = self.parts(stretch, &largest)?;
        let run = self.run(stretch, start, &parts)?;
        let mut measured = Measured::new(stretch, self.readout);
        let mut states = DMatrix::zeros(n, n + 2 * free);
        states.fill_diagonal(1.0);
        let mut columns = vec![vec![Vec::with_capacity(stretch.len()); n]; n + 2 * free];
        record(&states, &mut columns);
        let (mut forcing, mut middle) = (DMatrix::zeros(n, n + 2 * free), vec![0.0; n]);
        let (mut accelerations, mut slopes) = (vec![0.0; n], vec![0.0; n]);
        let mut row = 0;
        for k in 1..stretch.len() {
            let interval = stretch.time[k] - stretch.time[k - 1];
            let inputs: Vec<f64> = stretch.inputs.iter().map(|c| c[k - 1]).collect();
            let h = interval / parts[k - 1] as f64;
            let mut travelled = DMatrix::zeros(n, n + 2 * free);
            for part in 0..parts[k - 1] {
                // Every other row of the fine run is the middle of a step.
                middle.iter_mut().zip(&run).for_each(|(m, c)| *m = c[row + 1]);
                row += 2;
                self.model.accelerations(&self.theta, &inputs, &middle, &mut accelerations)?;
                let [mass, stiffness] = self.linearised(&inputs, &mut middle, &mut accelerations, &spans);
                self.force(Sample { inputs: &inputs, outputs: &middle, accelerations: &accelerations }, &mut forcing, n);
                measured.at(stretch.time[k - 1] + (part as f64 + 0.5) * h, &mut middle, &mut slopes);
                self.force(Sample { inputs: &inputs, outputs: &middle, accelerations: &slopes }, &mut forcing, n + free);
                let mut next = (&mass - 0.5 * h * &stiffness) * &states + h * &forcing;
                let solved = (mass + 0.5 * h * stiffness).lu().solve_mut(&mut next);
                if !solved || next.iter().any(|x| !x.is_finite()) {
                    return Err(ModelError::Diverged { model: self.model.name().to_owned(), time: stretch.time[k] });
                }
                travelled += 0.5 * h * (&states + &next);
                states = next;
            }
            match self.readout {
                Readout::Instantaneous => record(&states, &mut columns),
                Readout::IntervalMean => record(&(travelled / interval), &mut columns),
            }
        }
        let regressors = columns.split_off(n + free);
        let instruments = columns.split_off(n);
        Ok(Columns { initial: columns, instruments, regressors })
    }

    /// Steps of the filter in each interval between samples.
    fn parts(&mut self, stretch: &Stretch, largest: &[f64]) -> Result<Vec<usize>, ModelError> {
        let n = largest.len();
        let (inputs, mut rest, mut still) = (vec![0.0; stretch.inputs.len()], vec![0.0; n], vec![0.0; n]);
        let spans: Vec<f64> = largest.iter().map(|l| if *l > 0.0 { *l } else { 1.0 }).collect();
        let [mass, stiffness] = self.linearised(&inputs, &mut rest, &mut still, &spans);
        let singular = || ModelError::Singular { model: self.model.name().to_owned() };
        let rates = mass.lu().solve(&stiffness).ok_or_else(singular)?;
        let fastest = rates.row_iter().map(|r| r.iter().map(|x| x.abs()).sum::<f64>()).fold(0.0, f64::max);
        let parts = |w: &[f64]| (((w[1] - w[0]) * fastest * STEPS).ceil() as usize).clamp(1, MOST);
        Ok(stretch.time.windows(2).map(parts).collect())
    }

    /// The free run at the ends and the middle of every step.
    fn run(&mut self, stretch: &Stretch, start: &[f64], parts: &[usize]) -> Result<Vec<Vec<f64>>, ModelError> {
        let mut fine = Stretch {
            label: String::new(),
            time: vec![stretch.time[0]],
            inputs: vec![Vec::new(); stretch.inputs.len()],
            outputs: Vec::new(),
        };
        for (k, count) in parts.iter().enumerate() {
            let (from, to) = (stretch.time[k], stretch.time[k + 1]);
            let halves = 2 * count;
            fine.time.extend((1..halves).map(|i| from + (to - from) * i as f64 / halves as f64));
            fine.time.push(to);
            fine.inputs.iter_mut().zip(&stretch.inputs).for_each(|(f, c)| f.resize(f.len() + halves, c[k]));
        }
        let mut run = vec![Vec::new(); start.len()];
        self.simulator.run(&fine, start, &mut run)?;
        Ok(run)
    }

    /// M and K at a point of the run; the point is left as it was.
    fn linearised(&mut self, inputs: &[f64], outputs: &mut [f64], accelerations: &mut [f64], spans: &[f64]) -> [DMatrix<f64>; 2] {
        let n = outputs.len();
        let (mut mass, mut stiffness) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        for j in 0..n {
            for sign in [1.0, -1.0] {
                let (x, a) = (outputs[j], accelerations[j]);
                accelerations[j] = a + sign;
                self.add_error(Sample { inputs, outputs, accelerations }, 0.5 * sign, mass.column_mut(j).as_mut_slice());
                accelerations[j] = a;
                outputs[j] = x + sign * spans[j];
                self.add_error(Sample { inputs, outputs, accelerations }, 0.5 * sign / spans[j], stiffness.column_mut(j).as_mut_slice());
                outputs[j] = x;
            }
        }
        [mass, stiffness]
    }

    /// Adds a share of Φ θ − y.
    fn add_error(&mut self, sample: Sample<'_>, share: f64, to: &mut [f64]) {
        self.model.regressor(sample, &mut self.phi, &mut self.y);
        for ((to, row), y) in to.iter_mut().zip(self.phi.chunks_exact(self.theta.len())).zip(&self.y) {
            *to += share * (row.iter().zip(&self.theta).map(|(p, t)| p * t).sum::<f64>() - y);
        }
    }

    /// Writes −Φ T into the columns from `first`.
    fn force(&mut self, sample: Sample<'_>, forcing: &mut DMatrix<f64>, first: usize) {
        self.model.regressor(sample, &mut self.phi, &mut self.y);
        for (e, row) in self.phi.chunks_exact(self.theta.len()).enumerate() {
            let row = DVectorView::from_slice(row, row.len());
            for (j, column) in self.transform.column_iter().enumerate() {
                forcing[(e, first + j)] = -row.dot(&column);
            }
        }
    }
}

fn record(states: &DMatrix<f64>, columns: &mut [Channels]) {
    for (column, state) in columns.iter_mut().zip(states.column_iter()) {
        column.iter_mut().zip(state.iter()).for_each(|(c, x)| c.push(*x));
    }
}

/// The measurement at any time, going forward: straight lines between samples, a mean over an interval standing in its
/// middle.
struct Measured<'a> {
    outputs: &'a [Vec<f64>],
    knots: Vec<f64>,
    /// The line in use runs from this knot to the next.
    line: usize,
}

impl<'a> Measured<'a> {
    fn new(stretch: &'a Stretch, readout: Readout) -> Self {
        let time = &stretch.time;
        let knots = match readout {
            Readout::Instantaneous => time.clone(),
            Readout::IntervalMean => time.iter().take(1).copied().chain(time.windows(2).map(|w| 0.5 * (w[0] + w[1]))).collect(),
        };
        Self { outputs: &stretch.outputs, knots, line: 0 }
    }

    fn at(&mut self, time: f64, outputs: &mut [f64], slopes: &mut [f64]) {
        while self.line + 2 < self.knots.len() && time > self.knots[self.line + 1] {
            self.line += 1;
        }
        let (from, to) = (self.knots[self.line], self.knots[self.line + 1]);
        for ((x, slope), column) in outputs.iter_mut().zip(slopes).zip(self.outputs) {
            let before = column[self.line];
            *slope = (column[self.line + 1] - before) / (to - from);
            *x = before + *slope * (time - from);
        }
    }
}
