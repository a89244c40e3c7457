//! How far the training data let an explanation's parameters go, and what it is worth on other data with that leeway.
//!
//! Parameters that the training data hardly show make errors of their own on other data, which say nothing of the explanation: a friction in turns
//! that no turn has shown. So before an explanation is held for worse than another, its parameters go where the other data would have them, as
//! far as the training data let them:
//!
//! min over δ of ‖W (y − ŷ − J δ)‖² + δᵀ H δ
//!
//! with H what the training data know of the parameters. The second term is what the move costs, in twice the log-likelihood.

use std::cell::OnceCell;

use nalgebra::{DMatrix, DVector};
use wheelwright_core::Dataset;
use wheelwright_core::effect::Scene;
use wheelwright_core::least_squares::constrained_step;

use crate::fit::algebra::{dot, factor, gram};
use crate::fit::layout::Layout;
use crate::fit::search::{broyden, missed, parts};
use crate::fit::setting::{Point, Runner, Setting};
use crate::holdout::{BorneOut, Run};
use crate::noise::{HUBER, Noise};
use crate::residuals::Series;
use crate::select::{Search, State};

/// Most linear steps: each corrects the one before, by columns that are simulated once and kept up to date.
const STEPS: usize = 5;
/// Share of what a step changes, in squares, that they may fail to foretell: beyond it they are simulated anew.
const ASTRAY: f64 = 0.01;
/// A step that promises less, in twice the log-likelihood, is the last.
const LAST: f64 = 1.0;

/// An explanation as other data would have it.
pub(crate) struct Moved {
    /// Free run over the other data.
    pub(crate) simulated: Series,
    /// The same with the parameters as the training data told them.
    told: Series,
    /// Its parameters there.
    pub(crate) x: Vec<f64>,
    /// What the move costs on the training data, in twice the log-likelihood.
    pub(crate) cost: f64,
}

/// An explanation, and what the training data know of its parameters.
pub(crate) struct Leeway<'s, 'a> {
    search: &'s Search<'a>,
    state: &'s State,
    noise: &'s Noise,
    /// Only asked for where parameters move: it is a matter of many simulations.
    known: OnceCell<DMatrix<f64>>,
}

impl<'s, 'a> Leeway<'s, 'a> {
    /// Of an explanation that was fitted under a noise.
    pub(crate) fn new(search: &'s Search<'a>, state: &'s State, noise: &'s Noise) -> Self {
        Self { search, state, noise, known: OnceCell::new() }
    }

    fn known(&self) -> &DMatrix<f64> {
        self.known.get_or_init(|| self.search.known_of(self.state, self.noise).information)
    }

    /// Moves the parameters to where other data would have them; `None` where the explanation cannot be simulated there.
    pub(crate) fn moved(&self, data: &Dataset, scene: &Scene) -> Option<Moved> {
        self.moved_within(f64::INFINITY, data, scene)
    }

    /// The same, on the way there no farther than to where the move costs so much on the training data.
    pub(crate) fn moved_within(&self, most: f64, data: &Dataset, scene: &Scene) -> Option<Moved> {
        self.moved_but(&[], most, data, scene)
    }

    /// The same of all but some parameters, which stay where they are.
    fn moved_but(&self, stay: &[usize], most: f64, data: &Dataset, scene: &Scene) -> Option<Moved> {
        let Self { search, state, noise, .. } = self;
        let known = self.known();
        let layout = Layout::of(data, scene);
        let setting = Setting { data, scene, measured: layout.flat(data), layout, ..search.setting.clone() };
        let effects = search.effects(&state.effects);
        let limits = setting.limits(&search.parameters(&state.effects));
        let first = DVector::from_column_slice(&state.fit.point.x);
        let mut point = setting.point(state.fit.point.x.clone());
        let mut runner = Runner::new(&setting, &effects, &point).ok()?;
        let mut run = vec![0.0; setting.layout.len()];
        let (mut told, mut before): (Option<Series>, Option<Before>) = (None, None);
        for _ in 0..STEPS {
            if !runner.run(&point.x, &point.starts, &mut run) {
                return None;
            }
            told.get_or_insert_with(|| setting.layout.series(&run));
            let (error, weights) = weighed(&setting, &run, noise);
            let columns = before.take().and_then(|before| before.updated(&setting, &run, &weights));
            let columns = columns.unwrap_or_else(|| changes(&setting.layout, &mut runner, &point));
            let all: Vec<&[f64]> = columns.iter().chain([&error]).map(Vec::as_slice).collect();
            let x = DVector::from_column_slice(&point.x);
            let mut system = gram(&all, &parts(&setting), &weights) + prior(known, &(&x - &first));
            hold(&mut system, stay);
            let step = constrained_step(&factor(&system), None, &x, &limits).ok()?;
            let promised = step.dot(&(system.view((0, 0), (x.len(), x.len())) * &step));
            point.x = (x + &step).as_slice().to_vec();
            if promised < LAST {
                break;
            }
            before = Some(Before { columns, run: run.clone(), step });
        }
        let mut far = DVector::from_column_slice(&point.x) - &first;
        let mut cost = far.dot(&(known * &far));
        if cost > most {
            far *= (most / cost).sqrt();
            cost = most;
            point.x = (first + far).as_slice().to_vec();
        }
        let whole = runner.run(&point.x, &point.starts, &mut run);
        told.filter(|_| whole).map(|told| Moved { simulated: setting.layout.series(&run), told, x: point.x, cost })
    }

