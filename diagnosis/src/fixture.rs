//! A recording with known truth for the tests of this crate: θ model, noise of choice, and what a fit would hand over.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::cell::OnceCell;

use nalgebra::DMatrix;
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use wheelwright_core::effect::Scene;
use wheelwright_core::simulation::{Readout, Simulator};
use wheelwright_core::{Dataset, Effect, ModelConfig, Stretch};
use wheelwright_models::VwPdConfig;

use crate::comparison::{Channels, Comparison, less};
use crate::diagnose::{Surroundings, setting, surroundings};
use crate::fit::search::Fit;
use crate::fit::setting::Point;
use crate::question::Question;
use crate::select::{Search, Selected, State};
use crate::unrounded::step;

pub(crate) const THETA: [f64; 6] = [0.22, 0.18, -0.005, 1.0, 0.02, 1.03];
pub(crate) const NOISE: [f64; 2] = [0.005, 0.01];
pub(crate) const TRACK: f64 = 0.34;
pub(crate) const RADIUS: f64 = 0.1;

/// A recording of 100 s at 20 Hz in two stretches, and its noise-free response.
pub(crate) struct Case {
    pub(crate) data: Dataset,
    pub(crate) scene: Scene,
    pub(crate) truth: Vec<Channels>,
    pub(crate) noise: [f64; 2],
    jacobian: Vec<DMatrix<f64>>,
}

