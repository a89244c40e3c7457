//! Recursive Gauss-Newton on the free-run error: what gives the estimates of `recursive` honest intervals.
//!
//! The regression's columns hold measured outputs, whose noise pulls its estimates towards zero by many of their standard
//! errors. So once the regression knows θ, the model runs freely beside the robot, once with the parameters ẑ about which it is
//! linearised and once with each of them a little off. The differences are the sensitivities ψ, and each sample gives a row
//!
//! ψᵀ z = e + ψᵀ ẑ,  e = y − ŷ
//!
//! an output, in which only e carries noise. Rows pass through the whitening filter of e, an autoregression, and into a triangle.
//! Every time the rows have doubled, the model is linearised anew about what they say. Rows of a point far from the estimate are
//! dropped while it is still being approached; rows of a stretch count from where its measured first sample is forgotten.

use wheelwright_core::model::{ParameterMap, RegressorModel};
use wheelwright_core::simulation::Simulator;

use super::Recursive;
use super::colour::{Colour, ORDER};
use super::givens::Givens;

/// Rows before the first look at the estimate, as a multiple of the number of unknowns.
const FIRST_LOOK: usize = 10;
/// A move of the estimate by more than this many standard errors asks for rows about the new point.
const FAR: f64 = 5.0;
/// A move this small against the parameter leaves the linearisation as good as it was, whatever the standard error.
const SLIGHT: f64 = 1e-4;
/// Share of an error's variance that its own past may foretell. Beyond it is no noise but the trace of what the model lacks.
const FORETOLD: f64 = 0.95;
/// An error this small against the largest output does not matter, whatever it is.
const IMMATERIAL: f64 = 1e-3;
/// Correlation of neighbouring errors, in the mean over the outputs, below which each undoes part of the one before: −1/2 where counts of
/// an encoder are differenced and their rounding is all there is, 0 for a gyroscope's noise. Each of them below what chance reaches: four
/// over the root of the samples.
const UNDONE: f64 = -0.25;
const CHANCE: f64 = 4.0;
/// Offset of the runs that give the sensitivities, in standard errors.
const OFFSET: f64 = 0.01;
/// Offset relative to the parameter where it has no standard error to speak of.
const LEAST_OFFSET: f64 = 1e-7;
/// Share of an offset of the start below which it is forgotten.
const FORGOTTEN: f64 = 0.02;
/// Size of the free run, in units of the largest output seen, beyond which it has diverged.
const DIVERGED: f64 = 100.0;

/// The free run beside the robot.
#[derive(Debug)]
pub(super) struct FreeRun<'a> {
    map: ParameterMap,
    memory_s: Option<f64>,
    /// The run at `point`, then one a free parameter that is off by its offset, then one whose start was off.
    runs: Vec<Simulator<'a>>,
    point: Vec<f64>,
    offsets: Vec<f64>,
    /// One over each offset.
    scales: Vec<f64>,
    running: bool,
    settled: bool,
    /// Samples until the next attempt, while it does not run.
    pause: usize,
    failures: u32,
    largest: Vec<f64>,
    kick: Vec<f64>,
    colours: Vec<Colour>,
    /// Rows before whitening, a ring of `ORDER` + 1 samples.
    history: Vec<f64>,
    next: usize,
    filled: usize,
    row: Vec<f64>,
    triangle: Givens,
    /// Sums of the weights of the samples taken in, and of their squares.
    weight: f64,
    squares: f64,
    look_at: f64,
    z: Vec<f64>,
    scratch: Vec<f64>,
    theta: Vec<f64>,
    /// True while the estimate stays near the points its rows were made about.
    ready: bool,
    /// Why there is none, when last looked at.
    refusal: Option<&'static str>,
    /// Whether each error undid part of the one before, when last looked at.
    undone: bool,
}

