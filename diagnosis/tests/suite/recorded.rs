//! Recordings whose truth is known, made with the effects' own equations: for tests of the search, not of the equations.

use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use wheelwright_core::effect::{Effect, EffectSimulator, Scene};
use wheelwright_core::simulation::Readout;
use wheelwright_core::{Dataset, ModelConfig, RegressorModel, Stretch};
use wheelwright_diagnosis::effects::{
    ActuatorLag, CommandDelay, CommandOffset, CoulombFriction, GainAsymmetry, QuadraticDrag, VelocitySaturation,
};
use wheelwright_diagnosis::{Diagnosis, Question, diagnose};
use wheelwright_models::VwPdConfig;

/// Effects with the values of their parameters.
pub(crate) type Hidden<'a> = [(&'a dyn Effect, &'a [f64])];

pub(crate) const THETA: [f64; 6] = [0.24, 0.18, -0.01, 1.02, 0.03, 1.05];
pub(crate) const TRACK: f64 = 0.34;
pub(crate) const NOISE: f64 = 0.01;

pub(crate) fn model() -> Box<dyn RegressorModel> {
    VwPdConfig::default().build().unwrap()
}

/// A small library, so that a test takes no longer than it must.
pub(crate) fn library() -> Vec<Box<dyn Effect>> {
    vec![
        Box::new(CommandDelay::default()),
        Box::new(ActuatorLag::default()),
        Box::new(CoulombFriction::default()),
        Box::new(QuadraticDrag::default()),
        Box::new(GainAsymmetry::default()),
        Box::new(VelocitySaturation::default()),
        Box::new(CommandOffset {}),
    ]
}

/// Steps of random length, in both directions or in one.
pub(crate) fn commands(random: &mut StdRng, rows: usize, reverses: bool) -> Stretch {
    let (mut v, mut w) = (0.3, 0.0);
    let mut inputs = vec![Vec::new(), Vec::new()];
    for _ in 0..rows {
        if random.random_bool(0.06) {
            v = if reverses { random.random_range(-0.5..0.6) } else { random.random_range(0.25..0.6) };
            w = random.random_range(-1.0..1.0) * if reverses { 1.0 } else { 0.5 };
        }
        inputs[0].push(v);
        inputs[1].push(w);
    }
    let time = (0..rows).map(|k| 0.05 * k as f64).collect();
    let mut outputs = inputs.clone();
    // The robot stands still when the recording begins, with a command just given.
    outputs.iter_mut().for_each(|c| c[0] = 0.0);
    Stretch { label: "1".to_owned(), time, outputs, inputs }
}

/// A recording of a model with effects, under noise that remembers `colour` of itself.
pub(crate) fn record(seed: u64, rows: usize, reverses: bool, effects: &Hidden<'_>, colour: f64) -> Dataset {
    record_on(TRACK, seed, rows, reverses, effects, colour)
}

/// The same of a robot with another track width.
pub(crate) fn record_on(track: f64, seed: u64, rows: usize, reverses: bool, effects: &Hidden<'_>, colour: f64) -> Dataset {
    record_with(NOISE, track, seed, rows, reverses, effects, colour)
}

/// The same with noise of this size.
pub(crate) fn record_with(noise: f64, track: f64, seed: u64, rows: usize, reverses: bool, effects: &Hidden<'_>, colour: f64) -> Dataset {
    let mut random = StdRng::seed_from_u64(seed);
    let stretch = commands(&mut random, rows, reverses);
    driven(noise, track, &mut random, stretch, effects, colour)
}

/// What is recorded of a drive.
pub(crate) fn driven(noise: f64, track: f64, random: &mut StdRng, stretch: Stretch, effects: &Hidden<'_>, colour: f64) -> Dataset {
    let model = model();
    let mut data = Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![stretch] };
    let mut run = simulated(&data, track, effects, Readout::Instantaneous);
    for (i, series) in run.iter_mut().enumerate() {
        let mut e = 0.0;
        for x in series.iter_mut() {
            let fresh: f64 = StandardNormal.sample(random);
            e = colour * e + (1.0 - colour * colour).sqrt() * fresh;
            *x += noise * [1.0, 2.0][i] * e;
        }
    }
    data.stretches[0].outputs = run;
    data
}

