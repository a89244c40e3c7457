//! Free-run simulation of a model with effects.
//!
//! x' = L x + N(x, u, t) with L the model's linear part is stepped by the exponential midpoint rule of Cox and Matthews (J. Comput.
//! Phys. 176, 2002, ETD2RK),
//!
//! a = e^{hL/2} x + (h/2) φ1(hL/2) N(x),   x⁺ = e^{hL} x + h φ1(hL) N(x) + 2 h φ2(hL) (N(a) − N(x)),
//!
//! exact for the linear part under a command held or changing linearly, second order in the rest. Second order, because a
//! diagnosis simulates thousands of times and friction's kinks leave nothing to a fourth; each interval between samples is
//! cut where a command or an effect switches, divided as finely as step doubling on a pilot found needful, and a step halved,
//! and its halves again, where the right side bends more within it than may be missed.

mod linear;
mod pace;
mod slots;
mod step;
mod tangents;
mod trace;

use linear::Linear;
use pace::{Measure, Steps};
use slots::Slots;
use step::Body;
use tangents::Tangents;
use trace::{Added, Trace};

pub use tangents::Direction;

use super::{Effect, Instant, Scene};
use crate::dataset::Stretch;
use crate::model::{ModelError, RegressorModel};
use crate::simulation::Readout;

/// Difference between a step and two halves, relative to the outputs' root mean square, that the pilot aims at.
const TOLERANCE: f64 = 2e-5;
/// Most steps between samples that the pilot may choose, unless told otherwise.
const MAX_SUBSTEPS: usize = 16;
/// Change of an output within a step by the change of the right side alone, relative to its root mean square, above which an implicit rule is too coarse
/// for what holds the outputs.
const BEND: f64 = 0.02;
/// Outputs beyond this cannot be squared and multiplied any more.
const OVERFLOW: f64 = 1e100;
/// How much more finely at most, in terms of what the pilot may choose.
const FINEST: usize = 2;
/// What a step may miss of an output before it is halved, in terms of the pilot's aim.
const MISSED: f64 = 3.0;
/// What a step may miss more than usual where those of another run are followed: a kink that is met elsewhere is looked at more closely, and what is
/// only met a little sooner or later is not.
const FOLLOWED: f64 = 8.0;

/// A model with effects and their parameters, ready to be run. Stepping allocates nothing.
#[derive(Debug)]
pub struct EffectSimulator<'a> {
    model: &'a dyn RegressorModel,
    scene: &'a Scene,
    slots: Slots<'a>,
    theta: Vec<f64>,
    readout: Readout,
    substeps: usize,
    tolerance: f64,
    most: usize,
    linear: Linear,
    body: Body,
    /// Numbers of all effects' states, now and before the step.
    state: Vec<f64>,
    before: Vec<f64>,
    trace: Trace,
    added: Added,
    steps: u64,
    /// Whether any step has been halved.
    halved: bool,
    /// Whether a run follows the steps of one before it.
    follows: bool,
    /// Those steps, stretch by stretch, and the stretch that is run.
    paces: Vec<Steps>,
    stretch: usize,
    /// How finely it is run.
    measure: Measure,
    /// What is carried along beside it, if anything.
    tangents: Option<Tangents<'a>>,
}

