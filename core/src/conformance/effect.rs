//! What an effect promises, checked on three small models: one of forward and angular velocity, one of two sides, one of a single
//! channel.

use toml::{Table, Value};

use super::{Findings, Violation};
use crate::channel::{Channel, OMEGA, OMEGA_REF, U_LEFT, U_RIGHT, V, V_REF, VEL_LEFT, VEL_RIGHT};
use crate::config;
use crate::dataset::{Dataset, Stretch};
use crate::effect::{Effect, EffectParameter, EffectSimulator, Estimate, Instant, Motion, Scene};
use crate::model::{ModelError, Parameter, RegressorModel, Sample};
use crate::simulation::Readout;

/// Rows of each stretch of the data.
const ROWS: usize = 240;
/// Samples between changes of the command.
const HELD: usize = 9;
/// Largest difference of a run with neutral values from the plain one, relative to the outputs.
const NEUTRAL: f64 = 1e-9;

/// Checks an effect wherever it applies: that it names itself and its parameters, that bounds, scales and neutral values agree,
/// that its starts fit its parameters, that it says its magnitude in words, that neutral values change nothing and its first start
/// something, that it holds a command where it says so, stays finite within its bounds, gives the same twice, and is written and read
/// again as plain data.
///
/// # Errors
/// Every promise that was not kept.
pub fn check_effect(effect: &dyn Effect) -> Result<(), Vec<Violation>> {
    let mut found = Findings::default();
    found.name("the effect's name", effect.name());
    found.name("what it is", &effect.about());
    found.name("the family", effect.family());
    found.name("the motion that shows it", effect.excitation());
    for confusion in effect.confusions() {
        found.name("the name of a confusion", confusion.with);
        found.name(&format!("why it is confused with `{}`", confusion.with), confusion.because);
    }
    check_plain_data(effect, &mut found);
    let mut applies = false;
    for bench in [Bench::body(), Bench::sides(), Bench::one()] {
        match effect.inapplicable(&bench.scene) {
            Some(reason) => found.name("the reason why it does not apply", &reason),
            None => {
                applies = true;
                Trial { effect, bench: &bench, found: &mut found }.run();
            }
        }
    }
    if !applies {
        found.push(broken("all", "it applies nowhere: not to a body, to two sides nor to single channels".to_owned()));
    }
    found.end()
}

fn broken(channels: &'static str, promise: String) -> Violation {
    Violation::Effect { channels, promise }
}

/// Settings cross files as `type = "NAME"` and keys; an effect of a library is made by its library, not by its name alone.
fn check_plain_data(effect: &dyn Effect, found: &mut Findings) {
    let written = match Table::try_from(effect) {
        Ok(table) => table,
        Err(error) => return found.push(Violation::Failed { call: "writing it as plain data", reason: error.to_string() }),
    };
    let Some((name, Value::Table(mut settings))) = written.into_iter().next() else {
        return found.push(broken("all", "its plain data is no table of settings under its name".to_owned()));
    };
    if name != effect.name() {
        found.push(broken("all", format!("it is written as `{name}` and calls itself `{}`", effect.name())));
    }
    if !config::names::<Box<dyn Effect>>().contains(&name) {
        return;
    }
    settings.insert("type".to_owned(), Value::String(name));
    match config::tagged::<Box<dyn Effect>>(settings) {
        Ok(again) if format!("{again:?}") == format!("{effect:?}") => {}
        Ok(again) => found.push(broken("all", format!("{effect:?} is {again:?} when read again"))),
        Err(error) => found.push(Violation::Failed { call: "reading it from plain data", reason: error.to_string() }),
    }
}

/// A model u = T a + g y of each channel, and a recording of it.
struct Bench {
    /// `body`, `sides` or `single`.
    name: &'static str,
    model: Lags,
    theta: Vec<f64>,
    data: Dataset,
    scene: Scene,
    plain: Vec<Vec<f64>>,
}

#[derive(Debug)]
struct Lags {
    inputs: Vec<Channel>,
    outputs: Vec<Channel>,
    parameters: Vec<Parameter>,
}