/// What a drive makes of the model with effects, from rest.
fn simulated(data: &Dataset, track: f64, effects: &Hidden<'_>, readout: Readout) -> Vec<Vec<f64>> {
    let model = model();
    let scene = Scene::new(data, &*model, track, None, None);
    let list: Vec<&dyn Effect> = effects.iter().map(|e| e.0).collect();
    let values: Vec<f64> = effects.iter().flat_map(|e| e.1.iter().copied()).collect();
    let mut simulator = EffectSimulator::new(&*model, &THETA, &list, &scene).unwrap().with_readout(readout);
    simulator.set(&THETA, &values).unwrap();
    simulator.set_substeps(4);
    let mut run = vec![Vec::new(); 2];
    simulator.run(0, &data.stretches[0], &[0.0, 0.0], &mut run).unwrap();
    run
}

/// The noise of a recording.
pub(crate) fn noise_of(seed: u64, rows: usize) -> Vec<Vec<f64>> {
    let [noisy, clean] = [NOISE, 0.0].map(|noise| record_with(noise, TRACK, seed, rows, true, &[], 0.0));
    let pairs = noisy.stretches[0].outputs.iter().zip(&clean.stretches[0].outputs);
    pairs.map(|(noisy, clean)| noisy.iter().zip(clean).map(|(n, c)| n - c).collect()).collect()
}

/// Adds the noise of a recording to a run.
pub(crate) fn add_noise(run: &mut [Vec<f64>], seed: u64, rows: usize) {
    run.iter_mut().zip(noise_of(seed, rows)).for_each(|(run, noise)| run.iter_mut().zip(noise).for_each(|(x, n)| *x += n));
}

/// A recording whose outputs are means over the interval.
pub(crate) fn averaged(seed: u64, rows: usize, effects: &Hidden<'_>) -> Dataset {
    let mut data = record_with(0.0, TRACK, seed, rows, true, effects, 0.0);
    let mut run = simulated(&data, TRACK, effects, Readout::IntervalMean);
    add_noise(&mut run, seed, rows);
    data.stretches[0].outputs = run;
    data
}

/// A recording of which forward speed is a mean over the interval and turning is not; turning is commanded in steps and driving gently, or the
/// other way round.
pub(crate) fn half_averaged(seed: u64, rows: usize, turns: bool) -> Dataset {
    let mut random = StdRng::seed_from_u64(seed);
    let mut stretch = commands(&mut random, rows, true);
    let gently = |size: f64| stretch.time.iter().map(|t| size * (0.4 * t).sin()).collect();
    let (input, slow) = if turns { (0, gently(0.4)) } else { (1, gently(0.8)) };
    stretch.inputs[input] = slow;
    let mut data = driven(0.0, TRACK, &mut random, stretch, &[], 0.0);
    data.stretches[0].outputs[0] = simulated(&data, TRACK, &[], Readout::IntervalMean).swap_remove(0);
    add_noise(&mut data.stretches[0].outputs, seed, rows);
    data
}

/// A recording of wheels whose encoders count in steps of so much travel: differences of whole counts.
pub(crate) fn counted(seed: u64, rows: usize, effects: &Hidden<'_>, travel: f64) -> Dataset {
    let mut data = record_with(0.0, TRACK, seed, rows, true, effects, 0.0);
    let run = simulated(&data, TRACK, effects, Readout::IntervalMean);
    let step = data.stretches[0].time[1] - data.stretches[0].time[0];
    // Where the marks stand at the start.
    let (mut way, mut counts) = ([0.3 * travel, 0.8 * travel], [0.0; 2]);
    for (k, (v, omega)) in run[0].iter().zip(&run[1]).enumerate() {
        let speeds = [v - 0.5 * TRACK * omega, v + 0.5 * TRACK * omega];
        let seen = [0, 1].map(|side| {
            way[side] += speeds[side] * step;
            let before = std::mem::replace(&mut counts[side], (way[side] / travel).floor());
            (counts[side] - before) * travel / step
        });
        data.stretches[0].outputs[0][k] = 0.5 * (seen[0] + seen[1]);
        data.stretches[0].outputs[1][k] = (seen[1] - seen[0]) / TRACK;
    }
    data
}

pub(crate) fn ask(training: &Dataset, held_out: Option<&Dataset>) -> Diagnosis {
    let (model, library) = (model(), library());
    let mut question = Question::new(&*model, training, &library);
    question.held_out = held_out;
    question.track_width = Some(TRACK);
    diagnose(&question).unwrap()
}

pub(crate) fn names(diagnosis: &Diagnosis) -> Vec<&str> {
    diagnosis.effects.iter().map(|e| e.name.as_str()).collect()
}
