//! Recordings of drives in steps, with an effect and noise.

use std::ops::Range;

use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use wheelwright_core::effect::{Effect, EffectSimulator, Scene};
use wheelwright_core::{Dataset, RegressorModel, Stretch};

/// Commands at 20 Hz that change now and then.
pub(crate) struct Drive {
    pub(crate) samples: usize,
    /// How likely a sample is to bring a change.
    pub(crate) change: f64,
    pub(crate) forward: Range<f64>,
    pub(crate) turning: Range<f64>,
    pub(crate) seed: u64,
}

impl Drive {
    /// What a robot with an effect at some values answers to them, and the randomness that is left for its noise.
    pub(crate) fn driven(
        &self,
        model: &dyn RegressorModel,
        theta: &[f64],
        track: f64,
        effect: &dyn Effect,
        values: &[f64],
    ) -> (Dataset, StdRng) {
        let mut random = StdRng::seed_from_u64(self.seed);
        let (mut time, mut v, mut w) = (vec![0.0], vec![0.0], vec![0.0]);
        while time.len() < self.samples {
            time.push(time[time.len() - 1] + 0.05);
            let change = random.random_bool(self.change);
            v.push(if change { random.random_range(self.forward.clone()) } else { v[v.len() - 1] });
            w.push(if change { random.random_range(self.turning.clone()) } else { w[w.len() - 1] });
        }
        let stretch = Stretch { label: "1".to_owned(), outputs: vec![v.clone(), w.clone()], inputs: vec![v, w], time };
        let mut data = Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![stretch] };
        let scene = Scene::new(&data, model, track, None, None);
        let mut simulator = EffectSimulator::new(model, theta, &[effect], &scene).unwrap();
        simulator.set(theta, values).unwrap();
        simulator.set_substeps(8);
        let mut run = vec![Vec::new(); 2];
        simulator.run(0, &data.stretches[0], &[0.0, 0.0], &mut run).unwrap();
        data.stretches[0].outputs = run;
        (data, random)
    }
}

/// Adds white noise to each output.
pub(crate) fn blur(data: &mut Dataset, deviations: [f64; 2], random: &mut StdRng) {
    for (series, deviation) in data.stretches[0].outputs.iter_mut().zip(deviations) {
        series.iter_mut().for_each(|x| {
            let unit: f64 = StandardNormal.sample(random);
            *x += deviation * unit;
        });
    }
}