    /// Other data without what the parameters that an explanation shares with a rest of it would change there. What it has beyond that stays as it is:
    /// these data are to be asked about it.
    fn eased(&self, rest: &State, data: &Dataset, scene: &Scene) -> Option<Dataset> {
        let Self { search, state, .. } = self;
        let beyond = search.unknowns(state, &|i| !rest.effects.contains(&state.effects[i]));
        let stay: Vec<usize> = beyond.filter(|j| *j >= search.setting.free()).collect();
        let Moved { simulated, told, .. } = self.moved_but(&stay, f64::INFINITY, data, scene)?;
        let mut eased = data.clone();
        for ((stretch, moved), told) in eased.stretches.iter_mut().zip(&simulated).zip(&told) {
            let values = stretch.outputs.iter_mut().flatten();
            values.zip(moved.iter().flatten().zip(told.iter().flatten())).for_each(|(y, (moved, told))| *y -= moved - told);
        }
        Some(eased)
    }
}

/// Other data before which what an explanation has beyond a rest of it has to hold: as they are, and eased of what its other parameters would change there.
pub(crate) struct Court<'l, 'd> {
    leeway: &'l Leeway<'l, 'l>,
    /// Free run of the explanation.
    with: &'d Series,
    pub(crate) data: &'d Dataset,
    pub(crate) scene: &'d Scene,
}

impl<'l, 'd> Court<'l, 'd> {
    pub(crate) fn new(leeway: &'l Leeway<'l, 'l>, with: &'d Series, data: &'d Dataset, scene: &'d Scene) -> Self {
        Self { leeway, with, data, scene }
    }

    /// Whether they refute, as they are and eased, what the explanation has beyond a rest with its free run.
    pub(crate) fn refutes(&self, rest: &State, without: &Series) -> bool {
        let Leeway { search, state, noise, .. } = self.leeway;
        let gain = search.gain(&state.fit, rest);
        let by = |data: &Dataset| BorneOut::new(noise, Run { data, scene: self.scene, simulated: self.with }, without, gain).refuted();
        by(self.data) && self.leeway.eased(rest, self.data, self.scene).as_ref().is_none_or(by)
    }
}

/// A step, the run that it was taken from, and how that changes with each parameter.
struct Before {
    columns: Vec<Vec<f64>>,
    run: Vec<f64>,
    step: DVector<f64>,
}

impl Before {
    /// How a run changes with each parameter to which the step has led, unless what was known of that has foretold too little of it.
    fn updated(self, setting: &Setting<'_>, run: &[f64], weights: &[f64]) -> Option<Vec<Vec<f64>>> {
        let Self { mut columns, run: from, step } = self;
        let mut changed: Vec<f64> = run.iter().zip(&from).map(|(now, before)| now - before).collect();
        setting.layout.settle(&mut changed);
        let size =
            |series: &[f64]| parts(setting).into_iter().zip(weights).map(|(p, w)| w * dot(&series[p.clone()], &series[p])).sum::<f64>();
        let whole = size(&changed);
        let missed = missed(&columns, changed, &step);
        if size(&missed) > ASTRAY * whole {
            return None;
        }
        broyden(&mut columns, &missed, &step);
        Some(columns)
    }
}

/// How the run of a point changes with each parameter, where it counts.
fn changes(layout: &Layout, runner: &mut Runner<'_, '_>, point: &Point) -> Vec<Vec<f64>> {
    let mut columns = runner.columns(point, 0..point.x.len());
    columns.iter_mut().for_each(|column| layout.settle(column));
    columns
}

/// Errors of a run where they count, model minus measured, what is far out drawn in; and each output's weight: independent values count by what is left.
fn weighed(setting: &Setting<'_>, run: &[f64], noise: &Noise) -> (Vec<f64>, Vec<f64>) {
    let mut error: Vec<f64> = run.iter().zip(&setting.measured).map(|(model, measured)| model - measured).collect();
    setting.layout.settle(&mut error);
    let counted = setting.layout.counted() as f64;
    let output = |(c, part): (usize, std::ops::Range<usize>)| {
        let own = &mut error[part];
        let size = (own.iter().map(|e| e * e).sum::<f64>() / counted).sqrt().max(noise.deviation[c]);
        own.iter_mut().for_each(|e| *e = e.clamp(-HUBER * size, HUBER * size));
        noise.independent(c) / (size * size)
    };
    let weights = parts(setting).into_iter().enumerate().map(output).collect();
    (error, weights)
}

