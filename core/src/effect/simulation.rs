//! Free-run simulation of a model with effects.
//!
//! x' = L x + N(x, u, t) with L the model's linear part is stepped by the exponential midpoint rule of Cox and Matthews (J. Comput.
//! Phys. 176, 2002, ETD2RK),
//!
//! a = e^{hL/2} x + (h/2) φ1(hL/2) N(x),   x⁺ = e^{hL} x + h φ1(hL) N(x) + 2 h φ2(hL) (N(a) − N(x)),
//!
//! exact for the linear part under a command held or changing linearly, second order in the rest. Second order, because a
//! diagnosis simulates thousands of times and friction's kinks leave nothing to a fourth; each interval between samples is
//! cut where a command or an effect switches, divided as finely as step doubling on a pilot found needful, and once more
//! where the right side bends strongly within a step.

use super::{Effect, EffectParameter, Instant, Motion, Place, Scene, Stage, Track};
use crate::dataset::Stretch;
use crate::model::{ModelError, RegressorModel};
use crate::simulation::{Readout, Weights, linear_part, square_row};

/// Difference between a step and two halves, relative to the outputs' root mean square, that the pilot aims at.
const TOLERANCE: f64 = 2e-5;
/// Most sub-steps that the pilot may choose.
const MAX_SUBSTEPS: usize = 16;
/// Change of an output within a step by the bend of the right side alone, relative to its root mean square, above which the
/// interval is stepped again more finely.
const BEND: f64 = 0.02;
/// Outputs beyond this cannot be squared and multiplied any more.
const OVERFLOW: f64 = 1e100;
/// How much more finely.
const REFINEMENT: usize = 8;
/// Step lengths whose weights are kept: intervals cut by a delay have two or three that recur.
const CACHE: usize = 12;

/// A model with effects and their parameters, ready to be run. Stepping allocates nothing.
#[derive(Debug)]
pub struct EffectSimulator<'a> {
    model: &'a dyn RegressorModel,
    scene: &'a Scene,
    /// In the order in which they act.
    effects: Vec<Slot<'a>>,
    theta: Vec<f64>,
    readout: Readout,
    substeps: usize,
    tolerance: f64,
    linear: Linear,
    body: Body,
    /// Numbers of all effects' states, now and at the start of the interval.
    state: Vec<f64>,
    saved: Vec<f64>,
    trace: Trace,
    driven: bool,
    sensed: bool,
}

/// An effect with its parameters and where its numbers are.
#[derive(Debug)]
struct Slot<'a> {
    effect: &'a dyn Effect,
    /// First of its values in the caller's order.
    first: usize,
    values: Vec<f64>,
    states: std::ops::Range<usize>,
    place: Place,
    stage: Stage,
}

/// The model's linear part, what a unit of input does, and the weights of recent steps.
#[derive(Debug)]
struct Linear {
    matrix: Vec<f64>,
    diagonal: bool,
    /// ∂acceleration/∂input and its inverse, row-major.
    mobility: Vec<f64>,
    inertia: Vec<f64>,
    scratch: Weights,
    cache: Vec<StepWeights>,
    next: usize,
}

#[derive(Debug)]
struct StepWeights {
    step: f64,
    full: Vec<f64>,
    half: Vec<f64>,
    half_forcing: Vec<f64>,
    start: Vec<f64>,
    middle: Vec<f64>,
}

/// Outputs and inputs of the step in progress.
#[derive(Debug, Default)]
struct Body {
    x: Vec<f64>,
    saved: Vec<f64>,
    mid: Vec<f64>,
    n0: Vec<f64>,
    nm: Vec<f64>,
    next: Vec<f64>,
    u: Vec<f64>,
    travelled: Vec<f64>,
    work: Work,
}

/// Inputs on their way to accelerations.
#[derive(Debug, Default)]
struct Work {
    net: Vec<f64>,
    load: Vec<f64>,
    drive: Vec<f64>,
    /// The drive before the drive effects.
    given: Vec<f64>,
}

/// Outputs and their slopes at the sub-steps of a run, for effects that record the past.
#[derive(Debug, Default)]
struct Trace {
    time: Vec<f64>,
    outputs: Vec<f64>,
    slopes: Vec<f64>,
}

