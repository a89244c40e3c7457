//! The simulator against closed forms, an independent integrator, and itself with other steps.

use wheelwright_core::Stretch;
use wheelwright_core::channel::{Channel, OMEGA, OMEGA_REF, V, V_REF};
use wheelwright_core::model::{ModelError, Parameter, RegressorModel, Sample};
use wheelwright_core::simulation::{DIFFERENCE, Direction, Readout, Simulator};

const PIONEER: [f64; 6] = [0.2604, 0.2509, -0.0004, 0.9965, 0.0026, 1.0768];
const KHEPERA: [f64; 6] = [0.0228, 0.0568, -0.0001, 1.0030, 0.0732, 0.9981];

/// Equations given as a function that writes Φ and y of one sample.
#[derive(Debug)]
struct Equations {
    inputs: Vec<Channel>,
    outputs: Vec<Channel>,
    parameters: Vec<Parameter>,
    write: fn(Sample<'_>, &mut [f64], &mut [f64]),
}

impl Equations {
    fn new(inputs: &[Channel], outputs: &[Channel], parameters: usize, write: fn(Sample<'_>, &mut [f64], &mut [f64])) -> Self {
        let parameters = (1..=parameters).map(|i| Parameter::new(&format!("theta{i}"), "1", "", "")).collect();
        Self { inputs: inputs.to_vec(), outputs: outputs.to_vec(), parameters, write }
    }
}

impl RegressorModel for Equations {
    fn name(&self) -> &str {
        "test"
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
        (self.write)(sample, phi, y);
    }
}

/// Laut 2011, Appendix A.3.
fn robot() -> Equations {
    Equations::new(&[V_REF, OMEGA_REF], &[V, OMEGA], 6, |s, phi, y| {
        let ([v, w], [dv, dw]) = ([s.outputs[0], s.outputs[1]], [s.accelerations[0], s.accelerations[1]]);
        phi.copy_from_slice(&[dv, 0.0, -w * w, v, 0.0, 0.0, 0.0, dw, 0.0, 0.0, v * w, w]);
        y.copy_from_slice(s.inputs);
    })
}

/// θ x' = x (1 − x), with the exact solution 1 / (1 + (1/x0 − 1) e^{−t/θ}).
fn logistic() -> Equations {
    Equations::new(&[V_REF], &[V], 1, |s, phi, y| {
        let x = s.outputs[0];
        phi[0] = s.accelerations[0];
        y[0] = x * (1.0 - x);
    })
}

fn excited(period: f64, rows: usize, jitter: f64) -> Stretch {
    let time: Vec<f64> = (0..rows).map(|k| period * (k as f64 + jitter * (1.7 * k as f64).sin())).collect();
    let sines = |t: f64, rates: [f64; 4]| rates.iter().map(|r| (r * t).sin()).sum::<f64>();
    let v_ref = time.iter().map(|t| 0.4 + 0.1 * sines(*t, [2.0, 1.0, 1.0 / 3.0, 1.0 / 11.0])).collect();
    let omega_ref = time.iter().map(|t| 0.75 + 0.25 * sines(*t, [1.5, 1.0, 0.5, 0.2])).collect();
    Stretch { label: "0".into(), inputs: vec![v_ref, omega_ref], outputs: vec![vec![0.4; rows], vec![1.0; rows]], time }
}

/// Classical Runge-Kutta with `parts` steps a sample interval; the third vector pair is the mean over the interval.
fn runge_kutta(theta: &[f64; 6], stretch: &Stretch, initial: [f64; 2], parts: usize) -> [Vec<[f64; 2]>; 2] {
    let rate = |x: [f64; 2], u: [f64; 2]| {
        [(u[0] + theta[2] * x[1] * x[1] - theta[3] * x[0]) / theta[0], (u[1] - theta[4] * x[0] * x[1] - theta[5] * x[1]) / theta[1]]
    };
    let (mut x, mut states, mut means) = (initial, vec![initial], vec![initial]);
    for k in 1..stretch.len() {
        let u = [stretch.inputs[0][k - 1], stretch.inputs[1][k - 1]];
        let h = (stretch.time[k] - stretch.time[k - 1]) / parts as f64;
        let mut travelled = [0.0; 2];
        for _ in 0..parts {
            let at = |d: [f64; 2], f: f64| [x[0] + f * d[0], x[1] + f * d[1]];
            let k1 = rate(x, u);
            let k2 = rate(at(k1, h / 2.0), u);
            let k3 = rate(at(k2, h / 2.0), u);
            let k4 = rate(at(k3, h), u);
            for i in 0..2 {
                travelled[i] += h * x[i] + h * h / 6.0 * (k1[i] + k2[i] + k3[i]);
                x[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
            }
        }
        states.push(x);
        means.push([0, 1].map(|i| travelled[i] / (h * parts as f64)));
    }
    [states, means]
}

fn worst(simulated: &[Vec<f64>], reference: &[[f64; 2]]) -> f64 {
    reference.iter().enumerate().flat_map(|(k, r)| [(simulated[0][k] - r[0]).abs(), (simulated[1][k] - r[1]).abs()]).fold(0.0, f64::max)
}

#[test]
fn a_linear_model_follows_its_closed_form_whatever_the_step() {
    let model = robot();
    let theta = [0.0228, 0.5, 0.0, 1.003, 0.0, 0.9];
    let stretch = excited(0.3, 400, 0.3);
    let simulated = Simulator::new(&model, &theta).unwrap().run_measured(&stretch).unwrap();
    for (channel, (lag, gain)) in [(theta[0], theta[3]), (theta[1], theta[5])].into_iter().enumerate() {
        let mut x = stretch.outputs[channel][0];
        for (k, found) in simulated[channel].iter().enumerate().skip(1) {
            let settled = stretch.inputs[channel][k - 1] / gain;
            x = settled + (x - settled) * (-gain * (stretch.time[k] - stretch.time[k - 1]) / lag).exp();
            assert!((found - x).abs() < 1e-13, "row {k}: {found} for {x}");
        }
    }
}

/// v' = −a v + b ω + u, ω' = −b v − a ω: a coupled linear part, solved by e^{−at} (rotation by bt) about the steady state.
#[test]
fn a_coupled_linear_model_follows_its_closed_form() {
    let (a, b, u) = (1.3, 4.0, 0.7);
    let model = Equations::new(&[V_REF], &[V, OMEGA], 3, |s, phi, y| {
        let (x, d) = (s.outputs, s.accelerations);
        phi.copy_from_slice(&[d[0], x[0], -x[1], d[1], x[1], x[0]]);
        y.copy_from_slice(&[s.inputs[0], 0.0]);
    });
    let time: Vec<f64> = (0..200).map(|k| 0.05 * k as f64).collect();
    let stretch = Stretch { label: "0".into(), inputs: vec![vec![u; 200]], outputs: vec![vec![0.2; 200], vec![-0.5; 200]], time };
    let steady = [u * a / (a * a + b * b), -u * b / (a * a + b * b)];
    let start = [0.2 - steady[0], -0.5 - steady[1]];
    let simulated = Simulator::new(&model, &[1.0, a, b]).unwrap().run_measured(&stretch).unwrap();
    for (k, t) in stretch.time.iter().enumerate() {
        let (decay, s, c) = ((-a * t).exp(), (b * t).sin(), (b * t).cos());
        let exact = [steady[0] + decay * (c * start[0] + s * start[1]), steady[1] + decay * (c * start[1] - s * start[0])];
        assert!((simulated[0][k] - exact[0]).abs() < 1e-13 && (simulated[1][k] - exact[1]).abs() < 1e-13, "row {k}");
    }
}

#[test]
fn the_order_is_four() {
    let model = logistic();
    let time: Vec<f64> = (0..9).map(f64::from).collect();
    let stretch = Stretch { label: "0".into(), inputs: vec![vec![0.0; 9]], outputs: vec![vec![0.05; 9]], time };
    let lag = 0.9;
    let error = |substeps: f64| {
        let simulated = Simulator::new(&model, &[lag]).unwrap().with_max_step(1.0 / substeps).run_measured(&stretch).unwrap();
        let exact = |t: &f64| 1.0 / (1.0 + (1.0 / 0.05 - 1.0) * (-t / lag).exp());
        stretch.time.iter().zip(&simulated[0]).map(|(t, x)| (x - exact(t)).abs()).fold(0.0, f64::max)
    };
    for substeps in [8.0, 16.0, 32.0] {
        let order = (error(substeps) / error(2.0 * substeps)).log2();
        assert!((3.8..4.3).contains(&order), "order {order} at {substeps} sub-steps");
    }
}

#[test]
fn the_chosen_step_hides_no_error_on_the_thesis_robots() {
    let model = robot();
    for (theta, period, parts) in [(PIONEER, 0.05, 20), (PIONEER, 0.3, 100), (KHEPERA, 0.02, 60), (KHEPERA, 0.3, 900)] {
        for jitter in [0.0, 0.3] {
            let stretch = excited(period, 600, jitter);
            let mut simulator = Simulator::new(&model, &theta).unwrap();
            let simulated = simulator.run_measured(&stretch).unwrap();
            let [states, means] = runge_kutta(&theta, &stretch, [0.4, 1.0], parts);
            assert!(worst(&simulated, &states) < 1e-8, "{theta:?} at {period} s: {:e}", worst(&simulated, &states));
            let mut simulator = simulator.with_readout(Readout::IntervalMean);
            let simulated = simulator.run_measured(&stretch).unwrap();
            assert!(worst(&simulated, &means) < 1e-8, "means of {theta:?} at {period} s: {:e}", worst(&simulated, &means));
        }
    }
}

/// The sensitivity of a linear first-order lag has a closed form; so has that to the initial state.
#[test]
fn sensitivities_agree_with_closed_forms() {
    let model = robot();
    let (lag, gain) = (0.26, 0.9965);
    let theta = [lag, 0.25, 0.0, gain, 0.0, 1.07];
    let stretch = excited(0.1, 500, 0.0);
    let along = |i: usize| (0..6).map(|k| f64::from(u8::from(k == i))).collect::<Vec<f64>>();
    let directions = [0, 3].map(|i| Direction { along: along(i), step: DIFFERENCE * theta[i] });
    let found = Simulator::new(&model, &theta).unwrap().sensitivities(&stretch, &[0.4, 1.0], &directions).unwrap();
    let decay = (-gain * 0.1 / lag).exp();
    let (mut x, mut to_lag, mut to_gain, mut to_start) = (0.4, 0.0, 0.0, 1.0);
    for k in 1..stretch.len() {
        let settled = stretch.inputs[0][k - 1] / gain;
        let (by_lag, by_gain) = (decay * gain * 0.1 / (lag * lag), -decay * 0.1 / lag);
        to_lag = decay * to_lag + (x - settled) * by_lag;
        to_gain = decay * to_gain + (x - settled) * by_gain - settled / gain * (1.0 - decay);
        to_start *= decay;
        x = settled + (x - settled) * decay;
        let checks = [(found.parameters[0][0][k], to_lag), (found.parameters[1][0][k], to_gain), (found.initial[0][0][k], to_start)];
        for (numeric, exact) in checks {
            assert!((numeric - exact).abs() < 1e-8, "row {k}: {numeric} for {exact}");
        }
        assert_eq!(found.parameters[0][1][k], 0.0, "the first lag does not act on omega");
    }
}

/// Fourth-order differences of the independent integrator, which have other truncation and rounding errors. Short steps:
/// an error of 1e-9 in v, chosen by default, is 4e-6 of the sensitivity to a theta3 of 4e-4.
#[test]
fn sensitivities_of_the_nonlinear_robot_agree_with_differences_of_another_integrator() {
    let model = robot();
    let stretch = excited(0.05, 300, 0.3);
    let along = |i: usize| (0..6).map(|k| f64::from(u8::from(k == i))).collect::<Vec<f64>>();
    let directions: Vec<Direction> = (0..6).map(|i| Direction { along: along(i), step: DIFFERENCE * PIONEER[i].abs().max(0.05) }).collect();
    let mut simulator = Simulator::new(&model, &PIONEER).unwrap().with_max_step(0.004);
    let found = simulator.sensitivities(&stretch, &[0.4, 1.0], &directions).unwrap();
    for i in 0..6 {
        let step = 1e-3 * PIONEER[i].abs().max(0.2);
        let run = |shift: f64| {
            let mut theta = PIONEER;
            theta[i] += shift * step;
            runge_kutta(&theta, &stretch, [0.4, 1.0], 20)[0].clone()
        };
        let (far_up, up, down, far_down) = (run(2.0), run(1.0), run(-1.0), run(-2.0));
        for k in 0..stretch.len() {
            for c in 0..2 {
                let reference = (8.0 * (up[k][c] - down[k][c]) - (far_up[k][c] - far_down[k][c])) / (12.0 * step);
                let numeric = found.parameters[i][c][k];
                assert!((numeric - reference).abs() < 1e-8 * (1.0 + reference.abs()), "theta{}: {numeric} for {reference}", i + 1);
            }
        }
    }
}

#[test]
fn parameters_that_blow_up_end_in_an_error() {
    let model = robot();
    let stretch = excited(0.05, 3000, 0.0);
    let unstable = [-0.01, 0.25, 0.0, 1.0, 0.0, 1.0];
    let error = Simulator::new(&model, &unstable).unwrap().run_measured(&stretch).unwrap_err();
    assert!(matches!(error, ModelError::Diverged { time, .. } if time > 0.0 && time < 20.0), "{error}");
    assert!(matches!(Simulator::new(&model, &[0.0, 0.25, 0.0, 1.0, 0.0, 1.0]), Err(ModelError::Singular { .. })));
    for wild in [1e-300, 1e300, -1e300, f64::NAN, f64::INFINITY] {
        for i in 0..6 {
            let mut theta = PIONEER;
            theta[i] = wild;
            if let Ok(mut simulator) = Simulator::new(&model, &theta) {
                let outcome = simulator.run_measured(&stretch);
                assert!(outcome.is_err() || outcome.unwrap().iter().flatten().all(|x| x.is_finite()));
            }
        }
    }
}

#[test]
fn a_stretch_of_two_samples_runs() {
    let model = robot();
    let stretch = excited(0.05, 2, 0.0);
    assert_eq!(Simulator::new(&model, &PIONEER).unwrap().run_measured(&stretch).unwrap()[0].len(), 2);
}
