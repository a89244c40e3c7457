//! A plain integration with very small steps, against which the simulation with effects is held.

#![allow(clippy::unwrap_used, dead_code, unreachable_pub)]

use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use wheelwright_core::effect::{Effect, EffectSimulator, Scene};
use wheelwright_core::{Dataset, ModelConfig, RegressorModel, Stretch};
use wheelwright_models::VwPdConfig;

pub const THETA: [f64; 6] = [0.26, 0.19, -0.01, 1.02, 0.05, 1.05];
pub const HALF_TRACK: f64 = 0.17;

pub fn model() -> Box<dyn RegressorModel> {
    VwPdConfig::default().build().unwrap()
}

/// Steps of random length at uneven times, through standstill and backwards.
pub fn data(model: &dyn RegressorModel) -> Dataset {
    let mut random = StdRng::seed_from_u64(7);
    let (mut time, mut v, mut w) = (vec![0.0], vec![0.3], vec![0.2]);
    while time.len() < 1500 {
        time.push(time[time.len() - 1] + 0.05 * random.random_range(0.9..1.1));
        let change = random.random_bool(0.07);
        v.push(if change { random.random_range(-0.5..0.6) } else { v[v.len() - 1] });
        w.push(if change { random.random_range(-1.0..1.0) } else { w[w.len() - 1] });
    }
    let stretch = Stretch { label: "1".to_owned(), outputs: vec![v.clone(), w.clone()], inputs: vec![v, w], time };
    Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![stretch] }
}

/// Fourth-order Runge-Kutta with steps of at most 0.2 ms, cut at the times `switches` and at samples.
pub fn reference<const N: usize>(
    stretch: &Stretch,
    start: [f64; N],
    switches: &[f64],
    slope: impl Fn(f64, &[f64; N]) -> [f64; N],
) -> Vec<[f64; N]> {
    let mut cuts: Vec<f64> = stretch.time.iter().chain(switches).copied().filter(|t| *t <= stretch.time[stretch.len() - 1]).collect();
    cuts.sort_by(f64::total_cmp);
    let mut x = start;
    let mut out = vec![x];
    let mut row = 1;
    for pair in cuts.windows(2) {
        let (from, to) = (pair[0], pair[1]);
        let n = ((to - from) / 2e-4).ceil().max(1.0);
        let h = (to - from) / n;
        for i in 0..n as usize {
            // Evaluated inside the step only, so that no stage meets the switch.
            let at = |share: f64| from + (i as f64 + share) * h;
            let moved = |k: &[f64; N], f: f64| -> [f64; N] { std::array::from_fn(|j| x[j] + f * h * k[j]) };
            let k1 = slope(at(1e-6), &x);
            let k2 = slope(at(0.5), &moved(&k1, 0.5));
            let k3 = slope(at(0.5), &moved(&k2, 0.5));
            let k4 = slope(at(1.0 - 1e-6), &moved(&k3, 1.0));
            x = std::array::from_fn(|j| x[j] + h / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j]));
        }
        if row < stretch.len() && (to - stretch.time[row]).abs() < 1e-12 {
            out.push(x);
            row += 1;
        }
    }
    out
}

pub fn held(stretch: &Stretch, time: f64) -> [f64; 2] {
    let row = stretch.time.partition_point(|t| *t <= time).max(1) - 1;
    [stretch.inputs[0][row], stretch.inputs[1][row]]
}

pub fn base(u: [f64; 2], x: &[f64]) -> [f64; 2] {
    let (v, w) = (x[0], x[1]);
    [(u[0] + THETA[2] * w * w - THETA[3] * v) / THETA[0], (u[1] - THETA[4] * v * w - THETA[5] * w) / THETA[1]]
}

/// The scene of the test data.
pub fn scene() -> Scene {
    let model = model();
    Scene::new(&data(&*model), &*model, 2.0 * HALF_TRACK, None, None)
}

/// Root mean square difference of the simulation from a reference, relative to the outputs'.
pub fn difference<const N: usize>(
    effects: &[&dyn Effect],
    values: &[f64],
    switches: &[f64],
    start: [f64; N],
    slope: impl Fn(&Stretch, f64, &[f64; N]) -> [f64; N],
) -> f64 {
    let model = model();
    let data = data(&*model);
    let scene = Scene::new(&data, &*model, 2.0 * HALF_TRACK, None, None);
    let stretch = &data.stretches[0];
    let mut simulator = EffectSimulator::new(&*model, &THETA, effects, &scene).unwrap();
    simulator.set(&THETA, values).unwrap();
    simulator.choose_substeps(&data.stretches).unwrap();
    let mut run = vec![Vec::new(); 2];
    simulator.run(0, stretch, &start[..2], &mut run).unwrap();
    let truth = reference(stretch, start, switches, |t, x| slope(stretch, t, x));
    assert_eq!(truth.len(), stretch.len());
    let sum: f64 =
        (0..2).map(|i| truth.iter().zip(&run[i]).map(|(t, r)| ((t[i] - r) / scene.scales.outputs[i]).powi(2)).sum::<f64>()).sum();
    (sum / (2 * truth.len()) as f64).sqrt()
}
