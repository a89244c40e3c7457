//! The simulation with effects against plain integrations with very small steps, written anew for each case.

use crate::common::{HALF_TRACK, THETA, base, data, difference, held, model};
use wheelwright_core::effect::{EffectSimulator, Scene};
use wheelwright_core::simulation::Simulator;
use wheelwright_diagnosis::effects::{ActuatorLag, CommandDelay, CoulombFriction};

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
        let error = difference(&[&CommandDelay::default()], &[tau], &switches, [0.3, 0.2], |s, t, x| base(held(s, t - tau), x));
        assert!(error < 5e-5, "delay {tau}: {error}");
    }
}

#[test]
fn a_lag_filters_the_command() {
    for tau in [0.004, 0.08, 0.3] {
        let error = difference(&[&ActuatorLag::default()], &[tau], &[], [0.3, 0.2, 0.3, 0.2], |s, t, x| {
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
        let error = difference(&[&CoulombFriction::default()], &[c, rho], &[], [0.3, 0.2], |s, t, x| {
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
    let error =
        difference(&[&ActuatorLag::default(), &CommandDelay::default()], &[lag, tau], &switches, [0.3, 0.2, 0.3, 0.2], |s, t, x| {
            let (u, a) = (held(s, t - tau), base([x[2], x[3]], x));
            [a[0], a[1], (u[0] - x[2]) / lag, (u[1] - x[3]) / lag]
        });
    assert!(error < 5e-5, "{error}");
}