impl Trace {
    /// Outputs at an earlier time, by the parabola through a sub-step's ends with the slope at its start.
    fn at(&self, time: f64, out: &mut [f64]) {
        let n = out.len();
        let k = self.time.partition_point(|t| *t <= time).max(1) - 1;
        let row = |values: &[f64], k: usize, i: usize| values[k * n + i];
        for (i, out) in out.iter_mut().enumerate() {
            let x = row(&self.outputs, k, i);
            let since = (time - self.time[k]).max(0.0);
            *out = match self.time.get(k + 1) {
                Some(end) if *end > self.time[k] => {
                    let (h, slope) = (end - self.time[k], row(&self.slopes, k, i));
                    x + slope * since + (row(&self.outputs, k + 1, i) - x - slope * h) * (since / h) * (since / h)
                }
                _ => x,
            };
        }
    }
}

impl<'a> EffectSimulator<'a> {
    /// Prepares a model with effects; their values are neutral or, without a neutral value, those of the first start until
    /// [`set`](Self::set) is called.
    ///
    /// # Errors
    /// [`ModelError`] if the equations do not determine the accelerations.
    pub fn new(model: &'a dyn RegressorModel, theta: &[f64], effects: &[&'a dyn Effect], scene: &'a Scene) -> Result<Self, ModelError> {
        let n = model.outputs().len();
        let (mut first, mut states) = (0, 0);
        let mut slots = Vec::with_capacity(effects.len());
        for &effect in effects {
            let parameters = effect.parameters(scene);
            let start = effect.starts(scene).into_iter().next().map(|s| s.values);
            let value =
                |(i, p): (usize, &EffectParameter)| p.neutral.or_else(|| start.as_ref().and_then(|s| s.get(i).copied())).unwrap_or(p.scale);
            let values: Vec<f64> = parameters.iter().enumerate().map(value).collect();
            let range = states..states + effect.states(scene);
            let stage = effect.stage();
            slots.push(Slot { effect, first, values, states: range.clone(), place: stage.place(), stage });
            first += parameters.len();
            states = range.end;
        }
        slots.sort_by_key(|s| s.stage);
        let driven = slots.iter().any(|s| s.stage == Stage::Drive);
        let sensed = slots.iter().any(|s| s.place == Place::Measurement);
        let m = model.inputs().len();
        let buffer = || vec![0.0; n];
        let body = Body {
            x: buffer(),
            saved: buffer(),
            mid: buffer(),
            n0: buffer(),
            nm: buffer(),
            next: buffer(),
            u: vec![0.0; m],
            travelled: buffer(),
            work: Work { net: vec![0.0; m], load: vec![0.0; m], drive: vec![0.0; m], given: vec![0.0; m] },
        };
        let mut simulator = Self {
            model,
            scene,
            effects: slots,
            theta: theta.to_vec(),
            readout: Readout::default(),
            substeps: 1,
            tolerance: TOLERANCE,
            linear: Linear::new(n, m),
            body,
            state: vec![0.0; states],
            saved: vec![0.0; states],
            trace: Trace::default(),
            driven,
            sensed,
        };
        simulator.linear.set(model, theta, driven)?;
        Ok(simulator)
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
    /// [`choose_substeps`](Self::choose_substeps) aims at: where noise is known, no more accuracy is needed than a small share of it.
    pub fn set_tolerance(&mut self, relative: f64) {
        self.tolerance = relative.max(TOLERANCE);
    }

    /// Steps an interval between samples is divided into.
    pub fn substeps(&self) -> usize {
        self.substeps
    }

