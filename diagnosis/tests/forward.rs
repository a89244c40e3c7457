//! The simulation with effects against plain integrations with very small steps, written anew for each case.

#![allow(clippy::unwrap_used)]

use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use wheelwright_core::effect::{Effect, EffectSimulator, Scene};
use wheelwright_core::simulation::Simulator;
use wheelwright_core::{Dataset, ModelConfig, RegressorModel, Stretch};
use wheelwright_diagnosis::effects::{ActuatorLag, CommandDelay, CoulombFriction};
use wheelwright_models::VwPdConfig;

const THETA: [f64; 6] = [0.26, 0.19, -0.01, 1.02, 0.05, 1.05];
const HALF_TRACK: f64 = 0.17;

fn model() -> Box<dyn RegressorModel> {
    VwPdConfig::default().build().unwrap()
}

/// Steps of random length at uneven times, through standstill and backwards.
fn data(model: &dyn RegressorModel) -> Dataset {
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
fn reference<const N: usize>(
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

fn held(stretch: &Stretch, time: f64) -> [f64; 2] {
    let row = stretch.time.partition_point(|t| *t <= time).max(1) - 1;
    [stretch.inputs[0][row], stretch.inputs[1][row]]
}

fn base(u: [f64; 2], x: &[f64]) -> [f64; 2] {
    let (v, w) = (x[0], x[1]);
    [(u[0] + THETA[2] * w * w - THETA[3] * v) / THETA[0], (u[1] - THETA[4] * v * w - THETA[5] * w) / THETA[1]]
}

/// Root mean square difference of the simulation from a reference, relative to the outputs'.
fn difference<const N: usize>(
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

#[test]
fn without_effects_it_agrees_with_the_plain_simulator() {
    let model = model();
    let data = data(&*model);
    let scene = Scene::new(&data, &*model, 2.0 * HALF_TRACK, None, None);
    let stretch = &data.stretches[0];
    let plain = Simulator::new(&*model, &THETA).unwrap().run_measured(stretch).unwrap();
    let mut simulator = EffectSimulator::new(&*model, &THETA, &[], &scene).unwrap();
    simulator.choose_substeps(&data.stretches).unwrap();
    let mut run = vec![Vec::new(); 2];
    simulator.run(0, stretch, &[0.3, 0.2], &mut run).unwrap();
    let worst = plain.iter().flatten().zip(run.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-4, "{worst}");
}

#[test]
fn a_delay_shifts_the_command_to_the_instant() {
    for tau in [0.013, 0.05, 0.187] {
        let model = model();
        let switches: Vec<f64> = data(&*model).stretches[0].time.iter().map(|t| t + tau).collect();
        let error = difference(&[&CommandDelay {}], &[tau], &switches, [0.3, 0.2], |s, t, x| base(held(s, t - tau), x));
        assert!(error < 5e-5, "delay {tau}: {error}");
    }
}

#[test]
fn a_lag_filters_the_command() {
    for tau in [0.004, 0.08, 0.3] {
        let error = difference(&[&ActuatorLag {}], &[tau], &[], [0.3, 0.2, 0.3, 0.2], |s, t, x| {
            let (u, a) = (held(s, t), base([x[2], x[3]], x));
            [a[0], a[1], (u[0] - x[2]) / tau, (u[1] - x[3]) / tau]
        });
        assert!(error < 5e-5, "lag {tau}: {error}");
    }
}

#[test]
fn friction_brakes_each_wheel() {
    for (c, rho) in [(0.02, 1.0), (0.06, 1.8)] {
        let model = model();
        let scene = Scene::new(&data(&*model), &*model, 2.0 * HALF_TRACK, None, None);
        let kink = 0.008 * scene.scales.speed;
        let error = difference(&[&CoulombFriction {}], &[c, rho], &[], [0.3, 0.2], |s, t, x| {
            let u = held(s, t);
            let [l, r] = [x[0] - HALF_TRACK * x[1], x[0] + HALF_TRACK * x[1]].map(|s| c * (s / kink).tanh());
            base([u[0] - 0.5 * (l + r), u[1] - rho * (r - l) / (2.0 * HALF_TRACK)], x)
        });
        assert!(error < 2e-4, "friction {c}: {error}");
    }
}

#[test]
fn effects_act_in_the_order_of_their_stages_however_they_are_given() {
    let (tau, lag) = (0.06, 0.1);
    let model = model();
    let switches: Vec<f64> = data(&*model).stretches[0].time.iter().map(|t| t + tau).collect();
    let error = difference(&[&ActuatorLag {}, &CommandDelay {}], &[lag, tau], &switches, [0.3, 0.2, 0.3, 0.2], |s, t, x| {
        let (u, a) = (held(s, t - tau), base([x[2], x[3]], x));
        [a[0], a[1], (u[0] - x[2]) / lag, (u[1] - x[3]) / lag]
    });
    assert!(error < 5e-5, "{error}");
}