/// Standard normal numbers, by the sum of twelve uniform ones.
pub(crate) fn normal(random: &mut StdRng) -> f64 {
    (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0
}

/// How far the stamp of a row is off, in standard deviations: all its outputs have it.
pub(crate) fn stamps(seed: u64) -> impl Fn(f64) -> f64 {
    let mut random = StdRng::seed_from_u64(!seed);
    let off: Vec<f64> = (0..2200).map(|_| normal(&mut random)).collect();
    move |t| off[(t / 0.05).round() as usize]
}

impl Case {
    /// Random steps in both directions with standstills; `record(k, output, simulated, slope, random)` is what is recorded.
    pub(crate) fn new(seed: u64, mut record: impl FnMut(f64, usize, f64, f64, &mut StdRng) -> f64) -> Self {
        let mut random = StdRng::seed_from_u64(seed);
        let model = VwPdConfig::default().build().unwrap();
        let mut stretches = Vec::new();
        for s in 0..2 {
            let (mut v, mut w) = (0.0, 0.0);
            let (mut inputs, mut time) = (vec![Vec::new(), Vec::new()], Vec::new());
            for k in 0..1000 {
                if random.random_bool(0.04) {
                    v = if random.random_bool(0.2) { 0.0 } else { random.random_range(-0.4..0.6) };
                    w = if random.random_bool(0.2) { 0.0 } else { random.random_range(-1.0..1.0) };
                }
                time.push(60.0 * f64::from(s) + 0.05 * f64::from(k));
                inputs[0].push(v);
                inputs[1].push(w);
            }
            stretches.push(Stretch { label: s.to_string(), time, outputs: inputs.clone(), inputs });
        }
        let mut data = Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches };
        let run = |theta: &[f64], data: &Dataset| -> Vec<Channels> {
            let mut simulator = Simulator::new(&*model, theta).unwrap().with_max_step(0.05);
            data.stretches
                .iter()
                .map(|s| {
                    let mut out = vec![Vec::new(); 2];
                    simulator.run(s, &[0.0, 0.0], &mut out).unwrap();
                    out
                })
                .collect()
        };
        let truth = run(&THETA, &data);
        let mut jacobian = vec![DMatrix::zeros(data.samples(), THETA.len()); 2];
        for p in 0..THETA.len() {
            let mut moved = THETA;
            moved[p] += 1e-5;
            let shifted = run(&moved, &data);
            for (i, j) in jacobian.iter_mut().enumerate() {
                let column: Vec<f64> =
                    shifted.iter().zip(&truth).flat_map(|(a, b)| a[i].iter().zip(&b[i]).map(|(a, b)| (a - b) / 1e-5 / NOISE[i])).collect();
                j.column_mut(p).copy_from_slice(&column);
            }
        }
        for (stretch, run) in data.stretches.iter_mut().zip(&truth) {
            for (i, column) in run.iter().enumerate() {
                let slope = crate::adequacy::slope(&stretch.time, column);
                stretch.outputs[i] = (0..column.len()).map(|k| record(stretch.time[k], i, column[k], slope[k], &mut random)).collect();
            }
        }
        let scene = Scene::new(&data, &*model, TRACK, Some(RADIUS), None);
        Self { data, scene, truth, noise: NOISE, jacobian }
    }

    /// White noise on the truth and nothing else.
    pub(crate) fn clean(seed: u64) -> Self {
        Self::new(seed, |_, i, y, _, random| y + NOISE[i] * normal(random))
    }

    /// White noise, and stamps that are off by a standard deviation.
    pub(crate) fn jittering(seed: u64, deviation: f64) -> Self {
        let off = stamps(seed);
        Self::new(seed, |t, i, y, slope, random| y + NOISE[i] * normal(random) + deviation * slope * off(t))
    }

    /// Hands the comparison to a test as a fit of the truth would, the base and `without` being the same run or another.
    pub(crate) fn compare<T>(&self, without: Option<&[Channels]>, f: impl FnOnce(&Comparison<'_>) -> T) -> T {
        let white: Vec<Channels> = self
            .data
            .stretches
            .iter()
            .zip(&self.truth)
            .map(|(s, run)| (0..2).map(|i| s.outputs[i].iter().zip(&run[i]).map(|(y, m)| (y - m) / self.noise[i]).collect()).collect())
            .collect();
        let noise = self.noise;
        let whiten = move |output: usize, series: &mut [f64]| series.iter_mut().for_each(|x| *x /= noise[output]);
        f(&Comparison {
            data: &self.data,
            scene: &self.scene,
            base: without.unwrap_or(&self.truth),
            model: &self.truth,
            without: without.unwrap_or(&self.truth),
            moments: false,
            since: None,
            late: &[],
            rest: &less(&self.data, &self.truth),
            white: &white,
            whiten: &whiten,
            rounded: &[0, 1].map(|output| step(&self.data, output).unwrap_or(0.0)),
            noise: &self.noise,
            rates: &[THETA[3] / THETA[0], THETA[5] / THETA[1]],
            jacobian: &self.jacobian,
        })
    }
}

/// Hands a test a search in which the first effects of a library were selected, and nothing is known of rivals.
pub(crate) fn with_selected(case: &Case, library: &[Box<dyn Effect>], members: usize, test: impl FnOnce(&Search<'_>, Selected)) {
    let (model, course) = (VwPdConfig::default().build().unwrap(), OnceCell::new());
    let question = Question::new(&*model, &case.data, library);
    let start = surroundings(setting(&question, &case.data, &case.scene, Readout::Instantaneous), &question, &course).unwrap();
    let Surroundings { search, whitening, base, .. } = start;
    let values: Vec<f64> = library[..members].iter().flat_map(|effect| effect.starts(&case.scene).remove(0).values).collect();
    let (effects, start): (Vec<usize>, Point) = ((0..members).collect(), point(&base, base.point.x.len(), &values));
    let (whitening, fit) = search.at(&effects, start, &whitening.noise).unwrap();
    let state = State { effects, fit };
    test(&search, Selected { state, whitening, base, rivals: vec![Vec::new(); members], ranking: Vec::new() });
}

/// A point of a model with effects at these values, the base model's parameters as a fit has them.
pub(crate) fn point(fit: &Fit, free: usize, values: &[f64]) -> Point {
    Point { x: [&fit.point.x[..free], values].concat(), starts: fit.point.starts.clone() }
}

/// A recording in which some effects of a library hide.
pub(crate) fn hiding(seed: u64, library: &[Box<dyn Effect>], effects: &[usize], values: &[f64]) -> Case {
    let (mut case, mut run) = (Case::clean(seed), Vec::new());
    with_selected(&case, library, 1, |search, selected| {
        let there = point(&selected.base, search.setting.free(), values);
        run = search.setting.layout.series(&search.run_of(effects, &there).unwrap());
    });
    for (stretch, (run, clean)) in case.data.stretches.iter_mut().zip(run.iter().zip(&case.truth)) {
        for (c, output) in stretch.outputs.iter_mut().enumerate() {
            output.iter_mut().zip(run[c].iter().zip(&clean[c])).for_each(|(y, (run, clean))| *y += run - clean);
        }
    }
    case
}