    /// Replaces the model's parameters and the effects' values, these in the order in which the effects were given.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn set(&mut self, theta: &[f64], values: &[f64]) -> Result<(), ModelError> {
        for slot in &mut self.effects {
            let n = slot.values.len();
            slot.values.copy_from_slice(&values[slot.first..slot.first + n]);
        }
        if self.theta != theta {
            self.theta.copy_from_slice(theta);
            self.linear.set(self.model, theta, self.driven)?;
        }
        Ok(())
    }

    /// Finds how many steps an interval needs, by doubling on windows spread over a data set.
    ///
    /// # Errors
    /// [`ModelError`] if the model cannot be evaluated. Windows on which it diverges are left out.
    pub fn choose_substeps(&mut self, stretches: &[Stretch]) -> Result<usize, ModelError> {
        let windows = windows(stretches);
        self.substeps = 1;
        let mut coarse = self.pilot(stretches, &windows)?;
        while self.substeps < MAX_SUBSTEPS {
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

    fn run_rows(
        &mut self,
        s: usize,
        stretch: &Stretch,
        rows: std::ops::Range<usize>,
        initial: &[f64],
        simulated: &mut [Vec<f64>],
    ) -> Result<(), ModelError> {
        let track = &self.scene.tracks[s];
        let at = Instant {
            time: stretch.time[rows.start],
            span: 0.0,
            row: rows.start,
            stretch,
            track,
            scene: self.scene,
            readout: self.readout,
        };
        self.begin(&at, initial);
        for (i, out) in simulated.iter_mut().enumerate() {
            out.clear();
            out.reserve(rows.len());
            out.push(initial[i]);
        }
        if self.sensed {
            // A sensor sees the first sample too.
            self.record(&at, 0.0, simulated, true);
        }
        for k in rows.start + 1..rows.end {
            let stepped = self.interval(stretch, track, k - 1);
            // A model that runs away overflows, and then its accelerations are undetermined as well.
            if self.body.x.iter().chain(&self.body.mid).any(|x| x.is_nan() || x.abs() >= OVERFLOW) {
                return Err(ModelError::Diverged { model: self.model.name().to_owned(), time: stretch.time[k] });
            }
            stepped?;
            let at = Instant { time: stretch.time[k], span: 0.0, row: k, stretch, track, scene: self.scene, readout: self.readout };
            self.record(&at, stretch.time[k] - stretch.time[k - 1], simulated, false);
        }
        Ok(())
    }

    fn begin(&mut self, at: &Instant<'_>, initial: &[f64]) {
        self.body.x.copy_from_slice(initial);
        self.trace.time.clear();
        self.trace.outputs.clear();
        self.trace.slopes.clear();
        self.body.u.iter_mut().zip(&at.stretch.inputs).for_each(|(u, column)| *u = column[at.row]);
        for slot in &self.effects {
            let state = &mut self.state[slot.states.clone()];
            slot.effect.begin(&slot.values, at, &self.body.u, initial, state);
            if slot.place == Place::Command {
                slot.effect.command(&slot.values, at, initial, state, &mut self.body.u);
            }
        }
    }

    /// Writes what is recorded now: appends, or replaces the first value.
    fn record(&mut self, at: &Instant<'_>, interval: f64, simulated: &mut [Vec<f64>], first: bool) {
        let Self { body, trace, effects, state, .. } = self;
        let seen = &mut body.next;
        if self.readout == Readout::IntervalMean && !first {
            seen.iter_mut().zip(&body.travelled).for_each(|(s, d)| *s = d / interval);
        } else {
            seen.copy_from_slice(&body.x);
        }
        if self.sensed {
            if !first || trace.time.is_empty() {
                trace.push(at.time, &body.x, None);
            }
            let trace = &*trace;
            let past = |time: f64, out: &mut [f64]| trace.at(time, out);
            for slot in effects.iter().filter(|s| s.place == Place::Measurement) {
                slot.effect.measure(&slot.values, at, &past, &mut state[slot.states.clone()], seen);
            }
        }
        for (out, value) in simulated.iter_mut().zip(seen.iter()) {
            if first {
                out.pop();
            }
            out.push(*value);
        }
    }

    /// Advances over the interval from row `k`, twice if the first pass bends too much.
    fn interval(&mut self, stretch: &Stretch, track: &Track, k: usize) -> Result<(), ModelError> {
        self.body.saved.copy_from_slice(&self.body.x);
        self.saved.copy_from_slice(&self.state);
        let kept = self.trace.time.len();
        let bend = self.pass(stretch, track, k, self.substeps)?;
        if bend > BEND && self.body.x.iter().all(|x| x.is_finite()) {
            self.body.x.copy_from_slice(&self.body.saved);
            self.state.copy_from_slice(&self.saved);
            self.trace.truncate(kept, self.body.x.len());
            self.pass(stretch, track, k, REFINEMENT * self.substeps)?;
        }
        Ok(())
    }

    /// One pass over an interval; returns the largest bend.
    fn pass(&mut self, stretch: &Stretch, track: &Track, k: usize, substeps: usize) -> Result<f64, ModelError> {
        let (mut time, end) = (stretch.time[k], stretch.time[k + 1]);
        let longest = (end - time) / substeps as f64;
        // What is left after a switch this close to a sample is no step.
        let tolerance = 1e-9 * (end - time);
        self.body.travelled.fill(0.0);
        let mut worst: f64 = 0.0;
        while end - time > tolerance {
            let at = Instant { time, span: 0.0, row: k, stretch, track, scene: self.scene, readout: self.readout };
            self.arrive(&at);
            let switches = self.effects.iter().map(|s| s.effect.next_switch(&s.values, &at, &self.state[s.states.clone()]));
            let switch = switches.filter(|t| *t > time + tolerance).fold(end, f64::min);
            let until = if end - switch > tolerance { switch } else { end };
            // Where effects switch often they change fast: short pieces are refined as well when all are.
            let count = ((until - time) / longest - 1e-6).ceil().max(substeps.div_ceil(2) as f64);
            let step = (until - time) / count;
            for i in 0..count as usize {
                let at = Instant { time: time + i as f64 * step, ..at };
                worst = worst.max(self.step(&at, step)?);
            }
            time = until;
        }
        Ok(worst)
    }

    /// The command as it arrives and passes the command effects, with `at.span` seconds gone by; at the outputs `x`.
    fn arrive(&mut self, at: &Instant<'_>) {
        pass_command(&self.effects, &mut self.state, at, &self.body.x, &mut self.body.u);
    }

    /// One step from `at`; returns how much the right side bends.
    fn step(&mut self, at: &Instant<'_>, h: f64) -> Result<f64, ModelError> {
        let which = self.linear.weights(h, self.body.x.len());
        let Self { model, theta, effects, state, linear, body: b, driven, trace, sensed, readout, scene, .. } = self;
        let (w, diagonal) = (&linear.cache[which], linear.diagonal);
        let right = RightSide { model: *model, theta, effects, inertia: driven.then_some(&*linear) };
        right.accelerations(at, &b.x, &b.u, state, &mut b.work, &mut b.n0)?;
        if *sensed {
            trace.push(at.time, &b.x, Some(&b.n0));
        }
        linear_off(&linear.matrix, diagonal, &b.x, &mut b.n0);
        apply(&w.half, diagonal, &b.x, &mut b.mid, false);
        apply(&w.half_forcing, diagonal, &b.n0, &mut b.mid, true);
        let half = Instant { time: at.time + 0.5 * h, span: 0.5 * h, ..*at };
        pass_command(effects, state, &half, &b.mid, &mut b.u);
        advance(effects, state, &half, &b.mid, &b.work.given);
        right.accelerations(&half, &b.mid, &b.u, state, &mut b.work, &mut b.nm)?;
        linear_off(&linear.matrix, diagonal, &b.mid, &mut b.nm);
        apply(&w.full, diagonal, &b.x, &mut b.next, false);
        apply(&w.start, diagonal, &b.n0, &mut b.next, true);
        apply(&w.middle, diagonal, &b.nm, &mut b.next, true);
        let bends = b.nm.iter().zip(&b.n0).zip(&scene.scales.outputs).map(|((m, n), scale)| h * (m - n).abs() / scale);
        let bend = bends.fold(0.0, f64::max);
        if *readout == Readout::IntervalMean {
            let Body { travelled, x, mid, next, .. } = b;
            travelled
                .iter_mut()
                .zip(x.iter().zip(mid.iter()).zip(next.iter()))
                .for_each(|(d, ((x, m), y))| *d += h / 6.0 * (x + 4.0 * m + y));
        }
        std::mem::swap(&mut b.x, &mut b.next);
        let end = Instant { time: at.time + h, span: 0.5 * h, ..*at };
        pass_command(effects, state, &end, &b.x, &mut b.u);
        advance(effects, state, &end, &b.x, &b.work.given);
        Ok(bend)
    }
}

/// The accelerations of a model with loads and drive effects.
struct RightSide<'s, 'a> {
    model: &'a dyn RegressorModel,
    theta: &'s [f64],
    effects: &'s [Slot<'a>],
    /// What turns accelerations into inputs and back, if there is a drive effect.
    inertia: Option<&'s Linear>,
}