impl RegressorModel for Lags {
    fn name(&self) -> &str {
        "lags"
    }

    fn inputs(&self) -> &[Channel] {
        &self.inputs
    }

    fn outputs(&self) -> &[Channel] {
        &self.outputs
    }

    fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    fn regressor(&self, sample: Sample<'_>, phi: &mut [f64], y: &mut [f64]) {
        let (n, p) = (self.outputs.len(), self.parameters.len());
        phi.fill(0.0);
        for i in 0..n {
            phi[i * p + 2 * i] = sample.accelerations[i];
            phi[i * p + 2 * i + 1] = sample.outputs[i];
            y[i] = sample.inputs[i];
        }
    }

    fn accelerations(&self, theta: &[f64], inputs: &[f64], outputs: &[f64], accelerations: &mut [f64]) -> Result<(), ModelError> {
        let each = theta.chunks_exact(2).zip(inputs).zip(outputs);
        accelerations.iter_mut().zip(each).for_each(|(a, ((theta, u), y))| *a = (u - theta[1] * y) / theta[0]);
        Ok(())
    }
}

impl Bench {
    fn body() -> Self {
        Self::new("body", vec![V_REF, OMEGA_REF], vec![V, OMEGA], &[0.26, 1.02, 0.19, 1.05], &[0.5, 1.2])
    }

    fn sides() -> Self {
        Self::new("sides", vec![U_LEFT, U_RIGHT], vec![VEL_LEFT, VEL_RIGHT], &[0.8, 4.0, 0.9, 4.1], &[5.0, 5.0])
    }

    fn one() -> Self {
        Self::new("single", vec![Channel::new("valve", "1")], vec![Channel::new("flow", "m3/s")], &[0.4, 2.0], &[1.0])
    }

    fn new(name: &'static str, inputs: Vec<Channel>, outputs: Vec<Channel>, theta: &[f64], sizes: &[f64]) -> Self {
        let parameter = |i: usize| Parameter::new(&format!("p{i}"), "1", "a lag or a gain", "steps");
        let model = Lags { inputs, outputs, parameters: (0..theta.len()).map(parameter).collect() };
        let stretches = (0..2).map(|s| record(s, theta, sizes)).collect();
        let data = Dataset { inputs: model.inputs.clone(), outputs: model.outputs.clone(), stretches };
        let scene = Scene::new(&data, &model, 0.34, Some(0.09), None);
        let mut bench = Self { name, model, theta: theta.to_vec(), data, scene, plain: Vec::new() };
        bench.plain = bench.simulate(&[], &[]).unwrap_or_default();
        bench
    }

    /// Runs over both stretches, joined.
    fn simulate(&self, effects: &[&dyn Effect], values: &[f64]) -> Result<Vec<Vec<f64>>, ModelError> {
        let mut simulator = EffectSimulator::new(&self.model, &self.theta, effects, &self.scene)?;
        simulator.set(&self.theta, values)?;
        simulator.set_substeps(4);
        let mut all = vec![Vec::new(); self.model.outputs.len()];
        let mut run = all.clone();
        for (s, stretch) in self.data.stretches.iter().enumerate() {
            let initial: Vec<f64> = stretch.outputs.iter().map(|column| column[0]).collect();
            simulator.run(s, stretch, &initial, &mut run)?;
            all.iter_mut().zip(&run).for_each(|(all, run)| all.extend(run));
        }
        Ok(all)
    }

    /// Largest difference from the plain run, relative to the outputs.
    fn difference(&self, run: &[Vec<f64>]) -> f64 {
        let columns = run.iter().zip(&self.plain).zip(&self.scene.scales.outputs);
        columns.flat_map(|((a, b), scale)| a.iter().zip(b).map(move |(a, b)| (a - b).abs() / scale)).fold(0.0, f64::max)
    }
}