impl<'a> FreeRun<'a> {
    pub(super) fn new(model: &'a dyn RegressorModel, map: &ParameterMap, settings: &Recursive) -> Self {
        let (outputs, free) = (model.outputs().len(), map.free.len());
        Self {
            map: map.clone(),
            memory_s: settings.memory_s,
            runs: (0..free + 2).map(|_| Simulator::unset(model).with_readout(settings.velocity.readout())).collect(),
            point: vec![0.0; free],
            offsets: vec![0.0; free],
            scales: vec![0.0; free],
            running: false,
            settled: false,
            pause: 0,
            failures: 0,
            largest: vec![0.0; outputs],
            kick: vec![0.0; outputs],
            colours: vec![Colour::default(); outputs],
            history: vec![0.0; (ORDER + 1) * outputs * (free + 1)],
            next: 0,
            filled: 0,
            row: vec![0.0; free + 1],
            triangle: Givens::new(free),
            weight: 0.0,
            squares: 0.0,
            look_at: 0.0,
            z: vec![0.0; free],
            scratch: vec![0.0; free.max(outputs)],
            theta: vec![0.0; map.offset.len()],
            ready: false,
            refusal: None,
            undone: false,
        }
    }

    /// True if each error undid part of the one before, on every output, when last looked at.
    pub(super) fn undone(&self) -> bool {
        self.undone
    }

    /// True if [`estimate`](Self::estimate) has something to say.
    pub(super) fn ready(&self) -> bool {
        self.ready
    }

    /// True if it waits for a point to start from.
    pub(super) fn waits(&self) -> bool {
        !self.running && self.pause == 0
    }