impl RightSide<'_, '_> {
    #[inline(always)]
    fn accelerations(
        &self,
        at: &Instant<'_>,
        x: &[f64],
        u: &[f64],
        state: &[f64],
        work: &mut Work,
        out: &mut [f64],
    ) -> Result<(), ModelError> {
        let Work { net, load, drive, given } = work;
        load.fill(0.0);
        for slot in self.effects.iter().filter(|s| s.stage == Stage::Load) {
            slot.effect.load(&slot.values, at, x, &state[slot.states.clone()], load);
        }
        net.iter_mut().zip(u).zip(load.iter()).for_each(|((n, u), l)| *n = u - l);
        self.model.accelerations(self.theta, net, x, out)?;
        if let Some(Linear { inertia, mobility, .. }) = self.inertia {
            multiply(inertia, out, drive);
            given.copy_from_slice(drive);
            for slot in self.effects.iter().filter(|s| s.stage == Stage::Drive) {
                slot.effect.drive(&slot.values, at, &Motion { u, outputs: x, inertia }, &state[slot.states.clone()], drive);
            }
            multiply(mobility, drive, out);
        }
        Ok(())
    }
}

/// The command held now, passed through the command effects.
#[inline(always)]
fn pass_command(effects: &[Slot<'_>], state: &mut [f64], at: &Instant<'_>, outputs: &[f64], u: &mut [f64]) {
    u.iter_mut().zip(&at.stretch.inputs).for_each(|(u, column)| *u = column[at.row]);
    for slot in effects.iter().take_while(|s| s.place == Place::Command) {
        slot.effect.command(&slot.values, at, outputs, &mut state[slot.states.clone()], u);
    }
}

/// States of loads and drive effects.
fn advance(effects: &[Slot<'_>], state: &mut [f64], at: &Instant<'_>, outputs: &[f64], drive: &[f64]) {
    for slot in effects.iter().filter(|s| s.place == Place::Dynamics && !s.states.is_empty()) {
        slot.effect.advance(&slot.values, at, outputs, drive, &mut state[slot.states.clone()]);
    }
}

/// out = M x, or out += M x; only the diagonal counts where that is all there is, and then M holds one entry a row.
#[inline(always)]
fn apply(matrix: &[f64], diagonal: bool, x: &[f64], out: &mut [f64], add: bool) {
    let n = x.len();
    if diagonal {
        let terms = out.iter_mut().zip(&matrix[..n]).zip(x);
        if add {
            terms.for_each(|((out, m), x)| *out += m * x);
        } else {
            terms.for_each(|((out, m), x)| *out = m * x);
        }
        return;
    }
    for (i, out) in out.iter_mut().enumerate() {
        let value: f64 = square_row(matrix, i, x);
        *out = if add { *out + value } else { value };
    }
}

/// out −= L x.
#[inline(always)]
fn linear_off(linear: &[f64], diagonal: bool, x: &[f64], out: &mut [f64]) {
    let n = x.len();
    for (i, out) in out.iter_mut().enumerate() {
        *out -= if diagonal { linear[i * n + i] * x[i] } else { square_row(linear, i, x) };
    }
}

/// out = M x for a row-major matrix.
fn multiply(matrix: &[f64], x: &[f64], out: &mut [f64]) {
    out.iter_mut().enumerate().for_each(|(i, out)| *out = square_row(matrix, i, x));
}

impl Trace {
    /// Appends a sub-step's start, or replaces the last one at the same time.
    fn push(&mut self, time: f64, outputs: &[f64], slopes: Option<&[f64]>) {
        if self.time.last().is_some_and(|last| *last >= time) {
            self.truncate(self.time.len() - 1, outputs.len());
        }
        self.time.push(time);
        self.outputs.extend_from_slice(outputs);
        match slopes {
            Some(slopes) => self.slopes.extend_from_slice(slopes),
            None => self.slopes.extend(outputs.iter().map(|_| 0.0)),
        }
    }

    fn truncate(&mut self, length: usize, outputs: usize) {
        self.time.truncate(length);
        self.outputs.truncate(length * outputs);
        self.slopes.truncate(length * outputs);
    }
}

impl Linear {
    fn new(n: usize, inputs: usize) -> Self {
        Self {
            matrix: vec![0.0; n * n],
            diagonal: true,
            mobility: vec![0.0; n * inputs],
            inertia: vec![0.0; n * inputs],
            scratch: Weights::new(n),
            cache: (0..CACHE).map(|_| StepWeights::new(n)).collect(),
            next: 0,
        }
    }

    fn set(&mut self, model: &dyn RegressorModel, theta: &[f64], driven: bool) -> Result<(), ModelError> {
        let n = model.outputs().len();
        self.diagonal = linear_part(model, theta, &mut self.matrix)?;
        self.cache.iter_mut().for_each(|w| w.step = f64::NAN);
        self.next = 0;
        if !driven {
            return Ok(());
        }
        let singular = || ModelError::Singular { model: model.name().to_owned() };
        let m = model.inputs().len();
        if m != n {
            return Err(singular());
        }
        let (mut input, rest) = (vec![0.0; m], vec![0.0; n]);
        let (mut up, mut down) = (vec![0.0; n], vec![0.0; n]);
        for j in 0..m {
            input[j] = 1.0;
            model.accelerations(theta, &input, &rest, &mut up)?;
            input[j] = -1.0;
            model.accelerations(theta, &input, &rest, &mut down)?;
            input[j] = 0.0;
            (0..n).for_each(|i| self.mobility[i * m + j] = 0.5 * (up[i] - down[i]));
        }
        let inverse = nalgebra::DMatrix::from_row_slice(n, n, &self.mobility).try_inverse().ok_or_else(singular)?;
        self.inertia.iter_mut().enumerate().for_each(|(k, v)| *v = inverse[(k / n, k % n)]);
        Ok(())
    }

    /// Where in the cache the weights of a step length are.
    fn weights(&mut self, h: f64, n: usize) -> usize {
        if let Some(found) = self.cache.iter().position(|w| (w.step - h).abs() <= 1e-12 * h) {
            return found;
        }
        let place = self.next % CACHE;
        self.next += 1;
        if self.diagonal {
            self.cache[place].set_diagonal(h, &self.matrix, n);
            return place;
        }
        self.scratch.set(h, &self.matrix, n, false);
        let (s, w) = (&self.scratch, &mut self.cache[place]);
        w.step = h;
        // φ1 = first + 2 middle + last and φ2 = middle + last, in the weights of the fourth-order scheme.
        for i in 0..n * n {
            w.full[i] = s.full[i];
            w.half[i] = s.half[i];
            w.half_forcing[i] = s.half_forcing[i];
            w.start[i] = s.first[i] - s.last[i];
            w.middle[i] = 2.0 * (s.middle[i] + s.last[i]);
        }
        place
    }
}

impl StepWeights {
    /// Of no step yet.
    fn new(n: usize) -> Self {
        let room = || vec![0.0; n * n];
        Self { step: f64::NAN, full: room(), half: room(), half_forcing: room(), start: room(), middle: room() }
    }

    /// Weights where no output's rate depends on another output: φ1(z) = (eᶻ − 1)/z and φ2(z) = (φ1(z) − 1)/z of each z = h L_ii.
    fn set_diagonal(&mut self, h: f64, matrix: &[f64], n: usize) {
        self.step = h;
        for i in 0..n {
            let z = h * matrix[i * n + i];
            let (first, second) = phi(z);
            self.full[i] = z.exp();
            self.half[i] = (0.5 * z).exp();
            self.half_forcing[i] = 0.5 * h * phi(0.5 * z).0;
            self.start[i] = h * (first - 2.0 * second);
            self.middle[i] = 2.0 * h * second;
        }
    }
}

/// φ1 and φ2 of a number; near zero by their series, where the quotients lose digits.
fn phi(z: f64) -> (f64, f64) {
    if z.abs() < 1e-3 {
        return (1.0 + z * (1.0 / 2.0 + z * (1.0 / 6.0 + z / 24.0)), 1.0 / 2.0 + z * (1.0 / 6.0 + z * (1.0 / 24.0 + z / 120.0)));
    }
    let first = z.exp_m1() / z;
    (first, (first - 1.0) / z)
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