/// Held commands of varied size in both directions, with rests, at uneven times; and what lags make of them.
fn record(s: usize, theta: &[f64], sizes: &[f64]) -> Stretch {
    let fraction = |seed: usize| (seed as f64 * 0.618_033_988_749_894_9).fract();
    let mut time = vec![20.0 * s as f64];
    for k in 1..ROWS {
        time.push(time[k - 1] + 0.04 + 0.02 * fraction(k));
    }
    let command = |k: usize, i: usize| {
        let seed = 1 + k / HELD + 31 * i + 57 * s;
        if k / HELD % 7 == 6 { 0.0 } else { sizes[i] * (2.0 * fraction(seed) - 1.0) }
    };
    let inputs: Vec<Vec<f64>> = (0..sizes.len()).map(|i| (0..ROWS).map(|k| command(k, i)).collect()).collect();
    let lag = |i: usize| {
        let (t, g) = (theta[2 * i], theta[2 * i + 1]);
        let mut out = vec![inputs[i][0] / g];
        for k in 1..ROWS {
            let held = inputs[i][k - 1] / g;
            out.push(held + (out[k - 1] - held) * (-(time[k] - time[k - 1]) * g / t).exp());
        }
        out
    };
    let outputs = (0..sizes.len()).map(lag).collect();
    Stretch { label: format!("{}", s + 1), time, inputs, outputs }
}

/// An effect on one bench.
struct Trial<'a> {
    effect: &'a dyn Effect,
    bench: &'a Bench,
    found: &'a mut Findings,
}