impl<'a> EffectSimulator<'a> {
    /// Prepares a model with effects; their values are neutral or, without a neutral value, those of the first start until
    /// [`set`](Self::set) is called.
    ///
    /// # Errors
    /// [`ModelError`] if the equations do not determine the accelerations.
    pub fn new(model: &'a dyn RegressorModel, theta: &[f64], effects: &[&'a dyn Effect], scene: &'a Scene) -> Result<Self, ModelError> {
        let (n, m) = (model.outputs().len(), model.inputs().len());
        let slots = Slots::new(effects, scene);
        let mut linear = Linear::new(n, m);
        linear.set(model, theta, slots.driven())?;
        Ok(Self {
            model,
            scene,
            theta: theta.to_vec(),
            readout: Readout::default(),
            substeps: 1,
            tolerance: TOLERANCE,
            most: MAX_SUBSTEPS,
            linear,
            body: Body::new(n, m, scene),
            state: vec![0.0; slots.states],
            before: vec![0.0; slots.states],
            slots,
            trace: Trace::default(),
            added: Added::default(),
            steps: 0,
            halved: false,
            follows: false,
            paces: Vec::new(),
            stretch: 0,
            measure: Measure::default(),
            tangents: None,
        })
    }

    /// Simulates what a driver records that reads velocities in this way.
    #[must_use]
    pub fn with_readout(mut self, readout: Readout) -> Self {
        self.readout = readout;
        self
    }

    /// Divides each interval between samples into this many steps.
    pub fn set_substeps(&mut self, substeps: usize) {
        self.substeps = substeps.clamp(1, MAX_SUBSTEPS);
    }

    /// Sets the difference between a step and two halves, relative to the outputs' root mean square, that
    /// [`choose_substeps`](Self::choose_substeps) aims at, and the most steps between samples (at most 16) that it may take for it: where
    /// noise is known, no more accuracy is needed than a small share of it. Steps across a kink are made finer to the same measure.
    pub fn set_accuracy(&mut self, relative: f64, most: usize) {
        self.tolerance = relative.max(TOLERANCE);
        self.most = most.clamp(1, MAX_SUBSTEPS);
    }

    /// Has the runs to come follow the last one that did not: no step is longer than there, and shorter only where it misses much more. Their differences
    /// are then those of the motion, not of where a step was halved.
    pub fn set_following(&mut self, follows: bool) {
        self.follows = follows;
    }

    /// Steps an interval between samples is divided into.
    pub fn substeps(&self) -> usize {
        self.substeps
    }

    /// Steps taken since it was made: what its runs have cost, whatever the machine.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Replaces the model's parameters and the effects' values, these in the order in which the effects were given.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn set(&mut self, theta: &[f64], values: &[f64]) -> Result<(), ModelError> {
        self.slots.set(values);
        if self.theta != theta {
            self.theta.copy_from_slice(theta);
            self.linear.set(self.model, theta, self.slots.driven())?;
        }
        Ok(())
    }

    /// How finely a run is stepped. What a step of second order misses falls by eight as it is halved.
    fn measure(&self) -> Measure {
        let allowed = MISSED * self.tolerance / self.substeps.pow(3) as f64;
        let allowed = if self.follows { FOLLOWED * allowed } else { allowed };
        let deepest = (FINEST * self.most / self.substeps).max(1).ilog2();
        Measure { allowed, deepest, finest: 0.5_f64.powi(deepest as i32) }
    }

    /// Finds how many steps an interval needs, by doubling on windows spread over a data set.
    ///
    /// # Errors
    /// [`ModelError`] if the model cannot be evaluated. Windows on which it diverges are left out.
    pub fn choose_substeps(&mut self, stretches: &[Stretch]) -> Result<usize, ModelError> {
        let windows = windows(stretches);
        self.substeps = 1;
        let mut coarse = self.pilot(stretches, &windows)?;
        while self.substeps < self.most {
            self.substeps *= 2;
            let fine = self.pilot(stretches, &windows)?;
            let (mut sum, mut count) = (0.0, 0.0_f64);
            for (i, (a, b)) in coarse.iter().zip(&fine).enumerate() {
                let scale = self.scene.scales.outputs[i % self.scene.scales.outputs.len()];
                sum += a.iter().zip(b).map(|(a, b)| ((a - b) / scale).powi(2)).sum::<f64>();
                count += a.len().min(b.len()) as f64;
            }
            if (sum / count.max(1.0)).sqrt() <= self.tolerance {
                self.substeps /= 2;
                break;
            }
            coarse = fine;
        }
        Ok(self.substeps)
    }

    fn pilot(&mut self, stretches: &[Stretch], windows: &[(usize, std::ops::Range<usize>)]) -> Result<Vec<Vec<f64>>, ModelError> {
        let mut all = Vec::with_capacity(windows.len() * self.body.x.len());
        for (s, rows) in windows {
            let initial: Vec<f64> = stretches[*s].outputs.iter().map(|c| c[rows.start]).collect();
            let mut out = vec![Vec::new(); initial.len()];
            match self.run_rows(*s, &stretches[*s], rows.clone(), &initial, &mut out) {
                Ok(()) | Err(ModelError::Diverged { .. }) => all.append(&mut out),
                Err(other) => return Err(other),
            }
        }
        Ok(all)
    }

    /// Runs over stretch number `s` of the scene from `initial`; `simulated` gets one vector an output, as long as the stretch.
    ///
    /// # Errors
    /// [`ModelError::Diverged`] with the time; values up to it are in `simulated`.
    pub fn run(&mut self, s: usize, stretch: &Stretch, initial: &[f64], simulated: &mut [Vec<f64>]) -> Result<(), ModelError> {
        self.run_rows(s, stretch, 0..stretch.len(), initial, simulated)
    }

    /// Whether [`tangents`](Self::tangents) are to be had: where effects have numbers of their own that hang on the outputs, or change what is
    /// accelerated or recorded, only runs beside each other tell how they differ.
    pub fn has_tangents(&self) -> bool {
        self.slots.plain
    }

    /// Whether they are along one of the effects' values: that of a force which acts throughout a stretch.
    pub fn has_tangent(&self, value: usize, stretch: &Stretch) -> bool {
        let at = |track| Instant::of_sample(stretch, 0, track, self.scene, self.readout);
        self.slots.plain && self.scene.tracks.first().is_some_and(|track| self.slots.of_force(value, &at(track)))
    }

    /// Whether a step of a run had to be halved so far: something sets in within it, and differences of runs hang on where it does. Where nothing does they
    /// are nearer to the run's own derivatives than tangents are.
    pub fn has_kinks(&self) -> bool {
        self.halved
    }

    /// A [`run`](Self::run) with how its outputs change along directions, and then with each initial output: a vector an output of each.
    ///
    /// # Errors
    /// As there.
    pub fn tangents(
        &mut self,
        s: usize,
        stretch: &Stretch,
        initial: &[f64],
        directions: &[Direction],
        simulated: &mut [Vec<f64>],
    ) -> Result<Vec<Vec<Vec<f64>>>, ModelError> {
        self.tangents = Some(Tangents::new(directions, &self.slots, initial.len(), stretch.len()));
        let run = self.run(s, stretch, initial, simulated);
        let tangents = self.tangents.take();
        run?;
        Ok(tangents.map_or_else(Vec::new, |tangents| tangents.series))
    }
}

/// Up to eight windows of 32 rows, spread over the stretches.
fn windows(stretches: &[Stretch]) -> Vec<(usize, std::ops::Range<usize>)> {
    let total: usize = stretches.iter().map(Stretch::len).sum();
    let pieces = (total / 64).clamp(1, 8);
    let mut windows = Vec::with_capacity(pieces);
    for p in 0..pieces {
        let mut row = p * total / pieces;
        for (s, stretch) in stretches.iter().enumerate() {
            if row < stretch.len() {
                let start = row.min(stretch.len().saturating_sub(2));
                windows.push((s, start..(start + 33).min(stretch.len())));
                break;
            }
            row -= stretch.len();
        }
    }
    windows
}
