//! What is fitted to what: model, data and scene, and the free run of a point in their common space of unknowns.

use std::cell::Cell;
use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use wheelwright_core::Dataset;
use wheelwright_core::effect::{Direction, Effect, EffectParameter, EffectSimulator, Scene};
use wheelwright_core::least_squares::Limits;
use wheelwright_core::model::{ModelError, ParameterMap, RegressorModel, Sample};
use wheelwright_core::simulation::{Readout, linear_part};

use super::layout::Layout;
use crate::noise::Noise;

/// Rate per sampling interval beyond which no trial goes: within one interval a step comes nearer to its end than the numerical error, and all
/// that is faster looks the same, but for the time that it takes to simulate.
const TOO_FAST: f64 = 20.0;
/// Difference of a base parameter for its column, as a share of its plausible size.
const DIFFERENCE: f64 = 1e-3;
/// Difference of an effect's parameter for its column, as a share of its scale, or of its value where that is a size: large enough to average
/// over the small jumps of an adaptive step.
const EFFECT_DIFFERENCE: f64 = 1e-2;

/// How much coarser than a fit that counts it is stepped what only has to be ranked.
const COARSE: usize = 4;
/// The error of a step of second order is then still this share of the noise.
pub(crate) const COARSE_ERROR: f64 = 1.0 / 6.0;
/// Most steps between samples of a fit that counts.
const MOST_SUBSTEPS: usize = 16;

/// Data, model and what all fits share.
#[derive(Debug, Clone)]
pub(crate) struct Setting<'a> {
    pub(crate) model: &'a dyn RegressorModel,
    /// Which parameters are free; none where they are held.
    pub(crate) map: ParameterMap,
    pub(crate) bounds: Vec<(f64, f64)>,
    pub(crate) data: &'a Dataset,
    pub(crate) scene: &'a Scene,
    pub(crate) readout: Readout,
    pub(crate) layout: Layout,
    /// The measured outputs, flat.
    pub(crate) measured: Vec<f64>,
    /// Step in which each output is recorded; zero where there is none.
    pub(crate) rounded: Vec<f64>,
    /// Step of each free parameter for its column.
    pub(crate) steps: Vec<f64>,
    /// Free parameters by regression, where there are such.
    pub(crate) rough: Option<Vec<f64>>,
    /// Numerical error of each output.
    pub(crate) floor: Vec<f64>,
    /// Fewest steps between samples.
    pub(crate) substeps: usize,
    /// Accuracy of a free run that is worth its time, relative to the outputs' root mean square.
    pub(crate) tolerance: f64,
    /// Steps of the model and of each effect that all free runs together have taken.
    pub(crate) work: Cell<u64>,
    /// The most that they may take.
    pub(crate) most_steps: u64,
}

/// Where in the space of unknowns a fit is.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Point {
    /// Free parameters of the base, then the values of all effects.
    pub(crate) x: Vec<f64>,
    /// Initial outputs of each stretch.
    pub(crate) starts: Vec<Vec<f64>>,
}

impl<'a> Setting<'a> {
    pub(crate) fn free(&self) -> usize {
        self.map.free.len()
    }

    /// The law of the noise that a residual shows in which so many degrees of freedom were fitted.
    pub(crate) fn noise(&self, residual: &[f64], taken: f64) -> Noise {
        Noise::estimate(residual, &self.layout, taken, &self.floor, &self.rounded)
    }

    /// Whether the search has had its share of simulation.
    pub(crate) fn exhausted(&self) -> bool {
        self.work.get() > self.most_steps
    }

    /// Rates \[1/s\] at which the outputs of the model at these parameters change by themselves; none where it cannot be evaluated.
    fn rates(&self, theta: &[f64]) -> Option<Vec<f64>> {
        let n = self.layout.outputs();
        let mut linear = vec![0.0; n * n];
        linear_part(self.model, theta, &mut linear).ok()?;
        Some((0..n).map(|i| linear[i * n + i]).collect())
    }