impl Trial<'_> {
    fn run(&mut self) {
        let parameters = self.effect.parameters(&self.bench.scene);
        let before = self.found.0.len();
        self.parameters(&parameters);
        self.starts(&parameters);
        if self.found.0.len() > before {
            // What follows takes the lists at their word.
            return;
        }
        self.words(&parameters);
        self.neutral(&parameters);
        self.trace();
        self.holds();
        self.bounds(&parameters);
    }

    fn breaks(&mut self, promise: String) {
        self.found.push(broken(self.bench.name, promise));
    }

    fn parameters(&mut self, parameters: &[EffectParameter]) {
        if parameters.is_empty() {
            self.breaks("it has no parameters".to_owned());
        }
        for (i, p) in parameters.iter().enumerate() {
            self.found.name("the name of a parameter", &p.name);
            self.found.name(&format!("the unit of `{}`", p.name), &p.unit);
            let (lower, upper) = p.bounds;
            if lower.is_nan() || upper.is_nan() || lower >= upper {
                self.breaks(format!("the bounds of `{}` are {lower} and {upper}", p.name));
            }
            if !(p.scale.is_finite() && p.scale > 0.0) {
                self.breaks(format!("the scale of `{}` is {}: it must be a size above zero", p.name, p.scale));
            }
            // A limit that is never reached may lie beyond every limit that can be.
            if p.neutral.is_some_and(|n| !(lower..=upper).contains(&n) && !n.is_infinite()) {
                self.breaks(format!("the neutral value of `{}` lies outside its bounds", p.name));
            }
            if parameters[..i].iter().any(|other| other.name == p.name && other.label == p.label) {
                self.breaks(format!("two parameters are `{}` of the same side or axis", p.name));
            }
        }
        if parameters.iter().all(|p| p.neutral.is_none()) {
            self.breaks("no parameter has a neutral value: it cannot be turned off".to_owned());
        }
    }

    fn starts(&mut self, parameters: &[EffectParameter]) {
        for (s, start) in self.effect.starts(&self.bench.scene).into_iter().enumerate() {
            if start.values.len() != parameters.len() {
                self.breaks(format!("start {s} has {} values for {} parameters", start.values.len(), parameters.len()));
                continue;
            }
            for (p, value) in parameters.iter().zip(&start.values) {
                if !(p.bounds.0..=p.bounds.1).contains(value) {
                    self.breaks(format!("start {s}: `{}` = {value} is not within its bounds {:?}", p.name, p.bounds));
                }
            }
            let mut seen = vec![false; parameters.len()];
            for column in &start.columns {
                let neutral = column.iter().any(|i| parameters.get(*i).is_some_and(|p| p.neutral.is_some()));
                let again = column.iter().any(|i| seen.get_mut(*i).is_none_or(|seen| std::mem::replace(seen, true)));
                if again || !neutral {
                    self.breaks(format!(
                        "start {s}: column {column:?} names no parameter that can be turned off, one twice, or one too many"
                    ));
                }
            }
            if start.columns.is_empty() {
                self.breaks(format!("start {s} has no columns"));
            }
        }
    }

    /// Values of the first start; without one, neutral ones a scale away.
    fn values(&self) -> Vec<f64> {
        let first = self.effect.starts(&self.bench.scene).into_iter().next();
        let away = |p: &EffectParameter| {
            let from = p.neutral.filter(|n| n.is_finite()).unwrap_or(p.scale);
            (from + p.scale).min(p.bounds.1).max(p.bounds.0)
        };
        first.map_or_else(|| self.effect.parameters(&self.bench.scene).iter().map(away).collect(), |s| s.values)
    }

    fn words(&mut self, parameters: &[EffectParameter]) {
        let say = |factor: f64, interval: bool| {
            let estimate = |x: &f64| Estimate { value: factor * x, ci95: interval.then_some((0.9 * factor * x, 1.1 * factor * x)) };
            self.effect.statement(&self.values().iter().map(estimate).collect::<Vec<_>>(), &self.bench.scene)
        };
        let (plain, double, interval) = (say(1.0, false), say(2.0, false), say(1.0, true));
        self.found.name("the statement", &plain);
        if plain == double {
            self.breaks(format!("its statement does not tell its magnitude: \"{plain}\""));
        }
        if plain == interval && !parameters.is_empty() {
            self.breaks(format!("its statement leaves the interval out: \"{plain}\""));
        }
    }

    fn neutral(&mut self, parameters: &[EffectParameter]) {
        let values: Vec<f64> = parameters.iter().zip(self.values()).map(|(p, value)| p.neutral.unwrap_or(value)).collect();
        match self.bench.simulate(&[self.effect], &values) {
            Err(error) => self.breaks(format!("a run with neutral values fails: {error}")),
            Ok(run) => {
                let difference = self.bench.difference(&run);
                if difference.is_nan() || difference > NEUTRAL {
                    self.breaks(format!("neutral values {values:?} change a run by {difference} of its size"));
                }
            }
        }
    }

    /// Each start is run, twice; the first must leave a trace. An effect without starts is not found by a run.
    fn trace(&mut self) {
        let (mut traced, starts) = (false, self.effect.starts(&self.bench.scene));
        for start in &starts {
            let [once, again] = [0, 1].map(|_| self.bench.simulate(&[self.effect], &start.values));
            match (once, again) {
                (Ok(once), Ok(again)) => {
                    traced |= self.bench.difference(&once) > 0.0;
                    if once != again {
                        self.breaks(format!("two runs with {:?} differ", start.values));
                    }
                }
                (Err(error), _) | (_, Err(error)) => self.breaks(format!("a run with {:?} fails: {error}", start.values)),
            }
        }
        if !traced && !starts.is_empty() {
            self.breaks("it leaves no trace at any of its starts".to_owned());
        }
    }

    /// Every hook at the corners of the bounds: finite, and the same length.
    fn bounds(&mut self, parameters: &[EffectParameter]) {
        let usual = self.values();
        for i in 0..parameters.len() {
            let p = &parameters[i];
            let far = |x: f64| if x.is_finite() { x } else { x.signum() * 1e6 * p.scale };
            let neutral = p.neutral.unwrap_or(p.bounds.0);
            for value in [p.bounds.0, p.bounds.1, far(p.bounds.0), far(p.bounds.1), neutral] {
                // An endless value is one within bounds only where it is the neutral one.
                if value.is_finite() || p.neutral == Some(value) {
                    let mut values = usual.clone();
                    values[i] = value;
                    if let Some(hook) = self.hooks(&values) {
                        self.breaks(format!("{hook} gives a value that is not finite at {values:?}"));
                    }
                }
            }
        }
    }

    /// What holds is the same throughout an interval in which it does not switch, whatever the outputs do.
    fn holds(&mut self) {
        if !self.effect.holds() {
            return;
        }
        let (scene, stretch, p) = (&self.bench.scene, &self.bench.data.stretches[1], self.values());
        let mut state = vec![0.0; self.effect.states(scene)];
        for k in 0..ROWS - 1 {
            let (start, interval) = (stretch.time[k], stretch.time[k + 1] - stretch.time[k]);
            let sample = Instant::of_sample(stretch, k, &scene.tracks[1], scene, Readout::default());
            let at = |share: f64| Instant { time: start + share * interval, ..sample };
            let sent: Vec<f64> = stretch.inputs.iter().map(|c| c[k]).collect();
            let mut command = |share: f64, outputs: f64| {
                let (mut u, outputs) = (sent.clone(), vec![outputs; stretch.outputs.len()]);
                self.effect.command(&p, &at(share), &outputs, &mut state, &mut u);
                u
            };
            let (early, late) = (command(0.1, 0.3), command(0.9, -0.7));
            if early != late && self.effect.next_switch(&p, &at(0.1), &state) > at(0.9).time {
                return self.breaks(format!("it says that it holds, and its command changes within the interval from t = {start} s"));
            }
        }
    }

    /// The first hook that gives a value that is not finite.
    fn hooks(&self, p: &[f64]) -> Option<&'static str> {
        let Self { effect, bench, .. } = self;
        let (scene, stretch) = (&bench.scene, &bench.data.stretches[1]);
        let n = stretch.inputs.len();
        let mut state = vec![0.0; effect.states(scene)];
        let sample = |k: usize| Instant::of_sample(stretch, k, &scene.tracks[1], scene, Readout::default());
        let of = |columns: &[Vec<f64>], k: usize| columns.iter().map(|c| c[k]).collect::<Vec<f64>>();
        effect.begin(p, &sample(0), &of(&stretch.inputs, 0), &of(&stretch.outputs, 0), &mut state);
        let [inertia, drag] = [0.5, 1.0].map(|x| (0..n * n).map(|i| if i % (n + 1) == 0 { x } else { 0.0 }).collect::<Vec<f64>>());
        let past = |time: f64, out: &mut [f64]| {
            let k = stretch.time.partition_point(|t| *t <= time).max(1) - 1;
            out.iter_mut().zip(&stretch.outputs).for_each(|(out, column)| *out = column[k]);
        };
        let bad = |values: &[f64]| values.iter().any(|x| !x.is_finite());
        for k in 1..ROWS {
            let interval = stretch.time[k] - stretch.time[k - 1];
            let at = Instant { span: interval, step: interval, ..sample(k) };
            let (mut u, mut x) = (of(&stretch.inputs, k), of(&stretch.outputs, k));
            let (mut load, mut drive) = (vec![0.0; n], u.iter().zip(&x).map(|(u, x)| u - x).collect::<Vec<f64>>());
            effect.command(p, &at, &x, &mut state, &mut u);
            effect.load(p, &at, &x, &state, &mut load);
            let motion = Motion { u: &u, outputs: &x, inertia: &inertia, drag: &drag, held: &load };
            effect.drive(p, &at, &motion, &state, &mut drive);
            effect.advance(p, &at, &motion, &drive, &mut state);
            effect.measure(p, &at, &past, &mut state, &mut x);
            let switch = effect.next_switch(p, &at, &state);
            let results: [(&str, &[f64]); 5] = [("command", &u), ("load", &load), ("drive", &drive), ("measure", &x), ("a state", &state)];
            if let Some((hook, _)) = results.into_iter().find(|(_, values)| bad(values)) {
                return Some(hook);
            }
            if switch.is_nan() {
                return Some("next_switch");
            }
        }
        None
    }
}

#[cfg(test)]
#[path = "effect_tests.rs"]
mod tests;
