//! Two robots, one commanded by velocities and one by voltages, and plain integrations of what they do.

#![allow(clippy::unwrap_used, dead_code, unreachable_pub)]

use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use wheelwright_core::effect::{Effect, EffectSimulator, Scene};
use wheelwright_core::simulation::Readout;
use wheelwright_core::{Dataset, ModelConfig, RegressorModel, Stretch};
use wheelwright_models::{VwPdConfig, WheelVoltageConfig};

pub const HALF_TRACK: f64 = 0.17;

/// A robot as its model, its parameters and a recording's commands.
pub struct Rig {
    pub model: Box<dyn RegressorModel>,
    pub theta: Vec<f64>,
    pub data: Dataset,
    /// Accelerations that a net input gives; written here, not asked of the model.
    pub base: fn([f64; 2], [f64; 2]) -> [f64; 2],
    pub start: [f64; 2],
    /// Width of the smooth sign of a friction [m/s].
    pub kink: f64,
}

/// Velocity commands: th1 v' = u_v + th3 w² − th4 v, th2 w' = u_w − th5 v w − th6 w.
pub fn body() -> Rig {
    let base = |u: [f64; 2], x: [f64; 2]| {
        let [v, w] = x;
        [(u[0] - 0.01 * w * w - 1.02 * v) / 0.26, (u[1] - 0.05 * v * w - 1.05 * w) / 0.19]
    };
    rig(Box::new(VwPdConfig::default()), &[0.26, 0.19, -0.01, 1.02, 0.05, 1.05], [1.0, 1.0], [0.5, 1.0], base, [0.3, 0.2])
}

/// Voltages: each side u = kV s + kA s'.
pub fn sides() -> Rig {
    let base = |u: [f64; 2], x: [f64; 2]| [(u[0] - 2.5 * x[0]) / 0.4, (u[1] - 2.4 * x[1]) / 0.45];
    let config = WheelVoltageConfig { static_friction: false, symmetric: false };
    rig(Box::new(config), &[2.5, 0.4, 2.4, 0.45], [0.4, 0.4], [4.0, 4.0], base, [0.3, 0.4])
}

/// Steps of random length at uneven times, through standstill, in both directions.
fn rig(
    config: Box<dyn ModelConfig>,
    theta: &[f64],
    outputs: [f64; 2],
    inputs: [f64; 2],
    base: fn([f64; 2], [f64; 2]) -> [f64; 2],
    start: [f64; 2],
) -> Rig {
    let model = config.build().unwrap();
    let mut random = StdRng::seed_from_u64(11);
    let (mut time, mut u) = (vec![0.0], vec![vec![0.6 * inputs[0]], vec![0.2 * inputs[1]]]);
    while time.len() < 900 {
        time.push(time[time.len() - 1] + 0.05 * random.random_range(0.9..1.1));
        let change = random.random_bool(0.08);
        for (u, size) in u.iter_mut().zip(inputs) {
            u.push(if change { size * random.random_range(-1.0..1.1) } else { u[u.len() - 1] });
        }
    }
    // Outputs set scales and tracks only; a simulation takes nothing from them but its start.
    let measured = [0, 1].map(|i| u[i].iter().map(|u| outputs[i] * u).collect());
    let stretch = Stretch { label: "1".to_owned(), outputs: measured.into(), inputs: u, time };
    let data = Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![stretch] };
    let kink = 0.008 * Scene::new(&data, &*model, 2.0 * HALF_TRACK, None, None).scales.speed;
    Rig { model, theta: theta.to_vec(), data, base, start, kink }
}

impl Rig {
    pub fn scene(&self) -> Scene {
        Scene::new(&self.data, &*self.model, 2.0 * HALF_TRACK, None, None)
    }

    pub fn stretch(&self) -> &Stretch {
        &self.data.stretches[0]
    }

    pub fn run(&self, effects: &[&dyn Effect], values: &[f64]) -> Vec<Vec<f64>> {
        self.read(effects, values, Readout::Instantaneous)
    }

    /// The outputs' means over each interval, with one effect.
    pub fn mean_run(&self, effect: &dyn Effect, values: &[f64]) -> Vec<Vec<f64>> {
        self.read(&[effect], values, Readout::IntervalMean)
    }