    /// Fastest rate at which an output of the model at these unknowns follows, per sampling interval.
    pub(crate) fn rate(&self, x: &[f64]) -> f64 {
        let rates = self.rates(&self.map.theta(&x[..self.free()]));
        rates.map_or(f64::INFINITY, |rates| rates.iter().map(|r| r.abs()).fold(0.0, f64::max) * self.scene.scales.period)
    }

    /// Unknowns of which the last are time constants, one an axis, with those of some axes in the place of the model's own and these in theirs; none
    /// where the model has none, or its parameters do not let go of them.
    pub(crate) fn exchanged(&self, x: &[f64], axes: usize, which: impl Fn(usize) -> bool) -> Option<Vec<f64>> {
        let (free, mut exchanged) = (self.free(), x.to_vec());
        let theta = self.map.theta(&x[..free]);
        let rates = self.rates(&theta)?;
        for axis in (0..axes).filter(|axis| which(*axis)) {
            let (lag, own) = (x[x.len() - axes + axis], -1.0 / rates[axis]);
            if !(own > 0.0 && own.is_finite() && lag > 0.0) {
                return None;
            }
            exchanged[x.len() - axes + axis] = own;
            for j in self.accelerating(axis) {
                let along = |z: &usize| self.map.matrix[j * free + z];
                let z = (0..free).find(|z| along(z) != 0.0)?;
                exchanged[z] += theta[j] * (lag / own - 1.0) / along(&z);
            }
        }
        Some(exchanged)
    }

    /// Parameters that an acceleration of one output asks for command by.
    fn accelerating(&self, output: usize) -> Vec<usize> {
        let (equations, parameters) = (self.model.equations(), self.model.parameters().len());
        let (inputs, outputs) = (vec![0.0; self.model.inputs().len()], vec![0.0; self.model.outputs().len()]);
        let (mut accelerations, mut phi, mut y) = (outputs.clone(), vec![0.0; equations * parameters], vec![0.0; equations]);
        accelerations[output] = 1.0;
        self.model.regressor(Sample { inputs: &inputs, outputs: &outputs, accelerations: &accelerations }, &mut phi, &mut y);
        (0..parameters).filter(|j| (0..equations).any(|e| phi[e * parameters + j] != 0.0)).collect()
    }

    /// Fastest rate that a search may look at that goes on from a point.
    pub(crate) fn fastest(&self, from: &[f64]) -> f64 {
        self.rate(from).max(TOO_FAST)
    }

    /// Steps of the free parameters about a point, from the plausible sizes of θ.
    pub(crate) fn measure(&mut self, z: &[f64]) {
        let theta = self.map.theta(z);
        let sizes = wheelwright_core::start::plausible(self.model, self.data, &theta);
        let free = self.free();
        self.steps = (0..free)
            .map(|j| {
                let along = (0..sizes.len()).filter(|i| self.map.matrix[i * free + j] != 0.0);
                let size = along.map(|i| sizes[i] / self.map.matrix[i * free + j].abs()).fold(f64::INFINITY, f64::min);
                DIFFERENCE * if size.is_finite() { size } else { 1.0 }
            })
            .collect();
    }

    /// A base point whose stretches start as measured.
    pub(crate) fn point(&self, z: Vec<f64>) -> Point {
        let starts = self.data.stretches.iter().map(|s| s.outputs.iter().map(|c| c[0]).collect()).collect();
        Point { x: z, starts }
    }

    /// Bounds of base parameters and effects as inequalities of the unknowns.
    pub(crate) fn limits(&self, effects: &[EffectParameter]) -> Limits {
        let free = self.free();
        let n = free + effects.len();
        let mut rows: Vec<(Vec<f64>, f64)> = Vec::new();
        for (i, (lower, upper)) in self.bounds.iter().enumerate() {
            let along = &self.map.matrix[i * free..(i + 1) * free];
            if along.iter().all(|a| *a == 0.0) {
                continue;
            }
            let padded = |sign: f64| (0..n).map(|j| if j < free { sign * along[j] } else { 0.0 }).collect::<Vec<f64>>();
            if lower.is_finite() {
                rows.push((padded(1.0), lower - self.map.offset[i]));
            }
            if upper.is_finite() {
                rows.push((padded(-1.0), self.map.offset[i] - upper));
            }
        }
        for (k, parameter) in effects.iter().enumerate() {
            let unit = |sign: f64| (0..n).map(|j| if j == free + k { sign } else { 0.0 }).collect::<Vec<f64>>();
            if parameter.bounds.0.is_finite() {
                rows.push((unit(1.0), parameter.bounds.0));
            }
            if parameter.bounds.1.is_finite() {
                rows.push((unit(-1.0), -parameter.bounds.1));
            }
        }
        let h = DVector::from_iterator(rows.len(), rows.iter().map(|r| r.1));
        let g = DMatrix::from_fn(rows.len(), n, |i, j| rows[i].0[j]);
        Limits { g, h }
    }
}