/// Has some parameters stay where they are: nothing is known of them, or asked, but that.
fn hold(system: &mut DMatrix<f64>, stay: &[usize]) {
    for j in stay {
        system.row_mut(*j).fill(0.0);
        system.column_mut(*j).fill(0.0);
        system[(*j, *j)] = 1.0;
    }
}

/// What is known of parameters so far from where it was learnt, in the form of sums of products with the error as last column.
fn prior(known: &DMatrix<f64>, far: &DVector<f64>) -> DMatrix<f64> {
    let n = known.nrows();
    let pull = known * far;
    let mut prior = DMatrix::zeros(n + 1, n + 1);
    prior.view_mut((0, 0), (n, n)).copy_from(known);
    prior.view_mut((0, n), (n, 1)).copy_from(&pull);
    prior.view_mut((n, 0), (1, n)).copy_from(&pull.transpose());
    prior[(n, n)] = far.dot(&pull);
    prior
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

    use rand::rngs::StdRng;
    use rand::{Rng, SeedableRng};
    use wheelwright_core::simulation::{Readout, Simulator};
    use wheelwright_core::{ModelConfig, Stretch};
    use wheelwright_models::VwPdConfig;

    use super::*;
    use crate::diagnose::{setting, surroundings};
    use crate::fixture::{NOISE, THETA, TRACK, normal};
    use crate::question::Question;

    /// A recording of a robot that turns or does not.
    fn record(theta: &[f64], seed: u64, turning: f64) -> Dataset {
        let (model, mut random) = (VwPdConfig::default().build().unwrap(), StdRng::seed_from_u64(seed));
        let mut inputs = vec![vec![0.3], vec![0.0]];
        for k in 1..1200 {
            let step = random.random_bool(0.05);
            let held = [inputs[0][k - 1], inputs[1][k - 1]];
            inputs[0].push(if step { random.random_range(-0.4..0.6) } else { held[0] });
            inputs[1].push(if step { turning * random.random_range(-1.0..1.0) } else { held[1] });
        }
        let mut stretch =
            Stretch { label: "1".to_owned(), time: (0..1200).map(|k| 0.05 * f64::from(k)).collect(), outputs: inputs.clone(), inputs };
        let mut outputs = vec![Vec::new(); 2];
        Simulator::new(&*model, theta).unwrap().run(&stretch, &[0.0, 0.0], &mut outputs).unwrap();
        outputs.iter_mut().zip(NOISE).for_each(|(series, noise)| series.iter_mut().for_each(|x| *x += noise * normal(&mut random)));
        stretch.outputs = outputs;
        Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![stretch] }
    }

    /// Losses on held-out data of the base model that training data tell: as it was fitted, and moved; and what the move costs.
    fn losses(training: &Dataset, held: &Dataset) -> (f64, f64, f64) {
        let model = VwPdConfig::default().build().unwrap();
        let question = Question::new(&*model, training, &[]);
        let [scene, other] = [training, held].map(|data| Scene::new(data, &*model, TRACK, None, None));
        let course = OnceCell::new();
        let start = surroundings(setting(&question, training, &scene, Readout::Instantaneous), &question, &course).unwrap();
        let state = State::plain(start.base);
        let noise = Noise::white(&NOISE, &Layout::of(held, &other));
        let there = Setting { data: held, scene: &other, layout: Layout::of(held, &other), ..start.search.setting.clone() };
        let mut given = vec![0.0; there.layout.len()];
        let point = there.point(state.fit.point.x.clone());
        assert!(Runner::new(&there, &[], &point).unwrap().run(&point.x, &point.starts, &mut given));
        let Moved { simulated, cost, .. } = Leeway::new(&start.search, &state, &noise).moved(held, &other).unwrap();
        let loss = |run: &Series| Run { data: held, scene: &other, simulated: run }.loss(&NOISE, None);
        (loss(&there.layout.series(&given)), loss(&simulated), cost)
    }

    #[test]
    fn what_the_training_data_do_not_show_goes_where_other_data_have_it_for_nothing() {
        let (given, moved, cost) = losses(&record(&THETA, 1, 0.02), &record(&THETA, 2, 1.0));
        assert!(given > 1.5 && moved < 1.1 && cost < 40.0, "{given} {moved} {cost}");
    }

    #[test]
    fn what_they_show_stays() {
        let mut other = THETA;
        (other[0], other[1]) = (1.2 * THETA[0], 1.2 * THETA[1]);
        let (given, moved, cost) = losses(&record(&THETA, 3, 1.0), &record(&other, 4, 1.0));
        let values = 2.0 * 1200.0;
        assert!(given > 1.5 && moved * (cost / values).exp() > 1.0 + 0.5 * (given - 1.0), "{given} {moved} {cost}");
    }
}