    /// Why there is no estimate, if it is for other than a lack of samples.
    pub(super) fn refusal(&self) -> Option<&'static str> {
        self.refusal
    }

    /// Starts about a point known to about `deviations`.
    pub(super) fn start(&mut self, point: &[f64], deviations: &[f64], outputs: &[f64]) {
        self.clear();
        self.z.copy_from_slice(point);
        self.scratch[..deviations.len()].copy_from_slice(deviations);
        self.running = self.linearise();
        if self.running { self.begin_stretch(outputs) } else { self.fail() }
    }

    /// The next sample of a stretch: outputs measured after `inputs` were held for `interval`.
    pub(super) fn push(&mut self, interval: f64, inputs: &[f64], outputs: &[f64]) {
        self.largest.iter_mut().zip(outputs).for_each(|(l, y)| *l = l.max(y.abs()));
        if !self.running {
            self.pause = self.pause.saturating_sub(1);
            return;
        }
        if let Some(memory) = self.memory_s {
            self.fade((-interval / memory).exp());
        }
        let probe = self.runs.len() - 1;
        let moving = if self.settled { &mut self.runs[..probe] } else { &mut self.runs[..] };
        if moving.iter_mut().any(|run| run.hold(inputs, interval).is_err()) || !self.bounded() {
            return self.fail();
        }
        if !self.settled {
            self.settled = self.forgotten();
            return;
        }
        self.take_in(interval, outputs);
        if self.weight >= self.look_at {
            self.look(interval);
        }
    }

    /// Puts all runs at the first sample of a stretch.
    pub(super) fn begin_stretch(&mut self, outputs: &[f64]) {
        let probe = self.runs.len() - 1;
        self.runs[..probe].iter_mut().for_each(|run| run.place(outputs));
        for (((start, kick), y), largest) in self.scratch.iter_mut().zip(&mut self.kick).zip(outputs).zip(&mut self.largest) {
            *largest = largest.max(y.abs());
            *kick = if *largest > 0.0 { 0.1 * *largest } else { 0.1 };
            *start = y + *kick;
        }
        self.runs[probe].place(&self.scratch[..outputs.len()]);
        self.settled = false;
        self.filled = 0;
        self.colours.iter_mut().for_each(Colour::interrupt);
    }

    /// Writes θ and the standard error of each parameter (not a number where it is fixed), and returns the degrees of freedom
    /// behind them.
    pub(super) fn estimate(&mut self, theta: &mut [f64], std: &mut [f64]) -> Option<f64> {
        if !self.ready || !self.triangle.solve(&mut self.z) {
            return None;
        }
        let free = self.point.len();
        let (samples, variance) = (self.weight.powi(2) / self.squares, self.variance()?);
        for (i, (theta, std)) in theta.iter_mut().zip(std).enumerate() {
            let along = &self.map.matrix[i * free..(i + 1) * free];
            *theta = self.map.offset[i] + along.iter().zip(&self.z).map(|(t, z)| t * z).sum::<f64>();
            let spread = self.triangle.variance(|j| along[j], &mut self.scratch);
            *std = if spread > 0.0 { (variance * spread).sqrt() } else { f64::NAN };
        }
        Some(samples * self.kick.len() as f64 - free as f64)
    }

    /// Variance of a whitened row, corrected for what forgetting leaves of the triangle's own.
    fn variance(&self) -> Option<f64> {
        let (rows, free) = (self.weight * self.kick.len() as f64, self.point.len() as f64);
        let share = self.squares / self.weight;
        let freedom = rows - free * share;
        (freedom > 0.0).then(|| share * self.triangle.residual() / freedom)
    }

    fn clear(&mut self) {
        self.triangle.clear();
        self.colours.iter_mut().for_each(Colour::clear);
        (self.weight, self.squares, self.filled) = (0.0, 0.0, 0);
        self.look_at = (FIRST_LOOK * self.point.len().max(1) + ORDER) as f64;
    }

    fn fade(&mut self, factor: f64) {
        self.triangle.fade(factor.sqrt());
        self.colours.iter_mut().for_each(|c| c.fade(factor));
        self.weight *= factor;
        self.squares *= factor * factor;
    }

    fn fail(&mut self) {
        self.running = false;
        self.ready = false;
        self.refusal = Some("the free run with the regression's parameters does not follow the robot");
        self.failures += 1;
        // Attempts come further apart: the regression needs more samples, or the model cannot follow this robot at all.
        self.pause = (FIRST_LOOK * self.point.len().max(1)) << self.failures.min(3);
    }

    fn bounded(&self) -> bool {
        let within =
            |run: &Simulator<'_>| run.state().iter().zip(&self.largest).all(|(x, l)| x.abs() <= DIVERGED * l.max(f64::MIN_POSITIVE));
        self.runs[..self.runs.len() - 1].iter().all(within)
    }

    fn forgotten(&self) -> bool {
        let (run, probe) = (&self.runs[0], &self.runs[self.runs.len() - 1]);
        run.state().iter().zip(probe.state()).zip(&self.kick).all(|((x, p), kick)| (x - p).abs() < FORGOTTEN * kick)
    }

    /// Takes in a row an output, as soon as the whitening filter has its past.
    fn take_in(&mut self, interval: f64, outputs: &[f64]) {
        let free = self.point.len();
        let per_sample = outputs.len() * (free + 1);
        let at = self.next * per_sample;
        for (i, (y, colour)) in outputs.iter().zip(&mut self.colours).enumerate() {
            let row = &mut self.history[at + i * (free + 1)..at + (i + 1) * (free + 1)];
            let centre = self.runs[0].recorded(interval, i);
            row[free] = y - centre;
            colour.see(row[free]);
            for j in 0..free {
                row[j] = (self.runs[1 + j].recorded(interval, i) - centre) * self.scales[j];
                row[free] += row[j] * self.point[j];
            }
        }
        self.filled = (self.filled + 1).min(ORDER + 1);
        if self.filled > self.colours.iter().map(|c| c.order).max().unwrap_or(0) {
            for (i, colour) in self.colours.iter().enumerate() {
                let raw = |back: usize| {
                    let slot = (self.next + ORDER + 1 - back) % (ORDER + 1);
                    &self.history[slot * per_sample + i * (free + 1)..slot * per_sample + (i + 1) * (free + 1)]
                };
                self.row.copy_from_slice(raw(0));
                for (back, a) in colour.coefficients[..colour.order].iter().enumerate() {
                    self.row.iter_mut().zip(raw(back + 1)).for_each(|(w, past)| *w -= a * past);
                }
                if colour.deviation > 0.0 {
                    let weight = colour.deviation.recip();
                    self.row.iter_mut().for_each(|w| *w *= weight);
                }
                self.triangle.rotate(&mut self.row);
            }
            self.weight += 1.0;
            self.squares += 1.0;
        }
        self.next = (self.next + 1) % (ORDER + 1);
    }

    /// Linearises anew about what the rows say, and judges whether they were made about the right point.
    fn look(&mut self, interval: f64) {
        let most = self.memory_s.map_or(f64::INFINITY, |m| 0.9 * m / interval);
        self.look_at = (2.0 * self.weight).min(most.max(self.weight));
        self.colours.iter_mut().for_each(Colour::update);
        let (mut sum, mut all) = (0.0, true);
        for (correlation, samples) in self.colours.iter().map(Colour::neighbours) {
            sum += correlation;
            all &= correlation < -CHANCE / samples.sqrt();
        }
        self.undone = all && sum < UNDONE * self.colours.len() as f64;
        if !self.triangle.solve(&mut self.z) {
            return;
        }
        let Some(variance) = self.variance() else { return };
        let free = self.point.len();
        let mut far = false;
        for k in 0..free {
            let deviation = (variance * self.triangle.variance(|j| f64::from(u8::from(j == k)), &mut self.scratch)).sqrt();
            far |= (self.z[k] - self.point[k]).abs() > FAR * deviation + SLIGHT * self.point[k].abs();
            self.row[k] = deviation;
        }
        self.scratch[..free].copy_from_slice(&self.row[..free]);
        if !self.linearise() {
            return self.fail();
        }
        // Who forgets expects the robot to change.
        let follows = self.ready && self.memory_s.is_some();
        let structured = |(c, largest): (&Colour, &f64)| c.foretold > FORETOLD && c.spread > IMMATERIAL * largest;
        self.refusal = if self.colours.iter().zip(&self.largest).any(structured) {
            Some("the free-run error is foretold by its own past and is no noise: the model lacks something")
        } else if far && !follows {
            self.clear();
            Some("the estimate moved by more than its errors allow when last looked at: too few samples yet, or the model lacks something")
        } else {
            None
        };
        self.ready = self.refusal.is_none();
    }

    /// Moves all runs to the parameters in `z`, offsets by the standard errors in `scratch`; false if they cannot be simulated.
    fn linearise(&mut self) -> bool {
        self.point.copy_from_slice(&self.z);
        let free = self.point.len();
        for run in 0..self.runs.len() {
            let shifted = (1..=free).contains(&run).then(|| run - 1);
            if let Some(k) = shifted {
                let offset = (OFFSET * self.scratch[k]).max(LEAST_OFFSET * self.point[k].abs()).max(f64::EPSILON);
                // The difference to the first run is that of the old offset: it keeps its direction and gets the new length.
                let (first, others) = self.runs.split_at_mut(1);
                if self.offsets[k] > 0.0 {
                    others[k].draw(first[0].state(), offset / self.offsets[k]);
                }
                (self.offsets[k], self.scales[k]) = (offset, offset.recip());
            }
            for (i, theta) in self.theta.iter_mut().enumerate() {
                let along = &self.map.matrix[i * free..(i + 1) * free];
                *theta = self.map.offset[i] + along.iter().zip(&self.point).map(|(t, z)| t * z).sum::<f64>();
                if let Some(k) = shifted {
                    *theta += along[k] * self.offsets[k];
                }
            }
            if self.runs[run].set_theta(&self.theta).is_err() {
                return false;
            }
        }
        true
    }
}