/// Simulates a model with a fixed list of effects at any point.
pub(crate) struct Runner<'s, 'a> {
    setting: &'s Setting<'a>,
    simulator: EffectSimulator<'s>,
    /// Parameters of all effects in order.
    pub(crate) parameters: Vec<EffectParameter>,
    /// Unknowns of which tangents tell: what is carried along a run costs less than one beside it, and knows no kink that is met in another step.
    carried: Vec<usize>,
    /// The model and its effects.
    parts: u64,
    buffer: Vec<Vec<f64>>,
    /// The last run that runs beside it may follow.
    last: Option<Last>,
}

/// A run, and what is known of its surroundings.
struct Last {
    point: Point,
    run: Vec<f64>,
    /// How it changes with each unknown that is carried, and then with the initial value of each output; none where nobody has asked.
    tangents: Vec<Vec<f64>>,
}

impl<'s, 'a> Runner<'s, 'a> {
    /// A runner whose step suits the point.
    pub(crate) fn new(setting: &'s Setting<'a>, effects: &[&'s dyn Effect], at: &Point) -> Result<Self, ModelError> {
        let mut runner = Self::unstepped(setting, effects, at)?;
        runner.simulator.set_accuracy(setting.tolerance, MOST_SUBSTEPS);
        let chosen = runner.simulator.choose_substeps(&setting.data.stretches)?;
        runner.simulator.set_substeps(chosen.max(setting.substeps));
        Ok(runner)
    }

    /// The same, as coarse as does for a rank.
    pub(crate) fn coarse(setting: &'s Setting<'a>, effects: &[&'s dyn Effect], at: &Point) -> Result<Self, ModelError> {
        let mut runner = Self::ranking(setting, effects, at)?;
        runner.simulator.choose_substeps(&setting.data.stretches)?;
        Ok(runner)
    }

    /// A coarse one whose step is known to do.
    pub(crate) fn with_substeps(
        setting: &'s Setting<'a>,
        effects: &[&'s dyn Effect],
        at: &Point,
        substeps: usize,
    ) -> Result<Self, ModelError> {
        let mut runner = Self::ranking(setting, effects, at)?;
        runner.simulator.set_substeps(substeps);
        Ok(runner)
    }

    fn ranking(setting: &'s Setting<'a>, effects: &[&'s dyn Effect], at: &Point) -> Result<Self, ModelError> {
        let mut runner = Self::unstepped(setting, effects, at)?;
        runner.simulator.set_accuracy((COARSE * COARSE) as f64 * setting.tolerance, MOST_SUBSTEPS / COARSE);
        Ok(runner)
    }

    fn unstepped(setting: &'s Setting<'a>, effects: &[&'s dyn Effect], at: &Point) -> Result<Self, ModelError> {
        let theta = setting.map.theta(&at.x[..setting.free()]);
        let mut simulator = EffectSimulator::new(setting.model, &theta, effects, setting.scene)?.with_readout(setting.readout);
        simulator.set(&theta, &at.x[setting.free()..])?;
        let parameters: Vec<EffectParameter> = effects.iter().flat_map(|e| e.parameters(setting.scene)).collect();
        let free = setting.free();
        let carries = |j: &usize| match j.checked_sub(free) {
            None => simulator.has_tangents(),
            Some(value) => setting.data.stretches.first().is_some_and(|stretch| simulator.has_tangent(value, stretch)),
        };
        let carried = (0..free + parameters.len()).filter(carries).collect();
        let parts = 1 + effects.iter().map(|e| e.effort()).sum::<u64>();
        let buffer = vec![Vec::new(); setting.layout.outputs()];
        Ok(Self { setting, simulator, parameters, carried, parts, buffer, last: None })
    }

    /// First sample of each output of a stretch.
    pub(crate) fn firsts(&self, stretch: usize) -> Vec<f64> {
        self.setting.data.stretches[stretch].outputs.iter().map(|c| c[0]).collect()
    }

    /// Root mean square of each output.
    pub(crate) fn scales(&self) -> &[f64] {
        &self.setting.scene.scales.outputs
    }

    pub(crate) fn substeps(&self) -> usize {
        self.simulator.substeps()
    }

    /// The free run of all stretches, flat; false if it cannot be evaluated or leaves the range of numbers. That of the point where it was last is not
    /// made again.
    pub(crate) fn run(&mut self, x: &[f64], starts: &[Vec<f64>], out: &mut [f64]) -> bool {
        if let Some(Last { run, .. }) = self.last.as_ref().filter(|last| last.point.x == x && last.point.starts == starts) {
            out.copy_from_slice(run);
            return true;
        }
        self.last = None;
        self.simulator.set_following(false);
        let whole = self.counted(x, starts, out);
        let point = || Point { x: x.to_vec(), starts: starts.to_vec() };
        self.last = whole.then(|| Last { point: point(), run: out.to_vec(), tangents: Vec::new() });
        whole
    }

    fn counted(&mut self, x: &[f64], starts: &[Vec<f64>], out: &mut [f64]) -> bool {
        let before = self.simulator.steps();
        let whole = self.all(x, starts, out);
        self.count(before);
        whole
    }

    /// Adds to the work what steps have been taken since.
    fn count(&self, before: u64) {
        self.setting.work.set(self.setting.work.get() + self.parts * (self.simulator.steps() - before));
    }

    fn all(&mut self, x: &[f64], starts: &[Vec<f64>], out: &mut [f64]) -> bool {
        let setting = self.setting;
        let free = setting.free();
        if self.simulator.set(&setting.map.theta(&x[..free]), &x[free..]).is_err() {
            return false;
        }
        for (s, stretch) in setting.data.stretches.iter().enumerate() {
            if self.simulator.run(s, stretch, &starts[s], &mut self.buffer).is_err() {
                return false;
            }
            for (c, series) in self.buffer.iter().enumerate() {
                if series.iter().any(|x| !x.is_finite()) {
                    return false;
                }
                out[setting.layout.part(c, s)].copy_from_slice(series);
            }
        }
        true
    }

    /// Difference step of unknown `j` at a point, away from its upper bound.
    fn step(&self, x: &[f64], j: usize) -> f64 {
        let free = self.setting.free();
        if j < free {
            return self.setting.steps[j];
        }
        let parameter = &self.parameters[j - free];
        // A time or a place has no size that would say how finely it shows: its zero is anywhere.
        let size = if parameter.neutral.is_some() { x[j].abs() } else { 0.0 };
        let step = EFFECT_DIFFERENCE * parameter.scale.abs().max(size);
        if x[j] + step > parameter.bounds.1 { -step } else { step }
    }

    /// How the free run changes with each of some unknowns; nothing where it cannot be evaluated.
    pub(crate) fn columns(&mut self, point: &Point, unknowns: Range<usize>) -> Vec<Vec<f64>> {
        let places: Vec<Option<usize>> = unknowns.clone().map(|j| self.carried.iter().position(|c| *c == j)).collect();
        let carried = places.iter().any(Option::is_some) && self.carry(point);
        let tangent = |place: &Option<usize>| self.last.as_ref().filter(|_| carried)?.tangents.get((*place)?).cloned();
        let known: Vec<Option<Vec<f64>>> = places.iter().map(tangent).collect();
        let others = unknowns.zip(&known).filter(|(_, known)| known.is_none()).map(|(j, _)| j).collect();
        let beside = self.beside(point, others, |runner, j, base| {
            let step = runner.step(&point.x, j);
            [step, -step].iter().find_map(|step| runner.change(&moved(point, j, *step), base, *step))
        });
        let mut beside = beside.into_iter();
        known.into_iter().filter_map(|known| known.or_else(|| beside.next())).collect()
    }

    /// How it changes with the initial value of each output, at all stretches.
    pub(crate) fn start_columns(&mut self, point: &Point) -> Vec<Vec<f64>> {
        if self.carry(point) {
            let tangents = self.last.iter().flat_map(|last| &last.tangents[self.carried.len()..]);
            return tangents.cloned().collect();
        }
        self.beside(point, (0..self.setting.layout.outputs()).collect(), |runner, output, base| {
            let step = 1e-2 * runner.setting.scene.scales.outputs[output];
            let mut there = point.clone();
            there.starts.iter_mut().for_each(|start| start[output] += step);
            runner.change(&there, base, step)
        })
    }

    /// Has the tangents of a point's run at hand; false where there are none, where runs beside it are the better, and where it cannot be evaluated.
    fn carry(&mut self, point: &Point) -> bool {
        if !(self.simulator.has_tangents() && self.simulator.has_kinks()) {
            return false;
        }
        if self.last.as_ref().is_some_and(|last| last.point == *point && !last.tangents.is_empty()) {
            return true;
        }
        let before = self.simulator.steps();
        self.last = self.with_tangents(point);
        self.count(before);
        self.last.is_some()
    }

    fn direction(&self, point: &Point, unknown: usize) -> Direction {
        let by = self.step(&point.x, unknown);
        let (x, free) = (moved(point, unknown, by).x, self.setting.free());
        Direction { theta: self.setting.map.theta(&x[..free]), values: x[free..].to_vec(), by }
    }

    fn with_tangents(&mut self, point: &Point) -> Option<Last> {
        let directions: Vec<Direction> = self.carried.iter().map(|j| self.direction(point, *j)).collect();
        let Self { setting, simulator, buffer, .. } = self;
        let free = setting.free();
        simulator.set_following(false);
        simulator.set(&setting.map.theta(&point.x[..free]), &point.x[free..]).ok()?;
        let mut run = vec![0.0; setting.layout.len()];
        let mut tangents = vec![run.clone(); directions.len() + setting.layout.outputs()];
        for (s, stretch) in setting.data.stretches.iter().enumerate() {
            let carried = simulator.tangents(s, stretch, &point.starts[s], &directions, buffer).ok()?;
            let all = std::iter::once(&*buffer).chain(&carried);
            for (out, series) in std::iter::once(&mut run).chain(&mut tangents).zip(all) {
                series.iter().enumerate().for_each(|(c, series)| out[setting.layout.part(c, s)].copy_from_slice(series));
            }
        }
        let finite = |values: &Vec<f64>| values.iter().all(|x| x.is_finite());
        (finite(&run) && tangents.iter().all(finite)).then(|| Last { point: point.clone(), run, tangents })
    }

    /// What runs beside that of a point find, nothing where there are none.
    fn beside(&mut self, point: &Point, all: Vec<usize>, find: impl Fn(&mut Self, usize, &[f64]) -> Option<Vec<f64>>) -> Vec<Vec<f64>> {
        if all.is_empty() {
            return Vec::new();
        }
        let nothing = vec![0.0; self.setting.layout.len()];
        self.run(&point.x, &point.starts, &mut nothing.clone());
        let Some(last) = self.last.take() else { return vec![nothing; all.len()] };
        self.simulator.set_following(true);
        let found = all.into_iter().map(|i| find(self, i, &last.run).unwrap_or_else(|| nothing.clone())).collect();
        self.last = Some(last);
        found
    }

    /// By how much the run of a point differs from another one, over a step.
    fn change(&mut self, there: &Point, base: &[f64], step: f64) -> Option<Vec<f64>> {
        let mut column = vec![0.0; base.len()];
        let whole = self.counted(&there.x, &there.starts, &mut column);
        column.iter_mut().zip(base).for_each(|(c, b)| *c = (*c - b) / step);
        whole.then_some(column)
    }
}

/// A point with one unknown elsewhere.
fn moved(point: &Point, unknown: usize, by: f64) -> Point {
    let mut there = point.clone();
    there.x[unknown] += by;
    there
}