    fn read(&self, effects: &[&dyn Effect], values: &[f64], readout: Readout) -> Vec<Vec<f64>> {
        let scene = self.scene();
        let mut simulator = EffectSimulator::new(&*self.model, &self.theta, effects, &scene).unwrap().with_readout(readout);
        simulator.set(&self.theta, values).unwrap();
        simulator.choose_substeps(&self.data.stretches).unwrap();
        let mut run = vec![Vec::new(); 2];
        simulator.run(0, self.stretch(), &self.start, &mut run).unwrap();
        run
    }

    /// Root mean square difference, relative to the outputs', of an effect's simulation from the integration of `slope(time, u, x)`.
    /// The first two of `x` are the outputs.
    pub fn error<const N: usize>(
        &self,
        effect: &dyn Effect,
        values: &[f64],
        start: [f64; N],
        switches: &[f64],
        slope: impl Fn(f64, [f64; 2], [f64; N]) -> [f64; N],
    ) -> f64 {
        self.joint_error(&[effect], values, start, switches, slope)
    }

    /// The same of several effects.
    pub fn joint_error<const N: usize>(
        &self,
        effects: &[&dyn Effect],
        values: &[f64],
        start: [f64; N],
        switches: &[f64],
        slope: impl Fn(f64, [f64; 2], [f64; N]) -> [f64; N],
    ) -> f64 {
        let (run, truth) = (self.run(effects, values), integrate(self.stretch(), start, switches, slope));
        let plain = self.run(&[], &[]);
        let scale = self.scene().scales.outputs;
        let rms = |a: &dyn Fn(usize, usize) -> f64| {
            let sum: f64 = (0..2).map(|i| (0..truth.len()).map(|k| (a(i, k) / scale[i]).powi(2)).sum::<f64>()).sum();
            (sum / (2 * truth.len()) as f64).sqrt()
        };
        let did = rms(&|i, k| truth[k][i] - plain[i][k]);
        assert!(did > 0.01, "{effects:?} do next to nothing here: {did}");
        rms(&|i, k| truth[k][i] - run[i][k])
    }

    /// The same for a load on each of two channels, from `load(x)`.
    pub fn load_error(&self, effect: &dyn Effect, values: &[f64], load: impl Fn([f64; 2]) -> [f64; 2]) -> f64 {
        self.error(effect, values, self.start, &[], |_, u, x| {
            let load = load(x);
            (self.base)([u[0] - load[0], u[1] - load[1]], x)
        })
    }

    /// Sign of a speed, smooth within the kink.
    pub fn sign(&self, speed: f64) -> f64 {
        (speed / self.kink).tanh()
    }
}

/// Fourth-order Runge-Kutta with steps of at most 0.2 ms, cut at samples and at `switches`.
pub fn integrate<const N: usize>(
    stretch: &Stretch,
    start: [f64; N],
    switches: &[f64],
    slope: impl Fn(f64, [f64; 2], [f64; N]) -> [f64; N],
) -> Vec<[f64; N]> {
    let (mut x, mut out) = (start, vec![start]);
    for k in 0..stretch.len() - 1 {
        let u = [stretch.inputs[0][k], stretch.inputs[1][k]];
        let mut cuts = vec![stretch.time[k]];
        cuts.extend(switches.iter().filter(|t| **t > stretch.time[k] && **t < stretch.time[k + 1]));
        cuts.push(stretch.time[k + 1]);
        for pair in cuts.windows(2) {
            let n = ((pair[1] - pair[0]) / 2e-4).ceil();
            let h = (pair[1] - pair[0]) / n;
            for i in 0..n as usize {
                // Inside the step, so that no stage meets a switch.
                let at = |share: f64| pair[0] + (i as f64 + share) * h;
                let moved = |k: &[f64; N], f: f64| -> [f64; N] { std::array::from_fn(|j| x[j] + f * h * k[j]) };
                let k1 = slope(at(1e-6), u, x);
                let k2 = slope(at(0.5), u, moved(&k1, 0.5));
                let k3 = slope(at(0.5), u, moved(&k2, 0.5));
                let k4 = slope(at(1.0 - 1e-6), u, moved(&k3, 1.0));
                x = std::array::from_fn(|j| x[j] + h / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j]));
            }
        }
        out.push(x);
    }
    out
}
